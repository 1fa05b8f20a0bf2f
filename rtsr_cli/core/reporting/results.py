"""The result of an evaluation, as the report reads it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

DASH = "\u2013"
"""Stands for a number that there is not."""

SIGNIFICANT = 4
"""Digits of the greatest mean of a metric; its other numbers get as many decimals."""

MOST_DECIMALS = 8

OF_REFERENCE = "-reference"
"""Ends the keys of what is measured of the reference alone: no score, so nobody is best in it."""

FRAME = ""
"""Stands for the whole frame among regions, where values of frames are counted."""

Values = Mapping[str, float | None]
"""Numbers by name; None = not a number."""


@dataclass(frozen=True)
class ShownMetric:
    """A metric and how its numbers are written."""

    key: str
    title: str
    unit: str
    better: str
    convention: str
    unavailable: str
    decimals: int

    def text(self, value: float | None) -> str:
        """A number without its unit."""
        if value is None:
            return DASH
        if math.isinf(value):
            return "\u221e" if value > 0 else "\u2212\u221e"
        return f"{value:z.{self.decimals}f}".replace("-", "\u2212")

    def measure(self, value: float | None) -> str:
        """A number with its unit."""
        return f"{self.text(value)} {self.unit}".rstrip()

    @property
    def sign(self) -> int:
        """1: higher is better, -1: lower is; 0: neither."""
        return {"higher": 1, "lower": -1}.get(self.better, 0)

    def rank(self, values: Values) -> list[tuple[str, float]]:
        """Names and numbers, best first; empty where neither direction is better."""
        known = [(name, value) for name, value in values.items() if value is not None]
        return sorted(known, key=lambda pair: -self.sign * pair[1]) if self.sign else []

    def list_marked(self, values: Values) -> frozenset[str]:
        """Names of the best, nobody where all read alike."""
        best = self.best(values)
        return frozenset() if len(best) == len(self.rank(values)) else best

    def best(self, values: Values) -> frozenset[str]:
        """Names of the best, all that read alike; nobody is best alone on the field."""
        ranked = self.rank(values)
        if len(ranked) < 2:
            return frozenset()
        top = self.text(ranked[0][1])
        return frozenset(name for name, value in ranked if self.text(value) == top)


@dataclass(frozen=True)
class MethodEntry:
    """What was measured of one method, on one shot or on all.

    Args:
        mean: by metric.
        confidence: the mean's 95 % interval.
        frames: by number; of all shots together none.
        regions: means by region.
        notes: of the evaluation.
        counted: frames that take part in means.
        kept: frames whose values a mean holds, and perfect ones, whose infinite values it does
            not, by region (`FRAME` = everywhere) and metric.
    """

    mean: Values
    confidence: Mapping[str, tuple[float, float]]
    frames: Mapping[int, Values]
    regions: Mapping[str, Values | None]
    notes: tuple[str, ...]
    counted: frozenset[int]
    kept: Mapping[tuple[str, str], tuple[int, int]]

    def describe_left_out(self, metric: str, region: str = FRAME) -> str:
        """Tell how many frames are perfect and so left out of a mean; "" where none is."""
        kept, perfect = self.kept.get((region, metric), (0, 0))
        return f"{kept} of {kept + perfect} frames; {perfect} perfect" if kept and perfect else ""


@dataclass(frozen=True)
class Results:
    """Everything measured.

    Args:
        metrics: those that were computed.
        unavailable: those that could not be.
        methods: names, in the order of the evaluation.
        shots: names; one shot alone may be "".
        entries: by method and shot.
        overall: by method.
        regions: title and description by name.
    """

    metrics: tuple[ShownMetric, ...]
    unavailable: tuple[ShownMetric, ...]
    methods: tuple[str, ...]
    shots: tuple[str, ...]
    entries: Mapping[tuple[str, str], MethodEntry]
    overall: Mapping[str, MethodEntry]
    regions: Mapping[str, tuple[str, str]]

    def means(self, metric: ShownMetric, shot: str | None = None) -> Values:
        """A metric's means by method, over a shot or over all."""
        return {m: e.mean.get(metric.key) for m, e in self._of(shot)}

    def in_region(self, metric: ShownMetric, region: str, shot: str | None = None) -> Values:
        """A metric's values by method in a region, of a shot or of all."""
        entries = {method: entry.regions.get(region) for method, entry in self._of(shot)}
        return {method: (values or {}).get(metric.key) for method, values in entries.items()}

    def describe_left_out(
        self, metric: ShownMetric, region: str = FRAME, shot: str | None = None
    ) -> dict[str, str]:
        """What is to be said of perfect frames beside a metric's values, by method."""
        return {method: e.describe_left_out(metric.key, region) for method, e in self._of(shot)}

    def share(self, region: str, shot: str | None = None) -> float | None:
        """Share of the pixels that lie in a region, 0 to 1; None: it cannot be made."""
        shares = ((entry.regions.get(region) or {}).get("share") for _, entry in self._of(shot))
        return next((share for share in shares if share is not None), None)

    def at_frame(self, metric: ShownMetric, shot: str, frame: int) -> Values:
        """A metric's values by method at a frame."""
        return {m: e.frames.get(frame, {}).get(metric.key) for m, e in self._of(shot)}

    def frames(self, shot: str) -> list[int]:
        """Numbers of the frames of a shot."""
        return sorted({number for _, entry in self._of(shot) for number in entry.frames})

    def rounds(self, metric: ShownMetric) -> list[Values]:
        """A metric's values by method, of every frame of every shot that takes part in means."""
        return [
            self.at_frame(metric, shot, frame)
            for shot in self.shots
            for frame in self.frames(shot)
            if all(frame in entry.counted for _, entry in self._of(shot) if frame in entry.frames)
        ]

    def _of(self, shot: str | None) -> list[tuple[str, MethodEntry]]:
        if shot is None:
            return [(method, self.overall[method]) for method in self.methods]
        there = ((m, self.entries.get((m, shot))) for m in self.methods)
        return [(method, entry) for method, entry in there if entry is not None]


