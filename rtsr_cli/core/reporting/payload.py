"""What the script of a report works on: curves and pictures, methods by their place in a list."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rtsr_cli.core.reporting.markup import to_plain_number
from rtsr_cli.core.reporting.pictures import Crop, Moment, Picture, Strip
from rtsr_cli.core.reporting.results import Results, ShownMetric

POINTS = 200_000
"""Points of all curves together: about 2.5 MB."""

FEWEST_POINTS = 200
"""Of one curve, however many there are."""


def build_payload(results: Results, moments: Sequence[Moment], strips: Sequence[Strip]) -> Any:
    """Everything that the script needs, ready for JSON."""
    return {
        "methods": results.methods,
        "shots": results.shots,
        "metrics": [
            {"key": m.key, "title": m.title, "unit": m.unit, "decimals": m.decimals, "sign": m.sign}
            for m in results.metrics
        ],
        "pair": choose_first_pair(results),
        "curves": _list_curves(results),
        "moments": [_describe_moment(results, moment) for moment in moments],
        "strips": [_describe_strip(results, strip) for strip in strips],
    }


def choose_first_pair(results: Results) -> tuple[int, int]:
    """Places of the methods that the viewer compares first: the last and the best by a metric.

    -1 is the reference; a method alone is compared with it.
    """
    for metric in results.metrics:
        ranked = metric.rank(results.means(metric))
        if len(ranked) > 1:
            worst, best = ranked[-1][0], ranked[0][0]
            return results.methods.index(worst), results.methods.index(best)
    return (0, 1) if len(results.methods) > 1 else (-1, 0)


def list_extremes(values: Sequence[float | None], most: int) -> list[int]:
    """Places of the least and the greatest value of each stretch; at most `most` places.

    Thinned so, a curve keeps every peak. Places without a number are left out.
    """
    numbers = np.array([np.nan if v is None else v for v in values], dtype=np.float64)
    kept: list[int] = []
    for stretch in np.array_split(np.arange(len(numbers)), max(most // 2, 1)):
        known = stretch[~np.isnan(numbers[stretch])]
        if known.size:
            ends = {known[numbers[known].argmin()], known[numbers[known].argmax()]}
            kept += sorted(int(end) for end in ends)
    return kept


def _list_curves(results: Results) -> list[Any]:
    """A shot each: numbers of the frames, and values by metric and method."""
    count = len(results.shots) * len(results.methods) * max(len(results.metrics), 1)
    most = max(POINTS // max(count, 1), FEWEST_POINTS)
    rows = []
    for shot in results.shots:
        frames = results.frames(shot)
        curves = [
            [
                _make_curve(results, metric, (method, shot), frames, most)
                for method in results.methods
            ]
            for metric in results.metrics
        ]
        rows.append({"frames": frames, "curves": curves})
    return rows


def _make_curve(
    results: Results, metric: ShownMetric, whose: tuple[str, str], frames: list[int], most: int
) -> Any:
    """Values in the order of the frames, or, thinned, `at` (places of frames) and `values`."""
    entry = results.entries.get(whose)
    if entry is None:
        return None
    values = [entry.frames.get(frame, {}).get(metric.key) for frame in frames]
    if len(values) <= most:
        return {"values": [to_plain_number(value) for value in values]}
    at = list_extremes(values, most)
    return {"at": at, "values": [to_plain_number(values[place]) for place in at]}


def _list_uris(results: Results, pictures: Mapping[str, Picture]) -> list[str | None]:
    return [pictures[m].uri() if m in pictures else None for m in results.methods]


def _describe_moment(results: Results, moment: Moment) -> Any:
    reference = moment.reference
    return {
        "shot": results.shots.index(moment.shot) if moment.shot in results.shots else -1,
        "name": moment.shot,
        "frame": moment.frame,
        "why": moment.why,
        "size": moment.size or (reference.width, reference.height),
        "reference": reference.uri(),
        "tests": _list_uris(results, moment.tests),
        "heat": _list_uris(results, moment.heat),
        "crop": None if moment.crop is None else _describe_crop(results, moment.crop),
        "numbers": _list_numbers(results, moment),
    }


def _describe_crop(results: Results, crop: Crop) -> Any:
    return {
        "box": crop.box,
        "reference": crop.reference.uri(),
        "tests": _list_uris(results, crop.tests),
        "heat": _list_uris(results, crop.heat),
    }


def _list_numbers(results: Results, moment: Moment) -> list[Any]:
    """Of each metric, of each method: the number as it is shown, and whether it is marked."""
    numbers = []
    for metric in results.metrics:
        values = results.at_frame(metric, moment.shot, moment.frame)
        best = metric.list_marked(values)
        numbers.append([(metric.text(values.get(m)), m in best) for m in results.methods])
    return numbers


def _describe_strip(results: Results, strip: Strip) -> Any:
    return {
        "name": strip.shot,
        "row": strip.row,
        "height": strip.reference.height,
        "reference": strip.reference.uri(),
        "tests": _list_uris(results, strip.tests),
    }
