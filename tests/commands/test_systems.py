"""`rtsr systems`."""

from __future__ import annotations

import json
from collections.abc import Callable

from click.testing import Result

from rtsr_cli.models import system_names


def test_every_system_is_listed_with_its_inputs(rtsr: Callable[..., Result]) -> None:
    result = rtsr("systems")
    assert result.exit_code == 0, result.output
    for name in system_names():
        assert f"{name}: " in result.output
    assert "hr material" in result.output


def test_json_has_one_object_a_system(rtsr: Callable[..., Result]) -> None:
    facts = [json.loads(line) for line in rtsr("systems", "--json").stdout.splitlines()]
    assert [f["name"] for f in facts] == list(system_names())
    assert all(f["parameters"] == 0 for f in facts if "baseline" in f["summary"])
