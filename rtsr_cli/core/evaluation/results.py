"""Scores of frames put together: means, intervals, regions, merging of parts, thresholds.

The mean of a metric is the mean over frames. Infinite values (PSNR of identical frames) are left
out of it where others are finite; where all are infinite, so is the mean.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rtsr_cli.core.errors import ConfigError, FrameFolderError, did_you_mean

Scores = Mapping[str, float | None]
"""Metric -> value; None where a frame has none."""

RESAMPLES = 1000
CONFIDENCE = 0.95

INFINITE_RULE = "infinite values (identical frames) are left out of means unless all are"

CONDITION = re.compile(r"\s*([\w-]+)\s*(<=|>=|<|>)\s*([-+.\deE]+|inf)\s*$")


def mean(values: Iterable[float | None]) -> float | None:
    """Return the mean by the rule above; None without values."""
    known = [v for v in values if v is not None and not math.isnan(v)]
    finite = [v for v in known if math.isfinite(v)]
    if finite:
        return math.fsum(finite) / len(finite)
    return known[0] if known else None


def interval(values: Iterable[float | None]) -> list[float] | None:
    """95 % interval of the mean by a moving-block bootstrap, seeded [Kunsch 1989].

    Neighbouring frames resemble each other: blocks of n^(1/3) of them are drawn, not single ones.
    """
    finite = np.array([v for v in values if v is not None and math.isfinite(v)], dtype=np.float64)
    count = len(finite)
    if count < 2:
        return None
    block = max(1, round(count ** (1 / 3)))
    random = np.random.default_rng(0)
    starts = random.integers(0, count - block + 1, (RESAMPLES, -(-count // block)))
    drawn = (starts[:, :, None] + np.arange(block)).reshape(RESAMPLES, -1)[:, :count]
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.quantile(finite[drawn].mean(axis=1), (tail, 1.0 - tail))
    return [float(low), float(high)]


@dataclass(frozen=True, kw_only=True)
class FrameScores:
    """Scores of one method on one frame.

    Attributes:
        number: frame number.
        scores: metric -> value.
        regions: region -> share of the pixels and metric -> value; None where it cannot be made.
        nonfinite: pixels that are NaN or Inf in the test.
        counted: False where the frame is shown but takes no part in means (`--skip-first`).
    """

    number: int
    scores: Scores
    regions: Mapping[str, Scores | None]
    nonfinite: int
    counted: bool = True

    def facts(self) -> dict[str, Any]:
        """Return the plain values of the JSON file."""
        return {
            **self.scores,
            "nonfinite": self.nonfinite,
            "counted": self.counted,
            "regions": {name: None if r is None else dict(r) for name, r in self.regions.items()},
        }


def summarised(
    frames: Mapping[str, Mapping[str, Any]], sequence: Scores | None = None
) -> dict[str, Any]:
    """Put the frames of one method and shot together.

    Args:
        frames: number -> `FrameScores.facts`.
        sequence: metric -> value of metrics that judge the sequence as a whole.
    """
    counted = [f for f in frames.values() if f["counted"]]
    names = [k for k in _keys(counted) if k not in {"nonfinite", "counted", "regions"}]
    return {
        "mean": {name: mean(f.get(name) for f in counted) for name in names} | dict(sequence or {}),
        "confidence": {name: interval(f.get(name) for f in counted) for name in names},
        "frames": dict(frames),
        "regions": _region_means([f["regions"] for f in counted]),
        "nonfinite": sum(int(f["nonfinite"]) for f in frames.values()),
    }


def _keys(mappings: Iterable[Mapping[str, Any]]) -> list[str]:
    return list(dict.fromkeys(key for mapping in mappings for key in mapping))


def _region_means(frames: Sequence[Mapping[str, Scores | None]]) -> dict[str, Any]:
    """Means over the frames in which a region is; None where it is in none."""
    found: dict[str, Any] = {}
    for region in _keys(frames):
        held = [scores for f in frames if (scores := f.get(region)) is not None]
        means = {key: mean(scores.get(key) for scores in held) for key in _keys(held)}
        found[region] = means or None
    return found


def grouped(tests: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Means of every method over its shots, each shot counting once."""
    methods: dict[str, list[Mapping[str, Any]]] = {}
    for test in tests.values():
        methods.setdefault(test["method"], []).append(test)
    return {
        method: {
            "mean": {
                key: mean(t["mean"].get(key) for t in shots)
                for key in _keys(t["mean"] for t in shots)
            },
            "confidence": {
                key: interval(t["mean"].get(key) for t in shots)
                for key in _keys(t["mean"] for t in shots)
            },
            "shots": len(shots),
        }
        for method, shots in methods.items()
    }


