"""What headers tell of the frames that a run needs, and of others when they are asked for.

Of ten thousand frames a run over three of them opens a handful of files.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from typing import TypeVar

from rtsr_cli.core.frames.selection import Selection

T = TypeVar("T")


class SurveyedValues(Mapping[int, T]):
    """Values by frame number.

    It holds, counts and iterates over those of the frames that were surveyed; that of another frame
    is made when it is asked for.
    """

    def __init__(
        self, surveyed: Mapping[int, T], others: Collection[int], make: Callable[[int], T]
    ) -> None:
        """Start with what was surveyed.

        Args:
            surveyed: values by number.
            others: numbers that may be asked for, beside them.
            make: value of one of those.
        """
        self._surveyed = surveyed
        self._others = frozenset(others)
        self._make = make
        self._made: dict[int, T] = {}

    def __getitem__(self, number: int) -> T:
        """Return the value of a frame.

        Raises:
            KeyError: there is no such frame.
        """
        if number in self._surveyed or number not in self._others:
            return self._surveyed[number]
        if number not in self._made:
            self._made[number] = self._make(number)
        return self._made[number]

    def mapped(self, change: Callable[[T], T]) -> SurveyedValues[T]:
        """Return the same values, changed; those of other frames when they are asked for."""
        return self.numbered(lambda _, value: change(value))

    def numbered(self, change: Callable[[int, T], T]) -> SurveyedValues[T]:
        """Return the same values, changed by their number; of others when they are asked for."""
        surveyed = {number: change(number, value) for number, value in self._surveyed.items()}
        return SurveyedValues(surveyed, self._others, lambda number: change(number, self[number]))

    def __iter__(self) -> Iterator[int]:
        """Go through the surveyed numbers."""
        return iter(self._surveyed)

    def __len__(self) -> int:
        """Count the surveyed numbers."""
        return len(self._surveyed)


def list_needed(numbers: Collection[int], selection: Selection, step: int) -> Collection[int]:
    """Frames that a run over a selection may read: it looks back as far as it likes, ahead a step.

    Args:
        numbers: that there are.
        selection: frames whose outputs are wanted.
        step: numbers that one motion vector spans.
    """
    wanted = set() if selection.frames is None else selection.frames.intersection(numbers)
    if not wanted:
        return numbers
    last = max(wanted) + step
    return [number for number in numbers if number <= last]
