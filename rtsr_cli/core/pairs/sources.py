"""What an upscaler is fed: for each frame number an LR frame and the HR G-buffer beside it.

`real_pairs` come from two folders, `simulated_pairs` from one HR capture.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import torch

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.regions import OutputWindows
from rtsr_cli.core.choices import NonfinitePolicy
from rtsr_cli.core.files.exr import ExrHeader
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera_needs import name_lacking, say_frames
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.coverage import CoveredColor
from rtsr_cli.core.imaging.derivation import CAMERA, DerivationConfig, resolve_needs
from rtsr_cli.core.pairs.nonfinite import apply_policy, count_negative
from rtsr_cli.core.pairs.straight_radiance import take_coverage_out
from rtsr_cli.core.pairs.window import Reads, resolve_reads
from rtsr_cli.core.shapes import Mask, Size
from rtsr_cli.core.wording import join_names

DECLARED_MOTION = "a declared motion convention"
"""What is missing where nothing decides how vectors are stored."""

NAMED_LAYOUT = "a named layout"
"""What is missing where nothing proves that channels mean what their names say."""
HR_FRAMES = "hr frames"
"""What is missing where a system reads both resolutions, and only one is there."""

FITTING_HR = "frames of hr that fit lr"
"""What is missing where those that are there are turned, or of other moments."""


@dataclass(frozen=True, kw_only=True)
class PairInputs:
    """What a system asks of a pair, and how bad pixels are treated.

    Attributes:
        lr, hr: buffers it must have.
        lr_optional, hr_optional: buffers it uses where they are there.
        derivation: what divides radiance.
        on_nonfinite: policy for NaN and Inf.
        straight: take premultiplied LR radiance apart, so that a system sees the colour of what
            covers a pixel; `FramePair.covered` puts it together again.
        filter_known: tell LR frames how wide a pixel filter went over their radiance.
    """

    lr: tuple[Buffer, ...]
    hr: tuple[Buffer, ...] = ()
    lr_optional: tuple[Buffer, ...] = ()
    hr_optional: tuple[Buffer, ...] = ()
    derivation: DerivationConfig = field(default_factory=DerivationConfig)
    on_nonfinite: NonfinitePolicy = NonfinitePolicy.ERROR
    straight: bool = False
    filter_known: bool = False


@dataclass(frozen=True)
class FramePair:
    """One frame at both resolutions; `hr` never holds radiance.

    Attributes:
        lr, hr: the frames.
        fixed: NaN and Inf that were repaired.
        negative: values of radiance below 0.
        covered: what the LR radiance was taken apart to, None where it is as stored.
        doubted: why LR samples were left undivided though their material is above 0 -> which.
        colours: of some of these reasons -> what the material is at both sizes.
        bare: LR samples in whose blocks HR has no material of its own; None where none was doubted.
    """

    lr: Frame
    hr: Frame | None
    fixed: int = 0
    negative: int = 0
    covered: CoveredColor | None = None
    doubted: Mapping[str, Mask] = field(default_factory=dict)
    colours: Mapping[str, str] = field(default_factory=dict)
    bare: Mask | None = None

    def to(self, device: torch.device | str) -> FramePair:
        """Return the same pair on another device."""
        covered = None if self.covered is None else self.covered.to(device)
        hr = None if self.hr is None else self.hr.to(device)
        return replace(self, lr=self.lr.to(device), hr=hr, covered=covered)


@dataclass(frozen=True, kw_only=True)
class CheckedFrame:
    """A frame as it was read, before anything is derived from it.

    Attributes:
        frame: NaN and Inf repaired, radiance taken apart where that was asked for.
        fixed, negative, covered: as in `FramePair`.
    """

    frame: Frame
    fixed: int
    negative: int
    covered: CoveredColor | None


def check_frame(frame: Frame, inputs: PairInputs) -> CheckedFrame:
    """Repair or refuse NaN and Inf, count radiance below 0, and take coverage out of it.

    Raises:
        FrameFolderError: policy `error` and a bad value; names folder, frame and buffer.
    """
    frame, fixed = apply_policy(frame, inputs.on_nonfinite)
    negative = count_negative(frame)
    covered = None
    if inputs.straight:
        frame, covered = take_coverage_out(frame)
    return CheckedFrame(frame=frame, fixed=fixed, negative=negative, covered=covered)


class PairSource(Protocol):
    """Frames that can be upscaled, in order."""

    @property
    def reader(self) -> FrameReader:
        """The reader that names and numbers the outputs."""

    @property
    def scale(self) -> int:
        """Output pixels per LR pixel."""

    @property
    def lr_size(self) -> Size:
        """(height, width) of the LR frames."""

    def place_output(self, header: ExrHeader) -> OutputWindows:
        """Say where the output of a frame lies, whose file of the `reader` has this header."""

    @property
    def readers(self) -> tuple[FrameReader, ...]:
        """Every reader behind the pairs."""

    @property
    def jitters(self) -> bool:
        """Tell whether LR samples lie elsewhere from frame to frame, as far as is known."""

    @property
    def filter_width_px(self) -> float | None:
        """Standard deviation of the pixel filter that went over LR radiance and not over its
        G-buffer, LR pixels; 0 of point samples, None where nothing tells.
        """

    @property
    def filter_measured(self) -> bool:
        """Tell whether that width was measured and is not 0."""

    @property
    def looks_filtered(self) -> bool | None:
        """Tell whether LR radiance was filtered, by its HR material; None where that tells nothing.

        It may be where no width is known: wider than those that are tried.
        """

    @property
    def filter_doubt(self) -> str:
        """Say that a declared width is not what the frames have; empty where nothing says so."""

    @property
    def misfit(self) -> str:
        """Say how HR frames are turned beside LR's, or of other moments; empty if they are not."""

    @property
    def misfit_doubt(self) -> str:
        """Say that both sizes hardly show one picture, and nothing tells why; empty if they do."""

    @property
    def frame_bytes(self) -> int:
        """Memory that reading one frame takes, generously."""

    def resolve(self, inputs: PairInputs) -> PairReads:
        """Say what is read for a system, at both resolutions."""

    def missing(
        self, inputs: PairInputs, numbers: Collection[int] | None = None
    ) -> tuple[str, ...]:
        """Name what a system needs of some frames, or of all, and these files do not have."""

    def files(self, number: int, inputs: PairInputs) -> tuple[Path, ...]:
        """Every file that `load` opens for a frame."""

    def load(self, number: int, inputs: PairInputs) -> FramePair:
        """Read and derive a frame at both resolutions."""


