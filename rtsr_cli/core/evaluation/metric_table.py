"""The metrics by name: what each is called, which way is better, and how a frame is measured.

A metric is a map of one value a pixel whose mean is taken over any region, one figure of the
frame, or (VMAF) a judgement of the sequence, made elsewhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

from torch import Tensor

from rtsr_cli.core.choices import SsimConvention
from rtsr_cli.core.evaluation.protocols import Protocol, ShownPicture
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
class MetricRules:
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
class JudgedPair:
    """One test picture beside its reference, and both of the frame before where there is one.

    `history` is 1 where this frame's surface was seen in the frame before, at `motion_px`.
    """

    test: ShownPicture
    reference: ShownPicture
    rules: MetricRules
    test_before: ShownPicture | None = None
    reference_before: ShownPicture | None = None
    motion_px: Tensor | None = None
    history: Mask | None = None


@dataclass(frozen=True)
class ErrorMap:
    """One value a pixel, and how a mean of it reads; the map lacks `margin` pixels at each side."""

    values: PixelMap
    margin: int = 0
    reading: Callable[[float], float] = float

    def over(self, mask: Mask, *, least: int = LEAST_PIXELS) -> float | None:
        """Mean over a region; None where fewer than `least` pixels are in it."""
        inside = cut_margin(mask, self.margin).to(self.values)
        if float(inside.sum()) < least:
            return None
        return self.reading(float(masked_mean(self.values, inside)))


def _to_decibels(error: float) -> float:
    return math.inf if error == 0.0 else -DECIBELS * math.log10(error)


def _measure_psnr(pair: JudgedPair) -> ErrorMap:
    values = squared_error_map(pair.test.psnr, pair.reference.psnr)
    return ErrorMap(values, reading=_to_decibels)


def _measure_ssim(pair: JudgedPair) -> ErrorMap:
    convention = pair.rules.ssim
    values = ssim_map(pair.test.ssim, pair.reference.ssim, convention)
    return ErrorMap(values, margin=margin_px(convention))


def _measure_flip(pair: JudgedPair) -> ErrorMap:
    shown = pair.test.structure, pair.reference.structure
    return ErrorMap(ldr_flip(*shown, pair.rules.ppd))


def _measure_hdr_flip(pair: JudgedPair) -> ErrorMap:
    result = hdr_flip(pair.test.linear, pair.reference.linear, ppd=pair.rules.ppd)
    return ErrorMap(result.error)


def _measure_lpips(pair: JudgedPair) -> ErrorMap:
    assert pair.rules.lpips is not None
    shown = pair.test.structure, pair.reference.structure
    return ErrorMap(pair.rules.lpips(*shown))


def _measure_temporal_change(pair: JudgedPair) -> ErrorMap | None:
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


def warp_change(
    shown: ShownPicture, before: ShownPicture | None, motion_px: Tensor | None
) -> ErrorMap | None:
    """|frame - frame before fetched along motion|, shading changes included."""
    if before is None or motion_px is None:
        return None
    return ErrorMap(warped_error_map(shown.psnr, before.psnr, motion_px))


def _measure_tpsnr(pair: JudgedPair) -> ErrorMap | None:
    """PSNR of the differences of consecutive frames, pixel by pixel, without motion."""
    if pair.test_before is None or pair.reference_before is None:
        return None
    test = pair.test.psnr - pair.test_before.psnr
    reference = pair.reference.psnr - pair.reference_before.psnr
    return ErrorMap(squared_error_map(test, reference), reading=_to_decibels)


Measure = Callable[[JudgedPair], ErrorMap | None]


@dataclass(frozen=True, kw_only=True)
class MetricRow:
    """One metric.

    Attributes:
        title: as tables head it.
        better: which way.
        unit: of its values.
        meaning: one sentence for the report.
        measure: its map; None for one that judges whole frames or sequences.
        whole: one figure of the frame.
        needs_motion: only pixels count that the frame before shows, along motion.
        of_change: it compares a frame with the one before it.
    """

    title: str
    better: Better
    meaning: str
    unit: str = ""
    measure: Measure | None = None
    whole: Callable[[JudgedPair], float] | None = None
    needs_motion: bool = False
    of_change: bool = False


def _measure_ms_ssim(pair: JudgedPair) -> float:
    return float(ms_ssim(pair.test.ssim, pair.reference.ssim)[0])


WARPED, REFERENCE_WARPED = "warped", "warped-reference"
"""The reference's own warped error: what its shading changes leave to be explained."""

METRICS: dict[str, MetricRow] = {
    "psnr": MetricRow(
        title="PSNR",
        unit="dB",
        better=Better.HIGHER,
        meaning="peak signal-to-noise ratio, peak 1",
        measure=_measure_psnr,
    ),
    "ssim": MetricRow(
        title="SSIM", better=Better.HIGHER, meaning="structural similarity", measure=_measure_ssim
    ),
    "ms-ssim": MetricRow(
        title="MS-SSIM",
        better=Better.HIGHER,
        meaning="structural similarity over five scales; more than 160 pixels a side",
        whole=_measure_ms_ssim,
    ),
    "flip": MetricRow(
        title="FLIP",
        better=Better.LOWER,
        meaning="difference seen when flipping between the pictures, 0 to 1",
        measure=_measure_flip,
    ),
    "hdr-flip": MetricRow(
        title="HDR-FLIP",
        better=Better.LOWER,
        meaning="largest FLIP over the exposures that the reference calls for",
        measure=_measure_hdr_flip,
    ),
    "lpips": MetricRow(
        title="LPIPS",
        better=Better.LOWER,
        meaning="distance of AlexNet features, version 0.1",
        measure=_measure_lpips,
    ),
    "vmaf": MetricRow(
        title="VMAF",
        better=Better.HIGHER,
        meaning=f"video quality as viewers rate it, 0 to 100, by model {MODEL_HD} "
        f"({MODEL_4K} from {ROWS_4K} rows) on 8-bit BT.709 luma of limited range; by {MODEL_HD} "
        "identical pictures score 97.43 and not 100 where nothing moves, and nothing has moved in "
        "the first frame",
    ),
    "tpsnr": MetricRow(
        title="tPSNR",
        unit="dB",
        better=Better.HIGHER,
        meaning="PSNR of differences between consecutive frames",
        measure=_measure_tpsnr,
        of_change=True,
    ),
    "temporal": MetricRow(
        title="Temporal change",
        better=Better.LOWER,
        meaning="change of (test - reference) along motion, where the surface was seen before",
        measure=_measure_temporal_change,
        needs_motion=True,
        of_change=True,
    ),
    WARPED: MetricRow(
        title="Warped error",
        better=Better.LOWER,
        meaning="difference to the frame before along motion; the reference's own stands beside",
        measure=lambda pair: warp_change(pair.test, pair.test_before, pair.motion_px),
        needs_motion=True,
        of_change=True,
    ),
}
"""Every metric by the name users type, in the order of tables."""


def keep_changes(rules: MetricRules) -> MetricRules:
    """Leave the metrics that compare a frame with the one before it."""
    return replace(rules, metrics=tuple(m for m in rules.metrics if METRICS[m].of_change))
