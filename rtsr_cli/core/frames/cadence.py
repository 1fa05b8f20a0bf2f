"""Which frames of a sequence are rendered, where the others are to be predicted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rtsr_cli.core.errors import RequestError

FIRST_EVERY = 2
"""Least distance of rendered frames: with 1 there would be nothing to predict."""


FULL_PAST = 3
"""Rendered frames that make a history full: those that ExtraNet reads (t-1, t-3, t-5)."""


@dataclass(frozen=True, kw_only=True)
class Cadence:
    """Which frames are rendered.

    Attributes:
        every: the first is, and every so many after it.
        rendered: numbers that are, in place of `every`.
    """

    every: int = FIRST_EVERY
    rendered: frozenset[int] | None = None

    def __post_init__(self) -> None:
        """Check the distance.

        Raises:
            RequestError: every frame is rendered.
        """
        if self.every < FIRST_EVERY:
            raise RequestError(
                f"--every {self.every}: every frame would be rendered, and none left to predict; "
                f"give {FIRST_EVERY} or more"
            )

    def list_rendered(self, numbers: Sequence[int], step: int) -> frozenset[int]:
        """Return those of a sequence's frames that are rendered.

        Counted by number, so that a gap shifts none.

        Args:
            numbers: of the frames, ascending.
            step: difference of two successive ones.
        """
        if self.rendered is not None:
            return self.rendered.intersection(numbers)
        return frozenset(n for n in numbers if (n - numbers[0]) // step % self.every == 0)


def count_past(runs: Sequence[Sequence[int]], rendered: frozenset[int]) -> dict[int, int]:
    """Return how many rendered frames lie before each frame of its run, `FULL_PAST` at most.

    Args:
        runs: of frames, between which history ends.
        rendered: frames that are.
    """
    past: dict[int, int] = {}
    for run in runs:
        count = 0
        for number in run:
            past[number] = min(FULL_PAST, count)
            count += number in rendered
    return past


def choose_cadence(every: int | None, rendered: frozenset[int] | None) -> Cadence:
    """Return the cadence of one way to say it, of `FIRST_EVERY` where neither is given.

    Raises:
        RequestError: every frame would be rendered, or both ways are given.
    """
    if every is not None and rendered is not None:
        raise RequestError("--every and --rendered both say which frames are rendered")
    return Cadence(every=FIRST_EVERY if every is None else every, rendered=rendered)


def measure_reach(numbers: Sequence[int], rendered: frozenset[int], *, past_frames: int = 1) -> int:
    """Return how many frames a predicted one looks back at most.

    Args:
        numbers: of the frames, ascending.
        rendered: those that are rendered.
        past_frames: how many rendered ones it is to reach, where there are so many.
    """
    before: list[int] = []
    reach = 0
    for place, number in enumerate(numbers):
        if number in rendered:
            before.append(place)
        elif before:
            reach = max(reach, place - before[-past_frames:][0])
    return reach
