"""CONTRIBUTING's table of promises: each names a test that is there."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")

ROWS = re.findall(r"^\| ([^|\n]+) \| `(tests/[\w/]+\.py)::(test_\w+)` \|$", PAGE, re.MULTILINE)
"""(promise, file, test)."""


@cache
def asserting_tests(path: str) -> frozenset[str]:
    """Tests of a file that can fail: they assert, expect an error, or call what does."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    asserting = {name for name, node in functions.items() if _asserts(node)}
    calling = {name for name, node in functions.items() if asserting & _called(node)}
    return frozenset(name for name in asserting | calling if name.startswith("test_"))


def _asserts(node: ast.AST) -> bool:
    return any(
        isinstance(part, ast.Assert)
        or (isinstance(part, ast.Attribute) and part.attr in {"raises", "assert_array_equal"})
        for part in ast.walk(node)
    )


def _called(node: ast.AST) -> set[str]:
    calls = (part.func for part in ast.walk(node) if isinstance(part, ast.Call))
    return {function.id for function in calls if isinstance(function, ast.Name)}


def test_the_table_is_read() -> None:
    rows = [line for line in PAGE.splitlines() if "`tests/" in line and line.startswith("|")]
    assert len(ROWS) == len(rows) > 40
    assert len({promise for promise, _, _ in ROWS}) == len(ROWS)


@pytest.mark.parametrize(("promise", "path", "name"), ROWS, ids=[name for _, _, name in ROWS])
def test_a_promise_is_held_by_a_test(promise: str, path: str, name: str) -> None:
    assert name in asserting_tests(path), f"{promise}: {path} has no test {name} that can fail"
