"""What is to be said of one method on one shot beside its figures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rtsr_cli.core.evaluation.comparisons import Comparison
from rtsr_cli.core.evaluation.metric_table import METRICS
from rtsr_cli.core.evaluation.score_summary import NO_HISTORY, REASONS
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.wording import say_count, say_verb


def list_notes(comparison: Comparison, method: str, frames: Mapping[str, Any]) -> list[str]:
    """List the notes of a method.

    Args:
        comparison: what was compared.
        method: of the test.
        frames: its frames by number, as `FrameScores.facts`.
    """
    bad = {n: f["nonfinite"] for n, f in frames.items() if f["nonfinite"]}
    test, truth = comparison.tests[method], comparison.reference
    notes = [*test.warnings, *(f"the reference: {text}" for text in truth.warnings)]
    if not (test.fills_region and truth.fills_region):
        notes.append(
            "data windows are smaller than what is compared; pixels that no file holds are black"
        )
    if bad:
        count, where = sum(bad.values()), say_frames([int(n) for n in bad])
        notes.append(
            f"{say_count(count, 'pixel')} {say_verb(count)} NaN or Inf in {where}; left out"
        )
    hidden = {n: c for n, f in frames.items() if (c := f["nonfinite_reference"])}
    if hidden:
        count, where = sum(hidden.values()), say_frames([int(n) for n in hidden])
        notes.append(
            f"{say_count(count, 'pixel')} of the reference {say_verb(count)} NaN or Inf in "
            f"{where}; left out"
        )
    notes += _describe_stamped(comparison)
    notes += _describe_negative(frames)
    notes += _describe_reasons(frames)
    notes += list_buffer_notes(comparison)
    if comparison.gbuffer is not None and comparison.gbuffer.lent_motion is not None:
        notes.append(comparison.gbuffer.lent_motion.note)
    if comparison.gbuffer is None:
        notes.append("no buffers of this size: regions and temporal metrics cannot be made")
    elif all(comparison.previous(number) is None for number in comparison.numbers):
        notes.append(NO_HISTORY)
    return notes


def _describe_stamped(comparison: Comparison) -> list[str]:
    """Say that the stamped frames alone are judged, if they are, and what of."""
    if not comparison.stamped:
        return []
    between = comparison.between
    change = "; temporal metrics are of the frames between them, too" if between else ""
    return [
        f"{say_frames(comparison.numbers)} alone {say_verb(len(comparison.numbers))} judged, "
        f"stamped rtsr:predicted{change}"
    ]


def list_buffer_notes(comparison: Comparison) -> list[str]:
    """List what is to be said of the buffers that regions and history are made of.

    Disocclusion is told by depth, carried along the camera and held against the vectors: matrices
    that are not used or not verified count there.
    """
    gbuffer = comparison.gbuffer
    if gbuffer is None:
        return []
    said = {*comparison.reference.warnings, *comparison.reference.notes}
    own = dict.fromkeys((*gbuffer.warnings, *gbuffer.notes))
    notes = [f"the buffers: {text}" for text in own if text not in said]
    without = set(comparison.numbers).difference(gbuffer.numbers)
    if without:
        verb = "is" if len(without) == 1 else "are"
        notes.append(f"{say_frames(without)} {verb} judged as pictures, not by region")
    return notes


def _describe_negative(frames: Mapping[str, Any]) -> list[str]:
    """Say where radiance is below 0, which displays show as black."""
    notes = []
    for key, whose in (("negative", "radiance is"), ("negative_reference", "the reference is")):
        bad = {int(n): f[key] for n, f in frames.items() if f.get(key)}
        if bad:
            notes.append(
                f"{whose} below 0 in {say_count(sum(bad.values()), 'value')} of {say_frames(bad)}: "
                "PSNR compares them as -c/(1-c), pictures show black"
            )
    return notes


def _describe_reasons(frames: Mapping[str, Any]) -> list[str]:
    """Say why frames have no value of a metric."""
    lacking: dict[tuple[str, str], list[int]] = {}
    for number, facts in frames.items():
        for metric, reason in facts.get(REASONS, {}).items():
            lacking.setdefault((metric, reason), []).append(int(number))
    return [
        f"no {METRICS[metric].title} of {say_frames(numbers)}: {reason}"
        for (metric, reason), numbers in lacking.items()
    ]
