"""LR samples that are unlike all HR pixels around them, counted.

A sample strays as `pair_agreement` has it, and does so for sure where all these pixels are alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.pairs.pair_agreement import (
    ABSOLUTE,
    ENOUGH_SAMPLES,
    FAR_BETTER,
    FEW_STRAYS,
    LEAST_SAMPLES,
    RELATIVE,
)
from rtsr_cli.core.shapes import Image, Size

FLAT = 0.1
"""What HR pixels around a sample differ by at most where they are alike; of depth, of itself."""

FEW_FLAT = 0.001
"""Share of samples that stray from HR pixels that are alike, up to which nothing is doubted: of
right pairs more do where textures are finer than HR pixels."""

SPARSE = (Buffer.EMISSION, Buffer.METALLIC)
"""Buffers that are 0 on most surfaces, which tell nothing."""

LEAST_LIT = 32
"""Samples that are not, of which fewer tell nothing."""

SURE = 4.0
"""Standard deviations of counts by which strays of one frame are more than those of another."""

BETTER = 1.5
"""How many times fewer samples stray from the own frame than from the one beside it, where it is
the own one for sure: another frame's buffer is nearer to that than to its own."""


@dataclass(frozen=True)
class Strays:
    """How many of the samples that were looked at stray, and how many of them for sure."""

    counted: int
    strays: int
    flat: int

    @property
    def share(self) -> float:
        """Of those that stray."""
        return self.strays / self.counted

    @property
    def doubtful(self) -> bool:
        """Tell whether more stray than what right pairs have, and enough for `is_far_above`."""
        flat = self.flat > FEW_FLAT * self.counted and self.flat >= SURE
        return self.strays > SURE**2 and (flat or self.share > FEW_STRAYS)

    def is_above(self, other: Strays) -> bool:
        """Tell whether more stray than from another frame."""
        expected = BETTER * other.strays * self.counted / other.counted
        return self.strays > expected + math.sqrt(expected)

    def is_far_above(self, other: Strays) -> bool:
        """Tell whether another frame fits far better, beyond chance."""
        samples = self.counted / other.counted
        return self.strays - FAR_BETTER * samples * other.strays > SURE * math.sqrt(self.strays)


def count_strays(
    buffer: Buffer,
    lr: GBuffer,
    hr: GBuffer,
    scale: int,
    enough: int = ENOUGH_SAMPLES,
    *,
    dark_sky: bool = False,
) -> Strays | None:
    """Count LR samples that stray in one buffer; None where too few tell.

    Args:
        buffer: of `HELD`.
        lr: buffers of LR samples; their depth, if it is there, tells sky.
        hr: of HR pixels.
        scale: S.
        enough: samples of which more are not looked at.
        dark_sky: whether HR pixels of sky may be 0, too: the sky's emission may be a pass of its
            own, and of another frame than the lamps'.
    """
    return count_picked(
        pick_samples(buffer, lr, enough), cut_blocks(buffer, hr, scale, enough, dark_sky)
    )


@dataclass(frozen=True)
class PickedSamples:
    """LR samples that are looked at, and which of them are no sky."""

    buffer: Buffer
    image: Image
    counted: Tensor


@dataclass(frozen=True)
class CutBlocks:
    """What HR pixels of the blocks of those samples hold, and of one further to each side.

    Attributes:
        low, high: least and largest; of object ids each of them in the last dimension.
        flat: where they are alike.
    """

    low: Tensor
    high: Tensor
    flat: Tensor


def _step(size: Size, enough: int) -> int:
    """Of so many samples, one is looked at in both directions."""
    return max(1, math.isqrt(size[0] * size[1] // enough))


def pick_samples(buffer: Buffer, lr: GBuffer, enough: int = ENOUGH_SAMPLES) -> PickedSamples:
    """Pick every so many LR samples; arguments as those of `count_strays`."""
    every = _step(lr.size, enough)
    rows, columns = (slice(1, side - 1, every) for side in lr.size)
    image = _make_comparable(buffer, lr[buffer][..., rows, columns])
    counted = torch.isfinite(image).all(1)
    if Buffer.DEPTH in lr:
        counted &= (lr[Buffer.DEPTH][..., rows, columns] < SKY_DEPTH_M)[:, 0]
    return PickedSamples(buffer, image, counted)


def cut_blocks(
    buffer: Buffer,
    hr: GBuffer,
    scale: int,
    enough: int = ENOUGH_SAMPLES,
    dark_sky: bool = False,
) -> CutBlocks:
    """Cut out the HR pixels around those samples; arguments as those of `count_strays`."""
    height, width = (side // scale for side in hr.size)
    every = _step((height, width), enough)
    shape = [len(range(1, side - 1, every)) for side in (height, width)]

    def cut(image: Image) -> Tensor:
        inner = image[..., scale - 1 :, scale - 1 :]
        blocks = inner.unfold(-2, scale + 2, scale * every).unfold(-2, scale + 2, scale * every)
        return blocks[..., : shape[0], : shape[1], :, :].flatten(-2)

    blocks = _make_comparable(buffer, cut(hr[buffer]))
    high, low = blocks.amax(-1), blocks.amin(-1)
    most = FLAT * low.abs() if buffer is Buffer.DEPTH else _flat_of(buffer)
    flat = (high - low <= most).all(1)
    if buffer is Buffer.OBJECT_ID:
        return CutBlocks(blocks, blocks, flat)
    if dark_sky and Buffer.DEPTH in hr:
        low = low.masked_fill((cut(hr[Buffer.DEPTH]) >= SKY_DEPTH_M).any(-1), 0.0)
    return CutBlocks(low, high, flat)


def _flat_of(buffer: Buffer) -> float:
    return 0.0 if buffer is Buffer.OBJECT_ID else FLAT


def count_picked(samples: PickedSamples, blocks: CutBlocks) -> Strays | None:
    """Count samples that stray; None where too few tell."""
    image, counted = samples.image, samples.counted
    least = LEAST_SAMPLES
    if samples.buffer in SPARSE:
        # a frame that shows none of it fits any other
        counted = counted & ((image > ABSOLUTE) | (blocks.high > ABSOLUTE)).any(1)
        least = LEAST_LIT
    known = int(counted.sum())
    if known < least:
        return None
    if samples.buffer is Buffer.OBJECT_ID:
        strays = (blocks.low != image[..., None]).all(-1).any(1)
    else:
        off = RELATIVE * image.abs() if samples.buffer is Buffer.DEPTH else ABSOLUTE
        strays = ((image < blocks.low - off) | (image > blocks.high + off)).any(1)
    strays &= counted
    return Strays(known, int(strays.sum()), int((strays & blocks.flat).sum()))


def _make_comparable(buffer: Buffer, image: Image) -> Image:
    """Radiance by a curve x / (1 + x), so that one step suits all of it."""
    if buffer is Buffer.OBJECT_ID:
        return image
    image = image.float()
    return image / (1.0 + image.abs()) if buffer is Buffer.EMISSION else image
