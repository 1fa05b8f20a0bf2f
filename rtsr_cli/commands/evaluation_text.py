"""What `rtsr evaluate` says: its events, and a table for a person."""

from __future__ import annotations

import logging
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from typing import Any

from tqdm import tqdm

from rtsr_cli.commands.exit_codes import FAILED
from rtsr_cli.commands.failures_text import Failures
from rtsr_cli.commands.interrupts import unwind_on_signals
from rtsr_cli.commands.log import LOG
from rtsr_cli.commands.options import emit
from rtsr_cli.core.evaluation.events import (
    ComparisonPlanned,
    EvaluationDone,
    EvaluationEvent,
    FrameJudged,
    JudgingStarted,
    MetricUnavailable,
    ResultReady,
    ResultWritten,
)
from rtsr_cli.core.evaluation.result_files import encode_numbers
from rtsr_cli.core.evaluation.score_summary import HISTORY
from rtsr_cli.core.frames.selection import format_ranges
from rtsr_cli.core.wording import list_some

Result = Mapping[str, Any]

GAP = "  "
NOTHING = "-"

OF_REFERENCE = "-reference"
"""Ends the names of what is measured of the reference alone: nobody is best in it."""

MOST_NAMED = 3
"""Tests that are named before a note that many have."""

SMALL, FEW, MANY = 10.0, 2, 4
"""Scores below the first have so many decimals more than others."""


def show_evaluation(events: Iterable[EvaluationEvent], phase: ExitStack, *, as_json: bool) -> int:
    """Print what an evaluation says; return the exit code.

    Args:
        events: of the evaluation.
        phase: what Ctrl-C does until the result is there; files are then written undisturbed.
        as_json: print events in place of text.
    """
    bar, code = tqdm(disable=True), 0
    told: set[str] = set()
    failures, repeated = Failures(), set[str]()
    for event in events:
        match event:
            case JudgingStarted():
                bar = tqdm(total=event.frames, unit="frame", disable=None)
                phase.enter_context(bar)
            case FrameJudged():
                bar.update()
                if event.failed and not failures.add(event.shot, event.number, event.failed):
                    repeated.add(event.failed)
            case ResultReady():
                phase.close()
                show_result(event.result, told, as_json=as_json)
                phase.enter_context(unwind_on_signals())
            case EvaluationDone():
                log_shortfalls(event, failures, repeated)
                code = 0 if event.passed else FAILED
            case _:
                show_step(event, as_json=as_json)
                if isinstance(event, ComparisonPlanned) and LOG.isEnabledFor(logging.INFO):
                    told.update(event.notes)
    return code


def show_step(
    event: MetricUnavailable | ComparisonPlanned | ResultWritten, *, as_json: bool
) -> None:
    """Say what leads to a result, and what becomes of it."""
    match event:
        case MetricUnavailable():
            LOG.warning("Warning: %s", event.reason)
        case ComparisonPlanned():
            show_plan(event, as_json=as_json)
        case ResultWritten():
            LOG.info("%s: written", event.path)


def show_plan(plan: ComparisonPlanned, *, as_json: bool) -> None:
    """Say what is going to be judged of a shot."""
    height, width = plan.size
    facts = {
        "shot": plan.shot,
        "frames": format_ranges(plan.frames),
        "size": [width, height],
        "reference": str(plan.reference),
        "gbuffer": None if plan.gbuffer is None else str(plan.gbuffer),
        "remarks": list(plan.remarks),
        "predicted": plan.stamped,
        "notes": list(plan.notes),
    }
    if as_json:
        emit({"event": "plan", **facts})
        return
    for remark in plan.remarks:
        LOG.warning("Warning: %s", remark)
    if plan.frames and not plan.counts:
        LOG.warning("%s: --skip-first leaves no frame for means", facts["reference"])
    LOG.info(
        "%s: frames %s%s, %d x %d, against %s; buffers: %s",
        plan.shot or ", ".join(plan.tests),
        facts["frames"] or "none",
        " (stamped rtsr:predicted)" if plan.stamped else "",
        width,
        height,
        facts["reference"],
        facts["gbuffer"] or "none",
    )
    for note in plan.notes:
        LOG.info("    %s", note)


def show_result(result: Result, told: Collection[str] = (), *, as_json: bool) -> None:
    """Say all figures: means as a table, by region with -v, and what is noted about them.

    Args:
        result: of the evaluation.
        told: notes that were said before.
        as_json: print the result in place of text, all notes in it.
    """
    if as_json:
        emit({"event": "done", **encode_numbers(result)})
        return
    lines = (list_table_lines, list_history_lines, list_perfect_frame_lines)
    for line in (line for lines_of in lines for line in lines_of(result)):
        LOG.info("%s", line)
    if any(any(r for r in test["regions"].values()) for test in result["tests"].values()):
        for line in list_region_lines(result):
            LOG.debug("%s", line)
    for note, keys in group_notes(result).items():
        if note not in told:
            LOG.warning("Note: %s: %s", _name_tests(keys, result), note)


def group_notes(result: Result) -> dict[str, list[str]]:
    """Return each note once, with the tests that it is of."""
    groups: dict[str, list[str]] = {}
    for key, test in result["tests"].items():
        for note in test["notes"]:
            groups.setdefault(note, []).append(key)
    return groups


