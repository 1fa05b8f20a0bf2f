"""docs/architecture.md: what it names is there, and every room is on it."""

from __future__ import annotations

import ast
import re
import tomllib
from functools import cache
from pathlib import Path

import pytest

import rtsr_cli

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = Path(rtsr_cli.__file__).parent
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")

CODE = re.findall(r"`([^`\n]+)`", PAGE)
"""Everything between backticks."""

NAMED = re.compile(r"([\w/]+\.py):([\w.]+)")
"""A name in a file."""

SYMBOL = re.compile(r"[A-Za-z]\w*_\w+|[A-Z][a-z]\w+|[A-Z]\w+\.\w+")
"""A name without its file: one with an underscore, a class, or a member of one."""

EXAMPLES = {"core/<room>/request.py", "core/<room>/call.py"}


@cache
def names_of(path: str) -> frozenset[str]:
    """Functions, classes, their members and constants that a module defines."""
    tree = ast.parse((PACKAGE / path).read_text(encoding="utf-8"))
    return frozenset(list_names(tree))


def list_names(tree: ast.Module | ast.ClassDef, prefix: str = "") -> list[str]:
    names = []
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.append(prefix + node.name)
        if isinstance(node, ast.ClassDef):
            names += list_names(node, f"{prefix}{node.name}.")
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        names += [prefix + target.id for target in targets if isinstance(target, ast.Name)]
    return names


@cache
def all_names() -> frozenset[str]:
    """Names of every module, those of classes with and without the class."""
    paths = [path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py")]
    names = {name for path in paths for name in names_of(path)}
    modules = {Path(path).stem for path in paths}
    return frozenset(names | {name.rpartition(".")[2] for name in names} | modules)


@pytest.mark.parametrize("code", sorted({code for code in CODE if ".py" in code} - EXAMPLES))
def test_files_and_names_of_the_page_exist(code: str) -> None:
    if code.startswith("python "):
        assert (ROOT / code.split()[1]).is_file()
        return
    path, _, name = code.partition(":")
    assert (PACKAGE / path).is_file(), f"{path}: no such file"
    assert not name or name in names_of(path), f"{path} defines no {name}"


@pytest.mark.parametrize("symbol", sorted({code for code in CODE if SYMBOL.fullmatch(code)}))
def test_names_without_a_file_are_defined_somewhere(symbol: str) -> None:
    assert symbol in all_names() | {"jitter_px", "rtsr_cli"}


@pytest.mark.parametrize("folder", sorted({code for code in CODE if code.endswith("/")}))
def test_rooms_of_the_page_exist(folder: str) -> None:
    assert (PACKAGE / folder).is_dir()


def test_rooms_lie_in_the_layers_of_the_contract() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = {c["id"]: c for c in settings["tool"]["importlinter"]["contracts"]}
    layers = contracts["core"]["layers"][::-1]
    expected = {(room, i) for i, row in enumerate(layers, 1) for room in row.split(" | ")}
    rows = re.findall(r"^\| (\d+) \| (.+?) \|", PAGE, re.MULTILINE)
    shown = {
        (room, int(layer))
        for layer, rooms in rows
        for room in re.findall(r"`core/(\w+)(?:/|\.py)`", rooms)
    }
    assert shown == expected


def test_a_name_that_is_not_there_would_be_noticed() -> None:
    assert "plan_shot" in names_of("core/run/plan.py")
    assert "Stamps.of_output" in names_of("core/run/stamps.py")
    assert "plan_shots" not in names_of("core/run/plan.py")
    assert len([code for code in CODE if NAMED.fullmatch(code)]) > 80
