"""The metrics by name: what each is called, which way is better, and how a frame is measured.

A metric is a map of one value a pixel whose mean is taken over any region, one figure of the
frame, or (VMAF) a judgement of the sequence, made elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from torch import Tensor

from rtsr_cli.core.choices import SsimConvention
from rtsr_cli.core.evaluation.protocols import Protocol, Shown
from rtsr_cli.core.metrics.fidelity import DECIBELS, masked_mean, squared_error_map
from rtsr_cli.core.metrics.flip import DEFAULT_PPD, hdr_flip, ldr_flip
from rtsr_cli.core.metrics.ssim import cut_margin, margin_px, ms_ssim, ssim_map
from rtsr_cli.core.metrics.temporal import temporal_change_map, warped_error_map
from rtsr_cli.core.metrics.vmaf import MODEL_4K, MODEL_HD, ROWS_4K
from rtsr_cli.core.shapes import Color, Mask, PixelMap

LEAST_PIXELS = 64
"""A region of fewer pixels in a frame is not scored there."""


class Better(StrEnum):
    """Which way is better."""

    HIGHER = "higher"
    LOWER = "lower"


@dataclass(frozen=True, kw_only=True)
class Rules:
    """How frames are shown to the metrics.

    Attributes:
        protocol: tone mapping, transfer and quantisation.
        metrics: names, of `METRICS`.
        ssim: SSIM's convention.
        ppd: pixels per degree, for FLIP.
        lpips: map of a test and a reference, None where LPIPS is not asked for.
        lpips_source: where its weights come from.
    """

    protocol: Protocol
    metrics: tuple[str, ...]
    ssim: SsimConvention
    ppd: float = DEFAULT_PPD
    lpips: Callable[[Color, Color], PixelMap] | None = None
    lpips_source: str = ""


@dataclass(frozen=True, kw_only=True)
class Pair:
    """One test picture beside its reference, and both of the frame before where there is one.

    `history` is 1 where this frame's surface was seen in the frame before, at `motion_px`.
    """

    test: Shown
    reference: Shown
    rules: Rules
    test_before: Shown | None = None
    reference_before: Shown | None = None
    motion_px: Tensor | None = None
    history: Mask | None = None


@dataclass(frozen=True)
class ErrorMap:
    """One value a pixel, and how a mean of it reads; the map lacks `margin` pixels at each side."""

    values: PixelMap
    margin: int = 0
    reading: Callable[[float], float] = float

    def over(self, mask: Mask) -> float | None:
        """Mean over a region; None where it is too small."""
        inside = cut_margin(mask, self.margin).to(self.values)
        if float(inside.sum()) < LEAST_PIXELS:
            return None
        return self.reading(float(masked_mean(self.values, inside)))


def _decibels(error: float) -> float:
    return math.inf if error == 0.0 else -DECIBELS * math.log10(error)


def _psnr(pair: Pair) -> ErrorMap:
    values = squared_error_map(pair.test.psnr, pair.reference.psnr)
    return ErrorMap(values, reading=_decibels)


def _ssim(pair: Pair) -> ErrorMap:
    convention = pair.rules.ssim
    values = ssim_map(pair.test.ssim, pair.reference.ssim, convention)
    return ErrorMap(values, margin=margin_px(convention))


def _flip(pair: Pair) -> ErrorMap:
    shown = pair.test.structure, pair.reference.structure
    return ErrorMap(ldr_flip(*shown, pair.rules.ppd))


def _hdr_flip(pair: Pair) -> ErrorMap:
    found = hdr_flip(pair.test.linear, pair.reference.linear, ppd=pair.rules.ppd)
    return ErrorMap(found.error)


def _lpips(pair: Pair) -> ErrorMap:
    assert pair.rules.lpips is not None
    shown = pair.test.structure, pair.reference.structure
    return ErrorMap(pair.rules.lpips(*shown))


def _temporal(pair: Pair) -> ErrorMap | None:
    """|change of (test - reference) along motion|: 0 for a perfect result, and for a steady one."""
    if pair.test_before is None or pair.reference_before is None or pair.motion_px is None:
        return None
    values = temporal_change_map(
        pair.test.psnr,
        pair.reference.psnr,
        pair.test_before.psnr,
        pair.reference_before.psnr,
        pair.motion_px,
    )
    return ErrorMap(values)


def warped(shown: Shown, before: Shown | None, motion_px: Tensor | None) -> ErrorMap | None:
    """|frame - frame before fetched along motion|, shading changes included."""
    if before is None or motion_px is None:
        return None
    return ErrorMap(warped_error_map(shown.psnr, before.psnr, motion_px))


def _tpsnr(pair: Pair) -> ErrorMap | None:
    """PSNR of the differences of consecutive frames, pixel by pixel, without motion."""
    if pair.test_before is None or pair.reference_before is None:
        return None
    test = pair.test.psnr - pair.test_before.psnr
    reference = pair.reference.psnr - pair.reference_before.psnr
    return ErrorMap(squared_error_map(test, reference), reading=_decibels)


Measure = Callable[[Pair], ErrorMap | None]


@dataclass(frozen=True, kw_only=True)
class Metric:
    """One metric.

    Attributes:
        title: as tables head it.
        better: which way.
        unit: of its values.
        meaning: one sentence for the report.
        measure: its map; None for one that judges whole frames or sequences.
        whole: one figure of the frame.
        needs_motion: only pixels count that the frame before shows, along motion.
    """

    title: str
    better: Better
    meaning: str
    unit: str = ""
    measure: Measure | None = None
    whole: Callable[[Pair], float] | None = None
    needs_motion: bool = False


def _ms_ssim(pair: Pair) -> float:
    return float(ms_ssim(pair.test.ssim, pair.reference.ssim)[0])


WARPED, REFERENCE_WARPED = "warped", "warped-reference"
"""The reference's own warped error: what its shading changes leave to be explained."""

