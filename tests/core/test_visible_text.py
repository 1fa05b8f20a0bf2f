from __future__ import annotations

import json
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtsr_cli.core.visible_text import make_all_visible, make_visible, write_cell


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain Łódź 漢字 é", "plain Łódź 漢字 é"),
        ("\x1b[31mred", "\\x1b[31mred"),
        ("a\r\nb\tc\x00", "a\\r\\nb\\tc\\x00"),
        ("\x9b2J\x7f", "\\x9b2J\\x7f"),
        ("\u202egnp.exe", "\\u202egnp.exe"),
        (os.fsdecode(b"n\xff\xfe"), "n\\xff\\xfe"),
        ("\ud83d", "\\ud83d"),
    ],
)
def test_what_a_terminal_would_obey_is_shown_as_an_escape(text: str, shown: str) -> None:
    assert make_visible(text) == shown


def test_only_indented_lines_may_follow_the_first() -> None:
    text = "choices:\n    one\n    two\nError: fake"
    assert make_visible(text, lines=True) == "choices:\n    one\n    two\\nError: fake"


@given(st.text(st.characters()))
def test_what_is_shown_is_printable_utf8_and_shown_alike_again(text: str) -> None:
    shown = make_visible(text)
    shown.encode()
    assert make_visible(shown) == shown
    assert not any(ord(c) < 0x20 or 0x7F <= ord(c) < 0xA0 for c in shown)


def test_names_in_events_are_utf8_at_any_depth() -> None:
    name = os.fsdecode(b"\xff")
    event = {name: [name, {"é": (name, 1)}], "n": None}
    written = json.dumps(make_all_visible(event), ensure_ascii=False).encode()
    assert json.loads(written) == {"\\xff": ["\\xff", {"é": ["\\xff", 1]}], "n": None}


@pytest.mark.parametrize("start", ["=", "+", "-", "@", "\t", "\r"])
def test_a_cell_that_begins_like_a_formula_is_a_text(start: str) -> None:
    cell = str(write_cell(f"{start}HYPERLINK(1)"))
    assert cell[0] == "'"


@pytest.mark.parametrize("cell", ["-3", "+1.5e3", "-inf", "shot", "", -3.5, None, 4])
def test_numbers_and_other_texts_stay_as_they_are(cell: object) -> None:
    assert write_cell(cell) == cell
