"""`demodulate`: radiance -> lighting, material and emission; and back, event by event."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.regions import place_output
from rtsr_cli.core.demodulate.frame_parts import demodulate_frame, recompose_frame
from rtsr_cli.core.demodulate.request import DemodulateRequest
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import read_header, write_exr
from rtsr_cli.core.files.provenance import describe_provenance, name_color_space
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.derivation import (
    CAMERA,
    BufferNeeds,
    DerivationConfig,
    resolve_needs,
)
from rtsr_cli.core.pairs.lacking_frames import leave_out_lacking
from rtsr_cli.core.pairs.nonfinite import apply_policy, count_negative
from rtsr_cli.core.pairs.opening import open_radiance
from rtsr_cli.core.pairs.sources import describe_missing, name_partial
from rtsr_cli.core.run.events import FrameDone, RunDone, RunStarted, ShotPlanned, Status
from rtsr_cli.core.run.frame_pairs import read_options
from rtsr_cli.core.run.loop import Outcome, Product
from rtsr_cli.core.run.outputs import FLOAT_BYTES, HALF_BYTES, HEADER_BYTES
from rtsr_cli.core.run.plan import FrameOutputs, ShotPlan, check_selection, plan_shot
from rtsr_cli.core.run.shot_inputs import ShotInputs
from rtsr_cli.core.run.shot_runs import (
    AS_FLOAT,
    NEGATIVE,
    NONFINITE,
    ShotJob,
    describe_outcome,
    run_shots,
)
from rtsr_cli.core.run.system_inputs import CAMERA_REMEDY, describe_likely, suggest_without

COMMAND = "demodulate"


@dataclass(frozen=True, kw_only=True)
class FrameDivided(FrameDone):
    """A frame's end.

    Attributes:
        error: largest recomposition error relative to max(|c|, 1e-3), as the file stores it.
        undivided: share of the pixels with mask 0.
        sky: share that is sky, among those.
    """

    error: float = 0.0
    undivided: float = 0.0
    sky: float = 0.0

    @property
    def facts(self) -> dict[str, Any]:
        """The event as plain values."""
        return {
            "shot": self.shot,
            "number": self.number,
            "path": self.path,
            "error": self.error,
            "undivided": self.undivided,
            "sky": self.sky,
            "kept": self.status is Status.KEPT,
            "failed": self.message,
            "nonfinite": self.nonfinite,
            "negative": self.negative,
            "as_float": self.as_float,
            "stops": self.stops,
        }


@dataclass(frozen=True, kw_only=True)
class DivisionDone(RunDone):
    """A run's end.

    Attributes:
        error: largest of the frames that were written.
        undivided: mean over them.
        sky: mean over them, among what is undivided.
    """

    error: float
    undivided: float
    sky: float

    @property
    def facts(self) -> dict[str, Any]:
        """The summary as plain values."""
        return super().facts | {
            "error": self.error,
            "undivided": self.undivided,
            "sky": self.sky,
        }


def demodulate_frames(
    request: DemodulateRequest,
) -> Iterator[ShotPlanned | RunStarted | FrameDone | RunDone]:
    """Plan every frame set, then divide (or multiply) frame after frame.

    Yields:
        A plan for every set; unless it is a dry run, the start, an end for every frame, the end.

    Raises:
        RtsrError: before the first frame: an input is missing or wrong, an output is in the way;
            after the last event: nothing more can be written.
    """
    opened = open_whole(request)
    jobs = [DivisionJob(plan_division(name, reader, request), request) for name, reader in opened]
    check_selection(request.selection, [job.plan.inputs for job in jobs])
    for job in jobs:
        yield job.plan.announcement({})
    if request.dry_run:
        return
    written: list[FrameDivided] = []
    for event in run_shots(jobs, request):
        if isinstance(event, FrameDivided) and event.status is Status.WRITTEN:
            written.append(event)
        yield finish_division(event, written) if isinstance(event, RunDone) else event


def open_whole(request: DemodulateRequest) -> Iterable[tuple[str, FrameReader]]:
    """Survey every frame set, but for frames that lack what is divided by."""
    options = read_options(request)

    def list_needed(whole: FrameReader, without: FrameReader) -> frozenset[Buffer]:
        missing = resolve_division(whole, request).missing
        return resolve_division(without, request).read if missing else frozenset()

    return leave_out_lacking(
        lambda needed: open_radiance(
            request.in_folder, replace(options, needed=needed), lighting=request.inverse
        ),
        request.on_missing,
        list_needed,
    )


def finish_division(done: RunDone, written: list[FrameDivided]) -> DivisionDone:
    """Return a run's end with what is known of all frames that were written."""
    return DivisionDone(
        folder=done.folder,
        seconds=None,
        counts=done.counts,
        repaired=done.repaired,
        spoilt=done.spoilt,
        negative=done.negative,
        as_float=done.as_float,
        stopped=done.stopped,
        error=max((frame.error for frame in written), default=0.0),
        undivided=sum(frame.undivided for frame in written) / max(len(written), 1),
        sky=sum(frame.sky for frame in written) / max(len(written), 1),
    )


def make_derivation_config(request: DemodulateRequest) -> DerivationConfig:
    """Return what divides radiance."""
    return DerivationConfig(mode=request.mode, lut=request.convention, epsilon=request.epsilon)


