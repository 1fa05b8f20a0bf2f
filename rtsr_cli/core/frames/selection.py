"""Which frames of a shot a run writes: `--frames`, `--shard`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Shard:
    """Part `index` (from 1) of `count` contiguous, nearly equal parts."""

    index: int
    count: int

    def part(self, numbers: Sequence[int]) -> tuple[int, ...]:
        """Return this part of a shot's numbers; the parts are disjoint and complete."""
        start = len(numbers) * (self.index - 1) // self.count
        end = len(numbers) * self.index // self.count
        return tuple(numbers[start:end])


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Frames to write; None = all."""

    frames: frozenset[int] | None = None
    shard: Shard | None = None

    def of(self, numbers: Sequence[int]) -> tuple[int, ...]:
        """Return the selected ones among a shot's numbers."""
        chosen = tuple(n for n in numbers if self.frames is None or n in self.frames)
        return self.shard.part(chosen) if self.shard else chosen


def format_ranges(numbers: Iterable[int]) -> str:
    """Write numbers compactly: 1-4, 7; with negative ones -3..2, as -3-2 reads in two ways."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(_format_run(r[0], r[-1]) for r in runs)


def _format_run(first: int, last: int) -> str:
    return str(first) if first == last else f"{first}{'..' if first < 0 else '-'}{last}"
