"""Fetching the previous frame by motion vectors; chaining, enlarging and dilating them.

Conventions: `motion_px` = (dx, dy), previous minus current, in pixels of its own resolution, x
    right,
y down; pixel centres at +0.5. A position is split into the whole pixels and the fraction of the
*displacement* before anything is added to the pixel's own index, so zero motion is the identity
exactly, at any size. A tap of weight zero takes no part, even where it holds NaN or infinity.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Literal, TypeAlias

import torch
from torch import Tensor
from torch.nn import functional

from rtsr_cli.core.errors import ShapeMismatchError
from rtsr_cli.core.imaging.resampling import KEYS_A
from rtsr_cli.core.shapes import IdMap, Image, Mask, MotionPx, Plane, Size

WarpMode: TypeAlias = Literal["nearest", "bilinear", "bicubic", "sharp"]
"""`bicubic` is Catmull-Rom (Keys 1981 with a = -1/2), `sharp` the same with a = -3/4."""

CATMULL_ROM_A, SHARP_A = -0.5, KEYS_A
"""Slopes of the kernels of `bicubic` and `sharp`: by the latter, which enlargement uses, what is
fetched anew every frame loses less."""

Border: TypeAlias = Literal["clamp", "zero"]
"""What stands for samples outside the frame: its nearest border pixel, or zero."""

AnyImage: TypeAlias = Image | IdMap
"""Colours, vectors or object ids: what can be fetched without interpolation."""

_Taps: TypeAlias = list[tuple[Tensor, Tensor]]


def require_same_size(**images: Tensor) -> None:
    """Check that all images agree in batch, height and width.

    Raises:
        ShapeMismatchError: they do not; the message names both and their sizes.
    """
    (first_name, first), *others = images.items()
    for name, image in others:
        if image.shape[:1] + image.shape[2:] != first.shape[:1] + first.shape[2:]:
            raise ShapeMismatchError(
                f"{first_name} {tuple(first.shape)} and {name} {tuple(image.shape)} "
                "must agree in batch, height and width"
            )


def _nearest_weights(fraction: Tensor) -> tuple[int, tuple[Tensor, ...]]:
    """w = 1 for the pixel whose area holds the position."""
    above = (fraction >= 0.5).to(fraction.dtype)
    return 0, (1 - above, above)


def _bilinear_weights(fraction: Tensor) -> tuple[int, tuple[Tensor, ...]]:
    """w0 = 1 - f, w1 = f."""
    return 0, (1 - fraction, fraction)


def _keys_weights(fraction: Tensor, a: float) -> tuple[int, tuple[Tensor, ...]]:
    """Keys' kernel at distances 1 + f, f, 1 - f, 2 - f; a is its slope at 1.   [Keys 1981]."""
    f = fraction
    outer_before = f * (f * (a * f - 2 * a) + a)
    inner_before = 1 + f * f * ((a + 2) * f - (a + 3))
    outer_after = f * f * (a - a * f)
    inner_after = f * (f * ((2 * a + 3) - (a + 2) * f) - a)
    return -1, (outer_before, inner_before, inner_after, outer_after)


_KERNELS: dict[WarpMode, Callable[[Tensor], tuple[int, tuple[Tensor, ...]]]] = {
    "nearest": _nearest_weights,
    "bilinear": _bilinear_weights,
    "bicubic": partial(_keys_weights, a=CATMULL_ROM_A),
    "sharp": partial(_keys_weights, a=SHARP_A),
}


def bound_motion(motion_px: MotionPx, *, limit_px: int) -> MotionPx:
    """NaN becomes 0; what leaves the frame anyway is limited, so that it fits an integer."""
    return motion_px.nan_to_num(nan=0.0).clamp(-limit_px, limit_px)


def _finite_motion(motion_px: Tensor) -> Tensor:
    return bound_motion(motion_px, limit_px=sum(motion_px.shape[2:]))


def whole_pixels(displacement_px: Tensor) -> Tensor:
    """floor, as an index; int32 between, because float to int64 is not vectorised on CPUs."""
    return displacement_px.floor().int().long()


def own_index(motion_px: Tensor, axis: int, first: int = 0) -> Tensor:
    """Each pixel's own column (axis 0) or row (axis 1) from `first` on, broadcast."""
    index = torch.arange(first, first + motion_px.shape[3 - axis], device=motion_px.device)
    return index if axis == 0 else index.unsqueeze(1)


