"""The tables of a report; they need no script."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

from rtsr_cli.core.reporting.markup import escape_text, make_element
from rtsr_cli.core.reporting.results import DASH, MethodEntry, Results, ShownMetric, Values
from rtsr_cli.core.reporting.sentences import find_lead, write_sentence
from rtsr_cli.core.wording import say_count

NO_REGION = "cannot be made from these buffers"

Row = tuple[list[str], Values | None, Mapping[str, str]]
"""First cells, values by method (None: a region that cannot be made), what is left out of them."""

ARROWS = {1: "\u2191", -1: "\u2193", 0: ""}
"""Where better lies, after a metric's title."""


COLOURS = 6
"""Colours of methods in the style sheet."""


def write_summary(results: Results) -> str:
    """Methods by metrics: the mean, its 95 % interval, the best in bold."""
    head = make_element("th", "Method", scope="col")
    head += "".join(map(_write_metric_head, results.metrics))
    return _write_table(head, [_write_summary_row(results, method) for method in results.methods])


def write_sentences(results: Results) -> str:
    """A sentence a metric."""
    return "".join(
        make_element("dt", escape_text(metric.title))
        + make_element("dd", escape_text(write_sentence(results, metric)))
        for metric in results.metrics
    )


def write_shot_tables(results: Results) -> str:
    """Shots by methods, a table a metric; nothing where there is only one shot."""
    if len(results.shots) < 2:
        return ""
    return "".join(
        _write_panel(
            _write_comparison(
                results,
                metric,
                [make_element("th", "Shot", scope="col")],
                [
                    (
                        [_write_row_head(shot)],
                        results.means(metric, shot),
                        results.describe_left_out(metric, shot=shot),
                    )
                    for shot in results.shots
                ],
            ),
            data_metric=metric.key,
        )
        for metric in results.metrics
    )


def write_region_tables(results: Results) -> str:
    """Regions by methods, a table a metric and shot (`data-shot` "*" is all shots)."""
    several: list[str | None] = [None, *results.shots] if len(results.shots) > 1 else [None]
    return "".join(
        _write_panel(
            _write_region_table(results, metric, shot),
            data_metric=metric.key,
            data_shot="*" if shot is None else str(results.shots.index(shot)),
        )
        for shot in several
        for metric in results.metrics
        if any(_is_measured(results, metric, region) for region in results.regions)
    )


def write_region_terms(results: Results) -> str:
    """What each region is."""
    rows = [
        make_element("dt", escape_text(title)) + make_element("dd", escape_text(description))
        for title, description in results.regions.values()
        if description
    ]
    return make_element("dl", *rows, class_="facts") if rows else ""


def write_facts(values: Mapping[str, Any]) -> str:
    """Names and values; what is nested is named by its path."""
    rows = "".join(
        make_element("dt", escape_text(name)) + make_element("dd", escape_text(value))
        for name, value in _flatten(values)
    )
    return make_element("dl", rows, class_="facts")


def write_conventions(results: Results) -> str:
    """What each metric is, and what to do about those that could not be computed."""
    rows = [
        make_element("dt", escape_text(metric.title))
        + make_element("dd", escape_text(metric.convention or DASH))
        for metric in results.metrics
    ]
    rows += [
        make_element("dt", escape_text(metric.title))
        + make_element(
            "dd",
            "not computed; to have it: ",
            make_element("code", escape_text(metric.unavailable)),
        )
        for metric in results.unavailable
    ]
    return make_element("dl", *rows, class_="facts")


def write_notes(results: Results) -> str:
    """Notes of the evaluation and pixels that were not finite, each with whom it is about."""
    about: dict[str, list[str]] = {}
    for (method, shot), entry in results.entries.items():
        for note in (*entry.notes, *_describe_nonfinite(entry)):
            about.setdefault(note, []).append(f"{method} {shot}".strip())
    items = [
        make_element(
            "li",
            escape_text(note),
            " ",
            make_element("span", escape_text(_describe_owners(results, names)), class_="dim"),
        )
        for note, names in about.items()
    ]
    return make_element("ul", *items) if items else make_element("p", "None.", class_="dim")


def _describe_owners(results: Results, names: list[str]) -> str:
    return "everywhere" if len(names) == len(results.entries) > 1 else ", ".join(names)


def _write_table(head: str, rows: Iterable[str]) -> str:
    return make_element(
        "table", make_element("thead", make_element("tr", head)), make_element("tbody", *rows)
    )


def _write_panel(table: str, **attributes: object) -> str:
    return make_element("div", table, class_="scroll panel", **attributes)


def _write_metric_head(metric: ShownMetric) -> str:
    unit = make_element("small", escape_text(metric.unit)) if metric.unit else ""
    return make_element(
        "th",
        f"{escape_text(metric.title)} {ARROWS[metric.sign]} {unit}".strip(),
        scope="col",
        class_="n",
        title=metric.convention or None,
    )


def _write_row_head(name: str, about: str = "") -> str:
    return make_element("th", escape_text(name or DASH), scope="row", title=about or None)


