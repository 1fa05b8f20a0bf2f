"""Structural similarity (SSIM) in the conventions that publications use, and MS-SSIM.

    SSIM = l * cs
    l  = (2 m_x m_y + C1) / (m_x^2 + m_y^2 + C1)
    cs = (2 s_xy + C2) / (s_xx + s_yy + C2)                          [Wang et al. 2004, Eq. 13]

Means m and covariances s are taken over a window around each pixel, channel by channel; data
range 1. Window, border and covariance differ between implementations, and their results with
them: a figure means nothing without its convention.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.choices import SsimConvention
from rtsr_cli.core.errors import ShapeMismatchError
from rtsr_cli.core.metrics.fidelity import masked_mean
from rtsr_cli.core.metrics.filters import (
    Border,
    band_matrix,
    check_pair,
    column_windows,
    cut_strip,
    filter_along_columns,
    filter_along_rows,
    gaussian_taps,
    row_strips,
)
from rtsr_cli.core.shapes import Image, Mask, PixelMap, Scores

C1, C2 = 0.01**2, 0.03**2
"""(K1 L)^2 and (K2 L)^2 for data range L = 1 [Wang et al. 2004, Section III-B]."""

GAUSSIAN_SIGMA_PX = 1.5
"""Width of the Gaussian window [Wang et al. 2004, Section III-C]."""

GAUSSIAN_REACH = 5
"""Half of its 11 taps."""

MID_GREY = 0.5
"""Taken off before squaring: a variance does not change, but float32 rounds less of it away."""

MS_SSIM_WEIGHTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)
"""Exponents of the five scales, fine to coarse [Wang, Simoncelli and Bovik 2003, Section 3.2]."""

MS_SSIM_MIN_SIZE = 2 * GAUSSIAN_REACH * 2 ** (len(MS_SSIM_WEIGHTS) - 1) + 1
"""Below, the coarsest scale has no whole window: 161 pixels."""


@dataclass(frozen=True)
class _SsimWindow:
    """Taps, border (None = whole windows only) and kind of covariance of a convention."""

    taps: Tensor
    border: Border | None
    sample_covariance: bool = False

    @property
    def reach(self) -> int:
        return len(self.taps) // 2

    @property
    def offset(self) -> float:
        """What may be taken off every value: nothing where the weights do not sum to 1."""
        return 0.0 if self.border == "constant" else MID_GREY

    @property
    def covariance_factor(self) -> float:
        """n / (n - 1) for n pixels of a window, or 1."""
        count = len(self.taps) ** 2
        return count / (count - 1) if self.sample_covariance else 1.0


def _uniform_taps(size: int) -> Tensor:
    return torch.full((size,), 1.0 / size, dtype=torch.float64)


_GAUSSIAN = gaussian_taps(GAUSSIAN_SIGMA_PX, GAUSSIAN_REACH)

WINDOWS = {
    SsimConvention.WANG: _SsimWindow(_GAUSSIAN, None),
    SsimConvention.SKIMAGE7: _SsimWindow(_uniform_taps(7), None, sample_covariance=True),
    SsimConvention.SKIMAGE11: _SsimWindow(_uniform_taps(11), None, sample_covariance=True),
    SsimConvention.ZERO_PAD: _SsimWindow(_GAUSSIAN, "constant"),
    SsimConvention.TORCHMETRICS: _SsimWindow(_GAUSSIAN, "reflect"),
}
"""What each convention computes with."""


def margin_px(convention: SsimConvention) -> int:
    """Pixels of the frame outside of the map, at each side.

    A map of an H x W frame holds rows and columns margin .. H - margin - 1.
    """
    window = WINDOWS[convention]
    return window.reach if window.border is None else 0


def _comparisons(fields: Tensor, window: _SsimWindow) -> tuple[Tensor, Tensor]:
    """l and cs of filtered x, y, x^2 + y^2 and x y, taken of values less the offset o.

        l  = (2 m_x m_y + q) / (m_x^2 + m_y^2 + q),   q = 2 o (m_x + m_y) + 2 o^2 + C1
        cs = (2 f (E[xy] - m_x m_y) + C2) / (f (E[x^2 + y^2] - m_x^2 - m_y^2) + C2)

    with f the covariance factor; l is that of the means m + o.
    """
    x, y, squares, product = fields.unbind(1)
    offset, factor = window.offset, window.covariance_factor
    of_means = x * y
    squared_means = torch.addcmul(x * x, y, y)
    shift = (x + y).mul_(2.0 * offset).add_(2.0 * offset**2 + C1)
    luminance = torch.add(shift, of_means, alpha=2.0).div_(squared_means + shift)
    covariance = (product - of_means).mul_(2.0 * factor).add_(C2)
    return luminance, covariance / (squares - squared_means).mul_(factor).add_(C2)


def _strip_comparisons(
    test: Image, ref: Image, window: _SsimWindow
) -> Iterator[tuple[Tensor, Tensor]]:
    """l and cs, (N, C, rows, W), strip by strip from the map's top."""
    reach, width = window.reach, test.shape[-1]
    margin = reach if window.border is None else 0
    band = band_matrix(window.taps, test)
    for rows in row_strips(test, margin):
        x, y = (
            cut_strip(image, rows, reach, window.border or "replicate") - window.offset
            for image in (test, ref)
        )
        fields = torch.stack([x, y, x * x + y * y, x * y], dim=1)
        fields = filter_along_rows(column_windows(fields, reach), band)
        fields = filter_along_columns(fields, band)
        yield _comparisons(fields[..., margin : width - margin], window)


