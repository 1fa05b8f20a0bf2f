"""Demands on means."""

from __future__ import annotations

import math

import pytest

from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.evaluation.demands import Condition, list_failures, parse_conditions


@pytest.mark.parametrize(
    ("value", "relation", "bound", "holds"),
    [
        (30.0, ">", 30.0, False),
        (30.0, ">=", 30.0, True),
        (0.1, "<", 0.2, True),
        (0.3, "<=", 0.2, False),
        (math.inf, ">", 30.0, True),
        (None, ">", 30.0, False),
        (math.nan, "<", 30.0, False),
    ],
)
def test_conditions(value: float | None, relation: str, bound: float, holds: bool) -> None:
    assert Condition("psnr", relation, bound).holds(value) is holds


def test_conditions_are_parsed_and_name_what_they_miss() -> None:
    demanded = parse_conditions("PSNR>30, flip<=1e-1", ["psnr", "flip"])
    assert [str(c) for c in demanded] == ["psnr>30", "flip<=0.1"]
    result = {"tests": {"a": {"mean": {"psnr": 29.0, "flip": 0.05}}}}
    assert list_failures(result, demanded) == ["a: psnr is 29, demanded psnr>30"]


@pytest.mark.parametrize("text", ["psnr", "psnr>", "psnr=30", "psnr>x", "", "psnr>nan"])
def test_what_is_no_condition_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="is no condition"):
        parse_conditions(text, ["psnr"])


def test_a_condition_on_a_metric_that_is_not_computed_is_refused() -> None:
    with pytest.raises(ConfigError, match="metric 'flop' is not computed, did you mean 'flip'"):
        parse_conditions("flop<1", ["psnr", "flip"])
