"""What a person reads of a plan, before a run or in place of it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from rtsr_cli.commands.log import LOG
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.shared_warnings import list_warnings
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.frames.selection import format_ranges
from rtsr_cli.core.run.events import BETTER, FILTER, FILTER_DOUBT, RunDone, ShotPlanned
from rtsr_cli.core.wording import list_some, say_count, say_verb

MIB = 1 << 20

HELD = "held"

REASONS = {
    "done": "done already",
    "not_selected": "not to be written",
    "missing": "missing",
    HELD: "missing, the frame before stands in",
}
"""How a person reads why frames are not written, or are not themselves."""


def log_plan(plan: ShotPlanned, what: str, *, estimate: bool) -> None:
    """Say what is going to be done to a shot.

    Args:
        plan: of the shot.
        what: said between its frames and its counts.
        estimate: also say what will be read and written, and what is left out.
    """
    LOG.info(
        "%s: layout %s, frames %s%s; %d to write, %d done already",
        plan.reader.frames.root,
        _name_layout(plan.reader),
        format_ranges(plan.selected) or "none",
        what,
        plan.pending,
        len(plan.selected) - plan.pending,
    )
    for detail in (BETTER, FILTER):
        if plan.details.get(detail):
            LOG.info("    %s", plan.details[detail])
    if plan.details.get(FILTER_DOUBT):
        LOG.warning("Warning: %s: %s", plan.reader.frames.root, plan.details[FILTER_DOUBT])
    if HELD in plan.skipped and not estimate:
        LOG.info("    %s: %s", _say_ranges(plan.skipped[HELD]), REASONS[HELD])
    log_files_made_again(plan.damaged, "cut or damaged after writing; made again")
    log_files_made_again(plan.empty, "an empty file; its content is made")
    log_findings(plan.readers)
    if estimate:
        log_estimate(plan)
    log_binding(plan.reader)
    if not plan.selected:
        LOG.warning(
            "%s: nothing selected, its frames are %s",
            plan.reader.frames.root,
            format_ranges(plan.reader.numbers),
        )


def _name_layout(reader: FrameReader) -> str:
    """The layout, and which layer is read of several."""
    layer = f", layer {reader.layer}" if reader.layer and len(reader.layers) > 1 else ""
    return f"{reader.layout.name}{layer}"


def log_files_made_again(paths: Sequence[Path], why: str) -> None:
    """Say which files are there, and not as they were written."""
    if paths:
        more = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
        LOG.warning("Warning: %s%s: %s", paths[0], more, why)


def log_findings(readers: Sequence[FrameReader]) -> None:
    """Say what measurement contradicts, and what it decided; of which size, where only of one."""
    for text in list_warnings(readers):
        LOG.warning("Warning: %s", text)
    for text in dict.fromkeys(text for reader in readers for text in reader.notes):
        holders = [reader.frames.root.name for reader in readers if text in reader.notes]
        size = "" if len(holders) == len(readers) else f"{', '.join(holders)}: "
        LOG.info("    %s%s", size, text)


def log_estimate(plan: ShotPlanned) -> None:
    """Say what a run would read and write, and what it would leave out (`--dry-run`)."""
    LOG.info(
        "    reads %.1f MiB of files, writes at most %.1f MiB (without compression)",
        plan.read_bytes / MIB,
        plan.write_bytes_at_most / MIB,
    )
    for reason, frames in plan.skipped.items():
        LOG.info("    %s: %s", _say_ranges(frames), REASONS[reason])


def _say_ranges(ranges: str) -> str:
    return f"frame{'' if ranges.isdigit() else 's'} {ranges}"


def log_binding(reader: FrameReader) -> None:
    """Say which channel of which file sequence is which buffer (`-v`)."""
    for buffer, bound in reader.binding.items():
        places = ", ".join(f"{c.stream}: {c.channel}" if c.stream else c.channel for c in bound)
        computed = not bound.is_as_stored
        LOG.debug("    %s = %s", buffer, bound.describe(streams=True) if computed else places)


MAX_LISTED = 10
"""Frames that a summary names; the rest is counted."""


def log_pixel_findings(done: RunDone) -> None:
    """Say, by frame, what was repaired, what is below 0, and what half could not hold."""
    if done.repaired:
        LOG.info("repaired %d NaN or Inf in %s", *_count_by_frame(done.repaired))
    if done.negative:
        count, where = _count_by_frame(done.negative)
        LOG.warning(
            "Warning: %s of radiance %s below 0, which no light is, in %s: if that is not meant, "
            "render them again, or clamp the values",
            say_count(count, "value"),
            say_verb(count),
            where,
        )
    if done.as_float:
        LOG.warning(
            "Warning: numbers beyond 65504, or so small that they would be 0, which half cannot "
            "hold: written as float: %s",
            list_some(done.as_float, MAX_LISTED),
        )
    for shot, shares in done.no_material.items():
        LOG.info(
            "%s: %s of the pixels of %s are surfaces whose material does not explain their "
            "radiance, which is enlarged as it is: sound, but softer than the rest%s",
            shot if shot != "." else done.folder,
            _name_share(shares.values()),
            say_frames(shares),
            "".join(
                f"; {cause}: {say_frames(places)} (frame {min(places)}: {places[min(places)]})"
                for cause, places in done.no_material_why.get(shot, {}).items()
            ),
        )


def _name_share(shares: Collection[float]) -> str:
    """The mean of some shares, and the largest where that is another number; a few digits."""
    mean, most = (f"{float(f'{share:.2g}'):g} %" for share in _percentages(shares))
    return mean if mean == most else f"{mean} (at most {most})"


def _percentages(shares: Collection[float]) -> tuple[float, float]:
    return 100.0 * sum(shares) / len(shares), 100.0 * max(shares)


def _count_by_frame(counts: Mapping[str, int]) -> tuple[int, str]:
    """Return the sum, and how many frames of which names it is in."""
    listed = list_some([f"{name}: {count}" for name, count in counts.items()], MAX_LISTED)
    return sum(counts.values()), f"{say_count(len(counts), 'frame')} ({listed})"