METRICS: dict[str, Metric] = {
    "psnr": Metric(
        title="PSNR",
        unit="dB",
        better=Better.HIGHER,
        meaning="peak signal-to-noise ratio, peak 1",
        measure=_psnr,
    ),
    "ssim": Metric(
        title="SSIM", better=Better.HIGHER, meaning="structural similarity", measure=_ssim
    ),
    "ms-ssim": Metric(
        title="MS-SSIM",
        better=Better.HIGHER,
        meaning="structural similarity over five scales; more than 160 pixels a side",
        whole=_ms_ssim,
    ),
    "flip": Metric(
        title="FLIP",
        better=Better.LOWER,
        meaning="difference seen when flipping between the pictures, 0 to 1",
        measure=_flip,
    ),
    "hdr-flip": Metric(
        title="HDR-FLIP",
        better=Better.LOWER,
        meaning="largest FLIP over the exposures that the reference calls for",
        measure=_hdr_flip,
    ),
    "lpips": Metric(
        title="LPIPS",
        better=Better.LOWER,
        meaning="distance of AlexNet features, version 0.1",
        measure=_lpips,
    ),
    "vmaf": Metric(
        title="VMAF",
        better=Better.HIGHER,
        meaning=f"video quality as viewers rate it, 0 to 100, by model {MODEL_HD} "
        f"({MODEL_4K} from {ROWS_4K} rows) on 8-bit BT.709 luma of limited range; by {MODEL_HD} "
        "identical pictures score 97.43 and not 100 where nothing moves, and nothing has moved in "
        "the first frame",
    ),
    "tpsnr": Metric(
        title="tPSNR",
        unit="dB",
        better=Better.HIGHER,
        meaning="PSNR of differences between consecutive frames",
        measure=_tpsnr,
    ),
    "temporal": Metric(
        title="Temporal change",
        better=Better.LOWER,
        meaning="change of (test - reference) along motion, where the surface was seen before",
        measure=_temporal,
        needs_motion=True,
    ),
    WARPED: Metric(
        title="Warped error",
        better=Better.LOWER,
        meaning="difference to the frame before along motion; the reference's own stands beside",
        measure=lambda pair: warped(pair.test, pair.test_before, pair.motion_px),
        needs_motion=True,
    ),
}
"""Every metric by the name users type, in the order of tables."""
