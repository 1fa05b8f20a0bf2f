"""Trying one reading of motion vectors on sampled pixels: fetch the neighbour along them, compare.

`FetchPicture` is a frame laid out for fetching, `PixelSamples` the pixels that are looked at,
`FrameTriple` a frame with its neighbours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from rtsr_cli.core.frames.motion import Jitter, MotionConvention
from rtsr_cli.core.shapes import Image, MotionPx, Size

LARGEST_OFFSET_PX = 1.25
OFFSET_STEPS = 4
"""Of the search for a constant offset: jitter differs by less than a pixel between frames."""


@dataclass(frozen=True, kw_only=True)
class MotionEvidence:
    """One frame: pictures that move with the surfaces, and the vectors as stored.

    Attributes:
        features: 1 x c x h x w; anything that sticks to surfaces, scaled so that the mean absolute
            difference of two random pixels is 1 (see `normalise_picture`).
        nearest: object ids, compared for equality, or None.
        stored: motion as read, 1 x 2 x h x w.
        jitter_px: declared sample position.
    """

    features: Image
    nearest: Tensor | None
    stored: MotionPx
    jitter_px: Jitter = (0.0, 0.0)


def normalise_picture(image: Image) -> Image:
    """Scale an image so that two random pixels differ by 1 on average over its channels."""
    flat = image[0].flatten(1)
    chooser = torch.Generator().manual_seed(0)
    pairs = torch.randint(0, flat.shape[1], (2, 4096), generator=chooser)
    chance = (flat[:, pairs[0]] - flat[:, pairs[1]]).abs().mean()
    return image / chance.clamp(min=1e-6) if float(chance) > 0 else torch.zeros_like(image)


@dataclass(frozen=True, eq=False)
class FetchPicture:
    """A frame laid out for fetching: one row a pixel."""

    rows: Tensor
    ids: Tensor | None
    size: Size


def lay_out_picture(evidence: MotionEvidence) -> FetchPicture:
    """Lay a frame out."""
    image = evidence.features[0]
    rows = image.flatten(1).T.contiguous()
    ids = None if evidence.nearest is None else evidence.nearest[0, 0].flatten()
    return FetchPicture(rows, ids, (image.shape[-2], image.shape[-1]))


@dataclass(frozen=True)
class PixelSamples:
    """Pixels that are looked at, and what the picture holds there."""

    x: Tensor
    y: Tensor
    rows: Tensor
    ids: Tensor | None

    def first(self, count: int) -> PixelSamples:
        """Return the first `count` of them."""
        ids = None if self.ids is None else self.ids[:count]
        return PixelSamples(self.x[:count], self.y[:count], self.rows[:count], ids)

    def turned(self) -> PixelSamples:
        """Return each sample's picture at the place of the one after it."""
        return replace(self, x=self.x.roll(1), y=self.y.roll(1))


def _fetch(picture: FetchPicture, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
    """Bilinear rows at positions, and whether they lie inside."""
    height, width = picture.size
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    x, y = x.clamp(0, width - 1), y.clamp(0, height - 1)
    left, top = x.floor().clamp(max=max(width - 2, 0)), y.floor().clamp(max=max(height - 2, 0))
    fx, fy = (x - left)[..., None], (y - top)[..., None]
    index = (top * width + left).long()
    rows = picture.rows
    # a line of pixels has no neighbours across
    right, down = min(1, width - 1), width * min(1, height - 1)
    above = torch.lerp(rows[index], rows[index + right], fx)
    below = torch.lerp(rows[index + down], rows[index + down + right], fx)
    return torch.lerp(above, below, fy), inside


def sample_differences(
    samples: PixelSamples, other: FetchPicture, shift: Tensor
) -> tuple[Tensor, Tensor]:
    """Difference of each sample to the other frame, at most 1, and whether it lies inside.

    Args:
        samples: n pixels.
        other: frame that they are looked up in.
        shift: pixels, ... x 2 x n; the results are ... x n.
    """
    x, y = samples.x + shift[..., 0, :], samples.y + shift[..., 1, :]
    rows, inside = _fetch(other, x, y)
    error = (rows - samples.rows).abs().mean(-1)
    if samples.ids is not None and other.ids is not None:
        height, width = other.size
        column = x.round().clamp(0, width - 1).long()
        row = y.round().clamp(0, height - 1).long()
        differs = (other.ids[row * width + column] != samples.ids).to(error.dtype)
        error = 0.5 * (error + differs)
    return error.clamp(max=1.0), inside


def fit_offset(samples: PixelSamples, other: FetchPicture, shift: Tensor) -> Tensor:
    """Find the constant offset (2) that fits best: Lucas-Kanade, robustly weighted."""
    offset = torch.zeros(2)
    steps = ((0.5, 0.0), (0.0, 0.5))
    for _ in range(OFFSET_STEPS):
        x, y = samples.x + shift[0] + offset[0], samples.y + shift[1] + offset[1]
        rows, inside = _fetch(other, x, y)
        slopes = [
            _fetch(other, x + dx, y + dy)[0] - _fetch(other, x - dx, y - dy)[0] for dx, dy in steps
        ]
        residual = samples.rows - rows
        size = residual.abs().mean(1)
        weight = (inside & (size < 0.5)).to(size.dtype) / (size + 0.05)
        normal = torch.stack([(weight[:, None] * a * b).sum() for a in slopes for b in slopes])
        right = torch.stack([(weight[:, None] * a * residual).sum() for a in slopes])
        matrix = normal.view(2, 2)
        damping = 1e-3 * matrix.trace().clamp(min=1e-9) * torch.eye(2)
        offset = offset + torch.linalg.solve(matrix + damping, right)
        offset = offset.clamp(-LARGEST_OFFSET_PX, LARGEST_OFFSET_PX)
    return offset


@dataclass(frozen=True)
class FrameTriple:
    """A frame and its neighbours: what each hypothesis needs to be tried on it."""

    number: int
    pictures: Mapping[int, FetchPicture]
    stored: Mapping[int, Tensor]
    jitter: Mapping[int, Jitter]
    samples: PixelSamples
    index: Tensor
    size: Size
    screen: Size

    def allows(self, convention: MotionConvention) -> bool:
        """Tell whether the frames that a hypothesis is about are there."""
        target, source = self._places(convention)
        return target in self.pictures and source in self.stored

    def _places(self, convention: MotionConvention) -> tuple[int, int]:
        """Number of the frame that the vectors lead to, and of the file that holds them."""
        step = 1 if convention.direction.to_next else -1
        return self.number + step, self.number + convention.file_offset

    def shift(self, convention: MotionConvention, count: int) -> tuple[FetchPicture, Tensor]:
        """The other picture, and where in it each sample would be; declared jitter accounted."""
        target, source = self._places(convention)
        stored = self.stored[source][:, self.index[:count]]
        now, then = self.jitter[self.number], self.jitter[target]
        between = torch.tensor([[a - b] for a, b in zip(now, then, strict=True)])
        return self.pictures[target], convention.pixels(stored, self.screen, dim=0) + between
