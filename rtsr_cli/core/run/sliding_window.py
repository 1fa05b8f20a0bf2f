"""The window of frames that a system sees, kept while a shot is gone through in order."""

from __future__ import annotations

from collections import deque

from rtsr_cli.core.frames.sequence import Frame, FrameSequence
from rtsr_cli.core.pairs.sources import FramePair
from rtsr_cli.core.pairs.window import join_window
from rtsr_cli.core.system import FrameWindow


class SlidingWindow:
    """The last LR frames of a shot, as far as they are history of the present one."""

    def __init__(self, sequence: FrameSequence, *, history_frames: int, scale: int) -> None:
        """Start without any.

        Args:
            sequence: order of the frames, and resets of history.
            history_frames: predecessors that are kept.
            scale: output pixels per LR pixel.
        """
        self._sequence = sequence
        self._history, self._scale = history_frames, scale
        self._lr: deque[Frame] = deque(maxlen=history_frames + 1)
        self._previous: int | None = None

    def forget(self) -> None:
        """Let the next frame be one without history."""
        self._lr.clear()
        self._previous = None

    def follows(self, number: int) -> bool:
        """Tell whether what is remembered is history of frame `number`."""
        return self._sequence.follows(number, self._previous)

    def slide(self, pair: FramePair) -> FrameWindow:
        """Take in the next frame; what is no history of it is forgotten."""
        if not self.follows(pair.lr.number):
            self.forget()
        self._lr.appendleft(pair.lr)
        self._previous = pair.lr.number
        return join_window(self._lr, pair.hr, scale=self._scale, history=self._history)
