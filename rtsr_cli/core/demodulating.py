"""Running demodulation over folders: radiance -> lighting, material, emission; and back."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from rtsr_cli.core.choices import NonfinitePolicy
from rtsr_cli.core.derive import DerivationConfig, needs
from rtsr_cli.core.dividing import divided, recomposed
from rtsr_cli.core.errors import FrameFolderError, OutputBlockedError, RtsrError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.io.atomic import remove_leftovers
from rtsr_cli.core.io.exr import read_header, write_exr
from rtsr_cli.core.io.nonfinite import checked
from rtsr_cli.core.io.outputs import (
    FLOAT_BYTES,
    HALF_BYTES,
    HEADER_BYTES,
    OutputState,
    output_name,
    output_state,
    refuse_foreign,
    refuse_inputs,
)
from rtsr_cli.core.io.provenance import FileDigests, color_tag, config_digest, digest, provenance
from rtsr_cli.core.io.reading import FrameReader
from rtsr_cli.core.io.selection import Selection
from rtsr_cli.core.io.streaming import BackgroundWriter, prefetch, read_ahead

COMMAND = "demodulate"


@dataclass(frozen=True, kw_only=True)
class DemodulateOptions:
    """How to run.

    Attributes:
        derivation: the divisor.
        inverse: multiply back instead.
        full: write float instead of half.
        jobs: threads that read, and threads that write.
        overwrite: replace stale and foreign files.
        on_nonfinite: policy for NaN and Inf.
        selection: which frames are written.
    """

    derivation: DerivationConfig = field(default_factory=DerivationConfig)
    inverse: bool = False
    full: bool = False
    jobs: int = 2
    overwrite: bool = False
    on_nonfinite: NonfinitePolicy = NonfinitePolicy.ERROR
    selection: Selection = field(default_factory=Selection)


@dataclass(frozen=True, kw_only=True)
class FrameReport:
    """What became of a frame.

    Attributes:
        error: largest recomposition error relative to max(|c|, 1e-3), as the file stores it.
        undivided: share of the pixels with mask 0.
        kept: True if the output was there already.
        failed: message, empty if all went well.
        nonfinite: NaN and Inf that were repaired in the input.
        stops: True if no other frame could be written either, so that the run ended.
    """

    shot: str
    number: int
    path: Path
    error: float = 0.0
    undivided: float = 0.0
    kept: bool = False
    failed: str = ""
    nonfinite: int = 0
    stops: bool = False


@dataclass(frozen=True, kw_only=True)
class DemodulatePlan:
    """One frame set, checked and ready."""

    name: str
    reader: FrameReader
    folder: Path
    read: frozenset[Buffer]
    selected: tuple[int, ...]
    pending: tuple[int, ...]
    config_hash: str
    digests: FileDigests

    def path(self, number: int) -> Path:
        """Return the output of a frame."""
        return self.folder / output_name(self.reader, number)

    def files(self, number: int) -> tuple[Path, ...]:
        """Every file that is read for a frame."""
        return self.reader.files(number, self.read)

    @property
    def read_bytes(self) -> int:
        """Size of the files that the run will read."""
        return self.digests.bytes_of(path for n in self.pending for path in self.files(n))

    def write_bytes(self, options: DemodulateOptions) -> int:
        """Return what the run writes at most: its pixels without compression."""
        height, width = self.reader.size
        sample = FLOAT_BYTES if options.full else HALF_BYTES
        layers = 1 if options.inverse else 3 if Buffer.EMISSION in self.read else 2
        a_pixel = layers * 3 * sample + (0 if options.inverse else HALF_BYTES)
        return len(self.pending) * (height * width * a_pixel + HEADER_BYTES)

    def stamp(self, number: int) -> str:
        """Return the stamp of an output."""
        content = self.digests.of_all(self.files(number))
        return digest(self.config_hash, content, self.reader.camera_values(number))


def plan_frames(
    name: str, reader: FrameReader, folder: Path, options: DemodulateOptions
) -> DemodulatePlan:
    """Check one frame set: buffers that are missing, outputs that are in the way.

    Raises:
        RtsrError: before anything is computed.
    """
    wanted = (
        (Buffer.LIGHTING, Buffer.MATERIAL)
        if options.inverse
        else (Buffer.COLOR, Buffer.MATERIAL, Buffer.SKY)
    )
    stored = reader.stored if options.inverse else reader.stored - {Buffer.LIGHTING}
    resolved = needs(wanted, stored, has_camera=reader.has_camera, config=options.derivation)
    if resolved.missing:
        raise FrameFolderError(
            f"{reader.frames.root}: cannot {'recompose' if options.inverse else 'demodulate'}, "
            f"missing: {', '.join(resolved.missing)}. Layout '{reader.layout.name}' found: "
            f"{', '.join(sorted(reader.stored))}. Render what is missing, give a camera "
            "side-car in capture.toml, or choose another --mode"
        )
    emission = {Buffer.EMISSION} & set(reader.stored)
    plan = DemodulatePlan(
        name=name,
        reader=reader,
        folder=folder,
        read=resolved.read | emission,
        selected=options.selection.of(reader.numbers),
        pending=(),
        config_hash=config_digest(
            COMMAND,
            asdict(options.derivation),
            options.inverse,
            options.full,
            options.on_nonfinite,
            reader.declaration,
        ),
        digests=FileDigests(),
    )
    refuse_inputs([plan.path(n) for n in plan.selected], [reader])
    states = {n: _state(plan, n) for n in plan.selected}
    if not options.overwrite:
        foreign = [plan.path(n) for n, s in states.items() if s is OutputState.FOREIGN]
        refuse_foreign(foreign, f"rtsr {COMMAND}")
    pending = tuple(n for n, s in states.items() if s is not OutputState.DONE)
    for number in pending:
        plan.digests.note(plan.files(number))
    return replace(plan, pending=pending)


def _state(plan: DemodulatePlan, number: int) -> OutputState:
    """State of one output; inputs are hashed only where it is there."""
    path = plan.path(number)
    if not path.exists():
        return OutputState.ABSENT
    try:
        return output_state(path, plan.stamp(number))
    except FrameFolderError:
        # an input that cannot be read now is said when its frame's turn comes
        return OutputState.FOREIGN


def run_frames(plan: DemodulatePlan, options: DemodulateOptions) -> Iterator[FrameReport]:
    """Compute and write what is pending; yield a report for every selected frame.

    A disk that is full ends the run with the report that `stops`.
    """
    for number in set(plan.selected) - set(plan.pending):
        yield FrameReport(shot=plan.name, number=number, path=plan.path(number), kept=True)
    if not plan.pending:
        return
    remove_leftovers(plan.folder)
    ahead = read_ahead(options.jobs, plan.reader.frame_bytes)
    with BackgroundWriter[FrameReport](options.jobs) as writer:
        for report in _stream(plan, options, writer, ahead):
            yield report
            if report.stops:
                return


def _stream(
    plan: DemodulatePlan,
    options: DemodulateOptions,
    writer: BackgroundWriter[FrameReport],
    ahead: int,
) -> Iterator[FrameReport]:
    """Compute the frames in the threads that read them, and queue them for writing."""

    def work(number: int) -> tuple[FrameReport, Callable[[], None]]:
        return _computed(plan, number, options)

    for number, future in prefetch(work, plan.pending, ahead):
        try:
            report, write = future.result()
        except RtsrError as error:
            failed = FrameReport(shot=plan.name, number=number, path=plan.path(number))
            yield replace(failed, failed=str(error))
            continue
        writer.submit(report, write)
        yield from _written(writer, wait=False)
    yield from _written(writer, wait=True)


def _computed(
    plan: DemodulatePlan, number: int, options: DemodulateOptions
) -> tuple[FrameReport, Callable[[], None]]:
    """Read and divide a frame; return its report and the call that writes it.

    Raises:
        RtsrError: the frame cannot be read, or is not what it was when the run was planned.
    """
    source = plan.reader.path(number)
    with plan.digests.unchanged(plan.files(number)):
        stamp = plan.stamp(number)
        attributes = read_header(source).attributes
        frame = plan.reader.read(number, plan.read)
    frame, fixed = checked(frame, options.on_nonfinite)
    transform = recomposed if options.inverse else divided
    parts = transform(frame, options.derivation, full=options.full)
    report = FrameReport(
        shot=plan.name,
        number=number,
        path=plan.path(number),
        error=parts.error,
        undivided=parts.undivided,
        nonfinite=fixed,
    )
    known = provenance(
        command=COMMAND,
        config_hash=plan.config_hash,
        source=source,
        stamp=stamp,
        extra={"rtsr:nonfinite": fixed, **color_tag(plan.reader.conventions)},
    )

    def write() -> None:
        write_exr(
            report.path,
            parts.channels,
            attributes={**attributes, **known},
            data_window=plan.reader.region,
            display_window=plan.reader.display,
        )

    return report, write


def _written(writer: BackgroundWriter[FrameReport], *, wait: bool) -> Iterator[FrameReport]:
    """Reports of finished writes; after one that blocks the others, only of those that succeed."""
    for report, error in writer.done(wait=wait):
        if error is None:
            yield report
            continue
        if not isinstance(error, RtsrError):
            raise error
        failure = replace(report, failed=str(error))
        if not isinstance(error, OutputBlockedError):
            yield failure
            continue
        yield from (late for late, worse in writer.drop() if worse is None)
        yield replace(failure, stops=True)
        return
