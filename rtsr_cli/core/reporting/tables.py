"""The tables of a report; they need no script."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

from rtsr_cli.core.reporting.markup import element, text
from rtsr_cli.core.reporting.results import DASH, Entry, Metric, Results, Values
from rtsr_cli.core.reporting.wording import lead, sentence

NO_REGION = "cannot be made from these buffers"

Row = tuple[list[str], Values | None, Mapping[str, str]]
"""First cells, values by method (None: a region that cannot be made), what is left out of them."""

ARROWS = {1: "\u2191", -1: "\u2193", 0: ""}
"""Where better lies, after a metric's title."""


COLOURS = 6
"""Colours of methods in the style sheet."""


def summary(results: Results) -> str:
    """Methods by metrics: the mean, its 95 % interval, the best in bold."""
    head = element("th", "Method", scope="col")
    head += "".join(map(_metric_head, results.metrics))
    return _table(head, [_summary_row(results, method) for method in results.methods])


def sentences(results: Results) -> str:
    """A sentence a metric."""
    return "".join(
        element("dt", text(metric.title)) + element("dd", text(sentence(results, metric)))
        for metric in results.metrics
    )


def by_shot(results: Results) -> str:
    """Shots by methods, a table a metric; nothing where there is only one shot."""
    if len(results.shots) < 2:
        return ""
    return "".join(
        _panel(
            _comparison(
                results,
                metric,
                [element("th", "Shot", scope="col")],
                [
                    (
                        [_row_head(shot)],
                        results.means(metric, shot),
                        results.left_out(metric, shot=shot),
                    )
                    for shot in results.shots
                ],
            ),
            data_metric=metric.key,
        )
        for metric in results.metrics
    )


def by_region(results: Results) -> str:
    """Regions by methods, a table a metric and shot (`data-shot` "*" is all shots)."""
    several: list[str | None] = [None, *results.shots] if len(results.shots) > 1 else [None]
    return "".join(
        _panel(
            _region_table(results, metric, shot),
            data_metric=metric.key,
            data_shot="*" if shot is None else str(results.shots.index(shot)),
        )
        for shot in several
        for metric in results.metrics
        if any(_measured(results, metric, region) for region in results.regions)
    )


def region_terms(results: Results) -> str:
    """What each region is."""
    rows = [
        element("dt", text(title)) + element("dd", text(description))
        for title, description in results.regions.values()
        if description
    ]
    return element("dl", *rows, class_="facts") if rows else ""


def facts(found: Mapping[str, Any]) -> str:
    """Names and values; what is nested is named by its path."""
    rows = "".join(
        element("dt", text(name)) + element("dd", text(value)) for name, value in _flat(found)
    )
    return element("dl", rows, class_="facts")


def conventions(results: Results) -> str:
    """What each metric is, and what to do about those that could not be computed."""
    rows = [
        element("dt", text(metric.title)) + element("dd", text(metric.convention or DASH))
        for metric in results.metrics
    ]
    rows += [
        element("dt", text(metric.title))
        + element("dd", "not computed; to have it: ", element("code", text(metric.unavailable)))
        for metric in results.unavailable
    ]
    return element("dl", *rows, class_="facts")


def notes(results: Results) -> str:
    """Notes of the evaluation and pixels that were not finite, each with whom it is about."""
    about: dict[str, list[str]] = {}
    for (method, shot), entry in results.entries.items():
        for note in (*entry.notes, *_nonfinite(entry)):
            about.setdefault(note, []).append(f"{method} {shot}".strip())
    items = [
        element("li", text(note), " ", element("span", text(_whom(results, names)), class_="dim"))
        for note, names in about.items()
    ]
    return element("ul", *items) if items else element("p", "None.", class_="dim")


def _whom(results: Results, names: list[str]) -> str:
    return "everywhere" if len(names) == len(results.entries) > 1 else ", ".join(names)


def _table(head: str, rows: Iterable[str]) -> str:
    return element("table", element("thead", element("tr", head)), element("tbody", *rows))


def _panel(table: str, **attributes: object) -> str:
    return element("div", table, class_="scroll panel", **attributes)


def _metric_head(metric: Metric) -> str:
    unit = element("small", text(metric.unit)) if metric.unit else ""
    return element(
        "th",
        f"{text(metric.title)} {ARROWS[metric.sign]} {unit}".strip(),
        scope="col",
        class_="n",
        title=metric.convention or None,
    )


def _row_head(name: str, about: str = "") -> str:
    return element("th", text(name or DASH), scope="row", title=about or None)


def _summary_row(results: Results, method: str) -> str:
    cells = [_summary_cell(results, method, metric) for metric in results.metrics]
    swatch = element("i", class_=f"swatch {_colour(results, method)}")
    return element("tr", element("th", swatch, text(method), scope="row"), *cells)


