"""Holes in a numbering, as ranges: no more than files, however far two numbers are apart."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from itertools import pairwise

from rtsr_cli.core.frames.selection import format_ranges

MOST_APART = 4
"""Numbers in steps that are written one by one; more of them as --frames has them: 10-90x10."""

MOST_SINGLE = 1000
"""Numbers of a range that are given one by one as plain values."""


def list_gaps(there: Collection[int], known: Collection[int], step: int) -> list[range]:
    """List what is expected and not there: known numbers, and those between them in steps.

    Args:
        there: numbers that are not missing.
        known: numbers that anything has; steps count from the least of them.
        step: of the numbering.
    """
    if not known:
        return []
    first, last = min(known), max(known)
    regular = sorted(n for n in there if first <= n <= last and (n - first) % step == 0)
    bounds = [first - step, *regular, first + ((last - first) // step + 1) * step]
    pairs = pairwise(bounds)
    gaps = [range(a + step, b, step) for a, b in pairs if b - a > step]
    lost = set(known) - set(there)
    odd = [range(n, n + 1) for n in lost if (n - first) % step]
    return sorted([*gaps, *odd], key=lambda gap: gap.start)


def count_gaps(gaps: Iterable[range]) -> int:
    """Count their numbers; `len` of a range ends at 2^63."""
    return sum(-((gap.start - gap.stop) // gap.step) for gap in gaps)


def format_gaps(gaps: Iterable[range]) -> str:
    """Write them in short: 3, 7-20, 30-90x10."""
    return ", ".join(_format_gap(gap) for gap in gaps)


def _format_gap(gap: range) -> str:
    if gap.step == 1:
        first, last = gap[0], gap[-1]
        between = ".." if first < 0 else "-"
        return str(first) if first == last else f"{first}{between}{last}"
    if count_gaps([gap]) <= MOST_APART:
        return format_ranges(gap)
    return f"{gap[0]}{'..' if gap[0] < 0 else '-'}{gap[-1]}x{gap.step}"


def flatten_gaps(gaps: Iterable[range]) -> list[int | str]:
    """Return them as plain values: numbers, and in short what would be more than can be read."""
    return list(_flatten(gaps))


def _flatten(gaps: Iterable[range]) -> Iterator[int | str]:
    for gap in gaps:
        if count_gaps([gap]) > MOST_SINGLE:
            yield _format_gap(gap)
        else:
            yield from gap
