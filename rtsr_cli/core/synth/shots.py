"""Whole shots: which files a run writes, and writing them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from rtsr_cli import __version__
from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.io.atomic import remove_leftovers, write_atomically
from rtsr_cli.core.io.capture import CAPTURE_FILE
from rtsr_cli.core.io.layout_writing import Role as Resolution
from rtsr_cli.core.io.layout_writing import frame_files, write_frame, write_side_car
from rtsr_cli.core.io.outputs import OutputState, output_state, refuse_foreign
from rtsr_cli.core.io.provenance import STAMP, config_digest, digest
from rtsr_cli.core.io.streaming import READ_AHEAD_BYTES, BackgroundWriter
from rtsr_cli.core.synth.choices import Role, SynthOptions
from rtsr_cli.core.synth.exposure import random_scene
from rtsr_cli.core.synth.render import GEOMETRY, render_frame, render_reference
from rtsr_cli.core.synth.scene import Scene
from rtsr_cli.core.synth.writing import (
    BASE,
    SHOT,
    as_stored,
    camera_attributes,
    capture_text,
    holds_divided,
    stored_bytes,
    written_buffers,
)

COMMAND = "synth"


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
            layout=options.file_layout,
            scale=options.scale,
            jitter=options.jitter,
            period=options.period,
        )

    def role_folder(self, role: Role) -> Path:
        """Return the folder of a role's files, the shot's own for a data set's."""
        whole = role is Role.FRAMES or self.options.file_layout.tree is not None
        return self.folder if whole else self.folder / role.value

    def paths(self, number: int, role: Role) -> tuple[Path, ...]:
        """Return the files of a frame."""
        return frame_files(
            self.role_folder(role),
            self.buffers(role),
            self.options.file_layout,
            number=number,
            **self.place(role),
        )

    def path(self, number: int, role: Role) -> Path:
        """Return the file of a frame that is named in reports."""
        return self.paths(number, role)[0]

    def place(self, role: Role) -> dict[str, Any]:
        """Return where in a layout's folders a role's files go."""
        tree = self.options.file_layout.tree is not None
        resolution = Resolution.HR if role in {Role.HR, Role.REFERENCE} else Resolution.LR
        return {
            "base": SHOT if tree else BASE,
            "role": resolution,
            "scale": self.options.scale or 1,
        }

    def buffers(self, role: Role) -> frozenset[Buffer]:
        """Return the buffers that a role's files may hold."""
        if role is Role.REFERENCE:
            return frozenset({Buffer.COLOR})
        divided = holds_divided(self.options.file_layout)
        followed = {Buffer.LIGHTING, Buffer.MATERIAL} if divided else set()
        whole = role is not Role.HR or self.options.file_layout.tree is not None
        written = written_buffers(self.options.file_layout)
        return frozenset({*(b for b in written if whole or b in GEOMETRY), *followed})

    def rendered(self, role: Role) -> tuple[Buffer, ...]:
        """Return the buffers that are rendered for a role's files."""
        written = written_buffers(self.options.file_layout)
        return tuple(b for b in written if role is not Role.HR or b in GEOMETRY)

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
    files = _files(plan)
    states = {
        (file, path): output_state(path, plan.stamp(*file))
        for file in files
        for path in plan.paths(*file)
    }
    if not overwrite:
        foreign = [path for (_, path), state in states.items() if state is OutputState.FOREIGN]
        if _declared_otherwise(plan):
            foreign.insert(0, plan.folder / CAPTURE_FILE)
        refuse_foreign(foreign, f"rtsr {COMMAND}")
    unfinished = {file for (file, _), state in states.items() if state is not OutputState.DONE}
    pending = tuple(file for file in files if file in unfinished)
    return ShotPlan(seed, folder, options, plan.numbers, pending)


def _files(plan: ShotPlan) -> list[tuple[int, Role]]:
    return [(number, role) for number in plan.numbers for role in plan.options.roles]


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
    for folder in {
        p.parent for n in plan.numbers for r in plan.options.roles for p in plan.paths(n, r)
    }:
        remove_leftovers(folder)
    _write_cameras(plan)
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


def _write_cameras(plan: ShotPlan) -> None:
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
    frame = render_frame(
        plan.scene,
        number,
        size,
        jitter_px=options.jitter_px(number) if jittered else (0.0, 0.0),
        buffers=plan.rendered(role),
        threads=threads,
    )
    if role is not Role.HR or options.file_layout.tree is None:
        return frame
    reference = _render(plan, number, Role.REFERENCE, threads)
    return replace(frame, gbuffer=frame.gbuffer.with_buffers(reference.gbuffer))


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
        layout = plan.options.file_layout
        write_frame(
            plan.role_folder(role),
            as_stored(frame, layout),
            layout,
            number=frame.number,
            attributes=attributes,
            **plan.place(role),
        )

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
