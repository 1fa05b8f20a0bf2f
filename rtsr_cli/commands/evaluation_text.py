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
    """Lines of a table: a row a test, the best of each metric marked; then the methods' means."""
    rows = [(key, test["mean"]) for key, test in result["tests"].items()]
    yield from _aligned(result, rows)
    if "methods" in result:
        yield ""
        means = [
            (f"{m} (mean of {f['shots']} shots)", f["mean"]) for m, f in result["methods"].items()
        ]
        yield from _aligned(result, means)


def _aligned(result: Result, rows: Sequence[tuple[str, Mapping[str, Any]]]) -> Iterator[str]:
    metrics = result["metrics"]
    names = [n for n in metrics if any(n in mean for _, mean in rows)]
    heads = [
        metrics[n]["title"] + (f" {metrics[n]['unit']}" if metrics[n]["unit"] else "")
        for n in names
    ]
    best = {n: _best([mean.get(n) for _, mean in rows], metrics[n]["better"]) for n in names}
    cells = [
        [
            number(mean.get(n))
            + ("*" if len(rows) > 1 and mean.get(n) == best[n] is not None else " ")
            for n in names
        ]
        for _, mean in rows
    ]
    wide = max([len("test"), *(len(key) for key, _ in rows)])
    widths = [max(len(head), *(len(row[i]) for row in cells)) for i, head in enumerate(heads)]
    yield (
        "test".ljust(wide) + GAP + GAP.join(h.rjust(w) for h, w in zip(heads, widths, strict=True))
    )
    for (key, _), row in zip(rows, cells, strict=True):
        yield key.ljust(wide) + GAP + GAP.join(c.rjust(w) for c, w in zip(row, widths, strict=True))


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