def _name_tests(keys: Sequence[str], result: Result) -> str:
    """Name tests, or say that it is all of many."""
    if len(keys) > MOST_NAMED and len(keys) == len(result["tests"]):
        return f"all {len(keys)} tests"
    return list_some(keys, MOST_NAMED)


def log_shortfalls(done: EvaluationDone, failures: Failures, repeated: Collection[str]) -> None:
    """Say which demands are missed and which frames failed.

    Args:
        done: the end of an evaluation.
        failures: of the frames that were judged, by cause.
        repeated: what was said of a frame before.
    """
    for line in done.missed:
        LOG.error("Missed: %s", line)
    for reason in (reason for reason in done.failed if reason not in repeated):
        LOG.error("Failed: %s", reason)
    for line in failures.list_repeats():
        LOG.error("Failed: %s", line)


def choose_decimals(values: Iterable[float | None]) -> int:
    """Decimals of scores that stand together: four where all lie below 10, else two."""
    sizes = [abs(v) for v in values if v is not None and math.isfinite(v)]
    return FEW if any(size >= SMALL for size in sizes) else MANY


def format_score(value: float | None, places: int | None = None) -> str:
    """Write a score with so many decimals, by its own size if nothing is said; `-` for none."""
    if value is None or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "inf"
    return f"{value:.{choose_decimals([value]) if places is None else places}f}"


def _find_best(values: Sequence[float | None], better: str) -> float | None:
    known = [v for v in values if v is not None and not math.isnan(v)]
    return (max(known) if better == "higher" else min(known)) if known else None


def list_table_lines(result: Result) -> Iterator[str]:
    """Lines of a table: a row a test, the best of each shot marked; then the methods' means."""
    tests = result["tests"]
    shots = list(dict.fromkeys(test["shot"] for test in tests.values()))
    groups = [{k: t["mean"] for k, t in tests.items() if t["shot"] == shot} for shot in shots]
    if "methods" in result:
        methods = result["methods"].items()
        groups.append({f"{m} (mean of {f['shots']} shots)": f["mean"] for m, f in methods})
    metrics = result["metrics"]
    names = [n for n in metrics if any(n in mean for group in groups for mean in group.values())]
    units = [f" {metrics[n]['unit']}" if metrics[n]["unit"] else "" for n in names]
    head = ["test", *(metrics[n]["title"] + unit for n, unit in zip(names, units, strict=True))]
    places = {
        n: choose_decimals(mean.get(n) for group in groups for mean in group.values())
        for n in names
    }
    rows = [row for group in groups for row in _list_rows(group, metrics, places)]
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    for row in (head, *rows):
        cells = [c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True)]
        yield GAP.join([row[0].ljust(widths[0]), *cells]).rstrip()


def _list_rows(
    group: Mapping[str, Mapping[str, Any]], metrics: Mapping[str, Any], places: Mapping[str, int]
) -> Iterator[list[str]]:
    """Cells of the tests of one shot; what reads like the best is marked, unless all does."""
    written = {n: [format_score(mean.get(n), places[n]) for mean in group.values()] for n in places}
    marked: dict[str, str] = {}
    for name, cells in written.items():
        best = _find_best([mean.get(name) for mean in group.values()], metrics[name]["better"])
        told = {cell for cell in cells if cell != NOTHING}
        if best is not None and len(told) > 1 and not name.endswith(OF_REFERENCE):
            marked[name] = format_score(best, places[name])
    for row, key in enumerate(group):
        own = {name: values[row] for name, values in written.items()}
        yield [key, *(c + ("*" if c == marked.get(name) else " ") for name, c in own.items())]


def list_history_lines(result: Result) -> Iterator[str]:
    """Lines of the means of predicted frames with full history, and of those with less."""
    metrics = result["metrics"]
    for key, test in result["tests"].items():
        groups = test.get(HISTORY, {})
        for name, group in groups.items() if len(groups) > 1 else ():
            listed = GAP.join(
                f"{metrics[n]['title']} {format_score(value)}"
                for n, value in group["mean"].items()
                if n in metrics and value is not None
            )
            yield f"{key}, {name} history (frames {format_ranges(group['frames'])}): {listed}"


def list_perfect_frame_lines(result: Result) -> Iterator[str]:
    """Lines that tell which means leave out perfect frames, whose values are infinite."""
    for key, test in result["tests"].items():
        counted = [facts for facts in test["frames"].values() if facts["counted"]]
        for name, metric in result["metrics"].items():
            values = [v for facts in counted if (v := facts.get(name)) is not None]
            perfect = sum(map(math.isinf, values))
            if 0 < perfect < len(values):
                yield (
                    f"{key}: the mean of {metric['title']} is of {len(values) - perfect} of "
                    f"{len(values)} frames; {perfect} are perfect, their infinite values left out"
                )


def list_region_lines(result: Result) -> Iterator[str]:
    """Lines of a table by region: its share of the pixels, then every metric; `-` where none."""
    metrics = result["metrics"]
    for key, test in result["tests"].items():
        yield f"{key}:"
        for region, scores in test["regions"].items():
            if scores is None:
                yield f"    {region:<22} {NOTHING} (cannot be made from these buffers)"
                continue
            listed = GAP.join(
                f"{metrics[n]['title']} {format_score(scores[n])}" for n in metrics if n in scores
            )
            yield f"    {region:<22} {scores['share']:6.1%}  {listed}"
