"""What commands that read frames share after parsing; imported when they run, as it needs torch."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, Protocol, TypeVar

from rtsr_cli.commands.basics import LOG
from rtsr_cli.commands.options import emit
from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.errors import FrameFolderError, OutputBlockedError
from rtsr_cli.core.io.opening import ReadOptions
from rtsr_cli.core.io.reading import FrameReader
from rtsr_cli.core.io.selection import Selection, Shard, ranges

MIB = 1 << 20
MAX_LISTED = 10
"""Frames that a summary names; the rest is counted."""

FAILED = 1
"""Exit code where some frames failed and the rest are done."""


class Event(Protocol):
    """What became of a frame."""

    @property
    def stops(self) -> bool:
        """True if no other frame could be written either."""


E = TypeVar("E", bound=Event)


def read_options(chosen: Mapping[str, Any]) -> ReadOptions:
    """Options of `reads_frames` as the library takes them."""
    return ReadOptions(
        layout=chosen["layout"],
        capture=chosen["capture_file"],
        on_missing=MissingPolicy(chosen["on_missing"]),
        output=chosen["out_folder"],
        sharded=chosen["shard"] is not None,
    )


def selection(chosen: Mapping[str, Any]) -> Selection:
    """`--frames` and `--shard`."""
    part = chosen["shard"]
    return Selection(
        frames=chosen["frames"], shard=Shard(index=part[0], count=part[1]) if part else None
    )


def check_frames(chosen: Mapping[str, Any], readers: Sequence[FrameReader]) -> None:
    """Refuse `--frames` that select nothing of any shot.

    Raises:
        FrameFolderError: names the numbers that there are.
    """
    wanted = chosen["frames"]
    if wanted is not None and not any(wanted & set(reader.numbers) for reader in readers):
        there = "; ".join(f"{r.frames.root} has {ranges(r.numbers)}" for r in readers)
        raise FrameFolderError(f"--frames {ranges(wanted)} selects nothing: {there}")


def warn_if_nothing(reader: FrameReader, selected: Sequence[int]) -> None:
    """Say so where `--frames` and `--shard` leave nothing of a shot; farms may overshoot."""
    if not selected:
        LOG.warning(
            "%s: nothing selected, its frames are %s", reader.frames.root, ranges(reader.numbers)
        )


def plan_facts(
    name: str,
    readers: Sequence[FrameReader],
    selected: Sequence[int],
    pending: Collection[int],
) -> dict[str, Any]:
    """What every plan says; the first reader names and numbers the outputs."""
    return {
        "shot": name,
        "layout": readers[0].layout.name,
        "frames": len(selected),
        "pending": len(pending),
        "skipped": skipped(readers[0], selected, pending),
        "warnings": [text for reader in readers for text in reader.warnings],
        "notes": [text for reader in readers for text in reader.notes],
    }


def announce(
    chosen: Mapping[str, Any],
    facts: Mapping[str, Any],
    readers: Sequence[FrameReader],
    selected: Sequence[int],
    what: str = "",
) -> None:
    """Say what is going to be done to a shot; `what` is said between its frames and its counts."""
    if chosen["as_json"]:
        emit({"event": "plan", **facts})
        return
    main = readers[0]
    LOG.info(
        "%s: layout %s, frames %s%s; %d to write, %d done already",
        main.frames.root,
        main.layout.name,
        ranges(selected) or "none",
        what,
        facts["pending"],
        facts["frames"] - facts["pending"],
    )
    for reader in readers:
        log_findings(reader)
    if chosen["dry_run"]:
        log_estimate(facts)
    log_binding(main)
    warn_if_nothing(main, selected)


def until_stopped(runs: Iterable[Iterator[E]]) -> Iterator[E]:
    """Go through the events of one shot after the other, up to the one that stops them all."""
    for run in runs:
        for event in run:
            yield event
            if event.stops:
                return


def log_findings(reader: FrameReader) -> None:
    """Say what measurement contradicts, and what it decided."""
    for text in reader.warnings:
        LOG.warning("Warning: %s: %s", reader.frames.root, text)
    for text in reader.notes:
        LOG.info("    %s", text)


def skipped(
    reader: FrameReader, selected: Sequence[int], pending: Collection[int]
) -> dict[str, str]:
    """Say which frames of a shot are not written, or are not themselves, and why; as ranges."""
    there = set(reader.frames.numbers)
    expected = there | set(range(min(there), max(there) + 1, reader.step))
    reasons = {
        "done": set(selected) - set(pending),
        "not_selected": set(reader.numbers) - set(selected),
        "missing": expected - set(reader.numbers),
        "held": set(reader.held) & set(selected),
    }
    return {reason: ranges(numbers) for reason, numbers in reasons.items() if numbers}


REASONS = {
    "done": "done already",
    "not_selected": "not selected",
    "missing": "missing",
    "held": "missing, the frame before stands in",
}
"""How a person reads the reasons of `skipped`."""


def log_estimate(facts: Mapping[str, Any]) -> None:
    """Say what a run would read and write, and what it would leave out (`--dry-run`)."""
    LOG.info(
        "    reads %.1f MiB of files, writes at most %.1f MiB (without compression)",
        facts["read_bytes"] / MIB,
        facts["write_bytes_at_most"] / MIB,
    )
    for reason, frames in facts["skipped"].items():
        LOG.info("    frames %s: %s", frames, REASONS[reason])


def log_repairs(repaired: Mapping[str, int]) -> None:
    """Say how many NaN and Inf were repaired, by frame."""
    if not repaired:
        return
    listed = [f"{name}: {count}" for name, count in repaired.items()]
    more = f" and {len(listed) - MAX_LISTED} more" if len(listed) > MAX_LISTED else ""
    LOG.info(
        "repaired %d NaN or Inf in %d frames (%s%s)",
        sum(repaired.values()),
        len(repaired),
        ", ".join(listed[:MAX_LISTED]),
        more,
    )


def stopped(message: str, done: int, planned: int) -> OutputBlockedError:
    """Return the error of a run that ended because nothing can be written, and how to go on."""
    return OutputBlockedError(
        f"{message}. {done} of {planned} frames are done; the same command writes the rest then"
    )


def log_binding(reader: FrameReader) -> None:
    """Say which channel of which file sequence is which buffer (`-v`)."""
    for buffer, components in reader.binding.items():
        places = ", ".join(
            f"{c.stream}: {c.channel}" if c.stream else c.channel for c in components
        )
        LOG.debug("    %s = %s", buffer, places)
