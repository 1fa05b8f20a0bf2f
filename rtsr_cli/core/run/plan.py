"""Planning a run: what each shot needs, what is done, what is in the way.

An output counts as done if its stamp is that of the present settings and inputs, so that a run
that was cut off, run again, writes what is missing and nothing else.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.atomic_write import check_names
from rtsr_cli.core.files.ownership import refuse_foreign
from rtsr_cli.core.files.provenance import FileDigests, digest_config
from rtsr_cli.core.frames.selection import Selection, format_ranges
from rtsr_cli.core.frames.sequence import FrameSequence
from rtsr_cli.core.run.events import ShotPlanned, describe_skipped
from rtsr_cli.core.run.outputs import (
    OutputState,
    find_output,
    name_debug_file,
    read_debug_state,
    read_output_state,
    read_picture_state,
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
        damaged: files of theirs that were cut or damaged after they were written.
        empty: files in their places that hold nothing.
        order: numbers to process: pending ones, and the history they need.
        paths: number -> the output that is asked for.
        stamps: of the outputs.
    """

    inputs: ShotInputs
    outputs: FrameOutputs
    sequence: FrameSequence
    selected: tuple[int, ...]
    pending: frozenset[int]
    damaged: tuple[Path, ...] = ()
    empty: tuple[Path, ...] = ()
    order: tuple[int, ...]
    paths: Mapping[int, Path]
    stamps: Stamps

    def path(self, number: int) -> Path:
        """Return the output of a frame, asked for or not."""
        known = self.paths.get(number)
        return known or find_output(self.outputs.folder, self.inputs.reader, number)

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
            damaged=self.damaged,
            empty=self.empty,
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
    outputs_of: Collection[int] | None = None,
) -> ShotPlan:
    """Find out what is left to do of one shot.

    Args:
        inputs: what is read.
        outputs: what is written.
        settings: plain values that, beside the inputs' bytes, decide the outputs' bytes.
        selection: frames that are asked for.
        overwrite: replace files that are stale or foreign.
        history: how far an output looks back.
        outputs_of: frames that have outputs at all; None = every frame.

    Raises:
        RtsrError: an output is in the way; nothing has been computed.
    """
    reader = inputs.reader
    sequence = FrameSequence(numbers=reader.numbers, step=reader.step, cuts=reader.resets)
    made = reader.numbers if outputs_of is None else outputs_of
    selected = tuple(n for n in selection.of(reader.numbers) if n in made)
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
        paths={n: find_output(outputs.folder, reader, n) for n in selected},
        stamps=stamps,
    )
    refuse_inputs(list(plan.paths.values()), inputs.readers)
    if outputs.debug:
        refuse_inputs([name_debug_file(path) for path in plan.paths.values()], inputs.readers)
    check_names(path for n in plan.selected for path in _list_files(plan, n))
    plan = _find_pending(plan, overwrite=overwrite)
    plan = replace(plan, order=_order_numbers(sequence, stamps.starts, plan.pending))
    for number in plan.order:
        plan.digests.note(inputs.files(number))
    return plan


def _list_files(plan: ShotPlan, number: int) -> tuple[Path, ...]:
    """Files that a run writes of a frame, those of its debug folder left out."""
    path = plan.paths[number]
    return (path, *(path.with_suffix(suffix) for suffix in plan.outputs.pictures))


def _find_pending(plan: ShotPlan, *, overwrite: bool) -> ShotPlan:
    """Add the frames that are not done, and the damaged and the empty files among theirs.

    Raises:
        OutputError: files of others are there, unless they may be replaced.
    """
    states = {n: _read_states(plan, n) for n in plan.selected}

    def find_files(wanted: OutputState) -> tuple[Path, ...]:
        pairs = (pair for frame in states.values() for pair in frame.items())
        return tuple(path for path, state in pairs if state is wanted)

    if not overwrite:
        refuse_foreign(find_files(OutputState.FOREIGN), f"rtsr {plan.outputs.command}")
    unfinished = {n for n, frame in states.items() if {*frame.values()} != {OutputState.DONE}}
    return replace(
        plan,
        pending=frozenset(unfinished),
        damaged=find_files(OutputState.DAMAGED),
        empty=find_files(OutputState.EMPTY),
    )


def _read_states(plan: ShotPlan, number: int) -> dict[Path, OutputState]:
    """State of each file of a frame; its inputs are hashed only where one of EXR is there."""
    path, outputs = plan.paths[number], plan.outputs
    states = {}
    if not os.path.lexists(path):
        states[path] = OutputState.ABSENT
    else:
        states[path] = read_output_state(path, plan.stamps.of_output(number))
    for suffix in outputs.pictures:
        picture = path.with_suffix(suffix)
        states[picture] = read_picture_state(picture)
    debug = name_debug_file(path)
    if outputs.debug and os.path.lexists(debug):
        states[debug] = read_debug_state(debug, plan.stamps.of_output(number))
    elif outputs.debug:
        states[debug] = OutputState.ABSENT
    return states


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
