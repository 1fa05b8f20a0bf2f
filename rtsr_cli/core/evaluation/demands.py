"""Demands on means (`--fail-under`), and which results miss them; imports no torch."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rtsr_cli.core.errors import ConfigError, did_you_mean

CONDITION = re.compile(r"\s*([\w-]+)\s*(<=|>=|<|>)\s*([-+.\deE]+|inf)\s*$")


@dataclass(frozen=True)
class Condition:
    """A demand on the mean of a metric.

    Attributes:
        metric: its name.
        relation: one of < <= > >=.
        bound: what the mean is held against.
    """

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


def parse_conditions(text: str, metrics: Sequence[str]) -> tuple[Condition, ...]:
    """Parse 'psnr>30,flip<0.1'.

    Raises:
        ConfigError: it is no such list, or names a metric that is not computed.
    """
    parsed = []
    for part in text.split(","):
        match = CONDITION.match(part)
        try:
            bound = float(match.group(3)) if match else math.nan
        except ValueError:
            bound = math.nan
        if match is None or math.isnan(bound):
            raise ConfigError(f"'{part.strip()}' is no condition; write them as psnr>30,flip<0.1")
        metric = match.group(1).lower()
        if metric not in metrics:
            hint = did_you_mean(metric, metrics)
            raise ConfigError(f"metric '{metric}' is not computed{hint}; add it to --metric")
        parsed.append(Condition(metric, match.group(2), bound))
    return tuple(parsed)


def list_failures(result: Mapping[str, Any], demanded: Sequence[Condition]) -> list[str]:
    """Say which test misses which condition."""
    return [
        f"{key}: {condition.metric} is {_score_text(test['mean'].get(condition.metric))}, demanded "
        f"{condition}"
        for key, test in result["tests"].items()
        for condition in demanded
        if not condition.holds(test["mean"].get(condition.metric))
    ]


def _score_text(value: float | None) -> str:
    return "missing" if value is None else f"{value:.6g}"