def read_results(result: Mapping[str, Any]) -> Results:
    """Read the dictionary that an evaluation returns."""
    tests: list[Mapping[str, Any]] = list(result["tests"].values())
    entries = {(test["method"], test["shot"]): _read_entry(test) for test in tests}
    methods = tuple(dict.fromkeys(method for method, _ in entries))
    shots = tuple(dict.fromkeys(shot for _, shot in entries))
    overall = {
        method: _join_entries(
            [entries[method, shot] for shot in shots if (method, shot) in entries],
            result.get("methods", {}).get(method, {}),
        )
        for method in methods
    }
    metrics = tuple(
        _describe_metric(key, description, [entry.mean.get(key) for entry in overall.values()])
        for key, description in result["metrics"].items()
    )
    return Results(
        metrics=tuple(metric for metric in metrics if not metric.unavailable),
        unavailable=tuple(metric for metric in metrics if metric.unavailable),
        methods=methods,
        shots=shots,
        entries=entries,
        overall=overall,
        regions=_list_regions(result, entries.values()),
    )


def finite_number(value: Any) -> float | None:
    """A number, or None for what is none."""
    return None if value is None or math.isnan(value) else float(value)


def _read_values(scores: Mapping[str, Any]) -> Values:
    return {
        key: finite_number(value)
        for key, value in scores.items()
        if value is None or (isinstance(value, int | float) and not isinstance(value, bool))
    }