def _axis_taps(
    motion_px: Tensor, axis: int, mode: WarpMode, *, first: int = 0, extent: int | None = None
) -> _Taps:
    """(index, weight) of every tap along one axis of finite motion, clamped to the frame.

    Args:
        motion_px: of the frame, or of some of its rows.
        axis: 0 = x, 1 = y.
        mode: kernel.
        first: index of what comes first along the axis.
        extent: of the frame along the axis; None = that of `motion_px`.
    """
    displacement = motion_px[:, axis : axis + 1]
    whole = displacement.floor()
    nearest, weights = _KERNELS[mode](displacement - whole)
    start = whole_pixels(whole) + (own_index(motion_px, axis, first) + nearest)
    last = (motion_px.shape[3 - axis] if extent is None else extent) - 1
    return [((start + k).clamp(0, last), weight) for k, weight in enumerate(weights)]


def _nearest_index(motion_px: Tensor, axis: int) -> Tensor:
    """Index of the pixel that holds the position, along one axis, not clamped."""
    return whole_pixels(motion_px[:, axis : axis + 1] + 0.5) + own_index(motion_px, axis)


def _place(rows: Tensor, columns: Tensor, width: int) -> Tensor:
    """Index of pixels where rows follow each other."""
    return torch.add(columns, rows, alpha=width)


def _fetch(image: Tensor, index: Tensor) -> Tensor:
    """Pixels of an image by index maps of `_place`, n 1 h w."""
    n, c, h, w = image.shape
    if c > 1 and image.is_contiguous(memory_format=torch.channels_last):
        # a pixel's channels are one row: fetched at once
        start = torch.arange(0, n * h * w, h * w, device=image.device).view(n, 1, 1, 1)
        pixels = image.permute(0, 2, 3, 1).reshape(n * h * w, c)
        fetched = pixels.index_select(0, (index + start).flatten())
        return fetched.view(n, h, w, c).permute(0, 3, 1, 2)
    flat = index.reshape(n, 1, h * w).expand(n, c, h * w)
    return image.reshape(n, c, h * w).gather(2, flat).view(n, c, h, w)


def inside_frame(motion_px: MotionPx, rows: range | None = None) -> Mask:
    """1 where the pixel that holds the position exists and the motion is a number.

    Args:
        motion_px: from each pixel to where it is fetched.
        rows: that it is asked for; None = all.
    """
    height, width = motion_px.shape[2:]
    top, bottom = (0, height) if rows is None else (rows.start, rows.stop)
    # of the pixel's left and upper edge; no comparison holds for NaN
    edges = motion_px[:, :, top:bottom] + 0.5
    inside = torch.ones_like(edges[:, :1], dtype=torch.bool)
    for axis, (extent, first) in enumerate(((width, 0), (height, top))):
        edge, own = edges[:, axis : axis + 1], own_index(edges, axis, first).to(edges)
        inside &= (edge >= -own) & (edge < extent - own)
    return inside.to(motion_px.dtype)


def fetch_nearest(image: AnyImage, motion_px: MotionPx) -> AnyImage:
    """image at the pixel that holds p + motion_px(p), border clamped; any type."""
    finite = _finite_motion(motion_px)
    columns, rows = (
        _nearest_index(finite, axis).clamp(0, motion_px.shape[3 - axis] - 1) for axis in (0, 1)
    )
    return _fetch(image, _place(rows, columns, image.shape[3]))


def _may_hold_nonfinite(image: Tensor) -> bool:
    """False only if every pixel is finite: a finite sum proves it, far cheaper than a look."""
    return image.is_meta or not bool(image.detach().sum().isfinite())


def _weighted_sum(terms: Iterator[tuple[Tensor, Tensor]], *, drop_zero_weights: bool) -> Tensor:
    """Sum of value * weight; with `drop_zero_weights`, 0 * NaN and 0 * infinity count as 0."""
    total: Tensor | None = None
    for value, weight in terms:
        kept = value.masked_fill(weight == 0, 0) if drop_zero_weights else value
        factor = weight.to(value.dtype)
        total = kept * factor if total is None else torch.addcmul(total, kept, factor)
    assert total is not None
    return total