def _summary_cell(results: Results, method: str, metric: Metric) -> str:
    means = results.means(metric)
    value = means[method]
    found = results.overall[method].confidence.get(metric.key)
    interval = (
        element("small", f"{metric.text(found[0])} {DASH} {metric.text(found[1])}") if found else ""
    )
    shown = _number(metric, value, best=method in metric.marked(means))
    shown += _small(results.left_out(metric)[method])
    return element(
        "td", shown, interval, _whisker(results, metric, method), class_="n", **_exact(value)
    )


def _small(remark: str) -> str:
    return element("small", text(remark)) if remark else ""


def _whisker(results: Results, metric: Metric, method: str) -> str:
    """The interval and the mean on an axis that is the same for all methods."""
    spans = [entry.confidence.get(metric.key) for entry in results.overall.values()]
    ends = [end for span in spans if span for end in span if math.isfinite(end)]
    mean = results.overall[method].mean.get(metric.key)
    own = results.overall[method].confidence.get(metric.key)
    if not own or mean is None or not ends or not all(map(math.isfinite, (*own, mean))):
        return ""
    low, extent = min(ends), (max(ends) - min(ends)) or 1.0
    places = [100.0 * (value - low) / extent for value in (own[0], own[1], mean)]
    style = "--a:{:.1f}%;--b:{:.1f}%;--m:{:.1f}%".format(*places)
    return element("span", class_=f"whisker {_colour(results, method)}", style=style)


def _colour(results: Results, method: str) -> str:
    """The style class of a method's colour."""
    return f"m{results.methods.index(method) % COLOURS}"


def _number(metric: Metric, value: float | None, *, best: bool) -> str:
    shown = text(metric.text(value))
    return element("b", shown) if best else element("span", shown)


def _exact(value: float | None) -> dict[str, object]:
    return {} if value is None else {"title": json.dumps(value)}


def _comparison(results: Results, metric: Metric, first: list[str], rows: Iterable[Row]) -> str:
    """Rows by methods in one metric; the last column tells who leads and by how much."""
    head = "".join(first)
    head += "".join(element("th", text(m), scope="col", class_="n") for m in results.methods)
    head += element("th", "Lead", scope="col")
    return _table(head, [_comparison_row(results, metric, row) for row in rows])


def _comparison_row(results: Results, metric: Metric, row: Row) -> str:
    cells, values, left_out = row
    if values is None:
        blank = element("td", DASH, class_="n dim", title=NO_REGION)
        return element("tr", *cells, blank * len(results.methods), element("td"))
    numbers = [
        _value_cell(metric, values, method, left_out.get(method, "")) for method in results.methods
    ]
    return element("tr", *cells, *numbers, element("td", _lead(metric, values), class_="lead"))


def _value_cell(metric: Metric, values: Values, method: str, left_out: str) -> str:
    value = values.get(method)
    shown = _number(metric, value, best=method in metric.marked(values))
    return element("td", shown, _small(left_out), class_="n", **_exact(value))


def _lead(metric: Metric, values: Values) -> str:
    found = lead(metric, values)
    if found is None:
        return "tie" if metric.best(values) else ""
    return f"{text(found[0])} by {text(metric.measure(found[2]))}"


def _region_table(results: Results, metric: Metric, shot: str | None) -> str:
    rows: list[Row] = []
    for region, (title, description) in results.regions.items():
        share = results.share(region, shot)
        there = share is not None or _measured(results, metric, region, shot)
        part = element("td", DASH if share is None else f"{100 * share:.2f} %", class_="n")
        lost = element("td", DASH, class_="n dim", title=NO_REGION)
        values = results.in_region(metric, region, shot) if there else None
        cells = [_row_head(title, description), part if there else lost]
        rows.append((cells, values, results.left_out(metric, region, shot)))
    share_head = element("th", "Share of pixels", scope="col", class_="n")
    return _comparison(results, metric, [element("th", "Region", scope="col"), share_head], rows)


def _measured(results: Results, metric: Metric, region: str, shot: str | None = None) -> bool:
    return any(v is not None for v in results.in_region(metric, region, shot).values())


def _nonfinite(entry: Entry) -> list[str]:
    bad = [frame for frame, values in entry.frames.items() if values.get("nonfinite")]
    pixels = sum(int(entry.frames[frame]["nonfinite"] or 0) for frame in bad)
    return [f"{pixels} pixels that are not finite, in {len(bad)} frames"] if bad else []


def _flat(found: Mapping[str, Any], path: str = "") -> Iterable[tuple[str, str]]:
    for key, value in found.items():
        name = f"{path} {key}".strip()
        if isinstance(value, Mapping):
            yield from _flat(value, name)
        elif isinstance(value, list | tuple):
            yield name, ", ".join(map(str, value))
        else:
            yield name, DASH if value is None else str(value)
