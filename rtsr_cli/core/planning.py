"""Planning an upscaling run: what each shot needs, what is done, what is in the way.

An output counts as done if its stamp is that of the present config and inputs, so that a run
that was cut off, run again, writes what is missing and nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from rtsr_cli.core.choices import Precision
from rtsr_cli.core.errors import FrameFolderError, RtsrError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import FrameSequence
from rtsr_cli.core.io.outputs import (
    FLOAT_BYTES,
    HALF_BYTES,
    HEADER_BYTES,
    OutputState,
    debug_path,
    output_name,
    output_state,
    refuse_foreign,
    refuse_inputs,
)
from rtsr_cli.core.io.pairs import DECLARED_MOTION, Inputs, PairSource
from rtsr_cli.core.io.passing import Passed, find_passed
from rtsr_cli.core.io.provenance import FileDigests, config_digest, digest
from rtsr_cli.core.io.reading import FrameReader
from rtsr_cli.core.io.selection import Selection
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.system import System, Task

UNREADABLE = "unreadable"
"""Stands in the stamps for the content of a file that could not be read."""


@dataclass(frozen=True, kw_only=True)
class UpscaleOptions:
    """How to run.

    Attributes:
        device: torch device.
        precision: of network layers.
        jobs: threads that read, and threads that write.
        tile: side of tiles in LR pixels; 0 = never, None = by the frame's size.
        overwrite: replace files that are stale or foreign.
        pictures: suffixes of the PNGs beside each EXR; a frame that lacks one is not done.
        debug: EXR of what the system saw and decided.
        selection: which frames are written.
        command: that runs.
    """

    device: str = "cpu"
    precision: Precision = Precision.FP32
    jobs: int = 2
    tile: int | None = None
    overwrite: bool = False
    pictures: tuple[str, ...] = ()
    debug: bool = False
    selection: Selection = field(default_factory=Selection)
    command: str = "upscale"


@dataclass(frozen=True, kw_only=True)
class ShotPlan:
    """One shot, checked and ready.

    Attributes:
        name: path relative to IN.
        system: what runs on it.
        source: where frames come from.
        sequence: their order and resets.
        inputs: what the system reads.
        folder: where outputs go.
        selected: numbers whose outputs are asked for.
        pending: those that are not done yet.
        order: numbers to process, pending ones and the history they need.
        config_hash: of system, config, weights and everything that was declared or chosen.
        starts: for each selected number the first one whose input its output depends on.
        digests: of the input files.
        passed: channels that are only handed through.
    """

    name: str
    system: System
    source: PairSource
    sequence: FrameSequence
    inputs: Inputs
    folder: Path
    selected: tuple[int, ...]
    pending: frozenset[int]
    order: tuple[int, ...]
    config_hash: str
    starts: Mapping[int, int]
    digests: FileDigests
    passed: tuple[Passed, ...] = ()

    def path(self, number: int) -> Path:
        """Return the output of a frame."""
        return self.folder / output_name(self.source.reader, number)

    def files(self, number: int) -> tuple[Path, ...]:
        """Every file that is read for a frame."""
        passed = (path for part in self.passed for path in part.files(number))
        return tuple(dict.fromkeys((*self.source.files(number, self.inputs), *passed)))

    @property
    def output_size(self) -> Size:
        """(height, width) of the outputs."""
        height, width = self.source.lr_size
        return height * self.source.scale, width * self.source.scale

    @property
    def read_bytes(self) -> int:
        """Size of the files that the run will read, history included."""
        return self.digests.bytes_of(path for n in self.order for path in self.files(n))

    def write_bytes(self, options: UpscaleOptions) -> int:
        """Return what the run writes at most without debug files: pixels without compression."""
        height, width = self.output_size
        layers = len("RGBA" if Buffer.ALPHA in self.source.reader.stored else "RGB")
        passed = sum(len(part.channels) for part in self.passed)
        picture = len("RGB") * len(options.pictures)
        a_pixel = layers * HALF_BYTES + passed * FLOAT_BYTES + picture
        return len(self.pending) * (height * width * a_pixel + HEADER_BYTES)


def system_inputs(system: System, base: Inputs, config: object = None) -> Inputs:
    """Return what to read for a system; alpha goes along where there is one.

    Args:
        system: whose inputs they are.
        base: how bad pixels are treated.
        config: of the system, its defaults if None.
    """
    return replace(
        base,
        lr=system.lr_inputs,
        hr=system.hr_inputs,
        lr_optional=(*system.lr_optional, Buffer.ALPHA),
        hr_optional=system.hr_optional,
        derivation=system.derivation(config or system.config()),
    )


def check_system(system: System, source: PairSource, inputs: Inputs) -> None:
    """Raise if a shot cannot feed a system.

    Raises:
        FrameFolderError: names the folder, what is missing and what would help.
    """
    root = source.reader.frames.root
    missing = source.missing(inputs)
    if DECLARED_MOTION in missing:
        undecided = source.reader.motion_undecided
        raise FrameFolderError(f"{root}: system '{system.name}' reads motion, but {undecided}")
    if missing:
        other = ", or choose another --system" if system.task is Task.UPSCALE else ""
        raise FrameFolderError(
            f"{root}: system '{system.name}' cannot run, missing: {', '.join(missing)}. "
            f"{'; '.join(_found(reader) for reader in source.readers)}. Render what is missing, "
            f"declare it in capture.toml{other}"
        )
    if system.scales and source.scale not in system.scales:
        made_for = ", ".join(f"{s}x" for s in system.scales)
        raise FrameFolderError(
            f"{root}: system '{system.name}' is made for {made_for}, not {source.scale}x"
        )


def _found(reader: FrameReader) -> str:
    held = ", ".join(sorted(reader.stored))
    camera = ", camera" if reader.has_camera else ""
    return f"{reader.frames.root} (layout '{reader.layout.name}') has: {held}{camera}"


def plan_shot(
    name: str,
    source: PairSource,
    system: System,
    *,
    inputs: Inputs,
    folder: Path,
    options: UpscaleOptions,
    config: object,
    passthrough: Sequence[str] = (),
    beside: Sequence[Passed] = (),
) -> ShotPlan:
    """Check one shot and find out what is left to do.

    Args:
        name: path relative to IN.
        source: frames.
        system: what to run.
        inputs: from `system_inputs`.
        folder: where outputs go.
        options: how to run.
        config: plain values that, beside the inputs' bytes, decide the outputs' bytes.
        passthrough: patterns of channels that are handed through.
        beside: channels of other files that are handed through.

    Raises:
        RtsrError: an input is missing, an output is in the way; nothing has been computed.
    """
    check_system(system, source, inputs)
    reader = source.reader
    sequence = FrameSequence(
        numbers=reader.numbers,
        load_frame=lambda number: source.load(number, inputs).lr,
        step=reader.step,
        cuts=reader.resets,
    )
    selected = options.selection.of(reader.numbers)
    plan = ShotPlan(
        name=name,
        system=system,
        source=source,
        sequence=sequence,
        inputs=inputs,
        folder=folder,
        selected=selected,
        pending=frozenset(selected),
        order=(),
        config_hash=config_digest(system.name, config, reader.declaration, source.scale),
        starts=_starts(sequence, system, selected, sharded=options.selection.shard is not None),
        digests=FileDigests(),
        passed=(*find_passed(source, passthrough), *beside),
    )
    refuse_inputs([plan.path(n) for n in selected], source.readers)
    states = _states(plan, options)
    if not options.overwrite:
        refuse_foreign(
            [plan.path(n) for n, state in states.items() if state is OutputState.FOREIGN],
            f"rtsr {options.command}",
        )
    pending = frozenset(n for n, state in states.items() if state is not OutputState.DONE)
    plan = replace(plan, pending=pending, order=_order(plan, pending))
    for number in plan.order:
        plan.digests.note(plan.files(number))
    return plan


def _states(plan: ShotPlan, options: UpscaleOptions) -> dict[int, OutputState]:
    """State of every selected output; inputs are hashed only where an output is there."""
    states: dict[int, OutputState] = {}
    stamps = Stamps(plan)
    for number in plan.selected:
        path = plan.path(number)
        if not path.exists():
            states[number] = OutputState.ABSENT
            continue
        stamp = stamps.of(number)
        state = output_state(path, stamp)
        lacks_picture = not all(path.with_suffix(suffix).exists() for suffix in options.pictures)
        lacks_debug = options.debug and output_state(debug_path(path), stamp) is not state
        absent = state is OutputState.DONE and (lacks_picture or lacks_debug)
        states[number] = OutputState.ABSENT if absent else state
    return states


def _starts(
    sequence: FrameSequence, system: System, selected: Sequence[int], *, sharded: bool
) -> dict[int, int]:
    """For each selected number the first one whose input its output depends on."""
    starts: dict[int, int] = {}
    chosen = set(selected)
    first = min(chosen, default=0)
    for run in sequence.runs():
        position = {number: i for i, number in enumerate(run)}
        for number in (n for n in run if n in chosen):
            reach = position[number] if system.recurrent else system.history_frames
            if system.recurrent and sharded:
                begin = position.get(first, 0)
                reach = min(reach, position[number] - begin + system.preroll_frames)
            starts[number] = run[max(0, position[number] - reach)]
    return starts


def _order(plan: ShotPlan, pending: frozenset[int]) -> tuple[int, ...]:
    """Numbers to process: the pending ones, and those that their outputs depend on."""
    order: list[int] = []
    for run in plan.sequence.runs():
        position = {number: i for i, number in enumerate(run)}
        done = 0
        for number in (n for n in run if n in pending):
            # starts grow with the numbers, so that what is before `done` is in the order already
            begin = max(done, position[plan.starts[number]])
            order += run[begin : position[number] + 1]
            done = position[number] + 1
    return tuple(order)


class Stamps:
    """Stamps of a shot's outputs: config, and the content of every input since the last reset."""

    def __init__(self, plan: ShotPlan) -> None:
        """Prepare; nothing is read yet."""
        self._plan = plan
        self._position = {n: i for i, n in enumerate(plan.sequence.numbers)}
        self._inputs: dict[int, str] = {}
        self._chains: dict[tuple[int, int], str] = {}

    def of(self, number: int) -> str:
        """Return the stamp of one output."""
        return digest(self._plan.config_hash, self._chain(self._plan.starts[number], number))

    def _chain(self, start: int, number: int) -> str:
        first, last = self._position[start], self._position[number]
        numbers = self._plan.sequence.numbers
        begin = last
        # where every other frame is asked for, those between them are in no chain of their own
        while begin > first and (start, numbers[begin - 1]) not in self._chains:
            begin -= 1
        chain = self._chains[start, numbers[begin - 1]] if begin > first else ""
        for n in numbers[begin : last + 1]:
            chain = digest(chain, self.input_digest(n))
        self._chains[start, number] = chain
        return chain

    def input_digest(self, number: int) -> str:
        """Hash a frame's files and camera; a file that cannot be read hashes as such."""
        if number not in self._inputs:
            camera = self._plan.source.reader.camera_values(number)
            try:
                content = self._plan.digests.of_all(self._plan.files(number))
            except RtsrError:
                content = UNREADABLE
            self._inputs[number] = digest(content, camera)
        return self._inputs[number]

    def spoil(self, number: int) -> None:
        """Count a frame that changed under the run as unreadable, whatever it holds by now."""
        self._inputs[number] = digest(UNREADABLE, number)
