"""What a run reads of a shot, and how far its outputs look back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.captures.reader import FrameReader


@dataclass(frozen=True, kw_only=True)
class ShotInputs:
    """What a run reads of a shot.

    Attributes:
        name: of the shot, relative to IN.
        reader: names and numbers the outputs.
        readers: every reader behind the shot.
        files: number -> every file that is read for that frame.
    """

    name: str
    reader: FrameReader
    readers: tuple[FrameReader, ...]
    files: Callable[[int], tuple[Path, ...]]


@dataclass(frozen=True, kw_only=True)
class HistoryReach:
    """How far an output looks back.

    Attributes:
        frames: predecessors that it depends on.
        recurrent: True if it depends on every frame since the last reset.
        preroll_frames: of a recurrent run, frames that a shard replays before its first output.
    """

    frames: int = 0
    recurrent: bool = False
    preroll_frames: int = 0


NO_HISTORY = HistoryReach()
"""Of outputs that depend on their own frame alone."""
