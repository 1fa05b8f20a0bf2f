"""What an upscaler is fed: for each frame number an LR frame and the HR G-buffer beside it.

Real pairs come from two folders, simulated ones from one HR capture.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Protocol

import torch

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.choices import NonfinitePolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import PixelWindow
from rtsr_cli.core.frames.buffers import RADIANCE_BUFFERS, Buffer
from rtsr_cli.core.frames.selection import format_ranges
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.derivation import DerivationConfig
from rtsr_cli.core.pairs.nonfinite import apply_policy
from rtsr_cli.core.pairs.simulation import Simulation, decimate_frame
from rtsr_cli.core.pairs.window import Reads, build_hr, build_lr, resolve_reads, select_hr
from rtsr_cli.core.shapes import Size

DECLARED_MOTION = "a declared motion convention"
"""What is missing where nothing decides how vectors are stored."""


@dataclass(frozen=True, kw_only=True)
class PairInputs:
    """What a system asks of a pair, and how bad pixels are treated.

    Attributes:
        lr, hr: buffers it must have.
        lr_optional, hr_optional: buffers it uses where they are there.
        derivation: what divides radiance.
        on_nonfinite: policy for NaN and Inf.
    """

    lr: tuple[Buffer, ...]
    hr: tuple[Buffer, ...] = ()
    lr_optional: tuple[Buffer, ...] = ()
    hr_optional: tuple[Buffer, ...] = ()
    derivation: DerivationConfig = field(default_factory=DerivationConfig)
    on_nonfinite: NonfinitePolicy = NonfinitePolicy.ERROR


@dataclass(frozen=True)
class FramePair:
    """One frame at both resolutions; `hr` never holds radiance. `fixed` counts bad pixels."""

    lr: Frame
    hr: Frame | None
    fixed: int = 0

    def to(self, device: torch.device | str) -> FramePair:
        """Return the same pair on another device."""
        return replace(self, lr=self.lr.to(device), hr=self.hr and self.hr.to(device))


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

    @property
    def output_window(self) -> tuple[PixelWindow, PixelWindow]:
        """Data and display window of the outputs."""

    @property
    def readers(self) -> tuple[FrameReader, ...]:
        """Every reader behind the pairs."""

    @property
    def frame_bytes(self) -> int:
        """Memory that reading one frame takes, generously."""

    def missing(self, inputs: PairInputs) -> tuple[str, ...]:
        """Name what a system needs and these files do not have."""

    def files(self, number: int, inputs: PairInputs) -> tuple[Path, ...]:
        """Every file that `load` opens for a frame."""

    def load(self, number: int, inputs: PairInputs) -> FramePair:
        """Read and derive a frame at both resolutions."""


@dataclass(frozen=True, kw_only=True)
class PairReads:
    """What a system's inputs come to in the files of a shot, at both resolutions."""

    lr: Reads
    hr: Reads


def _resolve(
    required: Collection[Buffer],
    optional: Collection[Buffer],
    reader: FrameReader,
    inputs: PairInputs,
) -> Reads:
    return resolve_reads(
        required,
        optional,
        reader.readable,
        has_camera=reader.has_camera,
        derivation=inputs.derivation,
    )


def _describe_undeclared(missing: Collection[str], reader: FrameReader) -> tuple[str, ...]:
    """Say of vectors that are there that it is their declaration that is missing."""
    unread = {f"{size}{b}" for size in ("", "lr ") for b in reader.stored - reader.readable}
    return tuple(dict.fromkeys(DECLARED_MOTION if m in unread else m for m in missing))


