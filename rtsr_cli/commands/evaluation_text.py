"""What `rtsr evaluate` prints and writes: a table, JSON, CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

Result = Mapping[str, Any]

GAP = "  "
NOTHING = "-"


def number(value: float | None) -> str:
    """Write a score: four decimals below 10, two above, `-` for none."""
    if value is None or math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "inf"
    return f"{value:.4f}" if abs(value) < 10.0 else f"{value:.2f}"


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
    rows = [row for group in groups for row in _rows(group, metrics, names)]
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    for row in (head, *rows):
        cells = [c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True)]
        yield GAP.join([row[0].ljust(widths[0]), *cells]).rstrip()


def _rows(
    group: Mapping[str, Mapping[str, Any]], metrics: Mapping[str, Any], names: Sequence[str]
) -> Iterator[list[str]]:
    """Cells of the tests of one shot."""
    best = {n: _best([mean.get(n) for mean in group.values()], metrics[n]["better"]) for n in names}
    for key, mean in group.items():
        marks = [
            "*" if len(group) > 1 and mean.get(n) == best[n] is not None else " " for n in names
        ]
        yield [key, *(number(mean.get(n)) + mark for n, mark in zip(names, marks, strict=True))]


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
    """Write the result; infinite values as `Infinity`, as Python reads and writes them."""
    return json.dumps(result, indent=1, ensure_ascii=False) + "\n"


def as_csv(result: Result) -> str:
    """Write a line a test, frame and region; means carry no frame number."""
    metrics = list(result["metrics"])
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["test", "shot", "frame", "region", "share", *metrics, "nonfinite"])
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
