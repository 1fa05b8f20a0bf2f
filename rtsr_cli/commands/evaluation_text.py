"""What `rtsr evaluate` prints and writes, and reads again: a table, JSON, CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.io.atomic import check_writable

Result = Mapping[str, Any]

GAP = "  "
NOTHING = "-"

INFINITE = {"inf": math.inf, "-inf": -math.inf}
"""How JSON, which has no infinite numbers, holds them."""

CSV_HEAD, CSV_TAIL = ("test", "shot", "frame", "region", "share"), ("nonfinite",)
"""Columns before and after those of the metrics."""

REPORT_MARK = "rtsr report</title>"
"""Every report has it near its beginning."""

HEAD_CHARACTERS = 1 << 16

JSON_FIELDS: Mapping[str, type] = {
    "protocol": str, "options": dict, "metrics": dict, "rules": str, "tests": dict,
}  # fmt: skip
"""What a result always holds."""


OF_REFERENCE = "-reference"
"""Ends the names of what is measured of the reference alone: nobody is best in it."""

SMALL, FEW, MANY = 10.0, 2, 4
"""Scores below the first have so many decimals more than others."""


def decimals(values: Iterable[float | None]) -> int:
    """Decimals of scores that stand together: four where all lie below 10, else two."""
    sizes = [abs(v) for v in values if v is not None and math.isfinite(v)]
    return FEW if any(size >= SMALL for size in sizes) else MANY


def number(value: float | None, places: int | None = None) -> str:
    """Write a score with so many decimals, by its own size if nothing is said; `-` for none."""
    if value is None or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "inf"
    return f"{value:.{decimals([value]) if places is None else places}f}"


def _best(values: Sequence[float | None], better: str) -> float | None:
    known = [v for v in values if v is not None and not math.isnan(v)]
    return (max(known) if better == "higher" else min(known)) if known else None


def table(result: Result) -> Iterator[str]:
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
        n: decimals(mean.get(n) for group in groups for mean in group.values()) for n in names
    }
    rows = [row for group in groups for row in _rows(group, metrics, places)]
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    for row in (head, *rows):
        cells = [c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True)]
        yield GAP.join([row[0].ljust(widths[0]), *cells]).rstrip()


def _rows(
    group: Mapping[str, Mapping[str, Any]], metrics: Mapping[str, Any], places: Mapping[str, int]
) -> Iterator[list[str]]:
    """Cells of the tests of one shot; what reads like the best is marked, unless all does."""
    written = {n: [number(mean.get(n), places[n]) for mean in group.values()] for n in places}
    marked: dict[str, str] = {}
    for name, cells in written.items():
        best = _best([mean.get(name) for mean in group.values()], metrics[name]["better"])
        told = {cell for cell in cells if cell != NOTHING}
        if best is not None and len(told) > 1 and not name.endswith(OF_REFERENCE):
            marked[name] = number(best, places[name])
    for row, key in enumerate(group):
        own = {name: values[row] for name, values in written.items()}
        yield [key, *(c + ("*" if c == marked.get(name) else " ") for name, c in own.items())]


def perfect_frames(result: Result) -> Iterator[str]:
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


def region_table(result: Result) -> Iterator[str]:
    """Lines of a table by region: its share of the pixels, then every metric; `-` where none."""
    metrics = result["metrics"]
    for key, test in result["tests"].items():
        yield f"{key}:"
        for region, scores in test["regions"].items():
            if scores is None:
                yield f"    {region:<22} {NOTHING} (cannot be made from these buffers)"
                continue
            listed = GAP.join(
                f"{metrics[n]['title']} {number(scores[n])}" for n in metrics if n in scores
            )
            yield f"    {region:<22} {scores['share']:6.1%}  {listed}"


def as_json(result: Result) -> str:
    """Write the result as strict JSON."""
    return json.dumps(strict(result), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def strict(value: Any) -> Any:
    """Return plain values as JSON can hold them: infinite numbers as "inf", NaN as null."""
    if isinstance(value, float) and not math.isfinite(value):
        return next((name for name, known in INFINITE.items() if value == known), None)
    if isinstance(value, Mapping):
        return {key: strict(held) for key, held in value.items()}
    if isinstance(value, list | tuple):
        return [strict(held) for held in value]
    return value


def from_json(content: str) -> dict[str, Any]:
    """Read a result that `as_json` wrote; what follows from its frames is left as it is.

    Raises:
        ValueError: it is none; says what is wrong.
    """
    try:
        found = json.loads(content)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    _check_fields(found, JSON_FIELDS, "the result")
    _check_fields(found, {k: dict for k in ("inputs", "regions", "versions") if k in found}, "it")
    for name, metric in found["metrics"].items():
        _check_fields(metric, dict.fromkeys(("title", "unit", "better"), str), f"metric '{name}'")
    _demand(bool(found["tests"]), "it has no tests")
    if "shard" in found:
        _check_shard(found["shard"])
    tests = {key: _test(test, f"test '{key}'") for key, test in found["tests"].items()}
    return {**found, "tests": tests}


def _check_fields(found: Any, fields: Mapping[str, type], what: str) -> None:
    _demand(isinstance(found, dict), f"{what} is no object")
    for name, kind in fields.items():
        right = isinstance(found.get(name), kind)
        _demand(right, f"'{name}' of {what} is missing, or of another kind")


def _demand(condition: bool, complaint: str) -> None:
    if not condition:
        raise ValueError(complaint)


def _check_shard(found: Any) -> None:
    _check_fields(found, {"parts": list, "of": int}, "'shard'")
    right = all(isinstance(i, int) and 1 <= i <= found["of"] for i in found["parts"])
    _demand(right and "frames" in found, "'shard' names no parts")


def _test(found: Any, what: str) -> dict[str, Any]:
    _check_fields(found, {"method": str, "shot": str, "frames": dict, "notes": list}, what)
    _demand(all(isinstance(n, str) for n in found["notes"]), f"notes of {what} are no sentences")
    frames = {key: _frame(key, facts, what) for key, facts in found["frames"].items()}
    return {**found, "frames": frames}


def _frame(number: str, found: Any, what: str) -> dict[str, Any]:
    """One frame's facts, infinite numbers as numbers."""
    what = f"frame '{number}' of {what}"
    _demand(number.removeprefix("-").isdecimal(), f"{what} has no number")
    plain = {"nonfinite": int, "counted": bool, "regions": dict}
    _check_fields(found, plain, what)
    regions = {
        region: None if scores is None else _scores(scores, what)
        for region, scores in found["regions"].items()
    }
    scores = _scores({k: v for k, v in found.items() if k not in plain}, what)
    return {**found, **scores, "regions": regions}


