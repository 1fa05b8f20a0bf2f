"""`synth`: from a request to rendered frames, event by event."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from rtsr_cli import __version__
from rtsr_cli.core.captures.capture_file import CAPTURE_FILE
from rtsr_cli.core.captures.layout_writer import write_frame, write_side_car
from rtsr_cli.core.choices import JitterMode
from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.files.atomic_write import check_writable, write_text_atomically
from rtsr_cli.core.files.provenance import STAMP
from rtsr_cli.core.files.streaming import READ_AHEAD_BYTES
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.marks import MARKED
from rtsr_cli.core.run.events import RunStarted, Status
from rtsr_cli.core.run.loop import Outcome, Pace, Product, run_job
from rtsr_cli.core.synth.frame_storage import (
    SHOT,
    count_stored_bytes,
    describe_camera,
    prepare_for_storage,
)
from rtsr_cli.core.synth.render import render_frame, render_reference
from rtsr_cli.core.synth.request import SynthRequest
from rtsr_cli.core.synth.shot_options import FileRole, SynthOptions
from rtsr_cli.core.synth.shot_plan import COMMAND, SynthPlan, check_size, plan_synthetic_shot

FileKey = tuple[int, FileRole]
"""Frame number and role of a file."""


@dataclass(frozen=True, kw_only=True)
class SynthPlanned:
    """A shot that was checked.

    Attributes:
        plan: of the shot.
    """

    plan: SynthPlan

    @property
    def files(self) -> int:
        """How many the shot has."""
        return len(self.plan.numbers) * len(self.plan.options.roles)

    @property
    def facts(self) -> dict[str, Any]:
        """The plan as plain values."""
        height, width = self.plan.options.size
        return {
            "seed": self.plan.seed,
            "folder": self.plan.folder,
            "size": [width, height],
            "files": self.files,
            "pending": len(self.plan.pending),
        }


@dataclass(frozen=True, kw_only=True)
class FileDone:
    """A file's end.

    Attributes:
        seed: of its scene.
        number: of its frame.
        path: the one that reports name.
        kept: True if it was there already.
    """

    seed: int
    number: int
    path: Path
    kept: bool = False

    @property
    def facts(self) -> dict[str, Any]:
        """The event as plain values."""
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class SynthDone:
    """A run's end.

    Attributes:
        folder: OUT.
        seconds: from the first file to the last.
        written, kept: files.
    """

    folder: Path
    seconds: float
    written: int
    kept: int

    @property
    def facts(self) -> dict[str, Any]:
        """The summary as plain values."""
        return {"seconds": round(self.seconds, 3), "written": self.written, "kept": self.kept}


SynthEvent = SynthPlanned | RunStarted | FileDone | SynthDone


def synthesize_frames(request: SynthRequest) -> Iterator[SynthEvent]:
    """Plan every shot, then render file after file.

    Yields:
        A plan for every shot, the start, an end for every file, the end.

    Raises:
        OutputError: a file is in the way, or cannot be written.
    """
    options = make_synth_options(request)
    check_size(options)
    plans = [
        plan_synthetic_shot(
            seed, folder, options, tuple(request.frames), overwrite=request.overwrite
        )
        for seed, folder in list_shot_folders(request)
    ]
    for plan in plans:
        yield SynthPlanned(plan=plan)
        check_writable(plan.folder)
    yield RunStarted(pending=sum(len(plan.pending) for plan in plans))
    counts = dict.fromkeys(Status, 0)
    started = time.perf_counter()
    for plan in plans:
        for outcome in render_shot(plan, jobs=request.jobs):
            counts[outcome.status] += 1
            number, role = outcome.key
            yield FileDone(
                seed=plan.seed,
                number=number,
                path=plan.path(number, role),
                kept=outcome.status is Status.KEPT,
            )
    yield SynthDone(
        folder=request.out_folder,
        seconds=time.perf_counter() - started,
        written=counts[Status.WRITTEN],
        kept=counts[Status.KEPT],
    )


def make_synth_options(request: SynthRequest) -> SynthOptions:
    """Return what of a request decides the files' bytes."""
    return SynthOptions(
        size=request.size,
        scale=request.scale,
        jitter=None if request.jitter is JitterMode.NONE else request.jitter.value,
        samples=request.samples,
        layout=request.layout,
        static_camera=request.static_camera,
    )


def list_shot_folders(request: SynthRequest) -> list[tuple[int, Path]]:
    """Seed and folder of each shot."""
    if request.shots is None:
        return [(request.seed, request.out_folder)]
    return [(request.seed + i, request.out_folder / f"{i:04d}") for i in range(request.shots)]