def merged(parts: Sequence[tuple[str, Mapping[str, Any]]]) -> dict[str, Any]:
    """Join the results of parts of the same frames (`--shard`), by frame number.

    Args:
        parts: file name and its content.

    Raises:
        FrameFolderError: a part was judged by other rules, or holds a frame of another one.
    """
    first_name, first = parts[0]
    tests: dict[str, dict[str, Any]] = {}
    for name, part in parts:
        for rule in ("protocol", "options", "metrics"):
            if part.get(rule) != first.get(rule):
                raise FrameFolderError(
                    f"{name}: was judged with another {rule} than {first_name}; evaluate it again "
                    "with the same options"
                )
        for key, test in part["tests"].items():
            into = tests.setdefault(key, {**test, "frames": {}})
            twice = sorted(set(into["frames"]) & set(test["frames"]), key=int)
            if twice:
                raise FrameFolderError(
                    f"{name}: frame {twice[0]} of '{key}' is in another part already; merge each "
                    "part once"
                )
            into["frames"] |= test["frames"]
    for key, test in tests.items():
        frames = dict(sorted(test["frames"].items(), key=lambda item: int(item[0])))
        tests[key] = {**test, **summarised(frames)}
    result = {**first, "tests": tests}
    if "methods" in first:
        result["methods"] = grouped(tests)
    return result


@dataclass(frozen=True)
class Condition:
    """A demand on a mean: `metric`, one of < <= > >=, `bound`."""

    metric: str
    relation: str
    bound: float

    def __str__(self) -> str:
        """Write it as the user did."""
        return f"{self.metric}{self.relation}{self.bound:g}"

    def holds(self, value: float | None) -> bool:
        """Tell whether a mean meets the demand; one that is not there does not."""
        if value is None or math.isnan(value):
            return False
        return {
            "<": value < self.bound,
            "<=": value <= self.bound,
            ">": value > self.bound,
            ">=": value >= self.bound,
        }[self.relation]


def conditions(text: str, metrics: Sequence[str]) -> tuple[Condition, ...]:
    """Parse 'psnr>30,flip<0.1'.

    Raises:
        ConfigError: it is no such list, or names a metric that is not computed.
    """
    found = []
    for part in text.split(","):
        match = CONDITION.match(part)
        try:
            bound = float(match.group(3)) if match else math.nan
        except ValueError:
            bound = math.nan
        if match is None or math.isnan(bound):
            raise ConfigError(f"'{part.strip()}' is no condition; write them as psnr>30,flip<0.1")
        if match.group(1) not in metrics:
            hint = did_you_mean(match.group(1), metrics)
            raise ConfigError(
                f"metric '{match.group(1)}' is not computed{hint}; add it to --metric"
            )
        found.append(Condition(match.group(1), match.group(2), bound))
    return tuple(found)


def failures(result: Mapping[str, Any], demanded: Sequence[Condition]) -> list[str]:
    """Say which test misses which condition."""
    return [
        f"{key}: {condition.metric} is {_text(test['mean'].get(condition.metric))}, demanded "
        f"{condition}"
        for key, test in result["tests"].items()
        for condition in demanded
        if not condition.holds(test["mean"].get(condition.metric))
    ]


def _text(value: float | None) -> str:
    return "missing" if value is None else f"{value:.6g}"