def _check_size(image: Image, needed: int, metric: str) -> None:
    height, width = image.shape[-2:]
    if min(height, width) < needed:
        raise ShapeMismatchError(
            f"{metric} needs at least {needed} pixels a side, the frame is {width} x {height}: "
            "leave it out for this sequence"
        )


def ssim_map(test: Image, ref: Image, convention: SsimConvention = SsimConvention.WANG) -> PixelMap:
    """SSIM of every pixel, averaged over the channels.

    Args:
        test: values in the space to compare in, range 0..1 (display-encoded as a rule).
        ref: the same.
        convention: window, border and covariance.

    Returns:
        (N, H - 2 m, W - 2 m) with m = `margin_px(convention)`.

    Raises:
        ShapeMismatchError: the sizes differ, or the frame is smaller than a window.
    """
    check_pair(test, ref)
    window = WINDOWS[convention]
    _check_size(test, len(window.taps), f"SSIM ({convention})")
    strips = [(lum * cs).mean(1) for lum, cs in _strip_comparisons(test, ref, window)]
    return torch.cat(strips, dim=-2)


def ssim(
    test: Image,
    ref: Image,
    convention: SsimConvention = SsimConvention.WANG,
    *,
    mask: Mask | None = None,
) -> Scores:
    """Mean of `ssim_map`, 1 for equal images.

    Args:
        test: values in the space to compare in, range 0..1.
        ref: the same.
        convention: window, border and covariance.
        mask: 1 = counts, of the frame's size; cut to the map.

    Returns:
        One figure an image; NaN where the mask is empty.
    """
    values = ssim_map(test, ref, convention)
    if mask is not None:
        mask = cut_margin(mask, margin_px(convention))
    return masked_mean(values, mask)


def cut_margin(image: Image, margin: int) -> Image:
    """Leave out `margin` pixels at each side of a frame, as an SSIM map does."""
    height, width = image.shape[-2:]
    return image[..., margin : height - margin, margin : width - margin]


def _scale_means(test: Image, ref: Image) -> tuple[Tensor, Tensor]:
    """Means of l * cs and of cs over the whole windows of one scale, (N, C) each."""
    columns = [
        ((lum * cs).mean(-1), cs.mean(-1))
        for lum, cs in _strip_comparisons(test, ref, WINDOWS[SsimConvention.WANG])
    ]
    whole, contrast = (torch.cat(means, dim=-1).mean(-1) for means in zip(*columns, strict=True))
    return whole, contrast


def ms_ssim(test: Image, ref: Image) -> Scores:
    """Multi-scale SSIM: contrast of five scales, luminance of the coarsest.

        prod_{j=1..4} cs_j^w_j * (l_5 cs_5)^w_5       [Wang, Simoncelli and Bovik 2003, Eq. 7]

    Each scale is the mean of 2 x 2 pixels of the one before (of those there are at an odd end);
    whole windows only; a negative mean counts as 0; the mean over the channels is last.

    Args:
        test: values in the space to compare in, range 0..1.
        ref: the same.

    Raises:
        ShapeMismatchError: the sizes differ, or a side has fewer than 161 pixels.
    """
    check_pair(test, ref)
    _check_size(test, MS_SSIM_MIN_SIZE, "MS-SSIM")
    *fine, coarsest = MS_SSIM_WEIGHTS
    product = torch.ones(test.shape[:2], dtype=test.dtype, device=test.device)
    for weight in fine:
        _, contrast = _scale_means(test, ref)
        product = product * contrast.clamp(min=0.0) ** weight
        test, ref = (F.avg_pool2d(image, 2, ceil_mode=True) for image in (test, ref))
    whole, _ = _scale_means(test, ref)
    return (product * whole.clamp(min=0.0) ** coarsest).mean(1)
