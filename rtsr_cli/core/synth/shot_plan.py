"""Plans of synthetic shots: which files a run writes, and which are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from rtsr_cli.core.captures.capture_file import CAPTURE_FILE
from rtsr_cli.core.captures.layout_writer import FrameRole as Resolution
from rtsr_cli.core.captures.layout_writer import list_frame_files, name_side_car
from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.files.ownership import list_foreign, may_be_replaced, refuse_foreign
from rtsr_cli.core.files.provenance import digest_config, digest_values
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.run.outputs import OutputState, read_output_state
from rtsr_cli.core.synth.exposure import draw_scene
from rtsr_cli.core.synth.frame_storage import (
    BASE,
    SHOT,
    holds_divided,
    list_written_buffers,
    write_declarations,
)
from rtsr_cli.core.synth.render import GEOMETRY
from rtsr_cli.core.synth.scene import Scene
from rtsr_cli.core.synth.shot_options import FileRole, SynthOptions

COMMAND = "synth"


@dataclass(frozen=True)
class SynthPlan:
    """One shot: a seed, its folder, and the files that are still to be written."""

    seed: int
    folder: Path
    options: SynthOptions
    numbers: tuple[int, ...]
    pending: tuple[tuple[int, FileRole], ...] = ()

    @cached_property
    def scene(self) -> Scene:
        """The scene; made when first asked for."""
        scene = draw_scene(self.seed)
        return scene.still() if self.options.static_camera else scene

    @property
    def config_hash(self) -> str:
        """Hash of what decides the bytes."""
        return digest_config(COMMAND, self.seed, asdict(self.options))

    @property
    def capture(self) -> str:
        """Text of the shot's declarations."""
        options = self.options
        return write_declarations(
            layout=options.file_layout,
            scale=options.scale,
            jitter=options.jitter,
            period=options.period,
        )

    def role_folder(self, role: FileRole) -> Path:
        """Return the folder of a role's files, the shot's own for a data set's."""
        whole = role is FileRole.FRAMES or self.options.file_layout.tree is not None
        return self.folder if whole else self.folder / role.value

    def paths(self, number: int, role: FileRole) -> tuple[Path, ...]:
        """Return the files of a frame."""
        return list_frame_files(
            self.role_folder(role),
            self.buffers(role),
            self.options.file_layout,
            number=number,
            **self.place(role),
        )

    def path(self, number: int, role: FileRole) -> Path:
        """Return the file of a frame that is named in reports."""
        return self.paths(number, role)[0]

    def place(self, role: FileRole) -> dict[str, Any]:
        """Return where in a layout's folders a role's files go."""
        tree = self.options.file_layout.tree is not None
        resolution = Resolution.HR if role in {FileRole.HR, FileRole.REFERENCE} else Resolution.LR
        return {
            "base": SHOT if tree else BASE,
            "role": resolution,
            "scale": self.options.scale or 1,
        }

    def buffers(self, role: FileRole) -> frozenset[Buffer]:
        """Return the buffers that a role's files may hold."""
        if role is FileRole.REFERENCE:
            return frozenset({Buffer.COLOR})
        divided = holds_divided(self.options.file_layout)
        followed = {Buffer.LIGHTING, Buffer.MATERIAL} if divided else set()
        whole = role is not FileRole.HR or self.options.file_layout.tree is not None
        written = list_written_buffers(self.options.file_layout)
        return frozenset({*(b for b in written if whole or b in GEOMETRY), *followed})

    def list_rendered(self, role: FileRole) -> tuple[Buffer, ...]:
        """Return the buffers that are rendered for a role's files."""
        written = list_written_buffers(self.options.file_layout)
        return tuple(b for b in written if role is not FileRole.HR or b in GEOMETRY)

    def stamp(self, number: int, role: FileRole) -> str:
        """Return the stamp of a file."""
        return digest_values(self.config_hash, number, role.value)


def plan_synthetic_shot(
    seed: int, folder: Path, options: SynthOptions, numbers: Sequence[int], *, overwrite: bool
) -> SynthPlan:
    """Find what of a shot is still to be written.

    Raises:
        OutputError: a file is in the way that this run would not have written.
    """
    plan = SynthPlan(seed, folder, options, tuple(sorted(numbers)))
    files = _list_files(plan)
    states = {
        (file, path): read_output_state(path, plan.stamp(*file))
        for file in files
        for path in plan.paths(*file)
    }
    if not overwrite:
        foreign = [path for (_, path), state in states.items() if state is OutputState.FOREIGN]
        if _has_other_declaration(plan):
            foreign.insert(0, plan.folder / CAPTURE_FILE)
        side_car = name_side_car(folder, options.file_layout, SHOT)
        foreign += list_foreign([side_car] if side_car is not None else [])
        refuse_foreign(foreign, f"rtsr {COMMAND}")
    unfinished = {file for (file, _), state in states.items() if state is not OutputState.DONE}
    pending = tuple(file for file in files if file in unfinished)
    return SynthPlan(seed, folder, options, plan.numbers, pending)


def _list_files(plan: SynthPlan) -> list[tuple[int, FileRole]]:
    return [(number, role) for number in plan.numbers for role in plan.options.roles]


def _has_other_declaration(plan: SynthPlan) -> bool:
    """Tell whether another capture.toml lies where this shot's goes."""
    return not may_be_replaced(
        plan.folder / CAPTURE_FILE, lambda path: _holds_text(path, plan.capture)
    )


def _holds_text(path: Path, text: str) -> bool:
    try:
        return path.is_file() and path.read_text(encoding="utf-8") == text
    except (OSError, UnicodeDecodeError):
        return False


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
