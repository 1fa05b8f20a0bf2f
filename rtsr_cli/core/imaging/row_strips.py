"""Strips of rows: where a frame is cut so that what is computed of a strip stays in the cache."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import torch
from torch import Tensor

from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.shapes import Image, Size
from rtsr_cli.core.threads import share_among_threads


def cut_rows(height: int, rows: int) -> list[range]:
    """Cut the rows of a frame into strips of so many (the last may have fewer)."""
    return [range(top, min(height, top + rows)) for top in range(0, height, rows)]


def cut_pixels(size: Size, pixels: int, *, multiple: int = 1) -> list[range]:
    """Cut the rows of a frame into strips of at most so many pixels, or of the fewest rows.

    Args:
        size: (height, width).
        pixels: of a strip.
        multiple: rows of every strip but the last are a multiple of it.
    """
    height, width = size
    return cut_rows(height, max(1, pixels // (width * multiple)) * multiple)


def cut_frame(frame: Frame, pixels: int) -> Iterator[tuple[int, Frame]]:
    """Cut a frame into strips of at most so many pixels, or of one row; each with its top."""
    for rows in cut_pixels(frame.size, pixels):
        yield rows.start, frame.crop(rows.start, 0, (len(rows), frame.size[1]))


def run_in_strips(
    run: Callable[[Mapping[str, Tensor]], Tensor],
    images: Mapping[str, Tensor],
    *,
    rows: int,
    halo: int,
) -> Tensor:
    """Run a function of images on horizontal strips, and join what it gives.

    Args:
        run: named images -> an image; an output row depends on `halo` rows to each side.
        images: n c H w each; heights are whole multiples of the smallest, that of LR.
        rows: LR rows of a strip, without its halo.
        halo: LR rows.

    Returns:
        What `run` gives for the whole, up to rounding.
    """
    height = min(image.shape[2] for image in images.values())
    if height <= rows:
        return run(images)
    parts = [
        _run_strip(run, images, height=height, inner=inner, halo=halo)
        for inner in cut_rows(height, rows)
    ]
    return torch.cat(parts, dim=2)


def fill_in_strips(
    run: Callable[[Mapping[str, Tensor], slice], Tensor],
    images: Mapping[str, Tensor],
    out: Image,
    *,
    rows: int,
    halo: int = 0,
) -> None:
    """Fill an image, a strip a thread: for what costs memory traffic more than arithmetic.

    A halo is counted in the rows of the largest images, so that little is computed twice.

    Args:
        run: named images, and which rows of the largest are asked for -> what `out` has there.
        images: n c H w each; the largest come with their halo, others without; heights are whole
            multiples of the smallest, that of LR.
        out: where the result goes, n c S*h w.
        rows: LR rows of a strip, without its halo.
        halo: rows of the largest images that an output row depends on to each side.
    """
    heights = [image.shape[2] for image in images.values()]
    height, largest = min(heights), max(heights)
    scale = largest // height

    def fill_strip(inner: range) -> None:
        first, last = inner.start * scale, inner.stop * scale
        top, bottom = max(0, first - halo), min(largest, last + halo)
        strip = {
            name: image[:, :, top:bottom]
            if image.shape[2] == largest
            else _crop_rows(image, height, inner.start, inner.stop)
            for name, image in images.items()
        }
        given = run(strip, slice(first - top, last - top))
        _crop_rows(out, height, inner.start, inner.stop).copy_(given)

    share_among_threads(fill_strip, cut_rows(height, rows))


def _run_strip(
    run: Callable[[Mapping[str, Tensor]], Tensor],
    images: Mapping[str, Tensor],
    *,
    height: int,
    inner: range,
    halo: int,
) -> Tensor:
    """What `run` gives of some LR rows, which sees a halo beside them."""
    first, last = max(0, inner.start - halo), min(height, inner.stop + halo)
    strip = run({n: _crop_rows(image, height, first, last) for n, image in images.items()})
    scale = strip.shape[2] // (last - first)
    return strip[:, :, (inner.start - first) * scale : (inner.stop - first) * scale]


def _crop_rows(image: Tensor, height: int, first: int, last: int) -> Tensor:
    """Rows of an image that cover LR rows."""
    scale = image.shape[2] // height
    return image[:, :, first * scale : last * scale]
