"""Judging test folders against a reference: from folders to one result.

The result is plain values, the same that `--output` writes as JSON.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from importlib import metadata
from itertools import compress
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rtsr_cli import __version__
from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.evaluation import score_summary
from rtsr_cli.core.evaluation.comparisons import Comparison
from rtsr_cli.core.evaluation.events import FrameJudged
from rtsr_cli.core.evaluation.judged_frames import REFERENCE, JudgedFrame, read_judged
from rtsr_cli.core.evaluation.metric_table import METRICS, REFERENCE_WARPED, WARPED, MetricRules
from rtsr_cli.core.evaluation.protocols import Protocol, ShownPicture
from rtsr_cli.core.evaluation.regions import REGION_MEANINGS, Region
from rtsr_cli.core.evaluation.score_summary import BETWEEN, REASONS, VMAF
from rtsr_cli.core.evaluation.shot_notes import list_notes
from rtsr_cli.core.evaluation.shot_scores import ScoringOptions, score_shot
from rtsr_cli.core.frames.selection import Selection, format_ranges
from rtsr_cli.core.metrics.vmaf import Vmaf, choose_model, describe_too_small
from rtsr_cli.core.statistics import INTERVAL_RULE

MOST_ROWS = 512
"""Rows of an EPI picture; longer sequences are thinned."""


@dataclass(frozen=True, kw_only=True)
class FrameRow:
    """One row of every frame, for an EPI picture.

    Attributes:
        row: its number in the judged picture.
        rows: method, or "" for the reference, -> 1 x 3 x 1 x w of display values a frame.
    """

    row: int
    rows: dict[str, list[Tensor]] = field(default_factory=dict)

    def add(self, kept: KeptFrame) -> None:
        """Add the row of a frame, if it is not left out."""
        for method, row in kept.row.items():
            self.rows.setdefault(method, []).append(row)


@dataclass(frozen=True, kw_only=True)
class KeptFrame:
    """What is kept of a frame beside its scores, by method and for the reference.

    Attributes:
        row: 1 x 3 x 1 x w.
        pictures: h x w x 3 bytes, empty where VMAF is not asked for.
    """

    row: Mapping[str, Tensor]
    pictures: Mapping[str, NDArray[np.uint8]]


@dataclass(frozen=True, kw_only=True)
class _FrameKeeper:
    """Takes from each frame what is needed after its scores are known."""

    protocol: Protocol
    row: int
    numbers: frozenset[int]
    pictures: bool

    def __call__(self, frame: JudgedFrame) -> KeptFrame:
        linear = {REFERENCE: frame.reference, **frame.tests}
        shown = {method: ShownPicture(color, self.protocol) for method, color in linear.items()}
        cut = slice(self.row, self.row + 1)
        thinned = shown if frame.number in self.numbers else {}
        return KeptFrame(
            row={
                m: s.protocol.structure(s.linear[:, :, cut]).half().cpu()
                for m, s in thinned.items()
            },
            pictures={m: s.eight_bit().cpu().numpy() for m, s in shown.items()}
            if self.pictures
            else {},
        )


@dataclass(frozen=True, kw_only=True)
class JudgedShot:
    """Everything found out about one shot.

    Attributes:
        comparison: what was compared.
        frames: method -> frame number -> `FrameScores.facts`.
        slice: rows for the EPI picture.
        failed: why frames could not be judged.
        vmaf: model and build that judged the shot, "" where VMAF is not asked for.
    """

    comparison: Comparison
    frames: Mapping[str, Mapping[str, Any]]
    slice: FrameRow
    failed: tuple[str, ...] = ()
    vmaf: str = ""


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """How a judgement is described in its result.

    Attributes:
        run: how frames are judged.
        options: what of it users chose, for the result.
        inputs: folders, for the result.
        unavailable: metric -> why it was left out.
        selection: frames that are judged, `shard` being the part of them that this run judges.
        vmaf_model: VMAF's model, None for the one that the size calls for.
    """

    run: ScoringOptions
    options: Mapping[str, Any]
    inputs: Mapping[str, Any]
    unavailable: Mapping[str, str] = field(default_factory=dict)
    selection: Selection = field(default_factory=Selection)
    vmaf_model: str | None = None


class _Videos:
    """VMAF of every method; a frame's score depends on the one before and the one after it."""

    def __init__(self, scorers: Mapping[str, Vmaf]) -> None:
        """Start with no frame."""
        self.made_by = ""
        self._scorers = scorers
        self._judged: list[bool] = []

    def add(self, kept: KeptFrame, *, judged: bool = True) -> None:
        """Add a frame; one that is not judged is there for its neighbour's sake."""
        for method, scorer in self._scorers.items():
            scorer.add(kept.pictures[method], kept.pictures[REFERENCE])
        self._judged.append(judged)

    def finish(self) -> dict[str, tuple[float, ...]]:
        """Scores of the judged frames, by method."""
        scores = {method: scorer.finish() for method, scorer in self._scorers.items()}
        self.made_by = next((f"{s.model}, {s.build}" for s in scores.values()), "")
        return {m: tuple(compress(scores.frames, self._judged)) for m, scores in scores.items()}


