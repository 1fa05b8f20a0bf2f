"""What an upscaler is fed: for each frame number an LR frame and the HR G-buffer beside it.

Real pairs come from two folders, simulated ones from one HR capture.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import torch

from rtsr_cli.core.choices import NonfinitePolicy
from rtsr_cli.core.derive import DerivationConfig, Needs, derive, needs
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import RADIANCE_BUFFERS, Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.io.exr import Window
from rtsr_cli.core.io.nonfinite import checked
from rtsr_cli.core.io.reading import FrameReader
from rtsr_cli.core.io.selection import ranges
from rtsr_cli.core.io.simulation import Simulation, averaged, decimated
from rtsr_cli.core.shapes import Size

DECLARED_MOTION = "a declared motion convention"
"""What is missing where nothing decides how vectors are stored."""


@dataclass(frozen=True, kw_only=True)
class Inputs:
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
    def output_window(self) -> tuple[Window, Window]:
        """Data and display window of the outputs."""

    @property
    def readers(self) -> tuple[FrameReader, ...]:
        """Every reader behind the pairs."""

    @property
    def frame_bytes(self) -> int:
        """Memory that reading one frame takes, generously."""

    def missing(self, inputs: Inputs) -> tuple[str, ...]:
        """Name what a system needs and these files do not have."""

    def files(self, number: int, inputs: Inputs) -> tuple[Path, ...]:
        """Every file that `load` opens for a frame."""

    def load(self, number: int, inputs: Inputs) -> FramePair:
        """Read and derive a frame at both resolutions."""


def _available(
    wanted: Collection[Buffer], optional: Collection[Buffer], reader: FrameReader, inputs: Inputs
) -> tuple[Needs, tuple[Buffer, ...]]:
    """Resolve required buffers plus those optional ones that can be had."""

    def resolve(buffers: Collection[Buffer]) -> Needs:
        return needs(
            buffers, reader.readable, has_camera=reader.has_camera, config=inputs.derivation
        )

    extra = tuple(b for b in optional if not resolve((b,)).missing)
    used = (*wanted, *extra)
    return resolve(used), used


def _undeclared(missing: Collection[str], reader: FrameReader) -> tuple[str, ...]:
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
    def output_window(self) -> tuple[Window, Window]:
        """Windows of the HR frames, or those of the LR frames enlarged."""
        if self.hr is not None:
            return self.hr.region, self.hr.display
        return self.lr.region.scaled(self.scale), self.lr.display.scaled(self.scale)

    @property
    def readers(self) -> tuple[FrameReader, ...]:
        """LR's and HR's."""
        return (self.lr,) if self.hr is None else (self.lr, self.hr)

    @property
    def frame_bytes(self) -> int:
        """Both resolutions."""
        return self.lr.frame_bytes + (0 if self.hr is None else self.hr.frame_bytes)

    def missing(self, inputs: Inputs) -> tuple[str, ...]:
        """Name what is missing, with the resolution it is missing at."""
        lr, _ = _available(inputs.lr, (), self.lr, inputs)
        lacking = [f"lr {m}" for m in lr.missing]
        if inputs.hr:
            hr = () if self.hr is None else _available(inputs.hr, (), self.hr, inputs)[0].missing
            lacking += ["hr frames"] if self.hr is None else [f"hr {m}" for m in hr]
        return _undeclared(lacking, self.lr)

    def files(self, number: int, inputs: Inputs) -> tuple[Path, ...]:
        """Files of both resolutions."""
        found = self.lr.files(
            number, _available(inputs.lr, inputs.lr_optional, self.lr, inputs)[0].read
        )
        if self.hr is None or not inputs.hr + inputs.hr_optional:
            return found
        wanted = _available(inputs.hr, inputs.hr_optional, self.hr, inputs)[0].read
        return found + self.hr.files(self.lr.held.get(number, number), wanted)

    def load(self, number: int, inputs: Inputs) -> FramePair:
        """Read both frames; HR radiance is never among what is asked for."""
        lr_needs, lr_used = _available(inputs.lr, inputs.lr_optional, self.lr, inputs)
        lr, fixed = checked(self.lr.read(number, lr_needs.read), inputs.on_nonfinite)
        lr = derive(lr, lr_used, inputs.derivation)
        if self.hr is None or not inputs.hr + inputs.hr_optional:
            return FramePair(lr, None, fixed)
        hr_needs, hr_used = _available(inputs.hr, inputs.hr_optional, self.hr, inputs)
        hr, fixed_hr = checked(
            self.hr.read(self.lr.held.get(number, number), hr_needs.read - RADIANCE_BUFFERS),
            inputs.on_nonfinite,
        )
        return FramePair(lr, derive(hr, hr_used, inputs.derivation), fixed + fixed_hr)


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
    def output_window(self) -> tuple[Window, Window]:
        """Windows of the capture, less the samples of a pixel."""
        k = self.simulation.samples_per_pixel
        return _shrunk(self.capture.region, k), _shrunk(self.capture.display, k)

    @property
    def readers(self) -> tuple[FrameReader, ...]:
        """The capture's."""
        return (self.capture,)

    @property
    def frame_bytes(self) -> int:
        """The capture's."""
        return self.capture.frame_bytes

    def missing(self, inputs: Inputs) -> tuple[str, ...]:
        """Name what the capture lacks."""
        lacking = _available(inputs.lr + inputs.hr, (), self.capture, inputs)[0].missing
        return _undeclared(lacking, self.capture)

    def files(self, number: int, inputs: Inputs) -> tuple[Path, ...]:
        """Files of the capture."""
        lr, _ = _available(inputs.lr, inputs.lr_optional, self.capture, inputs)
        hr, _ = _available(inputs.hr, inputs.hr_optional, self.capture, inputs)
        return self.capture.files(number, lr.read | hr.read)

    def load(self, number: int, inputs: Inputs) -> FramePair:
        """Read the capture once; radiance goes to the LR frame only, and only its samples do."""
        lr_needs, lr_used = _available(inputs.lr, inputs.lr_optional, self.capture, inputs)
        hr_needs, hr_used = _available(inputs.hr, inputs.hr_optional, self.capture, inputs)
        full = self.capture.read(number, lr_needs.read | hr_needs.read)
        lr, fixed = checked(decimated(full, lr_needs.read, self.simulation), inputs.on_nonfinite)
        lr = derive(lr, lr_used, inputs.derivation)
        if not hr_used:
            return FramePair(lr, None, fixed)
        full = replace(full, gbuffer=full.gbuffer.only(hr_needs.read - RADIANCE_BUFFERS))
        hr, fixed_hr = checked(full, inputs.on_nonfinite)
        hr = averaged(derive(hr, hr_used, inputs.derivation), self.simulation.samples_per_pixel)
        return FramePair(lr, hr, fixed + fixed_hr)


def _shrunk(window: Window, k: int) -> Window:
    return Window(
        left=window.left // k,
        top=window.top // k,
        width=window.width // k,
        height=window.height // k,
    )


def simulated_pairs(capture: FrameReader, simulation: Simulation) -> SimulatedPairs:
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


def real_pairs(
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
            f"{hr.frames.root}: HR lacks frames {ranges(lacking)} that LR has in "
            f"{lr.frames.root}; render them, or use --on-missing skip"
        )
    lr = replace(lr, numbers=tuple(n for n in lr.numbers if n not in set(lacking)))
    return RealPairs(lr=lr, hr=hr, scale=ratio)


def _check_windows(lr: FrameReader, hr: FrameReader, scale: int) -> None:
    """Raise where the pixels of both resolutions do not show the same part of the image plane."""
    if lr.view.scaled(scale) != hr.view:
        raise FrameFolderError(
            f"{hr.frames.root}: HR shows another part of the image plane than LR in "
            f"{lr.frames.root} (data windows {hr.region} and {lr.region}, display windows "
            f"{hr.display} and {lr.display}); render both with the same crop"
        )
