from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import click
import pytest
from click.testing import Result

from rtsr_cli.cli import COMMANDS, group
from rtsr_cli.commands.evaluate import MetricList
from rtsr_cli.commands.options import Frames, ListOption
from rtsr_cli.core.choices import MetricName
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


def parse(line: str) -> dict[str, object]:
    """What a command is given by a line."""
    name, *arguments = line.split()
    command = group.get_command(click.Context(group), name)
    assert command is not None
    with command.make_context(name, arguments) as context:
        return context.params


def test_lists_of_a_repeated_option_add_up() -> None:
    given = parse(
        "evaluate a b --metric psnr --metric flip,psnr --frames 1-3 --frames 3-5x2,9 "
        "--fail-under psnr>30 --fail-under flip<0.1"
    )
    assert given["metrics"] == (MetricName.PSNR, MetricName.FLIP)
    assert given["frames"] == {1, 2, 3, 5, 9}
    assert given["fail_under"] == "psnr>30,flip<0.1"
    assert parse("upscale a b --frames 2 --frames 4")["frames"] == {2, 4}
    assert parse("synth a --frames 2 --frames 4")["frames"] == {2, 4}


def test_all_metrics_beside_others_are_all_and_a_wrong_name_is_still_named(rtsr: Run) -> None:
    assert parse("evaluate a b --metric psnr --metric all")["metrics"] == tuple(MetricName)
    result = rtsr("evaluate", "a", "b", "--metric", "all", "--metric", "psrn")
    assert result.exit_code == 2
    assert "psrn" in result.stderr


def test_defaults_of_lists_hold_where_none_is_given() -> None:
    given = parse("evaluate a b")
    assert given["metrics"] == (MetricName.PSNR, MetricName.SSIM, MetricName.FLIP)
    assert given["frames"] is None
    assert given["fail_under"] is None
    assert parse("synth a")["frames"] == set(range(1, 9))


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_that_takes_a_list_adds_up(name: str) -> None:
    command = group.get_command(click.Context(group), name)
    assert command is not None
    for param in command.params:
        if isinstance(param.type, Frames | MetricList) or param.metavar == "LIST":
            assert isinstance(param, ListOption), param.name
