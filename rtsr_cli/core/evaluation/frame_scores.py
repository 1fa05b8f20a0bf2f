"""Scoring one frame: every metric, over the whole frame and over its regions."""

from __future__ import annotations

from collections.abc import Mapping

from torch import Tensor

from rtsr_cli.core.evaluation.judged_frames import JudgedFrame
from rtsr_cli.core.evaluation.metric_table import (
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
from rtsr_cli.core.imaging.warping import fetch_nearest
from rtsr_cli.core.shapes import Mask


def score_frame(
    frame: JudgedFrame, before: JudgedFrame | None, rules: MetricRules, *, counted: bool
) -> dict[str, FrameScores]:
    """Score every method on one frame.

    Args:
        frame: the frame.
        before: the frame that its motion leads to, None after a cut.
        rules: protocol and metrics.
        counted: whether the frame takes part in means.
    """
    previous = None if before is None else before.gbuffer
    regions = find_regions(frame.gbuffer, previous, frame.reference)
    reference = ShownPicture(frame.reference, rules.protocol)
    reference_before = None if before is None else ShownPicture(before.reference, rules.protocol)
    motion = _motion_of(frame) if previous is not None else None
    disoccluded = regions[Region.DISOCCLUDED]
    by_method = {}
    for method, linear in frame.tests.items():
        valid = frame.valid[method]
        pair = JudgedPair(
            test=ShownPicture(linear, rules.protocol),
            reference=reference,
            rules=rules,
            test_before=None
            if before is None
            else ShownPicture(before.tests[method], rules.protocol),
            reference_before=reference_before,
            motion_px=motion,
            history=_valid_history(frame, before, method, disoccluded),
        )
        scores, by_region = _score_pair(pair, valid, regions)
        by_method[method] = FrameScores(
            number=frame.number,
            scores=scores,
            regions=by_region,
            nonfinite=frame.nonfinite[method],
            nonfinite_reference=frame.nonfinite_reference,
            counted=counted,
        )
    return by_method


def _motion_of(frame: JudgedFrame) -> Tensor | None:
    if frame.gbuffer is None or Buffer.MOTION not in frame.gbuffer.gbuffer:
        return None
    return frame.gbuffer.gbuffer[Buffer.MOTION]


def _valid_history(
    frame: JudgedFrame, before: JudgedFrame | None, method: str, disoccluded: Mask | None
) -> Mask | None:
    """Pixels that are valid now and were, seen, in the frame before; None where nobody can tell."""
    if before is None or disoccluded is None:
        return None
    motion = _motion_of(frame)
    if motion is None:
        return None
    was_valid = fetch_nearest(before.valid[method].to(motion), motion) > 0
    return frame.valid[method] & ~disoccluded & was_valid


def _score_pair(
    pair: JudgedPair, valid: Mask, regions: Mapping[Region, Mask | None]
) -> tuple[dict[str, float | None], dict[str, dict[str, float | None] | None]]:
    """Scores over the frame, and over each region."""
    masks = {Region.ALL: valid} | {r: None if m is None else m & valid for r, m in regions.items()}
    by_region: dict[str, dict[str, float | None] | None] = {
        region.value: None if mask is None else {"share": float(mask.float().mean())}
        for region, mask in masks.items()
    }
    scores: dict[str, float | None] = {}
    for name in pair.rules.metrics:
        metric = METRICS[name]
        if metric.whole is not None:
            scores[name] = metric.whole(pair)
        if metric.measure is None:
            continue
        error = metric.measure(pair)
        for region, mask in masks.items():
            held = by_region[region.value]
            if mask is not None and held is not None:
                held[name] = _mean_of_region(error, pair, mask, seen=metric.needs_motion)
        scores[name] = _mean_of_region(error, pair, valid, seen=metric.needs_motion)
        if name == WARPED:
            truth = warp_change(pair.reference, pair.reference_before, pair.motion_px)
            scores[REFERENCE_WARPED] = _mean_of_region(truth, pair, valid, seen=True)
    return scores, by_region


def _mean_of_region(
    error: ErrorMap | None, pair: JudgedPair, mask: Mask, *, seen: bool
) -> float | None:
    """Mean over a region, or over what of it the frame before shows; None where nobody can tell."""
    if error is None or (seen and pair.history is None):
        return None
    return error.over(mask & pair.history if seen and pair.history is not None else mask)