def _read_intervals(scores: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    pairs = {
        key: (finite_number(pair[0]), finite_number(pair[1]))
        for key, pair in scores.items()
        if pair
    }
    return {k: (lo, hi) for k, (lo, hi) in pairs.items() if lo is not None and hi is not None}


def _read_entry(test: Mapping[str, Any]) -> MethodEntry:
    frames: Mapping[str, Mapping[str, Any]] = test.get("frames", {})
    counted = {number: facts for number, facts in frames.items() if facts.get("counted", True)}
    return MethodEntry(
        mean=_read_values(test["mean"]),
        confidence=_read_intervals(test.get("confidence", {})),
        frames={int(frame): _read_values(facts) for frame, facts in frames.items()},
        regions={
            name: None if facts is None else _read_values(facts)
            for name, facts in test.get("regions", {}).items()
        },
        notes=tuple(test.get("notes", ())),
        counted=frozenset(map(int, counted)),
        kept=_count_kept(counted.values()),
    )


def _count_kept(frames: Iterable[Mapping[str, Any]]) -> dict[tuple[str, str], tuple[int, int]]:
    """Count finite and infinite values by region and metric."""
    counts: dict[tuple[str, str], tuple[int, int]] = {}
    for facts in frames:
        for region, values in {FRAME: facts, **facts.get("regions", {})}.items():
            for key, value in _read_values(values or {}).items():
                if value is not None:
                    finite, infinite = counts.get((region, key), (0, 0))
                    over = math.isinf(value)
                    counts[region, key] = (finite + (not over), infinite + over)
    return counts


def _count_all_kept(shots: Iterable[MethodEntry]) -> dict[tuple[str, str], tuple[int, int]]:
    counts: dict[tuple[str, str], tuple[int, int]] = {}
    for entry in shots:
        for key, (finite, infinite) in entry.kept.items():
            more = counts.get(key, (0, 0))
            counts[key] = (finite + more[0], infinite + more[1])
    return counts


def _join_entries(shots: list[MethodEntry], stated: Mapping[str, Any]) -> MethodEntry:
    """Of one shot its entry; of several what the evaluation states, else the mean over shots."""
    if len(shots) == 1:
        return shots[0]
    names = dict.fromkeys(name for entry in shots for name in entry.regions)
    mean = _average_entries([entry.mean for entry in shots])
    regions = {
        name: _average_entries([values for entry in shots if (values := entry.regions.get(name))])
        or None
        for name in names
    }
    whole = _read_entry({"mean": {}, **stated})
    return MethodEntry(
        mean={**mean, **whole.mean},
        confidence=whole.confidence,
        frames={},
        regions={**regions, **whole.regions},
        notes=whole.notes,
        counted=frozenset(),
        kept=_count_all_kept(shots),
    )


def _average_entries(parts: list[Values]) -> dict[str, float | None]:
    keys = dict.fromkeys(key for values in parts for key in values)
    known = {key: [v for values in parts if (v := values.get(key)) is not None] for key in keys}
    # as in the evaluation, infinite values do not count where others are finite
    taken = {key: [v for v in held if math.isfinite(v)] or held for key, held in known.items()}
    return {key: sum(v) / len(v) if v else None for key, v in taken.items()}


def _describe_metric(
    key: str, description: Mapping[str, Any], means: Iterable[float | None]
) -> ShownMetric:
    return ShownMetric(
        key=key,
        title=description.get("title", key),
        unit=description.get("unit", ""),
        better="" if key.endswith(OF_REFERENCE) else description.get("better", ""),
        convention=description.get("convention", ""),
        unavailable=description.get("unavailable") or "",
        decimals=_choose_decimals(means),
    )


def _choose_decimals(means: Iterable[float | None]) -> int:
    sizes = [abs(mean) for mean in means if mean and math.isfinite(mean)]
    whole = math.floor(math.log10(max(sizes))) + 1 if sizes else 1
    return min(max(SIGNIFICANT - whole, 0), MOST_DECIMALS)


def _list_regions(
    result: Mapping[str, Any], entries: Iterable[MethodEntry]
) -> dict[str, tuple[str, str]]:
    described: Mapping[str, Any] = result.get("regions", {})
    names = dict.fromkeys([*described, *(name for entry in entries for name in entry.regions)])
    descriptions = {name: described.get(name) or {} for name in names}
    return {
        name: (about.get("title", name.replace("_", " ")), about.get("description", ""))
        for name, about in descriptions.items()
    }