def _fetch_filtered(image: Tensor, motion_px: Tensor, mode: WarpMode) -> Tensor:
    """Separable kernel: taps along a row, then the rows."""
    finite = _finite_motion(motion_px)
    columns, rows = (_axis_taps(finite, axis, mode) for axis in (0, 1))
    drop_zero_weights = _may_hold_nonfinite(image)

    def fetch_row(row: Tensor) -> Tensor:
        taps = ((_fetch(image, _place(row, i, image.shape[3])), weight) for i, weight in columns)
        return _weighted_sum(taps, drop_zero_weights=drop_zero_weights)

    return _weighted_sum(
        ((fetch_row(row), weight) for row, weight in rows), drop_zero_weights=drop_zero_weights
    )


def backward_warp(
    image: AnyImage, motion_px: MotionPx, *, mode: WarpMode = "bilinear", border: Border = "clamp"
) -> tuple[AnyImage, Mask]:
    """Sample `image` where each pixel was in the previous frame.

        out(p) = image(p + motion_px(p)),  pixel centres at +0.5

    Differentiable in `image`, and in `motion_px` unless `mode` is nearest.

    Args:
        image: previous frame, any channel count; any type with `nearest`, else floating point.
        motion_px: (dx, dy) in pixels of `image`; zero is the identity, exactly. NaN counts as a
            sample outside the frame (and fetches the pixel's own position), so does infinity.
        mode: the interpolation kernel.
        border: what samples outside the frame read.

    Returns:
        The warped image and a mask, 1 where the position lies within the frame's area.

    Raises:
        ShapeMismatchError: batch, height or width differ.
        TypeError: an integer image with another mode than nearest.
    """
    require_same_size(image=image, motion_px=motion_px)
    inside_mask = inside_frame(motion_px)
    if mode == "nearest":
        warped = fetch_nearest(image, motion_px)
    elif image.is_floating_point():
        warped = _fetch_filtered(image, motion_px, mode)
    else:
        raise TypeError(f"{image.dtype} cannot be interpolated ({mode}): use mode='nearest'")
    if border == "zero":
        # unlike masked_fill, keeps channels that come last
        warped = torch.where(inside_mask == 0, warped.new_zeros(()), warped)
    return warped, inside_mask


def warp_pixels(image: Image, motion_px: Tensor, pixels: Tensor) -> Tensor:
    """`backward_warp`, bilinear and the border repeated, of some pixels alone: c k.

    Args:
        image: previous frame, 1 c h w, finite.
        motion_px: (dx, dy) of the pixels, 2 k.
        pixels: their index where rows follow each other, k.
    """
    height, width = image.shape[2:]
    planes = image[0].flatten(1)
    bounded = bound_motion(motion_px, limit_px=height + width)
    whole = bounded.floor()
    across, down = (_bilinear_weights(fraction)[1] for fraction in bounded - whole)
    first = whole_pixels(whole)
    column, row = first[0] + pixels % width, first[1] + pixels // width
    columns = [((column + i).clamp_(0, width - 1), weight) for i, weight in enumerate(across)]

    def fetch_row(step: int) -> Tensor:
        start = (row + step).clamp_(0, height - 1).mul_(width)
        taps = ((planes.index_select(1, start + column), weight) for column, weight in columns)
        return _weighted_sum(taps, drop_zero_weights=False)

    rows = ((fetch_row(step), weight) for step, weight in enumerate(down))
    return _weighted_sum(rows, drop_zero_weights=False)


def find_nearest_pixels(motion_px: Tensor, pixels: Tensor, size: Size) -> tuple[Tensor, Tensor]:
    """Which pixels hold the positions p + motion_px(p) of some pixels p.

    Args:
        motion_px: (dx, dy) of the pixels, 2 k.
        pixels: their index where rows follow each other, k.
        size: (height, width) of the frame.

    Returns:
        Their index, clamped to the frame, and 1 where they lie in it, k each.
    """
    height, width = size
    first = whole_pixels(bound_motion(motion_px, limit_px=height + width) + 0.5)
    column, row = first[0] + pixels % width, first[1] + pixels // width
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    inside = inside & ~motion_px.sum(dim=0).isnan()
    place = row.clamp(0, height - 1) * width + column.clamp(0, width - 1)
    return place, inside.to(motion_px.dtype)


