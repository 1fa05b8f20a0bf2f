"""Examples that end every help, and what shells complete."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise, takewhile

import click
import pytest
from click.shell_completion import ShellComplete
from click.testing import Result

from rtsr_cli.cli import COMMANDS, group
from rtsr_cli.commands.examples import EXAMPLES, GROUP
from rtsr_cli.core.captures.layout_names import LAYOUT_NAMES
from rtsr_cli.core.choices import MetricName
from rtsr_cli.models import list_trainable_names, list_upscaler_names

Run = Callable[..., Result]

LINES = [line for lines in EXAMPLES.values() for line in lines]


def test_every_command_has_two_examples() -> None:
    assert set(EXAMPLES) == {GROUP, *COMMANDS}
    assert all(len(lines) == 2 for lines in EXAMPLES.values())
    for name, lines in EXAMPLES.items():
        assert all(line.startswith(f"rtsr {name}".rstrip()) for line in lines)


@pytest.mark.parametrize("name", [GROUP, *COMMANDS])
def test_a_help_ends_with_its_examples_as_they_are_written(rtsr: Run, name: str) -> None:
    result = rtsr(*([name] if name else []), "--help")
    assert result.exit_code == 0
    lines = [line.strip() for line in result.output.rstrip().splitlines()]
    assert lines[-3:] == ["Examples:", *EXAMPLES[name]]


@pytest.mark.parametrize("line", LINES)
def test_an_example_is_a_valid_command_line(line: str) -> None:
    name, *arguments = shlex.split(line)[1:]
    command = group.get_command(click.Context(group), name)
    if isinstance(command, click.Group):
        name, *arguments = arguments
        command = command.get_command(click.Context(command), name)
    assert command is not None
    context = command.make_context(name, list(arguments))
    own = takewhile(lambda word: word != "--", arguments)
    given = {word.partition("=")[0] for word in own if word.startswith("--")}
    assert given <= {o for p in command.params for o in p.opts}
    context.close()


@pytest.mark.parametrize("line", [line for line in LINES if "--dry-run" not in line])
def test_an_example_is_no_usage_error_where_it_runs(rtsr: Run, line: str) -> None:
    """The frames of examples are not there: beyond its usage an example can only be refused."""
    name, *arguments = shlex.split(line)[1:]
    if name in {"export", "farm", "systems", "precompute-lut", "synth"}:
        pytest.skip("would do its work")
    result = rtsr(name, *arguments)
    assert result.exit_code == 3, result.output


def complete(line: str) -> list[str]:
    """What a shell offers for the last word of a line."""
    *words, begun = [*shlex.split(line)[1:], *([""] if line.endswith(" ") else [])]
    shell = ShellComplete(group, {}, "rtsr", "_RTSR_COMPLETE")
    return [item.value for item in shell.get_completions(words, begun)]


def test_shells_complete_commands_systems_layouts_and_metrics() -> None:
    assert complete("rtsr up") == ["upscale"]
    assert complete("rtsr upscale in out --system ") == list(list_upscaler_names())
    assert complete("rtsr upscale in out --system demod-") == [
        "demod-bicubic", "demod-guided", "demod-temporal",
    ]  # fmt: skip
    assert complete("rtsr train fus") == [n for n in list_trainable_names() if n.startswith("fus")]
    assert complete("rtsr inspect in --layout ") == list(LAYOUT_NAMES)
    assert complete("rtsr evaluate a b --metric ") == [*MetricName, "all"]
    assert complete("rtsr evaluate a b --metric psnr,s") == ["psnr,ssim"]
    assert complete("rtsr evaluate a b --protocol n") == ["nsrd"]
    assert complete("rtsr label in out --metric jn") == ["jnflip", "jnyang"]
    assert "--simulate-lr" in complete("rtsr upscale in out --sim")


def test_a_layout_may_be_a_file_for_shells() -> None:
    shell = ShellComplete(group, {}, "rtsr", "_RTSR_COMPLETE")
    (item,) = shell.get_completions(["inspect", "in", "--layout"], "my_")
    assert (item.type, item.value) == ("file", "my_")


@pytest.mark.parametrize(
    ("shell", "sign"), [("bash", "complete "), ("zsh", "compdef "), ("fish", "complete ")]
)
def test_the_script_of_a_shell_is_printed_without_torch(shell: str, sign: str) -> None:
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "rtsr_cli"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "_RTSR_COMPLETE": f"{shell}_source"},
    )
    assert sign in done.stdout
    assert "_RTSR_COMPLETE" in done.stdout
    loaded = [line.rpartition("|")[2].strip() for line in done.stderr.splitlines()]
    assert not {"torch", "numpy", "OpenEXR"} & set(loaded)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("3-1", "3-1 runs backwards; write 1-3"),
        ("1-2,9-4x2", "9-4 runs backwards; write 4-9"),
        ("5--3", "5--3 runs backwards; write -3..5"),
        ("1-z," * 5000, "is no frame range"),
        ("1-99999999999999", "'1-99999999999999' names more than 10000000 frames"),
        ("5,-9..999999999999", "names more than 10000000 frames"),
    ],
)
def test_a_wrong_range_of_frames_is_one_short_usage_error(rtsr: Run, given: str, said: str) -> None:
    result = rtsr("upscale", "in", "out", f"--frames={given}")
    assert result.exit_code == 2
    assert said in result.output
    assert all(len(line) < 200 for line in result.output.splitlines())


def test_ranges_in_order_are_taken(rtsr: Run) -> None:
    for given in ("1-3", "-5--3", "-3..2", "1-9x2,12"):
        assert rtsr("upscale", "in", "out", f"--frames={given}").exit_code == 3


def test_the_table_of_examples_keeps_the_order_of_commands() -> None:
    order = [name for name in EXAMPLES if name]
    places = [list(COMMANDS).index(name) for name in order]
    assert all(a < b for a, b in pairwise(places))
