"""Counts and lists in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def say_count(count: int, noun: str) -> str:
    """Write 1 frame, 2 frames."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def say_verb(count: int) -> str:
    """Write is of one thing, are of several."""
    return "is" if count == 1 else "are"


def join_names(names: Iterable[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    known = list(names)
    return " and ".join(filter(None, [", ".join(known[:-1]), *known[-1:]]))


def say_missing(buffers: Sequence[str]) -> str:
    """Write buffer 'a' is missing, buffers 'a' and 'b' are missing."""
    names = join_names(f"'{buffer}'" for buffer in buffers)
    several = len(buffers) > 1
    return f"buffer{'s' if several else ''} {names} {'are' if several else 'is'} missing"


def list_some(names: Sequence[str], most: int) -> str:
    """The first names; of more, the rest is counted."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