def compose_motion(
    newer_px: MotionPx, older_px: MotionPx, *, mode: WarpMode = "bilinear"
) -> tuple[MotionPx, Mask]:
    """Chain t -> t-1 and t-1 -> t-2 into t -> t-2.

        mv(x) = newer(x) + older(x + newer(x))

    Args:
        newer_px: motion of frame t, to t-1.
        older_px: motion of frame t-1, to t-2, same resolution.
        mode: how `older_px` is fetched; nearest never mixes two surfaces at an edge.

    Returns:
        The composed motion and a mask, 1 where `older_px` was fetched within the frame.

    Raises:
        ShapeMismatchError: sizes differ.
    """
    older_warped, inside_mask = backward_warp(older_px, newer_px, mode=mode)
    return newer_px + older_warped, inside_mask


def _upsample_axis(image: Tensor, dim: int, *, scale: int, jitter: float, mode: WarpMode) -> Tensor:
    """Resample one axis at u = (X + 0.5) / scale - 0.5 - jitter, borders replicated."""
    extent = image.shape[dim]
    position = torch.arange(extent * scale, dtype=torch.float64, device=image.device)
    position = (position + 0.5) / scale - 0.5 - jitter
    first, weights = _KERNELS[mode](position - position.floor())
    shape = [1] * image.ndim
    shape[dim] = -1
    start = position.floor().long() + first
    terms = (
        (image.index_select(dim, (start + k).clamp(0, extent - 1)), weight.view(shape))
        for k, weight in enumerate(weights)
    )
    return _weighted_sum(terms, drop_zero_weights=_may_hold_nonfinite(image))


def upsample_motion(
    motion_px: MotionPx,
    scale: int,
    *,
    mode: WarpMode = "bilinear",
    jitter_px: tuple[float, float] = (0.0, 0.0),
) -> Tensor:
    """Bring low-resolution motion to `scale` times the size, in pixels of the larger image.

        hr(X) = scale * lr(u),  u = (X + 0.5) / scale - 0.5 - jitter   (align_corners=False)

    Args:
        motion_px: in low-resolution pixels.
        scale: whole factor.
        mode: nearest takes the vector of the nearest *sample*, so it follows the jitter.
        jitter_px: sample position minus pixel centre, low-resolution pixels, x right, y down.

    Returns:
        Motion in high-resolution pixels, n 2 scale*h scale*w.
    """
    tall = _upsample_axis(motion_px, 2, scale=scale, jitter=jitter_px[1], mode=mode)
    return _upsample_axis(tall, 3, scale=scale, jitter=jitter_px[0], mode=mode) * scale


def dilate_motion(motion_px: MotionPx, depth_m: Plane, *, radius: int = 1) -> MotionPx:
    """Give each pixel the motion of the nearest surface in its (2 radius + 1)^2 neighbourhood.

    Silhouettes then move with the foreground. Where nothing is nearer, a pixel keeps its own
    motion.

    Args:
        motion_px: any resolution.
        depth_m: view depth at the same resolution; NaN counts as infinitely far.
        radius: pixels.

    Raises:
        ShapeMismatchError: sizes differ.
    """
    require_same_size(motion_px=motion_px, depth_m=depth_m)
    nearness = -depth_m.nan_to_num(nan=torch.inf)
    best, index = functional.max_pool2d(
        nearness, 2 * radius + 1, stride=1, padding=radius, return_indices=True
    )
    flat_index = index.flatten(2).expand(-1, 2, -1)
    dilated = motion_px.flatten(2).gather(2, flat_index).view_as(motion_px)
    return torch.where(best > nearness, dilated, motion_px)


def bilinear_places(
    motion_px: MotionPx, rows: range | None = None
) -> Iterator[tuple[Tensor, Plane]]:
    """(index, weight) of each of the four pixels that a bilinear fetch reads.

    Args:
        motion_px: from each pixel to where it is fetched.
        rows: that places are asked for; None = all.

    Yields:
        Index where the image's rows follow each other, and weight, n 1 len(rows) w each.
    """
    height, width = motion_px.shape[2:]
    first, last = (0, height) if rows is None else (rows.start, rows.stop)
    bounded = bound_motion(motion_px[:, :, first:last], limit_px=height + width)
    columns = _axis_taps(bounded, 0, "bilinear")
    for row, row_weight in _axis_taps(bounded, 1, "bilinear", first=first, extent=height):
        for column, column_weight in columns:
            yield _place(row, column, width), row_weight * column_weight


def bilinear_taps(image: AnyImage, motion_px: MotionPx) -> Iterator[tuple[AnyImage, Plane]]:
    """(values, weight) of each of the four pixels that a bilinear fetch reads; any type."""
    for index, weight in bilinear_places(motion_px):
        yield _fetch(image, index), weight