def render_shot(plan: SynthPlan, *, jobs: int) -> Iterator[Outcome[FileKey]]:
    """Render and write what is pending; yield an outcome for every file.

    Args:
        plan: of the shot.
        jobs: threads that render, and threads that write.

    Raises:
        OutputError: a file cannot be written; what was rendered before is.
    """
    job = RenderJob(plan, jobs)
    job.prepare()
    for outcome in run_job(job, job.pace()):
        if outcome.error is not None:
            raise outcome.error
        yield outcome


class RenderJob:
    """A synthetic shot for the frame loop: nothing is read."""

    def __init__(self, plan: SynthPlan, jobs: int) -> None:
        """Remember the plan."""
        self._plan, self._jobs = plan, jobs

    @property
    def folders(self) -> Iterable[Path]:
        """Folders of the files."""
        plan = self._plan
        return {
            path.parent
            for number in plan.numbers
            for role in plan.options.roles
            for path in plan.paths(number, role)
        }

    @property
    def kept(self) -> Iterable[FileKey]:
        """Files that are there."""
        pending = set(self._plan.pending)
        files = ((n, role) for n in self._plan.numbers for role in self._plan.options.roles)
        return (file for file in files if file not in pending)

    @property
    def order(self) -> Iterable[FileKey]:
        """Files to render."""
        return self._plan.pending

    def pace(self) -> Pace:
        """One large frame is written while the next is rendered, not more."""
        roles = self._plan.options.roles
        largest = max(count_stored_bytes(self._plan.options.role_size(role)) for role in roles)
        writers = self._jobs if largest * (self._jobs + 1) <= READ_AHEAD_BYTES else 1
        queued = 1 if largest > READ_AHEAD_BYTES else writers + 1
        return Pace(ahead=1, writers=writers, queued=queued)

    def prepare(self) -> None:
        """Write what is declared beside the frames."""
        plan = self._plan
        write_cameras(plan)
        write_text_atomically(plan.folder / CAPTURE_FILE, plan.capture)

    def load(self, key: FileKey) -> None:
        """Nothing is read."""

    def compute(self, key: FileKey, loaded: None) -> Product:
        """Render a file's frame."""
        number, role = key
        frame = render_role(self._plan, number, role, self._jobs)
        return Product(write=partial(write_role, self._plan, frame, role))

    def fail(self, key: FileKey, error: RtsrError) -> None:
        """A file that cannot be written ends the run."""


def write_cameras(plan: SynthPlan) -> None:
    """Write the side-car of a data set that keeps its cameras beside the frames."""
    layout, size = plan.options.file_layout, plan.options.role_size(plan.options.roles[0])
    frames = (
        Frame(
            number=number,
            gbuffer=GBuffer({}),
            camera=plan.scene.camera.metadata(
                number, size, jitter_px=plan.options.jitter_px(number)
            ),
            view=View(display=size),
        )
        for number in plan.numbers
    )
    write_side_car(plan.folder, frames, layout, shot=SHOT, scale=plan.options.scale or 1)


def render_role(plan: SynthPlan, number: int, role: FileRole, threads: int) -> Frame:
    """Render the frame of a role."""
    options, size = plan.options, plan.options.role_size(role)
    if role is FileRole.REFERENCE:
        color = render_reference(plan.scene, number, size, samples=options.samples, threads=threads)
        return Frame(
            number=number,
            gbuffer=GBuffer({Buffer.COLOR: color}),
            camera=plan.scene.camera.metadata(number, size),
            view=View(display=size),
        )
    jittered = role is not FileRole.HR
    frame = render_frame(
        plan.scene,
        number,
        size,
        jitter_px=options.jitter_px(number) if jittered else (0.0, 0.0),
        buffers=plan.list_rendered(role),
        threads=threads,
    )
    if role is not FileRole.HR or options.file_layout.tree is None:
        return frame
    reference = render_role(plan, number, FileRole.REFERENCE, threads)
    return replace(frame, gbuffer=frame.gbuffer.with_buffers(reference.gbuffer))


def write_role(plan: SynthPlan, frame: Frame, role: FileRole) -> None:
    """Write the files of a rendered frame.

    Raises:
        OutputError: a file cannot be written.
    """
    attributes = {
        **describe_camera(frame.camera, frame.number, plan.scene.camera.fov_deg),
        "scene": plan.scene.arrangement,
        "sequence": f"seed {plan.seed}",
        "software": f"rtsr {__version__}",
        **MARKED,
        "rtsr:command": COMMAND,
        "rtsr:configHash": plan.config_hash,
        STAMP: plan.stamp(frame.number, role),
    }
    layout = plan.options.file_layout
    write_frame(
        plan.role_folder(role),
        prepare_for_storage(frame, layout),
        layout,
        number=frame.number,
        attributes=attributes,
        **plan.place(role),
    )
