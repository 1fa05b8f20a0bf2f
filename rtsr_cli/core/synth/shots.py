"""Whole shots: which files a run writes, and writing them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any

from rtsr_cli import __version__
from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import View
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.io.atomic import remove_leftovers, write_atomically
from rtsr_cli.core.io.capture import CAPTURE_FILE, JitterSequence
from rtsr_cli.core.io.outputs import OutputState, output_state, refuse_foreign
from rtsr_cli.core.io.provenance import STAMP, config_digest, digest
from rtsr_cli.core.io.streaming import READ_AHEAD_BYTES, BackgroundWriter
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.synth.exposure import random_scene
from rtsr_cli.core.synth.render import ALL_BUFFERS, GEOMETRY, render_frame, render_reference
from rtsr_cli.core.synth.scene import Scene
from rtsr_cli.core.synth.writing import (
    BASE,
    camera_attributes,
    capture_text,
    frame_path,
    stored_bytes,
    write_frame,
)

COMMAND = "synth"

JITTER_PERIOD = 8
"""Length of the jitter sequence: 8 scale^2 frames, as FSR2 has it."""


class Role(StrEnum):
    """What a file of a shot is; the value is its folder, `frames` lie in the shot itself."""

    FRAMES = "frames"
    LR = "lr"
    HR = "hr"
    REFERENCE = "reference"


@dataclass(frozen=True, kw_only=True)
class SynthOptions:
    """What is made of a scene; everything here decides bytes.

    Attributes:
        size: (height, width) of the output.
        scale: write a pair, LR of size / scale and HR; None writes one resolution.
        jitter: of the samples, None or the name of a sequence.
        samples: K: of a single resolution, K x K samples of each output pixel are stored; of a
            pair, the reference is their mean.
        layout: channel layout.
        static_camera: the camera stays where it is at frame 1.
    """

    size: Size
    scale: int | None = None
    jitter: str | None = None
    samples: int = 1
    layout: str = "rtsr"
    static_camera: bool = False

    @property
    def roles(self) -> tuple[Role, ...]:
        """Files of a frame."""
        return (Role.FRAMES,) if self.scale is None else (Role.LR, Role.HR, Role.REFERENCE)

    @property
    def period(self) -> int:
        """Length of the jitter sequence."""
        return JITTER_PERIOD * (self.scale or 1) ** 2

    def jitter_px(self, number: int) -> Jitter:
        """Jitter of a frame, in pixels of the resolution that is jittered."""
        if self.jitter is None:
            return 0.0, 0.0
        return JitterSequence(period=self.period, first_frame=1).at(number)

    def role_size(self, role: Role) -> Size:
        """(height, width) of a role's files."""
        height, width = self.size
        if role is Role.LR:
            assert self.scale is not None
            return height // self.scale, width // self.scale
        if role is Role.FRAMES:
            return height * self.samples, width * self.samples
        return height, width


@dataclass(frozen=True)
class ShotPlan:
    """One shot: a seed, its folder, and the files that are still to be written."""

    seed: int
    folder: Path
    options: SynthOptions
    numbers: tuple[int, ...]
    pending: tuple[tuple[int, Role], ...] = ()

    @cached_property
    def scene(self) -> Scene:
        """The scene; made when first asked for."""
        scene = random_scene(self.seed)
        return scene.still() if self.options.static_camera else scene

    @property
    def config_hash(self) -> str:
        """Hash of what decides the bytes."""
        return config_digest(COMMAND, self.seed, asdict(self.options))

    @property
    def capture(self) -> str:
        """Text of the shot's declarations."""
        options = self.options
        return capture_text(
            layout=options.layout,
            scale=options.scale,
            jitter=options.jitter,
            period=options.period,
        )

    def role_folder(self, role: Role) -> Path:
        """Return the folder of a role's files."""
        return self.folder if role is Role.FRAMES else self.folder / role.value

    def path(self, number: int, role: Role) -> Path:
        """Return the file of a frame."""
        return frame_path(self.role_folder(role), number)

    def stamp(self, number: int, role: Role) -> str:
        """Return the stamp of a file."""
        return digest(self.config_hash, number, role.value)


@dataclass(frozen=True, kw_only=True)
class FileReport:
    """What became of a file."""

    seed: int
    number: int
    path: Path
    kept: bool = False


