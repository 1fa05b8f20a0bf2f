"""What every run over folders of frames is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.choices import MissingPolicy, NonfinitePolicy
from rtsr_cli.core.frames.selection import Selection, Shard
from rtsr_cli.core.requests import MOST_JOBS, accept_words, check_ranges, check_shard


@dataclass(frozen=True, kw_only=True)
class FramesRequest:
    """Frames of IN, and what becomes of them in OUT.

    Attributes:
        in_folder: a shot, or a tree of shots.
        out_folder: outputs go here, in folders like IN's.
        layout: preset or layout file; None = detected.
        layer: layer or stereo view that is read of files with several.
        view: stereo view that is read, of that layer if one is named.
        capture_file: declarations in place of each shot's capture.toml.
        frames: numbers of the outputs that are asked for; None = all. History reads the others.
        shard: part i of n of each shot, (i, n) counted from 1; None = all.
        jobs: threads that read, and threads that write.
        on_missing: what holes in the numbering mean.
        on_nonfinite: what NaN and Inf in an input mean.
        overwrite: replace files that are stale or not rtsr's.
        dry_run: plan and check, write nothing.
    """

    in_folder: Path
    out_folder: Path
    layout: str | None = None
    layer: str | None = None
    view: str | None = None
    capture_file: Path | None = None
    frames: frozenset[int] | None = None
    shard: tuple[int, int] | None = None
    jobs: int = 2
    on_missing: MissingPolicy = MissingPolicy.ERROR
    on_nonfinite: NonfinitePolicy = NonfinitePolicy.ERROR
    overwrite: bool = False
    dry_run: bool = False

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            RequestError: one is not among those that it may be.
        """
        accept_words(self)
        check_ranges(self, jobs=(1, MOST_JOBS))
        check_shard(self.shard)

    @property
    def selection(self) -> Selection:
        """Which frames of a shot are written."""
        part = self.shard
        return Selection(
            frames=self.frames,
            shard=None if part is None else Shard(index=part[0], count=part[1]),
        )
