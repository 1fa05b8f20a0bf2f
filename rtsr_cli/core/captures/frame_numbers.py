"""Which frames of a sequence there are, which are missing, and what stands in for them."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Collection, Sequence

from rtsr_cli.core.captures.shots import FrameSet
from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.gaps import count_gaps, format_gaps, list_gaps
from rtsr_cli.core.frames.selection import format_ranges

MOST_HELD, HELD_A_FRAME = 10_000, 100
"""Frames that may be stood in for: so many, or so many a frame that is there."""


def choose_numbers(
    frames: FrameSet,
    used: list[str],
    step: int,
    policy: MissingPolicy,
    *,
    wanted: frozenset[int] | None = None,
    partial: frozenset[str] = frozenset(),
    left_out: Collection[int] = (),
) -> tuple[tuple[int, ...], dict[int, int]]:
    """Frames that every used stream has, and stand-ins for the others where they are held.

    Args:
        frames: the files.
        used: streams whose files make a frame.
        step: of the numbering.
        policy: what is done about frames that are missing.
        wanted: frames that are asked for: what is missing before and behind them is no matter.
        partial: streams that may lack frames.
        left_out: frames whose files are there, and not among these: others stand in for them, too.

    Raises:
        FrameFolderError: frames are missing, or more than can be held.
    """
    needed = [key for key in used if key not in partial]
    complete = frozenset.intersection(*(frozenset(frames.streams[key].files) for key in needed))
    missing = list_missing_frames(frames, used, step)
    missing = {key: gaps for key, gaps in missing.items() if key not in partial}
    missing = {key: within for key, gaps in missing.items() if (within := _cut_gaps(gaps, wanted))}
    if missing and policy is MissingPolicy.ERROR:
        listed = "; ".join(f"'{key}' lacks {format_gaps(gaps)}" for key, gaps in missing.items())
        raise FrameFolderError(
            f"{frames.root}: frames are missing: {listed}. Render them, or use --on-missing "
            "skip|hold (history restarts there); dumps numbered in steps declare frame_step"
        )
    if not complete:
        listed = "; ".join(
            f"'{key}' has {format_ranges(frames.streams[key].files)}" for key in used
        )
        raise FrameFolderError(f"{frames.root}: no frame has all of its files: {listed}")
    held: dict[int, int] = {}
    if policy is MissingPolicy.HOLD:
        known = _list_known(frames, used).union(left_out)
        held = _hold_frames(frames, sorted(complete), known, step)
    return tuple(sorted(complete | set(held))), held


def _cut_gaps(gaps: Sequence[range], wanted: frozenset[int] | None) -> list[range]:
    """What of gaps lies between the first and the last of some numbers."""
    if not wanted:
        return list(gaps)
    first, last = min(wanted), max(wanted)
    cut = (
        range(
            max(gap.start, gap.start - (gap.start - first) // gap.step * gap.step),
            min(gap.stop, last + 1),
            gap.step,
        )
        for gap in gaps
    )
    return [gap for gap in cut if gap]


def _hold_frames(
    frames: FrameSet, complete: Sequence[int], known: Collection[int], step: int
) -> dict[int, int]:
    """Stand-ins for the frames that are not complete: for each the last one before it that is."""
    gaps = list_gaps(complete, known, step)
    if count_gaps(gaps) > max(MOST_HELD, HELD_A_FRAME * len(complete)):
        raise FrameFolderError(
            f"{frames.root}: frames {format_gaps(gaps)} are missing, more than can be held; move "
            "stray files out of the folder, or use --on-missing skip"
        )
    numbers = (number for gap in gaps for number in gap)
    places = ((number, bisect(complete, number)) for number in numbers)
    return {number: complete[place - 1] for number, place in places if place}


def _list_known(frames: FrameSet, used: Collection[str]) -> set[int]:
    """Numbers that any of the streams has."""
    return {number for key in used for number in frames.streams[key].files}


def list_missing_frames(
    frames: FrameSet, used: Collection[str], step: int
) -> dict[str, list[range]]:
    """For each of the streams the numbers that it lacks; streams that lack none are left out."""
    known = _list_known(frames, used)
    lacking = {key: list_gaps(frames.streams[key].files, known, step) for key in used}
    return {key: gaps for key, gaps in lacking.items() if gaps}
