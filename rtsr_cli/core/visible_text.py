"""Foreign text made harmless where it is shown: on a terminal, in events, in tables.

Names of channels, attributes, files and the like come from whoever wrote a file. What they hold is
shown, never obeyed: no escape sequence moves a cursor, no cell is a formula, no byte of a name
breaks an encoding.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

HIDDEN = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Control characters, what turns the direction of writing, and halves of characters."""

INDENTED = "\n    "
"""Begins the further lines of messages that have some."""

BYTES = range(0xDC80, 0xDD00)
"""What Python puts for bytes of a file's name that are not UTF-8 (PEP 383)."""

FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")
"""Spreadsheets take cells that begin so for formulas."""


def make_visible(text: str, *, lines: bool = False) -> str:
    r"""Return a text with control characters as escapes: `\x1b`, `\n`, `\u202e`.

    Args:
        text: of any origin.
        lines: leave ends of lines before indented lines as they are; nothing that looks like a
            message of its own can follow them.
    """
    if text.isprintable():
        return text
    if lines:
        return INDENTED.join(make_visible(line) for line in text.split(INDENTED))
    return HIDDEN.sub(_escape, text)


def _escape(found: re.Match[str]) -> str:
    code = ord(found[0])
    if code in BYTES:
        return f"\\x{code - BYTES.start + 0x80:02x}"
    return found[0].encode("unicode_escape").decode()


def make_all_visible(value: Any) -> Any:
    """Return plain values, names among them, without halves of characters, which no UTF-8 has."""
    if isinstance(value, str):
        return value if value.isascii() or _is_utf8(value) else make_visible(value)
    if isinstance(value, Mapping):
        return {make_all_visible(key): make_all_visible(held) for key, held in value.items()}
    if isinstance(value, list | tuple):
        return [make_all_visible(held) for held in value]
    return value


def _is_utf8(text: str) -> bool:
    return not any("\ud800" <= character <= "\udfff" for character in text)


def write_cell(value: object) -> object:
    """Return a value for a table: a text that begins like a formula is marked as a text by `'`."""
    if not isinstance(value, str):
        return value
    text = make_visible(value)
    return f"'{text}" if value.startswith(FORMULA_STARTS) and not _is_number(value) else text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