def plan_shot(
    seed: int, folder: Path, options: SynthOptions, numbers: Sequence[int], *, overwrite: bool
) -> ShotPlan:
    """Find what of a shot is still to be written.

    Raises:
        OutputError: a file is in the way that this run would not have written.
    """
    plan = ShotPlan(seed, folder, options, tuple(sorted(numbers)))
    files = [(number, role) for number in plan.numbers for role in options.roles]
    states = {file: output_state(plan.path(*file), plan.stamp(*file)) for file in files}
    if not overwrite:
        foreign = [plan.path(*f) for f, state in states.items() if state is OutputState.FOREIGN]
        if _declared_otherwise(plan):
            foreign.insert(0, plan.folder / CAPTURE_FILE)
        refuse_foreign(foreign, f"rtsr {COMMAND}")
    pending = tuple(f for f, state in states.items() if state is not OutputState.DONE)
    return ShotPlan(seed, folder, options, plan.numbers, pending)


def _declared_otherwise(plan: ShotPlan) -> bool:
    """Tell whether another capture.toml lies where this shot's goes."""
    path = plan.folder / CAPTURE_FILE
    try:
        return path.exists() and path.read_text(encoding="utf-8") != plan.capture
    except (OSError, UnicodeDecodeError):
        return True


def run_shot(plan: ShotPlan, *, jobs: int) -> Iterator[FileReport]:
    """Render and write what is pending; yield a report for every file.

    Args:
        plan: of `plan_shot`.
        jobs: threads that render, and threads that write.

    Raises:
        OutputError: a file cannot be written.
    """
    pending = set(plan.pending)
    for number in plan.numbers:
        for role in plan.options.roles:
            if (number, role) not in pending:
                path = plan.path(number, role)
                yield FileReport(seed=plan.seed, number=number, path=path, kept=True)
    for role in plan.options.roles:
        remove_leftovers(plan.role_folder(role))
    write_atomically(plan.folder / CAPTURE_FILE, lambda part: _write_text(part, plan.capture))
    largest = max(stored_bytes(plan.options.role_size(role)) for role in plan.options.roles)
    # one large frame is written while the next is rendered, not more
    writers = jobs if largest * (jobs + 1) <= READ_AHEAD_BYTES else 1
    with BackgroundWriter[FileReport](writers) as writer:
        for number, role in plan.pending:
            frame = _render(plan, number, role, jobs)
            report = FileReport(seed=plan.seed, number=number, path=plan.path(number, role))
            writer.submit(report, _writing(plan, frame, role))
            del frame
            yield from _written(writer, wait=largest > READ_AHEAD_BYTES)
        yield from _written(writer, wait=True)


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def _written(writer: BackgroundWriter[FileReport], *, wait: bool) -> Iterator[FileReport]:
    for report, error in writer.done(wait=wait):
        if error is not None:
            raise error
        yield report


def _render(plan: ShotPlan, number: int, role: Role, threads: int) -> Frame:
    options, size = plan.options, plan.options.role_size(role)
    if role is Role.REFERENCE:
        color = render_reference(plan.scene, number, size, samples=options.samples, threads=threads)
        return Frame(
            number=number,
            gbuffer=GBuffer({Buffer.COLOR: color}),
            camera=plan.scene.camera.metadata(number, size),
            view=View(display=size),
        )
    jittered = role is not Role.HR
    return render_frame(
        plan.scene,
        number,
        size,
        jitter_px=options.jitter_px(number) if jittered else (0.0, 0.0),
        buffers=GEOMETRY if role is Role.HR else ALL_BUFFERS,
        threads=threads,
    )


def _writing(plan: ShotPlan, frame: Frame, role: Role) -> Any:
    attributes = {
        **camera_attributes(frame.camera, frame.number, plan.scene.camera.fov_deg),
        "scene": plan.scene.arrangement,
        "sequence": f"seed {plan.seed}",
        "software": f"rtsr {__version__}",
        "rtsr:version": __version__,
        "rtsr:command": COMMAND,
        "rtsr:configHash": plan.config_hash,
        STAMP: plan.stamp(frame.number, role),
    }

    def write() -> None:
        write_frame(plan.role_folder(role), BASE, frame, plan.options.layout, attributes)

    return write


def check_size(options: SynthOptions) -> None:
    """Raise where LR pixels would not divide the size.

    Raises:
        OutputError: names size and scale.
    """
    height, width = options.size
    if options.scale is not None and (height % options.scale or width % options.scale):
        raise OutputError(
            f"--size {width}x{height} cannot be divided by --scale {options.scale}; "
            "choose a size that is a multiple of the scale"
        )