@dataclass(frozen=True, kw_only=True)
class PairReads:
    """What a system's inputs come to in the files of a shot, at both resolutions."""

    lr: Reads
    hr: Reads


def resolve_buffers(
    required: Collection[Buffer],
    optional: Collection[Buffer],
    reader: FrameReader,
    inputs: PairInputs,
    unread: Collection[Buffer] = (),
) -> Reads:
    """Say what is read of one resolution, and what is missing there.

    Args:
        required, optional: as for `resolve_reads`.
        reader: of the frames.
        inputs: that are asked for.
        unread: buffers that are left alone, though they are there.
    """
    reads = resolve_reads(
        required,
        [buffer for buffer in optional if buffer not in unread],
        reader.readable.difference(unread),
        has_camera=reader.has_camera,
        derivation=inputs.derivation,
    )
    if not reads.missing:
        return reads
    missing = name_partial(required, reader, inputs.derivation)
    return replace(reads, missing=missing)


def name_partial(
    required: Collection[Buffer], reader: FrameReader, derivation: DerivationConfig
) -> tuple[str, ...]:
    """Name what is missing: where some frames alone lack it, the buffer that the others hold.

    A system that divides by `material` lacks nothing else where one frame has none; what material
    could be derived from instead would be asked of all frames for the sake of one.

    Args:
        required: buffers that are wanted, stored or derived.
        reader: of the frames.
        derivation: what divides radiance.
    """
    partial = reader.partial.keys()
    names: dict[str, None] = {}
    for buffer in required:
        now, whole = (
            resolve_needs((buffer,), stored, has_camera=reader.has_camera, config=derivation)
            for stored in (reader.readable, reader.readable | partial)
        )
        held = sorted(whole.read & partial) if whole.missing != now.missing else []
        names.update(dict.fromkeys((*held, *whole.missing) if now.missing else ()))
    return tuple(names)


def describe_missing(
    missing: Collection[str], reader: FrameReader, size: str = ""
) -> tuple[str, ...]:
    """Say what is missing of the frames of a reader.

    Of vectors that are there it is their declaration, of depth and normals that a camera converts
    the camera, and of the camera the frames without.

    Args:
        missing: names of buffers, or `CAMERA`.
        reader: of the frames.
        size: "lr " or "hr ", where there are two resolutions.
    """
    if reader.undecided and missing:
        return (NAMED_LAYOUT,)
    return name_once(_describe_one(name, reader, size) for name in missing)


CONTRADICTED = " that agrees with depth and cameras (what is there is warned of)"
"""Said behind a buffer that is there, and that what the frames show speaks against."""

CONVERTS = " (to convert "
"""Stands between a camera and the buffers that cannot be read without it."""


def name_once(missing: Iterable[str]) -> tuple[str, ...]:
    """Name each thing once: a camera that converts buffers is the camera that is wanted anyhow."""
    known: dict[str, dict[str, None]] = {}
    for name in missing:
        what, _, converted = name.partition(CONVERTS)
        reasons = known.setdefault(what, {})
        reasons.update({converted.removesuffix(")"): None} if converted else {})
    return tuple(
        f"{what}{CONVERTS}{join_names(reasons)})" if reasons else what
        for what, reasons in known.items()
    )


def describe_lacking(
    numbers: Collection[int], buffers: Collection[Buffer], reader: FrameReader, size: str = ""
) -> tuple[str, ...]:
    """Say which frames lack a buffer that others of the same reader hold.

    Args:
        numbers: of the frames that are read.
        buffers: that are read of them.
        reader: of the frames.
        size: as for `describe_missing`.
    """
    found = reader.list_lacking(numbers, buffers)
    return tuple(f"{size}{buffer} of {say_frames(without)}" for buffer, without in found.items())


def _describe_one(name: str, reader: FrameReader, size: str) -> str:
    if name == CAMERA:
        lacking = reader.without_camera
        every = len(lacking) == len(reader.cameras)
        bare = [n for n in lacking if not reader.cameras[n].fault]
        why = f" ({reader.camera_faults})" if reader.camera_faults else ""
        return f"{size}{CAMERA}{name_lacking(bare, everywhere=every)}{why}"
    unmet, without = reader.unmet.get(Buffer(name)), reader.lacking.get(Buffer(name))
    if without:
        return f"{size}{name} of {say_frames(without)}"
    if unmet is not None:
        return f"{size}{CAMERA}{unmet.frames}{CONVERTS}{name} from {unmet.need.stored_as})"
    if Buffer(name) in reader.contradicted:
        return f"{size}{name}{CONTRADICTED}"
    return DECLARED_MOTION if name in reader.stored - reader.readable else f"{size}{name}"
