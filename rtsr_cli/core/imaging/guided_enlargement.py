"""Enlargement that keeps to the surfaces of a large G-buffer: joint bilateral upsampling.

    out(p) = sum_q w(p, q) m(q) v(q) / sum_q w(p, q) m(q)
    w = exp(-|p - q|^2 / (2 s^2) - a (1 - n(p).n(q)) - d(p, q))
    d = max(0, |z(p) - z(q)| - b |grad z(p)| |p - q|) / (c z(p))

over the small frame's samples q near p: those whose normal is that of p and whose depth is that of
p's plane count; where p or q is a surface whose normal is 0, which says nothing, its depth alone
does (n(p).n(q) = 1) [Kopf et al. 2007, with the edge-stopping functions of Dammertz et al. 2010].

A network may raise or lower each of the three terms of log w at every p (`upsample_emphasised`):

    log w = -f_0 |p - q|^2 / (2 s^2) - f_1 a (1 - n(p).n(q)) - f_2 d(p, q)
    d out / d f_k = sum_q w m (v - out) term_k / sum_q w m

Conventions: samples are pixel (S//2, S//2) of their S x S block (see `alignment`).
"""

from __future__ import annotations

import math
from typing import Any

import torch

from rtsr_cli.core.imaging.guided_kernel import (
    FALLBACK_WEIGHT,
    GuidedSamples,
    SampleKernel,
    find_taps,
    gather_planes,
)
from rtsr_cli.core.shapes import Image, Plane
from rtsr_cli.core.threads import share_among_threads

STRIP_VALUES = 98304
"""Of a plane of a strip: few enough for the caches, enough to be worth a call."""


def upsample_guided(samples: GuidedSamples) -> Image:
    """Enlarge values along surfaces, without a gradient.

    Works in strips of rows whose planes stay in the processor's caches, at any number of threads
    with the same result; weights are found once for all channels.
    """
    return _enlarge(samples, emphasis=None, fit=None)


def upsample_guided_and_fit(samples: GuidedSamples) -> tuple[Image, Plane]:
    """`upsample_guided`, and how well the best sample of each output pixel fits.

    fit(p) = max_q w(p, q) m(q),   1 where p is a sample itself
    """
    fit = torch.zeros_like(samples.large.depth)
    return _enlarge(samples, emphasis=None, fit=fit), fit


def upsample_emphasised(samples: GuidedSamples, emphasis: Image) -> Image:
    """`upsample_guided` with the terms of log w multiplied; the gradient is that of the factors.

    Args:
        samples: what is enlarged.
        emphasis: f, n 3 S*h S*w: of distance, normal and depth, 0 or more.
    """
    # torch's annotations leave it out
    enlarged: Image = _EmphasisedKernel.apply(emphasis, samples)  # type: ignore[no-untyped-call]
    return enlarged


class _EmphasisedKernel(torch.autograd.Function):
    """`upsample_emphasised`; weights are found anew on the way back: they are too many to keep."""

    @staticmethod
    def forward(ctx: Any, emphasis: Image, samples: GuidedSamples) -> Image:
        enlarged = _enlarge(samples, emphasis=emphasis, fit=None)
        ctx.save_for_backward(emphasis, enlarged)
        ctx.samples = samples
        return enlarged

    @staticmethod
    def backward(ctx: Any, gradient: Image) -> tuple[Image, None]:
        emphasis, enlarged = ctx.saved_tensors
        return _differentiate(ctx.samples, emphasis, enlarged, gradient), None


def _enlarge(samples: GuidedSamples, *, emphasis: Image | None, fit: Plane | None) -> Image:
    """Enlarge, and write into `fit` how well the best sample fits where that is asked for."""
    count, channels, height, width = samples.values.shape
    scale, fallback = samples.scale, samples.fallback
    planes = gather_planes(samples)
    taps = find_taps(scale, width, like=samples.values)
    enlarged = samples.values.new_empty(count, channels, *fallback.shape[2:])
    rows = _strip_rows(height, count * scale * scale * width)

    def enlarge_strip(top: int) -> None:
        strip = slice(top, min(height, top + rows))
        here = slice(strip.start * scale, strip.stop * scale)
        kernel = SampleKernel(planes, strip, samples, emphasis)
        total = kernel.sum_samples(taps, None if fit is None else fit[:, :, here]).flatten(2, 3)
        total[:, : fallback.shape[1]].add_(fallback[:, :, here], alpha=FALLBACK_WEIGHT)
        torch.div(total[:, :-1], total[:, -1:].add_(FALLBACK_WEIGHT), out=enlarged[:, :, here])

    share_among_threads(enlarge_strip, range(0, height, rows))
    return enlarged


def _differentiate(
    samples: GuidedSamples, emphasis: Image, enlarged: Image, gradient: Image
) -> Image:
    """Gradient of the factors, n 3 S*h S*w, from that of what was enlarged."""
    count, _, height, width = samples.values.shape
    scale = samples.scale
    planes = gather_planes(samples)
    taps = find_taps(scale, width, like=samples.values)
    rows = _strip_rows(height, count * scale * scale * width)
    found = torch.empty_like(emphasis)

    def differentiate_strip(top: int) -> None:
        strip = slice(top, min(height, top + rows))
        here = slice(strip.start * scale, strip.stop * scale)
        kernel = SampleKernel(planes, strip, samples, emphasis)
        slopes = kernel.sum_slopes(taps, enlarged[:, :, here], gradient[:, :, here])
        found[:, :, here] = slopes.flatten(2, 3)

    share_among_threads(differentiate_strip, range(0, height, rows))
    return found


def _strip_rows(height: int, row_values: int) -> int:
    """Rows of each of the fewest strips, about equally high, that are not too large."""
    most = max(1, STRIP_VALUES // row_values)
    return math.ceil(height / math.ceil(height / most))