def _scores(found: Any, what: str) -> dict[str, float | None]:
    _check_fields(found, {}, f"a region of {what}")
    return {name: _score(value, f"'{name}' of {what}") for name, value in found.items()}


def _score(value: Any, what: str) -> float | None:
    if isinstance(value, str) and value in INFINITE:
        return INFINITE[value]
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return None
    _demand(type(value) in (int, float), f"{what} is no number")
    return float(value)


def is_result(path: Path) -> bool:
    """Tell whether `rtsr evaluate` wrote a file, by what its suffix promises."""
    try:
        with path.open(encoding="utf-8") as stream:
            if path.suffix.lower() == ".json":
                found = json.load(stream)
                return isinstance(found, dict) and found.keys() >= JSON_FIELDS.keys()
            head = stream.read(HEAD_CHARACTERS)
    except (OSError, ValueError, RecursionError):
        return False
    if path.suffix.lower() == ".csv":
        columns = tuple(head.partition("\n")[0].split(","))
        return columns[: len(CSV_HEAD)] == CSV_HEAD and columns[-1:] == CSV_TAIL
    return REPORT_MARK in head


def as_csv(result: Result) -> str:
    """Write a line a test, frame and region; means carry no frame number."""
    metrics = list(result["metrics"])
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*CSV_HEAD, *metrics, *CSV_TAIL])
    for test in result["tests"].values():
        place = [test["method"], test["shot"]]
        for frame, facts in test["frames"].items():
            for region, scores in facts["regions"].items():
                everything = facts if region == "all" else scores or {}
                writer.writerow(
                    [*place, frame, region, (scores or {}).get("share"),
                     *(everything.get(m) for m in metrics), facts["nonfinite"]]
                )  # fmt: skip
        for region, scores in test["regions"].items():
            everything = test["mean"] if region == "all" else scores or {}
            writer.writerow(
                [*place, "", region, (scores or {}).get("share"),
                 *(everything.get(m) for m in metrics), test["nonfinite"]]
            )  # fmt: skip
    return text.getvalue()


def check_outputs(paths: Sequence[Path], *, overwrite: bool) -> None:
    """Refuse files that cannot be written, or that something else wrote.

    Raises:
        OutputError: names the file.
    """
    for path in paths:
        file = next((p for p in path.parents if p.exists() and not p.is_dir()), None)
        if file is not None:
            raise OutputError(f"{path}: {file} is a file, no folder; choose another --output")
        if path.is_dir():
            raise OutputError(f"{path}: is a folder; name a file in --output")
        if path.exists() and not overwrite and not is_result(path):
            raise OutputError(
                f"{path}: 'rtsr evaluate' did not write this file; choose another --output, or "
                "replace it with --overwrite"
            )
        check_writable(path.parent)
