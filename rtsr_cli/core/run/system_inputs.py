"""What a run needs to know of a system before the first frame: its inputs, and whether they fit."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field

from rtsr_cli.core.captures.likely_channels import suggest_lines
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.shots import HR_FOLDER, LR_FOLDER
from rtsr_cli.core.choices import InputCondition, NonfinitePolicy, SystemTask
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.folders import is_folder
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera import GIVE_CAMERAS
from rtsr_cli.core.imaging.derivation import CAMERA
from rtsr_cli.core.pairs.point_samples import is_point_sampled
from rtsr_cli.core.pairs.sources import (
    CONTRADICTED,
    DECLARED_MOTION,
    FITTING_HR,
    PairInputs,
    PairSource,
)
from rtsr_cli.core.run.shot_inputs import HistoryReach
from rtsr_cli.core.system import System
from rtsr_cli.core.visible_text import INDENTED


@dataclass(frozen=True, kw_only=True)
class SystemTable:
    """The systems that a run may choose from.

    Attributes:
        load: name -> its declaration.
        preferred: names, best first: the default is the first that the inputs allow.
        when: name -> what inputs must be like for it to be the default.
    """

    load: Callable[[str], System]
    preferred: tuple[str, ...] = ()
    when: Mapping[str, tuple[InputCondition, ...]] = field(default_factory=dict)


WITHOUT_FRAMES = (
    "frames that lack what the others hold are left out by --on-missing skip; by --on-missing hold "
    "the frame before is taken in their place"
)
"""What helps where some frames lack a buffer."""

OF_FRAMES = " of frame"
"""Stands between a buffer and the frames that lack it, where others hold it."""

CAMERA_REMEDY = f" (camera matrices: {GIVE_CAMERAS})"
"""Where camera matrices are declared."""


def measure_history_reach(system: System) -> HistoryReach:
    """How far a system's outputs look back."""
    return HistoryReach(
        frames=system.history_frames,
        recurrent=system.recurrent,
        preroll_frames=system.preroll_frames,
    )


def resolve_system_inputs(
    system: System, policy: NonfinitePolicy, config: object = None
) -> PairInputs:
    """Return what to read for a system; alpha goes along where there is one.

    Args:
        system: whose inputs they are.
        policy: how bad pixels are treated.
        config: of the system, its defaults if None.
    """
    return PairInputs(
        lr=system.lr_inputs,
        hr=system.hr_inputs,
        lr_optional=(*system.lr_optional, Buffer.ALPHA),
        hr_optional=system.hr_optional,
        derivation=system.derivation(system.config() if config is None else config),
        on_nonfinite=policy,
        straight=system.sees_straight,
        filter_known=system.matches_filter,
    )


def resolve_unshaded_inputs(
    system: System, policy: NonfinitePolicy, config: object = None
) -> PairInputs:
    """Return what to read, for a system, of a frame that was not rendered; as the above."""
    return PairInputs(
        lr=system.unshaded_inputs,
        lr_optional=system.unshaded_optional,
        derivation=system.derivation(system.config() if config is None else config),
        on_nonfinite=policy,
    )


def check_system(
    system: System, source: PairSource, inputs: PairInputs, *, remedy: str = ""
) -> None:
    """Raise if a shot cannot feed a system.

    Args:
        system: that is to run.
        source: the shot's pairs.
        inputs: what is read of them.
        remedy: what else would help, as `check_inputs` has it.

    Raises:
        FrameFolderError: names the folder, what is missing and what would help.
    """
    another = ", or choose another --system" if system.task is SystemTask.UPSCALE else ""
    check_inputs(f"system '{system.name}'", source, inputs, remedy=f"{another}{remedy}")
    if system.scales and source.scale not in system.scales:
        made_for = ", ".join(f"{s}x" for s in system.scales)
        raise FrameFolderError(
            f"{source.reader.frames.root}: system '{system.name}' is made for {made_for}, "
            f"not {source.scale}x"
        )


def require_known_filter(source: PairSource, inputs: PairInputs, *, sharded: bool) -> None:
    """Refuse a pixel filter that was measured where parts of a run might measure differently.

    Raises:
        FrameFolderError: names the folder, the width and the line to declare it.
    """
    if sharded and inputs.filter_known and source.filter_measured:
        raise FrameFolderError(
            f"{source.reader.frames.root}: the width of LR radiance's pixel filter is measured, "
            "not declared, and --shard needs it declared so that all parts agree; run "
            f"'rtsr farm pin IN' once, or add filter_width_px = {source.filter_width_px:.2f} to "
            "capture.toml"
        )


