"""Judging result folders against a reference: from a request to figures, files and demands."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtsr_cli.core.documents import read_text
from rtsr_cli.core.errors import ConfigError, FrameFolderError, did_you_mean
from rtsr_cli.core.evaluation import score_summary
from rtsr_cli.core.evaluation.comparisons import Comparison
from rtsr_cli.core.evaluation.demands import Condition, list_failures
from rtsr_cli.core.evaluation.events import (
    ComparisonPlanned,
    EvaluationDone,
    EvaluationEvent,
    JudgingStarted,
    ResultReady,
    ResultWritten,
)
from rtsr_cli.core.evaluation.illustrations import draw_moments, draw_strips
from rtsr_cli.core.evaluation.judged_frames import check_border
from rtsr_cli.core.evaluation.judgement import JudgedShot, Judgement, assemble_result, judge_shot
from rtsr_cli.core.evaluation.metric_table import METRICS
from rtsr_cli.core.evaluation.preparation import make_judgement, open_request
from rtsr_cli.core.evaluation.request import EvaluateRequest
from rtsr_cli.core.evaluation.result_files import (
    check_outputs,
    decode_json,
    encode_csv,
    encode_json,
)
from rtsr_cli.core.evaluation.shot_notes import list_buffer_notes
from rtsr_cli.core.files.atomic_write import write_text_atomically
from rtsr_cli.core.files.folders import is_folder
from rtsr_cli.core.reporting.report import write_html_report


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """A result, and what its pictures are made from; nothing of the latter after a merge.

    Attributes:
        result: plain values, as the JSON file has them.
        shots: what was judged.
        judgement: how, None after a merge.
    """

    result: Mapping[str, Any]
    shots: Sequence[JudgedShot] = ()
    judgement: Judgement | None = None


def evaluate(request: EvaluateRequest) -> Iterator[EvaluationEvent]:
    """Judge, or join parts; then write what was asked for.

    Nothing is written before `ResultReady`; the last event is `EvaluationDone`. A dry run ends
    with the plans.

    Raises:
        RtsrError: an input is refused, or an output cannot be written.
    """
    check_outputs(request.outputs, overwrite=request.overwrite)
    if request.merge:
        evaluation = merge_files(request.tests)
    else:
        judged = yield from _judge(request)
        if judged is None:
            return
        evaluation = judged
    check_demands(request.demands, evaluation.result)
    contents = {path: WRITERS[path.suffix.lower()](evaluation) for path in request.outputs}
    yield ResultReady(result=evaluation.result)
    for path, content in contents.items():
        write_text_atomically(path, content)
        yield ResultWritten(path=path)
    unavailable = {} if evaluation.judgement is None else evaluation.judgement.unavailable
    # one that was named is missed; of all of them, those that can be had are enough
    named = set(request.metrics) < set(METRICS)
    yield EvaluationDone(
        result=evaluation.result,
        missed=tuple(list_failures(evaluation.result, request.demands)),
        failed=tuple(reason for shot in evaluation.shots for reason in shot.failed),
        lacking=tuple(unavailable) if named else (),
    )


def _judge(request: EvaluateRequest) -> Generator[EvaluationEvent, None, Evaluation | None]:
    """Survey, judge and put together; None for a dry run."""
    comparisons = open_request(request)
    judgement = yield from make_judgement(request)
    for comparison in comparisons:
        check_border(comparison, request.border)
        yield describe_comparison(comparison, request.skip_first)
    if request.dry_run:
        return None
    yield JudgingStarted(frames=sum(len(c.shown) for c in comparisons))
    shots = []
    for comparison in comparisons:
        shot = yield from judge_shot(comparison, judgement)
        shots.append(shot)
    return Evaluation(result=assemble_result(shots, judgement), shots=shots, judgement=judgement)


def describe_comparison(comparison: Comparison, skip_first: int) -> ComparisonPlanned:
    """Say what is going to be judged of a shot."""
    gbuffer = comparison.gbuffer
    return ComparisonPlanned(
        shot=comparison.shot,
        tests=tuple(comparison.tests),
        frames=comparison.numbers,
        size=comparison.size,
        reference=comparison.reference.frames.root,
        gbuffer=None if gbuffer is None else gbuffer.frames.root,
        counts=bool(set(comparison.numbers) - set(comparison.available[:skip_first])),
        remarks=comparison.remarks,
        stamped=comparison.stamped,
        notes=tuple(list_buffer_notes(comparison)),
    )


def merge_files(paths: Sequence[Path]) -> Evaluation:
    """Join the JSON files of parts; a folder stands for those in it.

    Raises:
        FrameFolderError: one is no result, or they do not go together.
    """
    parts = []
    for path in (part for given in paths for part in _list_parts(given)):
        try:
            parts.append((str(path), decode_json(read_text(path, pipes=True))))
        except (ValueError, OverflowError) as error:
            raise FrameFolderError(
                f"{path}: is no result of 'rtsr evaluate --output part.json' ({error})"
            ) from error
    return Evaluation(result=score_summary.merge_results(parts))


def _list_parts(path: Path) -> list[Path]:
    """The files that a path stands for."""
    if not is_folder(path):
        return [path]
    parts = sorted(path.glob("*.json"))
    if not parts:
        raise FrameFolderError(f"{path}: holds no parts; 'rtsr evaluate --output part.json' does")
    return parts


def check_demands(demands: Sequence[Condition], result: Mapping[str, Any]) -> None:
    """Refuse demands on metrics that merged parts do not hold.

    Raises:
        ConfigError: names the metric.
    """
    known = result["metrics"]
    for condition in demands:
        if condition.metric not in known:
            hint = did_you_mean(condition.metric, known)
            raise ConfigError(f"--fail-under: the parts hold no metric '{condition.metric}'{hint}")


def _encode_html(evaluation: Evaluation) -> str:
    if evaluation.judgement is None:
        return write_html_report(evaluation.result, (), ())
    pictures = tuple(draw_moments(evaluation.shots, evaluation.judgement))
    return write_html_report(evaluation.result, pictures, tuple(draw_strips(evaluation.shots)))


WRITERS: Mapping[str, Callable[[Evaluation], str]] = {
    ".json": lambda evaluation: encode_json(evaluation.result),
    ".csv": lambda evaluation: encode_csv(evaluation.result),
    ".html": _encode_html,
}
"""What a suffix of `outputs` writes."""