def _write_summary_row(results: Results, method: str) -> str:
    cells = [_write_summary_cell(results, method, metric) for metric in results.metrics]
    swatch = make_element("i", class_=f"swatch {_colour_class(results, method)}")
    return make_element("tr", make_element("th", swatch, escape_text(method), scope="row"), *cells)


def _write_summary_cell(results: Results, method: str, metric: ShownMetric) -> str:
    means = results.means(metric)
    value = means[method]
    bounds = results.overall[method].confidence.get(metric.key)
    interval = (
        make_element("small", f"{metric.text(bounds[0])} {DASH} {metric.text(bounds[1])}")
        if bounds
        else ""
    )
    shown = _write_number(metric, value, best=method in metric.list_marked(means))
    shown += _write_remark(results.describe_left_out(metric)[method])
    return make_element(
        "td",
        shown,
        interval,
        _draw_whisker(results, metric, method),
        class_="n",
        **_write_exact(value),
    )


def _write_remark(remark: str) -> str:
    return make_element("small", escape_text(remark)) if remark else ""


def _draw_whisker(results: Results, metric: ShownMetric, method: str) -> str:
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
    return make_element("span", class_=f"whisker {_colour_class(results, method)}", style=style)


def _colour_class(results: Results, method: str) -> str:
    """The style class of a method's colour."""
    return f"m{results.methods.index(method) % COLOURS}"


def _write_number(metric: ShownMetric, value: float | None, *, best: bool) -> str:
    shown = escape_text(metric.text(value))
    return make_element("b", shown) if best else make_element("span", shown)


def _write_exact(value: float | None) -> dict[str, object]:
    return {} if value is None else {"title": json.dumps(value)}


def _write_comparison(
    results: Results, metric: ShownMetric, first: list[str], rows: Iterable[Row]
) -> str:
    """Rows by methods in one metric; the last column tells who leads and by how much."""
    head = "".join(first)
    head += "".join(
        make_element("th", escape_text(m), scope="col", class_="n") for m in results.methods
    )
    head += make_element("th", "Lead", scope="col")
    return _write_table(head, [_write_comparison_row(results, metric, row) for row in rows])


def _write_comparison_row(results: Results, metric: ShownMetric, row: Row) -> str:
    cells, values, left_out = row
    if values is None:
        blank = make_element("td", DASH, class_="n dim", title=NO_REGION)
        return make_element("tr", *cells, blank * len(results.methods), make_element("td"))
    numbers = [
        _write_value_cell(metric, values, method, left_out.get(method, ""))
        for method in results.methods
    ]
    return make_element(
        "tr", *cells, *numbers, make_element("td", _write_lead(metric, values), class_="lead")
    )


def _write_value_cell(metric: ShownMetric, values: Values, method: str, left_out: str) -> str:
    value = values.get(method)
    shown = _write_number(metric, value, best=method in metric.list_marked(values))
    return make_element("td", shown, _write_remark(left_out), class_="n", **_write_exact(value))


def _write_lead(metric: ShownMetric, values: Values) -> str:
    leader = find_lead(metric, values)
    if leader is None:
        return "tie" if metric.best(values) else ""
    return f"{escape_text(leader[0])} by {escape_text(metric.measure(leader[2]))}"


def _write_region_table(results: Results, metric: ShownMetric, shot: str | None) -> str:
    rows: list[Row] = []
    for region, (title, description) in results.regions.items():
        share = results.share(region, shot)
        there = share is not None or _is_measured(results, metric, region, shot)
        part = make_element("td", DASH if share is None else f"{100 * share:.2f} %", class_="n")
        lost = make_element("td", DASH, class_="n dim", title=NO_REGION)
        values = results.in_region(metric, region, shot) if there else None
        cells = [_write_row_head(title, description), part if there else lost]
        rows.append((cells, values, results.describe_left_out(metric, region, shot)))
    share_head = make_element("th", "Share of pixels", scope="col", class_="n")
    return _write_comparison(
        results, metric, [make_element("th", "Region", scope="col"), share_head], rows
    )


def _is_measured(
    results: Results, metric: ShownMetric, region: str, shot: str | None = None
) -> bool:
    return any(v is not None for v in results.in_region(metric, region, shot).values())


def _describe_nonfinite(entry: MethodEntry) -> list[str]:
    bad = [frame for frame, values in entry.frames.items() if values.get("nonfinite")]
    pixels = sum(int(entry.frames[frame]["nonfinite"] or 0) for frame in bad)
    return (
        [f"{pixels} pixels that are not finite, in {say_count(len(bad), 'frame')}"] if bad else []
    )


def _flatten(values: Mapping[str, Any], path: str = "") -> Iterable[tuple[str, str]]:
    for key, value in values.items():
        name = f"{path} {key}".strip()
        if isinstance(value, Mapping):
            yield from _flatten(value, name)
        elif isinstance(value, list | tuple):
            yield name, ", ".join(map(str, value))
        else:
            yield name, DASH if value is None else str(value)