def plan_division(name: str, reader: FrameReader, request: DemodulateRequest) -> ShotPlan:
    """Check one frame set: buffers that are missing, outputs that are in the way.

    Raises:
        RtsrError: before anything is computed.
    """
    read = read_buffers(reader, request)

    @cache
    def files(number: int) -> tuple[Path, ...]:
        return reader.files(number, read)

    return plan_shot(
        ShotInputs(name=name, reader=reader, readers=(reader,), files=files),
        FrameOutputs(
            folder=request.out_folder / name,
            command=COMMAND,
            frame_bytes=_count_frame_bytes(reader, read, request),
        ),
        settings=[
            asdict(make_derivation_config(request)),
            request.inverse,
            request.full,
            request.on_nonfinite,
        ],
        selection=request.selection,
        overwrite=request.overwrite,
    )


DIVIDED, MULTIPLIED = (
    (Buffer.COLOR, Buffer.MATERIAL, Buffer.SKY),
    (Buffer.LIGHTING, Buffer.MATERIAL),
)
"""What is read to divide, and to multiply back."""


def resolve_division(reader: FrameReader, request: DemodulateRequest) -> BufferNeeds:
    """Resolve what dividing, or multiplying back, reads of a frame set, and what it lacks there."""
    inverse = request.inverse
    stored = reader.readable if inverse else reader.readable - {Buffer.LIGHTING}
    config = make_derivation_config(request)
    wanted = MULTIPLIED if inverse else DIVIDED
    return resolve_needs(wanted, stored, has_camera=reader.has_camera, config=config)


def read_buffers(reader: FrameReader, request: DemodulateRequest) -> frozenset[Buffer]:
    """Return what is read of a frame set.

    Raises:
        FrameFolderError: names what is missing.
    """
    inverse = request.inverse
    resolved = resolve_division(reader, request)
    if resolved.missing:
        wanted = MULTIPLIED if inverse else DIVIDED
        lacking = name_partial(wanted, reader, make_derivation_config(request))
        missing = describe_missing(lacking, reader)
        if reader.camera_unfit and any(CAMERA in m.split() for m in missing):
            raise FrameFolderError(
                f"{reader.frames.root}: what lighting is divided by needs the camera, but "
                f"{reader.camera_unfit}"
            )
        raise FrameFolderError(
            f"{reader.frames.root}: cannot {'recompose' if inverse else 'demodulate'}, "
            f"missing: {', '.join(missing)}. Layout '{reader.layout.name}' found: "
            f"{', '.join(sorted(reader.stored))}. Render what is missing, declare it in "
            f"capture.toml{CAMERA_REMEDY if CAMERA in missing else ''}, or choose another --mode"
            f"{suggest_without([reader])}{describe_likely([reader], missing)}"
        )
    return resolved.read | ({Buffer.EMISSION} & reader.stored)


def _count_frame_bytes(
    reader: FrameReader, read: frozenset[Buffer], request: DemodulateRequest
) -> int:
    """Size of an output at most: its pixels without compression."""
    height, width = reader.size
    sample = FLOAT_BYTES if request.full else HALF_BYTES
    layers = 1 if request.inverse else 3 if Buffer.EMISSION in read else 2
    a_pixel = layers * 3 * sample + (0 if request.inverse else HALF_BYTES)
    return height * width * a_pixel + HEADER_BYTES


class DivisionJob(ShotJob[Product]):
    """A frame set and its division, for the frame loop: frames are divided where they are read."""

    def __init__(self, plan: ShotPlan, request: DemodulateRequest) -> None:
        """Remember the plan."""
        super().__init__(plan, frame_bytes=plan.inputs.reader.frame_bytes)
        self._request = request
        self._read = read_buffers(plan.inputs.reader, request)

    def load(self, key: int) -> Product:
        """Read and divide a frame.

        Raises:
            RtsrError: the frame cannot be read, or is not what it was when the run was planned.
        """
        plan, request, reader = self.plan, self._request, self.plan.inputs.reader
        source = reader.path(key)
        with plan.digests.hold_unchanged(plan.inputs.files(key)):
            stamp = plan.stamps.of_output(key)
            header = read_header(source)
            frame = reader.read(key, self._read)
        frame, fixed = apply_policy(frame, request.on_nonfinite)
        negative = count_negative(frame)
        transform = recompose_frame if request.inverse else demodulate_frame
        parts = transform(frame, make_derivation_config(request), full=request.full)
        known = describe_provenance(
            command=COMMAND,
            config_hash=plan.stamps.config_hash,
            source=source,
            stamp=stamp,
            extra={"rtsr:nonfinite": fixed, **name_color_space(reader.conventions)},
        )

        windows = place_output(header, reader.main_channel, reader.region, Fraction(1))

        def write() -> None:
            write_exr(
                plan.path(key),
                windows.crop(parts.channels),
                attributes={**header.attributes, **known},
                data_window=windows.kept,
                display_window=windows.display,
            )

        facts = {
            NONFINITE: fixed,
            NEGATIVE: negative,
            AS_FLOAT: parts.as_float,
            "error": parts.error,
            "undivided": parts.undivided,
            "sky": parts.sky,
        }
        return Product(write=write, facts=facts)

    def compute(self, key: int, loaded: Product) -> Product:
        """Give on what was divided already."""
        del key
        return loaded

    def event(self, outcome: Outcome[int]) -> FrameDivided:
        """Return the event of a frame's end."""
        known = {name: outcome.facts.get(name, 0.0) for name in ("error", "undivided", "sky")}
        return FrameDivided(**describe_outcome(self.plan, outcome), **known)
