"""Tables of Markdown; what stands in them may come from anywhere."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from rtsr_cli.core.visible_text import make_visible

ESCAPES = str.maketrans({"|": "\\|", "<": "&lt;"})
"""What would end a cell, or begin an element."""


def write_table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """Return a table's lines."""
    lines = [head, ["---"] * len(head), *rows]
    return [f"| {' | '.join(_write_cell(cell) for cell in line)} |" for line in lines]


def write_facts(facts: Mapping[str, object]) -> list[str]:
    """Return a table of names and values."""
    return write_table(("", ""), facts.items())


def _write_cell(cell: object) -> str:
    return make_visible(str(cell)).translate(ESCAPES)