def find_neighbours(comparison: Comparison, selection: Selection) -> tuple[int | None, int | None]:
    """Return the frames before and after a part (`--shard`) in the sequence that it is part of."""
    whole = replace(selection, shard=None).of(comparison.available)
    first, last = comparison.numbers[0], comparison.numbers[-1]
    before = max((n for n in whole if n < first), default=None)
    after = min((n for n in whole if n > last), default=None)
    return (before, after) if selection.shard else (None, None)


def judge_shot(
    comparison: Comparison, judgement: Judgement
) -> Generator[FrameJudged, None, JudgedShot]:
    """Judge one shot; yields after every frame.

    Raises:
        RtsrError: VMAF's program fails.
    """
    options = judgement.run
    height, width = (side - 2 * options.border for side in comparison.size)
    every = max(1, -(-len(comparison.numbers) // MOST_ROWS))
    sliced = FrameRow(row=height // 2)
    wanted = tuple(comparison.tests) if VMAF in options.rules.metrics else ()
    too_small = describe_too_small((height, width)) if wanted else ""
    videos = wanted if comparison.numbers and not too_small else ()
    keep = _FrameKeeper(
        protocol=options.rules.protocol,
        row=sliced.row,
        numbers=frozenset(comparison.numbers[::every]),
        pictures=bool(videos),
    )
    frames: dict[str, dict[str, Any]] = {method: {} for method in comparison.tests}
    failed: list[str] = []
    with ExitStack() as stack:
        model = judgement.vmaf_model or choose_model(height)
        video = _Videos({m: stack.enter_context(Vmaf((height, width), model)) for m in videos})
        before, after = find_neighbours(comparison, judgement.selection) if videos else (None, None)
        _add_neighbour(video, comparison, before, replace(options, keep=keep))
        for scored in score_shot(comparison, replace(options, keep=keep)):
            yield FrameJudged(shot=comparison.shot, number=scored.number, failed=scored.failed)
            if scored.failed:
                failed.append(scored.failed)
                continue
            if scored.kept is not None:
                sliced.add(scored.kept)
                video.add(scored.kept)
            for method, scores in scored.scores.items():
                frames[method][str(scored.number)] = scores.facts()
        _add_neighbour(video, comparison, after, replace(options, keep=keep))
        vmaf_scores = video.finish()
    for method in wanted:
        _add_vmaf(frames[method], vmaf_scores.get(method, ()), too_small)
    return JudgedShot(
        comparison=comparison,
        frames=frames,
        slice=sliced,
        failed=tuple(failed),
        vmaf=video.made_by,
    )


def _add_vmaf(frames: Mapping[str, Any], values: Sequence[float], too_small: str) -> None:
    """Add VMAF, or why there is none, to the facts of the frames that are judged."""
    judged = [facts for facts in frames.values() if BETWEEN not in facts]
    for facts in judged if too_small else ():
        facts |= {VMAF: None, REASONS: {**facts.get(REASONS, {}), VMAF: too_small}}
    for facts, value in zip(judged, values, strict=not too_small):
        facts[VMAF] = value


def _add_neighbour(
    video: _Videos, comparison: Comparison, number: int | None, options: ScoringOptions
) -> None:
    """Show VMAF a frame that another part judges; one that cannot be read fails there."""
    if number is None or options.keep is None:
        return
    try:
        frame = read_judged(comparison, number, border=options.border, device=options.device)
    except RtsrError:
        return
    video.add(options.keep(frame), judged=False)


def describe_shard(selection: Selection) -> dict[str, Any] | None:
    """Which part of what is judged, as the JSON file has it; None for everything."""
    if selection.shard is None:
        return None
    return {
        "parts": [selection.shard.index],
        "of": selection.shard.count,
        "frames": None if selection.frames is None else format_ranges(selection.frames),
    }


def assemble_result(shots: Sequence[JudgedShot], judgement: Judgement) -> dict[str, Any]:
    """Put the shots together as the JSON file has them."""
    rules = judgement.run.rules
    single = len(shots) == 1
    tests: dict[str, Any] = {}
    for shot in shots:
        name = shot.comparison.shot
        for method, frames in shot.frames.items():
            key = f"{method}/{name}" if name and not single else method
            summary = score_summary.summarise_frames(frames)
            tests[key] = {
                "method": method,
                "shot": name,
                "predicted": sorted(shot.comparison.tests[method].predicted),
                **summary,
                "notes": list_notes(shot.comparison, method, frames),
            }
    result = {
        "protocol": rules.protocol.name,
        "description": rules.protocol.description,
        "version": __version__,
        "options": dict(judgement.options),
        "metrics": _describe_metrics(judgement),
        "regions": {region.value: {"description": REGION_MEANINGS[region]} for region in Region},
        "inputs": dict(judgement.inputs),
        "versions": _list_versions(shots, rules),
        "rules": f"{score_summary.INFINITE_RULE}; {INTERVAL_RULE}",
        "tests": tests,
    }
    shard = describe_shard(judgement.selection)
    if shard is not None:
        result["shard"] = shard
    return result if single else {**result, "methods": score_summary.group_by_method(tests)}


def _list_versions(shots: Sequence[JudgedShot], rules: MetricRules) -> dict[str, str]:
    """Everything that figures depend on beside this program."""
    versions = {"rtsr": __version__, "torch": torch.__version__, "numpy": np.__version__}
    models = dict.fromkeys(shot.vmaf for shot in shots if shot.vmaf)
    if models:
        versions |= {"imageio-ffmpeg": metadata.version("imageio-ffmpeg"), VMAF: "; ".join(models)}
    return versions | ({"lpips weights": rules.lpips_source} if rules.lpips_source else {})


def _describe_metrics(judgement: Judgement) -> dict[str, Any]:
    rules = judgement.run.rules
    described: dict[str, Any] = {}
    for name in (*rules.metrics, *judgement.unavailable):
        metric = METRICS[name]
        described[name] = {
            "title": metric.title,
            "unit": metric.unit,
            "better": metric.better.value,
            "convention": metric.meaning + _describe_convention(name, rules),
        }
        if name in judgement.unavailable:
            described[name]["unavailable"] = judgement.unavailable[name]
        if name == WARPED:
            described[REFERENCE_WARPED] = {
                **described[name],
                "title": "Warped error of the reference",
                "convention": "what the reference itself changes along motion",
            }
    return described


def _describe_convention(name: str, rules: MetricRules) -> str:
    return {
        "ssim": f"; convention {rules.ssim}",
        "flip": f"; {rules.ppd:g} pixels per degree",
        "hdr-flip": f"; {rules.ppd:g} pixels per degree",
    }.get(name, "")
