"""Planning a run: what each shot needs, what is done, what is in the way.

An output counts as done if its stamp is that of the present settings and inputs, so that a run
that was cut off, run again, writes what is missing and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.provenance import FileDigests, digest_config
from rtsr_cli.core.frames.selection import Selection, format_ranges
from rtsr_cli.core.frames.sequence import FrameSequence
from rtsr_cli.core.run.events import ShotPlanned, describe_skipped
from rtsr_cli.core.run.outputs import (
    OutputState,
    name_debug_file,
    name_output,
    read_output_state,
    refuse_foreign,
    refuse_inputs,
)
from rtsr_cli.core.run.shot_inputs import NO_HISTORY, HistoryReach, ShotInputs
from rtsr_cli.core.run.stamps import Stamps


@dataclass(frozen=True, kw_only=True)
class FrameOutputs:
    """What a run writes of a frame.

    Attributes:
        folder: of the shot's outputs.
        command: that writes them, as users type it.
        pictures: suffixes of the PNGs beside each EXR; a frame that lacks one is not done.
        debug: whether an EXR of what was seen and decided goes along.
        frame_bytes: size of a frame at most, without compression and debug files.
    """

    folder: Path
    command: str
    pictures: tuple[str, ...] = ()
    debug: bool = False
    frame_bytes: int = 0


@dataclass(frozen=True, kw_only=True)
class ShotPlan:
    """One shot, checked and ready.

    Attributes:
        inputs: what is read.
        outputs: what is written.
        sequence: order of the frames, and resets of history.
        selected: numbers whose outputs are asked for.
        pending: those that are not done yet.
        order: numbers to process: pending ones, and the history they need.
        paths: number -> the output that is asked for.
        stamps: of the outputs.
    """

    inputs: ShotInputs
    outputs: FrameOutputs
    sequence: FrameSequence
    selected: tuple[int, ...]
    pending: frozenset[int]
    order: tuple[int, ...]
    paths: Mapping[int, Path]
    stamps: Stamps

    def path(self, number: int) -> Path:
        """Return the output of a frame, asked for or not."""
        known = self.paths.get(number)
        return known or self.outputs.folder / name_output(self.inputs.reader, number)

    @property
    def digests(self) -> FileDigests:
        """Of the input files."""
        return self.stamps.digests

    def announcement(self, details: Mapping[str, Any]) -> ShotPlanned:
        """Say what is going to be done; `details` are those of the kind of run."""
        read = (path for n in self.order for path in self.inputs.files(n))
        return ShotPlanned(
            shot=self.inputs.name,
            reader=self.inputs.reader,
            readers=self.inputs.readers,
            selected=self.selected,
            pending=len(self.pending),
            skipped=describe_skipped(self.inputs.reader, self.selected, self.pending),
            read_bytes=self.digests.bytes_of(read),
            write_bytes_at_most=len(self.pending) * self.outputs.frame_bytes,
            details=details,
        )


def plan_shot(
    inputs: ShotInputs,
    outputs: FrameOutputs,
    *,
    settings: object,
    selection: Selection,
    overwrite: bool,
    history: HistoryReach = NO_HISTORY,
) -> ShotPlan:
    """Find out what is left to do of one shot.

    Args:
        inputs: what is read.
        outputs: what is written.
        settings: plain values that, beside the inputs' bytes, decide the outputs' bytes.
        selection: frames that are asked for.
        overwrite: replace files that are stale or foreign.
        history: how far an output looks back.

    Raises:
        RtsrError: an output is in the way; nothing has been computed.
    """
    reader = inputs.reader
    sequence = FrameSequence(numbers=reader.numbers, step=reader.step, cuts=reader.resets)
    selected = selection.of(reader.numbers)
    stamps = Stamps(
        inputs=inputs,
        digests=FileDigests(),
        numbers=reader.numbers,
        starts=_find_starts(sequence, history, selected, sharded=selection.shard is not None),
        config_hash=digest_config(outputs.command, settings, reader.declaration),
    )
    plan = ShotPlan(
        inputs=inputs,
        outputs=outputs,
        sequence=sequence,
        selected=selected,
        pending=frozenset(selected),
        order=(),
        paths={n: outputs.folder / name_output(reader, n) for n in selected},
        stamps=stamps,
    )
    refuse_inputs(list(plan.paths.values()), inputs.readers)
    pending = _find_pending(plan, overwrite=overwrite)
    plan = replace(plan, pending=pending, order=_order_numbers(sequence, stamps.starts, pending))
    for number in plan.order:
        plan.digests.note(inputs.files(number))
    return plan


def _find_pending(plan: ShotPlan, *, overwrite: bool) -> frozenset[int]:
    """Frames that are not done; refuses outputs of others, unless they may be replaced."""
    states = {n: _read_state(plan, n) for n in plan.selected}
    if not overwrite:
        foreign = [plan.paths[n] for n, state in states.items() if state is OutputState.FOREIGN]
        refuse_foreign(foreign, f"rtsr {plan.outputs.command}")
    return frozenset(n for n, state in states.items() if state is not OutputState.DONE)


def _read_state(plan: ShotPlan, number: int) -> OutputState:
    """State of an output; its inputs are hashed only where a file is there."""
    path = plan.paths[number]
    if not path.exists():
        return OutputState.ABSENT
    stamp = plan.stamps.of_output(number)
    state = read_output_state(path, stamp)
    outputs = plan.outputs
    lacks_picture = not all(path.with_suffix(suffix).exists() for suffix in outputs.pictures)
    lacks_debug = outputs.debug and read_output_state(name_debug_file(path), stamp) is not state
    incomplete = state is OutputState.DONE and (lacks_picture or lacks_debug)
    return OutputState.ABSENT if incomplete else state


def _find_starts(
    sequence: FrameSequence, history: HistoryReach, selected: Sequence[int], *, sharded: bool
) -> dict[int, int]:
    """For each selected number the first one whose input its output depends on."""
    starts: dict[int, int] = {}
    chosen = set(selected)
    first = min(chosen, default=0)
    for run in sequence.runs():
        begin = next((i for i, number in enumerate(run) if number == first), 0)
        for position, number in enumerate(run):
            if number not in chosen:
                continue
            reach = position if history.recurrent else history.frames
            if history.recurrent and sharded:
                reach = min(reach, position - begin + history.preroll_frames)
            starts[number] = run[max(0, position - reach)]
    return starts


def _order_numbers(
    sequence: FrameSequence, starts: Mapping[int, int], pending: frozenset[int]
) -> tuple[int, ...]:
    """Numbers to process: the pending ones, and those that their outputs depend on."""
    order: list[int] = []
    for run in sequence.runs():
        position = {number: i for i, number in enumerate(run)}
        done = 0
        for number in (n for n in run if n in pending):
            # starts grow with the numbers, so that what is before `done` is in the order already
            begin = max(done, position[starts[number]])
            order += run[begin : position[number] + 1]
            done = position[number] + 1
    return tuple(order)


def check_selection(selection: Selection, inputs: Iterable[ShotInputs]) -> None:
    """Refuse `--frames` that select nothing of any shot.

    Raises:
        FrameFolderError: names the numbers that there are.
    """
    readers = [shot.reader for shot in inputs]
    wanted = selection.frames
    if wanted is not None and not any(wanted & set(reader.numbers) for reader in readers):
        there = "; ".join(f"{r.frames.root} has {format_ranges(r.numbers)}" for r in readers)
        raise FrameFolderError(f"--frames {format_ranges(wanted)} selects nothing: {there}")
