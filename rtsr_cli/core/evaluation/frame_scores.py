"""Scoring one frame: every metric, over the whole frame and over its regions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from torch import Tensor

from rtsr_cli.core.errors import MetricError, ShapeMismatchError
from rtsr_cli.core.evaluation.judged_frames import REFERENCE, JudgedFrame
from rtsr_cli.core.evaluation.metric_table import (
    LEAST_PIXELS,
    METRICS,
    REFERENCE_WARPED,
    WARPED,
    ErrorMap,
    JudgedPair,
    MetricRules,
    warp_change,
)
from rtsr_cli.core.evaluation.protocols import ShownPicture
from rtsr_cli.core.evaluation.regions import Region, find_regions
from rtsr_cli.core.evaluation.score_summary import FrameScores
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.warping import fetch_nearest
from rtsr_cli.core.shapes import Mask

NOTHING_FINITE = "no pixel that it is computed for is finite in both pictures"
NOTHING_SEEN = f"fewer than {LEAST_PIXELS} pixels show a surface that the frame before shows, too"
"""Why a metric has no value, where it is none of its own."""


def score_frame(
    frame: JudgedFrame,
    before: JudgedFrame | None,
    rules: MetricRules,
    *,
    counted: bool,
    surfaces_before: Frame | None = None,
) -> dict[str, FrameScores]:
    """Score every method on one frame.

    Args:
        frame: the frame.
        before: the frame that its motion leads to, None after a cut.
        rules: protocol and metrics.
        counted: whether the frame takes part in means.
        surfaces_before: buffers of that frame where not all folders have it.
    """
    previous = surfaces_before if before is None else before.gbuffer
    regions = find_regions(frame.gbuffer, previous, frame.reference)
    signed = any(any(f.negative.values()) for f in (frame, before) if f is not None)
    show = partial(ShownPicture, protocol=rules.protocol, signed=signed)
    reference = show(frame.reference)
    reference_before = None if before is None else show(before.reference)
    motion = _motion_of(frame) if previous is not None else None
    unseen = _join_unseen(regions)
    by_method = {}
    for method, linear in frame.tests.items():
        valid = frame.valid[method]
        pair = JudgedPair(
            test=show(linear),
            reference=reference,
            rules=rules,
            test_before=None if before is None else show(before.tests[method]),
            reference_before=reference_before,
            motion_px=motion,
            history=_valid_history(frame, before, method, unseen),
        )
        found = _score_pair(pair, valid, regions)
        by_method[method] = FrameScores(
            number=frame.number,
            scores=found.scores,
            regions=found.regions,
            nonfinite=frame.nonfinite[method],
            nonfinite_reference=frame.nonfinite_reference,
            negative=frame.negative[method],
            negative_reference=frame.negative[REFERENCE],
            reasons=found.reasons,
            counted=counted,
            past=frame.past.get(method),
            between=frame.between,
        )
    return by_method


def _join_unseen(regions: Mapping[Region, Mask | None]) -> Mask | None:
    """Pixels that the frame before does not show, for whichever reason; None if nobody can tell."""
    hidden, outside = regions[Region.DISOCCLUDED], regions[Region.OFF_SCREEN]
    return None if hidden is None or outside is None else hidden | outside


def _motion_of(frame: JudgedFrame) -> Tensor | None:
    if frame.gbuffer is None or Buffer.MOTION not in frame.gbuffer.gbuffer:
        return None
    return frame.gbuffer.gbuffer[Buffer.MOTION]


def _valid_history(
    frame: JudgedFrame, before: JudgedFrame | None, method: str, unseen: Mask | None
) -> Mask | None:
    """Pixels that are valid now and were, seen, in the frame before; None where nobody can tell."""
    if before is None or unseen is None:
        return None
    motion = _motion_of(frame)
    if motion is None:
        return None
    was_valid = fetch_nearest(before.valid[method].to(motion), motion) > 0
    return frame.valid[method] & ~unseen & was_valid


@dataclass(frozen=True)
class _PairScores:
    """Scores over the frame, and over each region; and metric -> why there is none."""

    scores: dict[str, float | None]
    regions: dict[str, dict[str, float | None] | None]
    reasons: dict[str, str]


def _score_pair(
    pair: JudgedPair, valid: Mask, regions: Mapping[Region, Mask | None]
) -> _PairScores:
    masks = {r: None if m is None else m & valid for r, m in regions.items()}
    result = _PairScores(
        scores={},
        regions={
            region.value: None if mask is None else {"share": float(mask.float().mean())}
            for region, mask in ({Region.ALL: valid} | masks).items()
        },
        reasons={},
    )
    for name in pair.rules.metrics:
        try:
            _score_metric(name, pair, valid, masks=masks, result=result)
        except (ShapeMismatchError, MetricError) as small:
            result.scores[name], result.reasons[name] = None, str(small)
    return result


def _score_metric(
    name: str,
    pair: JudgedPair,
    valid: Mask,
    *,
    masks: Mapping[Region, Mask | None],
    result: _PairScores,
) -> None:
    """Add a metric's scores.

    Raises:
        ShapeMismatchError, MetricError: the metric cannot compare frames of this size.
    """
    metric, scores = METRICS[name], result.scores
    if metric.whole is not None:
        scores[name] = metric.whole(pair)
    if metric.measure is None:
        return
    error, seen = metric.measure(pair), metric.needs_motion
    whole = _mean_of_region(error, pair, valid, seen=seen, least=LEAST_PIXELS if seen else 1)
    scores[name] = whole
    if whole is None and error is not None and not (seen and pair.history is None):
        result.reasons[name] = NOTHING_SEEN if seen else NOTHING_FINITE
    for region, mask in ({Region.ALL: valid} | dict(masks)).items():
        held = result.regions[region.value]
        if mask is not None and held is not None:
            of_all = region is Region.ALL
            held[name] = whole if of_all else _mean_of_region(error, pair, mask, seen=seen)
    if name == WARPED:
        truth = warp_change(pair.reference, pair.reference_before, pair.motion_px)
        scores[REFERENCE_WARPED] = _mean_of_region(truth, pair, valid, seen=True)


def _mean_of_region(
    error: ErrorMap | None,
    pair: JudgedPair,
    mask: Mask,
    *,
    seen: bool,
    least: int = LEAST_PIXELS,
) -> float | None:
    """Mean over a region, or over what of it the frame before shows; None where nobody can tell."""
    if error is None or (seen and pair.history is None):
        return None
    counted = mask & pair.history if seen and pair.history is not None else mask
    return error.over(counted, least=least)