@dataclass(frozen=True, kw_only=True)
class RealPairs:
    """LR frames, and HR frames beside them (or none) of `scale` times their size."""

    lr: FrameReader
    hr: FrameReader | None
    scale: int

    @property
    def reader(self) -> FrameReader:
        """The LR reader."""
        return self.lr

    @property
    def lr_size(self) -> Size:
        """(height, width) of the LR frames."""
        return self.lr.size

    @property
    def output_window(self) -> tuple[PixelWindow, PixelWindow]:
        """Windows of the HR frames, or those of the LR frames enlarged."""
        if self.hr is not None:
            return self.hr.region, self.hr.display
        return self.lr.region.at_scale(self.scale), self.lr.display.at_scale(self.scale)

    @property
    def readers(self) -> tuple[FrameReader, ...]:
        """LR's and HR's."""
        return (self.lr,) if self.hr is None else (self.lr, self.hr)

    @property
    def frame_bytes(self) -> int:
        """Both resolutions."""
        return self.lr.frame_bytes + (0 if self.hr is None else self.hr.frame_bytes)

    @cached_property
    def _resolved(self) -> dict[PairInputs, PairReads]:
        """Of inputs that were asked for; nothing else about a source ever changes."""
        return {}

    def resolve(self, inputs: PairInputs) -> PairReads:
        """Say what is read for a system; without HR frames nothing is read of them."""
        if inputs not in self._resolved:
            lr = _resolve(inputs.lr, inputs.lr_optional, self.lr, inputs)
            hr = Reads(stored=frozenset(), used=())
            if self.hr is not None:
                hr = _resolve(inputs.hr, inputs.hr_optional, self.hr, inputs)
            self._resolved[inputs] = PairReads(lr=lr, hr=hr)
        return self._resolved[inputs]

    def missing(self, inputs: PairInputs) -> tuple[str, ...]:
        """Name what is missing, with the resolution it is missing at."""
        reads = self.resolve(inputs)
        lacking = [f"lr {m}" for m in reads.lr.missing]
        if inputs.hr:
            hr = [f"hr {m}" for m in reads.hr.missing]
            lacking += ["hr frames"] if self.hr is None else hr
        return _describe_undeclared(lacking, self.lr)

    def files(self, number: int, inputs: PairInputs) -> tuple[Path, ...]:
        """Files of both resolutions."""
        reads = self.resolve(inputs)
        lr = self.lr.files(number, reads.lr.stored)
        if self.hr is None or not inputs.hr + inputs.hr_optional:
            return lr
        return lr + self.hr.files(self.lr.held.get(number, number), reads.hr.stored)

    def load(self, number: int, inputs: PairInputs) -> FramePair:
        """Read both frames; HR radiance is never among what is asked for."""
        reads = self.resolve(inputs)
        lr, fixed = apply_policy(self.lr.read(number, reads.lr.stored), inputs.on_nonfinite)
        lr = build_lr(lr, reads.lr, inputs.derivation)
        if self.hr is None or not inputs.hr + inputs.hr_optional:
            return FramePair(lr, None, fixed)
        stored = reads.hr.stored - RADIANCE_BUFFERS
        hr = self.hr.read(self.lr.held.get(number, number), stored)
        hr, fixed_hr = apply_policy(hr, inputs.on_nonfinite)
        return FramePair(lr, build_hr(hr, reads.hr, inputs.derivation), fixed + fixed_hr)


@dataclass(frozen=True, kw_only=True)
class SimulatedPairs:
    """Both resolutions from one HR capture."""

    capture: FrameReader
    simulation: Simulation

    @property
    def reader(self) -> FrameReader:
        """The capture's reader."""
        return self.capture

    @property
    def scale(self) -> int:
        """Output pixels per LR pixel."""
        return self.simulation.scale

    @property
    def lr_size(self) -> Size:
        """(height, width) of the LR frames."""
        height, width = self.capture.size
        return height // self.simulation.block, width // self.simulation.block

    @property
    def output_window(self) -> tuple[PixelWindow, PixelWindow]:
        """Windows of the capture, less the samples of a pixel."""
        k = self.simulation.samples_per_pixel
        return _shrink_window(self.capture.region, k), _shrink_window(self.capture.display, k)

    @property
    def readers(self) -> tuple[FrameReader, ...]:
        """The capture's."""
        return (self.capture,)

    @property
    def frame_bytes(self) -> int:
        """The capture's."""
        return self.capture.frame_bytes

    @cached_property
    def _resolved(self) -> dict[PairInputs, PairReads]:
        """Of inputs that were asked for; nothing else about a source ever changes."""
        return {}

    def resolve(self, inputs: PairInputs) -> PairReads:
        """Say what is read for a system."""
        if inputs not in self._resolved:
            self._resolved[inputs] = PairReads(
                lr=_resolve(inputs.lr, inputs.lr_optional, self.capture, inputs),
                hr=_resolve(inputs.hr, inputs.hr_optional, self.capture, inputs),
            )
        return self._resolved[inputs]

    def missing(self, inputs: PairInputs) -> tuple[str, ...]:
        """Name what the capture lacks."""
        reads = self.resolve(inputs)
        return _describe_undeclared((*reads.lr.missing, *reads.hr.missing), self.capture)

    def files(self, number: int, inputs: PairInputs) -> tuple[Path, ...]:
        """Files of the capture."""
        reads = self.resolve(inputs)
        return self.capture.files(number, reads.lr.stored | reads.hr.stored)

    def load(self, number: int, inputs: PairInputs) -> FramePair:
        """Read the capture once; radiance goes to the LR frame only, and only its samples do."""
        reads, derivation = self.resolve(inputs), inputs.derivation
        full = self.capture.read(number, reads.lr.stored | reads.hr.stored)
        small = decimate_frame(full, reads.lr.stored, self.simulation)
        lr, fixed = apply_policy(small, inputs.on_nonfinite)
        lr = build_lr(lr, reads.lr, derivation)
        if not reads.hr.used:
            return FramePair(lr, None, fixed)
        hr, fixed_hr = apply_policy(select_hr(full, reads.hr), inputs.on_nonfinite)
        hr = build_hr(hr, reads.hr, derivation, self.simulation.samples_per_pixel)
        return FramePair(lr, hr, fixed + fixed_hr)


