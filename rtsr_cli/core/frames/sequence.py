"""Frames in order: one frame, and a lazy sequence of them that does no input or output itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import torch

from rtsr_cli.core.frames.buffers import GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.shapes import Color, Size


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One moment at one resolution; low and high resolution are two frames.

    Attributes:
        number: frame number of the files.
        gbuffer: the buffers.
        camera: matrices, jitter (pixels of this frame's resolution), exposure.
        view: which part of the image plane the buffers show.
        lighting_scale: k of the whole frame, `exp(mean(log(lighting + 1e-3)))` over divided
            pixels; 1 where there is no lighting. Crops and tiles keep the frame's value.
        beside: further radiance of the moment by name, at a reduced rate for example; there where
            it is what training compares with.
    """

    number: int
    gbuffer: GBuffer
    camera: CameraMetadata
    view: View
    lighting_scale: float = 1.0
    beside: Mapping[str, Color] = field(default_factory=dict)

    @property
    def size(self) -> Size:
        """(height, width) of the buffers."""
        return self.gbuffer.size

    def crop(self, top: int, left: int, size: Size) -> Frame:
        """Return a window of the frame; camera and lighting scale stay the whole frame's."""
        view = replace(self.view, top=self.view.top + top, left=self.view.left + left)
        return replace(self, gbuffer=self.gbuffer.crop(top, left, size), view=view)

    def to(self, device: torch.device | str) -> Frame:
        """Return the same frame on another device."""
        return replace(self, gbuffer=self.gbuffer.to(device))


@dataclass(frozen=True)
class FrameSequence:
    """Frames of one resolution, loaded when asked for, in the order of their numbers.

    Attributes:
        numbers: the frame numbers, ascending.
        load_frame: loads one frame by number; given by whoever knows the files.
        step: difference of two numbers that one motion vector spans.
        cuts: numbers before which history ends.
    """

    numbers: Sequence[int]
    load_frame: Callable[[int], Frame]
    step: int = 1
    cuts: frozenset[int] = frozenset()

    @cached_property
    def _known(self) -> frozenset[int]:
        return frozenset(self.numbers)

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.numbers)

    def __getitem__(self, index: int) -> Frame:
        """Load the frame at a position of the sequence."""
        return self.load_frame(self.numbers[index])

    def follows(self, number: int, previous: int | None) -> bool:
        """Tell whether history of `previous` is valid for `number`: adjacent, and no cut."""
        return previous is not None and number - previous == self.step and number not in self.cuts

    def window_numbers(self, number: int, history: int) -> tuple[int, ...]:
        """Return `number` and up to `history` predecessors, newest first, ending at a reset."""
        window = [number]
        while len(window) <= history and window[-1] not in self.cuts:
            previous = window[-1] - self.step
            if previous not in self._known:
                break
            window.append(previous)
        return tuple(window)

    def runs(self) -> list[tuple[int, ...]]:
        """Split the numbers where temporal history resets."""
        runs: list[list[int]] = []
        previous: int | None = None
        for number in self.numbers:
            if not runs or not self.follows(number, previous):
                runs.append([])
            runs[-1].append(number)
            previous = number
        return [tuple(run) for run in runs]

    def select(self, numbers: Iterable[int]) -> FrameSequence:
        """Return the sequence of those numbers that are there."""
        wanted = set(numbers)
        return replace(self, numbers=tuple(n for n in self.numbers if n in wanted))
