"""Counts and lists in sentences."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[-+]?\d+)?%?")
"""Numbers in a sentence."""

LINE = "capture.toml"
"""From this word on, a text has lines to paste: there, numbers are no measurements."""


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


def say_once(said: Mapping[str, Sequence[str]]) -> list[tuple[tuple[str, ...], str]]:
    """Join what several say alike, up to what each has measured: shares and broken numbers.

    Args:
        said: texts by the name of who says them.

    Returns:
        Names and text, in the order of the first to say it. Where a number differs, it is the
        first one's, with the others' behind it: `5.1% (hr: 5.0%)`.
    """
    groups: list[dict[str, str]] = []
    for name, texts in said.items():
        for text in dict.fromkeys(texts):
            known = (g for g in groups if name not in g and _is_alike(text, *g.values()))
            group = next(known, None)
            if group is None:
                groups.append({name: text})
            else:
                group[name] = text
    return [(tuple(group), _write_joined(group)) for group in groups]


def _is_alike(text: str, first: str, *_others: str) -> bool:
    """Tell whether texts differ by measured numbers at most, and not in a line to paste."""
    (said, _, line), (known, _, known_line) = text.partition(LINE), first.partition(LINE)
    if line != known_line or NUMBER.split(said) != NUMBER.split(known):
        return False
    pairs = zip(NUMBER.findall(said), NUMBER.findall(known), strict=True)
    return all(a == b or any(c in a + b for c in "%.") for a, b in pairs)


def _write_joined(group: Mapping[str, str]) -> str:
    (_, text), *others = group.items()
    said, mark, line = text.partition(LINE)
    numbers = [NUMBER.findall(said)]
    numbers += [NUMBER.findall(other.partition(LINE)[0]) for _, other in others]
    names = [name for name, _ in others]
    own = iter(zip(*numbers, strict=True))

    def show(_: re.Match[str]) -> str:
        first, *rest = next(own)
        apart = [f"{n}: {value}" for n, value in zip(names, rest, strict=True) if value != first]
        return f"{first} ({', '.join(apart)})" if apart else first

    return f"{NUMBER.sub(show, said)}{mark}{line}"