def _shrink_window(window: PixelWindow, k: int) -> PixelWindow:
    return PixelWindow(
        left=window.left // k,
        top=window.top // k,
        width=window.width // k,
        height=window.height // k,
    )


def open_simulated_pairs(capture: FrameReader, simulation: Simulation) -> SimulatedPairs:
    """Check that a capture can be decimated.

    Raises:
        FrameFolderError: its size is not a multiple of the block.
    """
    height, width = capture.size
    offsets = (capture.region.left, capture.region.top)
    if any(v % simulation.block for v in (height, width, *offsets)):
        raise FrameFolderError(
            f"{capture.frames.root}: {width} x {height} pixels at {offsets} cannot be decimated "
            f"by {simulation.block}; choose a scale that divides them, or crop the frames"
        )
    return SimulatedPairs(capture=capture, simulation=simulation)


def open_real_pairs(
    lr: FrameReader, hr: FrameReader | None, scale: int | None, *, skip_missing: bool = False
) -> RealPairs:
    """Match LR and HR frames.

    Args:
        lr: the frames to enlarge.
        hr: their G-buffers at the target size, or None.
        scale: as asked for, or None to take it from the sizes.
        skip_missing: leave out frames that HR lacks, instead of refusing.

    Raises:
        FrameFolderError: HR lacks a frame, is no multiple of LR, or contradicts `scale`.
    """
    if hr is None:
        if scale is None:
            raise FrameFolderError(
                f"{lr.frames.root}: there are no HR frames to take the scale from; add "
                "'hr/', name it with --hr, or give --scale (--simulate-lr makes LR frames)"
            )
        return RealPairs(lr=lr, hr=None, scale=scale)
    (lr_h, lr_w), (hr_h, hr_w) = lr.size, hr.size
    ratio = hr_w // lr_w
    if ratio < 1 or (hr_h, hr_w) != (lr_h * ratio, lr_w * ratio):
        raise FrameFolderError(
            f"{hr.frames.root}: HR is {hr_w} x {hr_h}, which is no whole multiple of LR "
            f"{lr_w} x {lr_h} in {lr.frames.root}; render both with one ratio"
        )
    if scale is not None and scale != ratio:
        raise FrameFolderError(
            f"{hr.frames.root}: HR is {ratio} times the size of LR, not {scale} times; "
            f"leave --scale out, or give frames of that ratio"
        )
    _check_windows(lr, hr, ratio)
    lacking = sorted(set(lr.numbers) - set(hr.numbers))
    if lacking and not skip_missing:
        raise FrameFolderError(
            f"{hr.frames.root}: HR lacks frames {format_ranges(lacking)} that LR has in "
            f"{lr.frames.root}; render them, or use --on-missing skip"
        )
    lr = replace(lr, numbers=tuple(n for n in lr.numbers if n not in set(lacking)))
    return RealPairs(lr=lr, hr=hr, scale=ratio)


def _check_windows(lr: FrameReader, hr: FrameReader, scale: int) -> None:
    """Raise where the pixels of both resolutions do not show the same part of the image plane."""
    if lr.view.at_scale(scale) != hr.view:
        raise FrameFolderError(
            f"{hr.frames.root}: HR shows another part of the image plane than LR in "
            f"{lr.frames.root} (data windows {hr.region} and {lr.region}, display windows "
            f"{hr.display} and {lr.display}); render both with the same crop"
        )
