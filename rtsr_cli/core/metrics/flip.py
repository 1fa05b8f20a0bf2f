"""FLIP: the difference a viewer sees when two images alternate, for LDR and HDR images.

Sources: [Andersson et al. 2020], "FLIP: A Difference Evaluator for Alternating Images" (LDR), and
[Andersson et al. 2021], "Visualizing Errors in Rendered High Dynamic Range Images" (HDR).
The same code gives the metric, strip by strip in the processor's cache, and a loss: gradients are
finite everywhere. Products run in the images' own precision; TF32 on a GPU (off unless a caller
turns it on) would show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import torch
from torch import Tensor

from rtsr_cli.core.errors import RtsrError, ShapeMismatchError
from rtsr_cli.core.imaging.color import luminance
from rtsr_cli.core.metrics.filters import check_pair, cut_strip, row_strips
from rtsr_cli.core.metrics.flip_vision import (
    RGB_CHANNELS,
    Bands,
    build_bands,
    compare_strips,
    decode_extended_srgb,
)
from rtsr_cli.core.metrics.tonemapping import (
    ExposureRange,
    ToneMapper,
    expose,
    exposure_count,
    exposure_ends,
)
from rtsr_cli.core.shapes import Color, PixelMap


def pixels_per_degree(distance_m: float, width_px: int, width_m: float) -> float:
    """Pixels in one degree of the visual field at a monitor's centre.

    ppd = distance (width_px / width_m) (pi / 180)            [Andersson et al. 2020]
    """
    return distance_m * width_px / width_m * math.pi / 180.0


DEFAULT_PPD = pixels_per_degree(0.7, 3840, 0.7)
"""A 4K monitor 0.7 m wide, seen from 0.7 m: 67.02 [Andersson et al. 2020]."""


@dataclass(frozen=True, kw_only=True)
class HdrFlip:
    """Result of HDR-FLIP.

    Attributes:
        error: the largest FLIP of all exposures, for each pixel.
        exposures: the range used, one an image.
    """

    error: PixelMap
    exposures: tuple[ExposureRange, ...]


def _check(test: Color, ref: Color, name: str) -> None:
    """Raise for what FLIP cannot compare; a NaN would spread over its whole surroundings."""
    check_pair(test, ref.expand(len(test), -1, -1, -1) if len(ref) == 1 else ref)
    if test.shape[1] != RGB_CHANNELS:
        raise ShapeMismatchError(f"{name} compares RGB images, not {test.shape[1]} channel(s)")
    for role, image in (("test", test), ("reference", ref)):
        if not torch.stack(torch.aminmax(image.detach())).isfinite().all():
            raise RtsrError(
                f"{name}: the {role} image has NaN or infinite pixels: fill or mask them first"
            )


def ldr_flip(test: Color, ref: Color, ppd: float = DEFAULT_PPD) -> PixelMap:
    """LDR-FLIP of every pixel, 0 (the same) to 1.

    Args:
        test: sRGB display-encoded, 0..1; values outside are clipped.
        ref: the same; one image may stand against many, and is looked at once.
        ppd: pixels per degree of the visual field (`pixels_per_degree`).

    Returns:
        (N, H, W); 0 and of finite gradient where the images are equal.

    Raises:
        ShapeMismatchError: the sizes differ, or the images are not RGB.
        RtsrError: a NaN or infinite pixel.
    """
    _check(test, ref, "LDR-FLIP")
    bands = build_bands(ppd, test)
    strips = []
    for rows in row_strips(test):
        shown, expected = (
            decode_extended_srgb(cut_strip(image, rows, bands.reach, "replicate").clamp(0.0, 1.0))
            for image in (test, ref)
        )
        strips.append(compare_strips(shown, expected, bands)[..., : test.shape[-1]])
    return torch.cat(strips, dim=-2)


def exposure_range(
    ref: Color,
    tone_mapper: ToneMapper = ToneMapper.ACES,
    *,
    start: float | None = None,
    stop: float | None = None,
    count: int | None = None,
) -> ExposureRange:
    """Exposures for one reference; what is not given follows from the picture.

    Args:
        ref: (1, 3, H, W), linear.
        tone_mapper: the curve it is shown with.
        start: darkest exposure in stops.
        stop: brightest exposure in stops.
        count: number of exposures; one a stop if not given.
    """
    if start is None or stop is None:
        first, last = exposure_ends(luminance(ref.clamp(min=0.0)), tone_mapper)
        start = first if start is None else start
        stop = last if stop is None else stop
    number = exposure_count(start, stop) if count is None else count
    return ExposureRange(start=start, stop=stop, count=number)


def _image_hdr_flip(
    test: Color, ref: Color, bands: Bands, exposures: Sequence[float], tone_mapper: ToneMapper
) -> Tensor:
    """HDR-FLIP of one pair, (1, H, W)."""
    strips = []
    for rows in row_strips(test):
        pair = [
            cut_strip(image, rows, bands.reach, "replicate").clamp(min=0.0) for image in (test, ref)
        ]
        lights = [luminance(image) for image in pair]
        errors = []
        for exposure in exposures:
            shown, expected = (
                expose(image, light, exposure, tone_mapper)
                for image, light in zip(pair, lights, strict=True)
            )
            errors.append(compare_strips(shown, expected, bands))
        strips.append(reduce(torch.maximum, errors)[..., : test.shape[-1]])
    return torch.cat(strips, dim=-2)


def hdr_flip(
    test: Color,
    ref: Color,
    *,
    ppd: float = DEFAULT_PPD,
    tone_mapper: ToneMapper = ToneMapper.ACES,
    start: float | None = None,
    stop: float | None = None,
    count: int | None = None,
) -> HdrFlip:
    """HDR-FLIP: the largest LDR-FLIP over a range of exposures [Andersson et al. 2021].

    Args:
        test: linear radiance; negative values count as 0.
        ref: the same; its brightness sets the exposures that are not given.
        ppd: pixels per degree of the visual field (`pixels_per_degree`).
        tone_mapper: the curve that shows an exposure.
        start: darkest exposure in stops.
        stop: brightest exposure in stops.
        count: number of exposures; one a stop if not given.

    Raises:
        ShapeMismatchError: the sizes differ, or the images are not RGB.
        RtsrError: a NaN or infinite pixel, or a range that shows nothing.
    """
    _check(test, ref, "HDR-FLIP")
    bands = build_bands(ppd, test)
    ranges, maps = [], []
    for test_image, ref_image in zip(test.unbind(), ref.unbind(), strict=True):
        pair = test_image[None], ref_image[None]
        used = exposure_range(pair[1], tone_mapper, start=start, stop=stop, count=count)
        ranges.append(used)
        maps.append(_image_hdr_flip(*pair, bands, used.stops, tone_mapper))
    return HdrFlip(error=torch.cat(maps), exposures=tuple(ranges))