def describe_filter_width(source: PairSource, inputs: PairInputs) -> str:
    """Say which pixel filter a run reckons with; empty if with none."""
    width = source.filter_width_px if inputs.filter_known else 0.0
    if width is None and not is_point_sampled(source):
        return (
            "LR radiance went through a pixel filter, and no filter width that was tried fits it: "
            "it is taken for point samples; declare filter_width_px in capture.toml (its standard "
            "deviation in LR pixels), or render LR without a pixel filter"
        )
    if not width:
        return ""
    said = "as declared or simulated"
    if source.filter_measured:
        said = "measured; capture.toml: filter_width_px, 0 if it is none"
    return (
        f"LR radiance went through a pixel filter of standard deviation {width:.2f} LR pixels "
        f"({said})"
    )


def check_inputs(
    reads: str,
    source: PairSource,
    inputs: PairInputs,
    *,
    remedy: str = "",
    numbers: Collection[int] | None = None,
) -> None:
    """Raise if a shot lacks buffers.

    Args:
        reads: who reads them, for the message.
        source: the shot's pairs.
        inputs: what is read of them.
        remedy: what else would help, beside rendering or declaring what is missing.
        numbers: of the frames that are read so; all if None.

    Raises:
        FrameFolderError: names the folder, what is missing and what would help.
    """
    root = source.reader.frames.root
    missing = source.missing(inputs, numbers)
    if FITTING_HR in missing:
        raise FrameFolderError(f"{source.misfit}{remedy} ({reads} reads the HR G-buffer)")
    unproven = next((r for r in source.readers if r.undecided), None)
    if missing and unproven is not None:
        raise FrameFolderError(
            f"{root}: {reads} reads more than radiance, but {unproven.undecided}"
        )
    if DECLARED_MOTION in missing:
        raise FrameFolderError(
            f"{root}: {reads} reads motion, but {source.reader.motion_undecided}"
        )
    unfit = next((r for r in source.readers if r.camera_unfit), None)
    needs_camera = any(CAMERA in m.split() for m in missing)
    if unfit is not None and needs_camera:
        raise FrameFolderError(
            f"{unfit.frames.root}: {reads} needs the camera, but {unfit.camera_unfit}"
        )
    if needs_camera:
        remedy = f"{CAMERA_REMEDY}{remedy}"
    _refuse_contradicted(reads, source, missing, remedy)
    if missing:
        lacks = f"{root}: {reads} cannot run, missing: {', '.join(missing)}"
        if all(is_of_frames(name) for name in missing):
            raise FrameFolderError(
                f"{lacks}, which the other frames have. Render what these frames lack{remedy}"
                f"{suggest_without(source.readers)}"
            )
        raise FrameFolderError(
            f"{lacks}. {'; '.join(_describe_buffers(reader) for reader in source.readers)}. "
            f"Render what is missing, declare it in capture.toml{remedy}{_suggest_parent(source)}"
            f"{suggest_without(source.readers)}"
            f"{describe_likely(source.readers, missing)}"
        )


def _refuse_contradicted(
    reads: str, source: PairSource, missing: Collection[str], remedy: str
) -> None:
    """Raise where what is missing is there, and is not read for what speaks against it."""
    if not any(CONTRADICTED in name for name in missing):
        return
    for reader in source.readers:
        if reader.contradicted:
            why = "; ".join(reader.contradicted.values())
            raise FrameFolderError(f"{reader.frames.root}: {reads} cannot run: {why}{remedy}")


def is_of_frames(missing: str) -> bool:
    """Tell whether a buffer is missing in some frames alone, and not a camera."""
    return OF_FRAMES in missing and CAMERA not in missing.split()


def suggest_without(readers: Iterable[FrameReader]) -> str:
    """Say how to do without frames that lack what others hold; empty where none does."""
    return f"; {WITHOUT_FRAMES}" if any(reader.partial for reader in readers) else ""


def describe_likely(readers: Iterable[FrameReader], missing: Collection[str]) -> str:
    """Say which lines would bind what is missing by channels that are there; empty if none would.

    Each stands on a line of its own, so that all of them can be pasted at once.

    Args:
        readers: of a shot's frames, of each size.
        missing: names of buffers, with or without their size.
    """
    lines = suggest_lines(readers, missing)
    said = "; perhaps, below [buffers] in capture.toml:"
    return "".join((said, *(f"{INDENTED}{line}" for line in lines))) if lines else ""


def _suggest_parent(source: PairSource) -> str:
    """Say that a shot's folder holds both sizes, where only one of them was named."""
    root = source.reader.frames.root
    other = {LR_FOLDER: HR_FOLDER, HR_FOLDER: LR_FOLDER}.get(root.name)
    # a command for frames of one size reads no pair, whatever it is given
    alone = len(source.readers) == 1 and source.scale > 1
    if other is None or not alone or not is_folder(root.parent / other):
        return ""
    return f"; {root.parent} holds '{LR_FOLDER}' and '{HR_FOLDER}': name that to use both"


def _describe_buffers(reader: FrameReader) -> str:
    held = ", ".join(sorted(reader.stored))
    camera = ", camera" if reader.has_camera else ""
    return f"{reader.frames.root} (layout '{reader.layout.name}') has: {held}{camera}"
