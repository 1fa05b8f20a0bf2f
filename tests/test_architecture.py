"""The picture of the package, what is installed, and how fast and quietly the CLI answers."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

import pytest

import rtsr_cli
from rtsr_cli.cli import COMMANDS

ROOT = Path(__file__).resolve().parents[1]

HELP_LIMIT_S = 0.3

TORCH_LOADED = "torch was imported"

PROBE = f"""
import sys
from rtsr_cli.cli import main
try:
    main()
finally:
    if "torch" in sys.modules:
        print("{TORCH_LOADED}", file=sys.stderr)
"""


def run_python(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run an interpreter that imports the same rtsr_cli as this process."""
    package = str(Path(rtsr_cli.__file__).parents[1])
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=cwd,
        env=os.environ | {"PYTHONPATH": package},
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=120,
        check=False,
    )


@pytest.fixture
def rtsr(tmp_path):
    """`rtsr` in a process of its own, which says at the end whether it imported torch."""

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return run_python("-c", PROBE, *arguments, cwd=tmp_path)

    return run


@pytest.mark.skipif(find_spec("importlinter") is None, reason="import-linter is not installed")
def test_the_import_contracts_hold():
    code = "from importlinter.cli import lint_imports_command as lint; lint()"
    result = run_python("-c", code, "--no-logo", "--no-cache", cwd=ROOT)
    assert result.returncode == 0, result.stdout + result.stderr


def test_every_file_of_the_package_is_installed_and_nothing_else():
    try:
        record = metadata.distribution("rtsr").read_text("RECORD")
    except metadata.PackageNotFoundError:
        record = None
    if not record:
        pytest.skip("rtsr runs from the tree here, it is not installed")
    names = {line.split(",")[0] for line in record.splitlines()}
    installed = {name for name in names if name.startswith("rtsr_cli/") and ".pyc" not in name}
    if not installed:
        pytest.skip("rtsr is installed as a link to the tree")
    tree = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "rtsr_cli").rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }
    assert not tree - installed, "in the tree, but not installed"
    assert not installed - tree, "installed, but not in the tree"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_of_the_table_has_a_help_page(rtsr, command):
    result = rtsr(command, "--help")
    assert result.returncode == 0, result.stderr
    assert f"rtsr {command}" in result.stdout


@pytest.mark.parametrize("option", ["--help", "-h", "--version"])
def test_help_and_version_import_no_torch(rtsr, option):
    result = rtsr(option)
    assert result.returncode == 0
    assert TORCH_LOADED not in result.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("nosuch",),
        ("--nosuch",),
        ("upscale",),
        ("upscale", "a", "b", "--system", "bcubic"),
        ("demodulate", "--mode", "x", "a", "b"),
        ("precompute-lut",),
        ("systems", "--nosuch"),
    ],
    ids=" ".join,
)
def test_a_usage_error_exits_with_2_and_imports_no_torch(rtsr, arguments):
    result = rtsr(*arguments)
    assert result.returncode == 2
    assert "Usage: rtsr" in result.stderr
    assert TORCH_LOADED not in result.stderr


def test_the_probe_notices_torch(rtsr):
    result = rtsr("upscale", "nosuch", "out")
    assert result.returncode == 3
    assert TORCH_LOADED in result.stderr


def test_help_answers_in_under_0_3_seconds(tmp_path):
    def seconds() -> float:
        start = time.perf_counter()
        assert run_python("-m", "rtsr_cli", "--help", cwd=tmp_path).returncode == 0
        return time.perf_counter() - start

    # a busy machine adds to a run and never takes away: the best of some is the command's own time
    assert any(seconds() < HELP_LIMIT_S for _ in range(12))


def test_the_version_is_that_of_the_package(rtsr):
    assert rtsr("--version").stdout.split()[-1] == rtsr_cli.__version__


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (("upscal",), "did you mean 'upscale'"),
        (("demodualte",), "did you mean 'demodulate'"),
        (("upscale", "a", "b", "--system", "bcubic"), "did you mean 'bicubic'"),
        (("upscale", "a", "b", "--sclae", "2"), "'--scale'"),
        (("--versoin",), "'--version'"),
    ],
    ids=["command", "command-2", "system", "option", "group-option"],
)
def test_a_mistyped_name_gets_the_right_one_suggested(rtsr, arguments, meant):
    result = rtsr(*arguments)
    assert result.returncode == 2
    assert meant in result.stderr


def test_an_unknown_command_that_is_like_none_lists_them_all(rtsr):
    message = rtsr("xyzzy").stderr
    assert all(command in message for command in COMMANDS)
