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
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.frames.vectors import normalized
from rtsr_cli.core.imaging.resampling import (
    box_mean,
    decimate,
    decimate_filtered,
    halton_offset,
    sample_jitter,
)


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """How LR frames are made from an HR capture.

    Attributes:
        scale: S, output pixels per LR pixel.
        samples_per_pixel: K, capture pixels per output pixel.
        jitter: which sample of a block is kept.
        lr_filter: pixel filter of the radiance before decimation, or "none".
    """

    scale: int
    samples_per_pixel: int = 1
    jitter: JitterMode = JitterMode.NONE
    lr_filter: str = "none"

    @property
    def block(self) -> int:
        """Capture pixels per LR pixel, along an axis."""
        return self.scale * self.samples_per_pixel

    def offset(self, number: int) -> tuple[int, int]:
        """Sample (x, y) of each block that frame `number` keeps."""
        if self.jitter is JitterMode.HALTON:
            return halton_offset(number, self.block)
        return self.block // 2, self.block // 2


def decimated(full: Frame, buffers: Collection[Buffer], simulation: Simulation) -> Frame:
    """Make the LR frame of a capture: one sample of each block, its offset recorded as jitter."""
    block = simulation.block
    offset = simulation.offset(full.number)

    def shrink(buffer: Buffer, tensor: Tensor) -> Tensor:
        if buffer is Buffer.COLOR and simulation.lr_filter != "none":
            return decimate_filtered(tensor, simulation.lr_filter, block, offset)
        small = decimate(tensor, block, offset).contiguous()
        return small / block if buffer in VECTOR_BUFFERS else small

    height, width = full.view.display
    return replace(
        full,
        gbuffer=full.gbuffer.only(buffers).map(shrink),
        camera=replace(
            full.camera,
            jitter_px=(sample_jitter(offset[0], block), sample_jitter(offset[1], block)),
        ),
        view=View(
            display=(height // block, width // block),
            top=full.view.top // block,
            left=full.view.left // block,
        ),
    )


def averaged(full: Frame, k: int) -> Frame:
    """Make a frame of K x K samples a pixel: means, or the middle sample where means mislead."""
    if k == 1:
        return full

    def shrink(buffer: Buffer, tensor: Tensor) -> Tensor:
        if BUFFER_SPECS[buffer].resampling is Resampling.SAMPLE:
            small = decimate(tensor, k, (k // 2, k // 2)).contiguous()
            return small / k if buffer in VECTOR_BUFFERS else small
        mean = box_mean(tensor, k)
        return normalized(mean) if buffer in NORMAL_BUFFERS else mean

    height, width = full.view.display
    view = View(display=(height // k, width // k), top=full.view.top // k, left=full.view.left // k)
    return replace(full, gbuffer=full.gbuffer.map(shrink), view=view)
