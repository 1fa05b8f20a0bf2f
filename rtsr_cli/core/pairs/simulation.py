"""LR frames made from an HR capture, as a renderer of that size would sample.

LR sample (x, y) of each block of `samples_per_pixel * scale` capture pixels is kept; its offset
from the LR pixel's centre is recorded as the frame's jitter.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from torch import Tensor

from rtsr_cli.core.choices import JitterMode
from rtsr_cli.core.frames.buffers import (
    BUFFER_SPECS,
    NORMAL_BUFFERS,
    VECTOR_BUFFERS,
    Buffer,
    Resampling,
)
from rtsr_cli.core.frames.camera import View
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.frames.vector_length import normalize_vectors
from rtsr_cli.core.imaging.resampling import (
    box_mean,
    decimate,
    decimate_filtered,
    halton_offset,
    measure_filter_width,
    sample_jitter,
)

Offset = tuple[int, int]
"""Sample (x, y) of a block that is kept."""


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """How LR frames are made from an HR capture.

    Attributes:
        scale: S, output pixels per LR pixel.
        samples_per_pixel: K, capture pixels per output pixel.
        jitter: which sample of a block is kept.
        phase: added to frame numbers where the jitter's sequence is looked up.
        lr_filter: pixel filter of the radiance before decimation, or "none".
    """

    scale: int
    samples_per_pixel: int = 1
    jitter: JitterMode = JitterMode.NONE
    phase: int = 0
    lr_filter: str = "none"

    @property
    def block(self) -> int:
        """Capture pixels per LR pixel, along an axis."""
        return self.scale * self.samples_per_pixel

    def offset(self, number: int) -> Offset:
        """Sample (x, y) of each block that frame `number` keeps."""
        if self.jitter is JitterMode.HALTON:
            return halton_offset(number + self.phase, self.block)
        return self.block // 2, self.block // 2

    def jitter_px(self, number: int) -> Jitter:
        """Where the samples of frame `number` lie, minus LR pixel centres, in LR pixels."""
        x, y = self.offset(number)
        return sample_jitter(x, self.block), sample_jitter(y, self.block)

    @property
    def filter_width_px(self) -> float:
        """Standard deviation of the pixel filter, LR pixels; 0 where there is none."""
        if self.lr_filter == "none":
            return 0.0
        return measure_filter_width(self.lr_filter, self.block)


def keep_samples(buffer: Buffer, tensor: Tensor, simulation: Simulation, offset: Offset) -> Tensor:
    """Keep one sample of each block; vectors become LR pixels.

    Radiance is filtered first, and coverage with it: it is premultiplied by just that.
    """
    block = simulation.block
    if buffer in (Buffer.COLOR, Buffer.ALPHA) and simulation.lr_filter != "none":
        return decimate_filtered(tensor.float(), simulation.lr_filter, block, offset)
    small = decimate(tensor, block, offset).contiguous()
    # what is stored as halves would be rounded by a division
    return small.float() / block if buffer in VECTOR_BUFFERS else small


def shrink_view(view: View, block: int) -> View:
    """Return the same part of the image plane at a resolution that is `block` times smaller."""
    height, width = view.display
    return View(
        display=(height // block, width // block), top=view.top // block, left=view.left // block
    )


def decimate_frame(full: Frame, buffers: Collection[Buffer], simulation: Simulation) -> Frame:
    """Make the LR frame of a capture: one sample of each block, its offset recorded as jitter."""
    offset = simulation.offset(full.number)
    return replace(
        full,
        gbuffer=full.gbuffer.only(buffers).map(
            lambda buffer, tensor: keep_samples(buffer, tensor, simulation, offset)
        ),
        camera=replace(full.camera, jitter_px=simulation.jitter_px(full.number)),
        view=shrink_view(full.view, simulation.block),
        filter_width_px=simulation.filter_width_px,
    )


def average_samples(full: Frame, k: int) -> Frame:
    """Make a frame of K x K samples a pixel: means, or the middle sample where means mislead."""
    if k == 1:
        return full

    def shrink(buffer: Buffer, tensor: Tensor) -> Tensor:
        if BUFFER_SPECS[buffer].resampling is Resampling.SAMPLE:
            small = decimate(tensor, k, (k // 2, k // 2)).contiguous()
            return small / k if buffer in VECTOR_BUFFERS else small
        mean = box_mean(tensor, k)
        return normalize_vectors(mean) if buffer in NORMAL_BUFFERS else mean

    beside = {name: box_mean(color, k) for name, color in full.beside.items()}
    return replace(
        full, gbuffer=full.gbuffer.map(shrink), view=shrink_view(full.view, k), beside=beside
    )
