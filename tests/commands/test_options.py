from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from rtsr_cli.commands.options import Frames
from rtsr_cli.core.frames.selection import format_ranges

Run = Callable[..., Result]


@pytest.mark.parametrize("numbers", [{-3, -2, -1, 0, 1, 2}, {-4, -3, 1, 2, 3, 9}, {5}])
def test_frames_are_read_as_ranges_writes_them(numbers: set[int]) -> None:
    assert Frames().convert(format_ranges(numbers), None, None) == numbers


def test_steps_and_the_older_way_of_writing_negative_bounds_hold() -> None:
    assert Frames().convert("-3..3x3", None, None) == {-3, 0, 3}
    assert Frames().convert("-3--1", None, None) == {-3, -2, -1}


@pytest.mark.parametrize(
    "arguments",
    [
        ("upscale", "IN", "OUT", "--json"),
        ("demodulate", "IN", "OUT", "--json"),
        ("synth", "OUT", "--size", "100x64", "--scale", 3, "--json"),
    ],
)
def test_a_refusal_is_an_event_where_events_are_asked_for(
    rtsr: Run, tmp_path: Path, arguments: tuple[object, ...]
) -> None:
    places = {"IN": tmp_path / "nosuch", "OUT": tmp_path / "out"}
    result = rtsr(*(places.get(str(a), a) for a in arguments))
    assert result.exit_code == 3
    (event,) = (json.loads(line) for line in result.stdout.splitlines())
    message = result.stderr.removeprefix("Error: ").rstrip("\n")
    assert event == {"event": "error", "message": message, "exit": 3}


def test_a_refusal_is_no_event_where_none_are_asked_for(rtsr: Run, tmp_path: Path) -> None:
    result = rtsr("upscale", tmp_path / "nosuch", tmp_path / "out")
    assert result.stdout == ""
    assert "no such folder" in result.stderr
