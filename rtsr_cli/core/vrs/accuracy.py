"""How well predicted tile errors agree with true ones, summed so that frames can be put together.

    R^2 = 1 - sum (p - y)^2 / sum (y - mean y)^2

of each rate on its own, then their mean: rates taken together differ so much that R^2 flatters.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass, fields

from rtsr_cli.core.shapes import Mask, TileMap

MIN_VARIANCE = 1e-4
"""Tiles whose true values vary less than this have no R^2: all of them are alike."""


@dataclass(frozen=True)
class AccuracyTally:
    """Sums over the tiles of one rate.

    Attributes:
        tiles: how many.
        true: of true values.
        true_squared: of their squares.
        squared: of (p - y)^2.
        absolute: of |p - y|.
        under: of max(0, y - p).
    """

    tiles: float = 0.0
    true: float = 0.0
    true_squared: float = 0.0
    squared: float = 0.0
    absolute: float = 0.0
    under: float = 0.0

    def __add__(self, other: AccuracyTally) -> AccuracyTally:
        """Both together."""
        return AccuracyTally(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    @property
    def determination(self) -> float | None:
        """R^2, None where the true values do not vary."""
        spread = self.true_squared - self.true**2 / max(self.tiles, 1.0)
        if spread < MIN_VARIANCE * self.tiles:
            return None
        return 1.0 - self.squared / spread


def tally_errors(predicted: TileMap, wanted: TileMap, chosen: Mask | None = None) -> AccuracyTally:
    """Sum up tiles, those where `chosen` is 1 or all; all arguments of one channel."""
    p, y = predicted.double(), wanted.double()
    weight = y.new_ones(1) if chosen is None else chosen.double()
    difference = p - y
    terms = (
        y.new_ones(1).expand_as(y),
        y,
        y.square(),
        difference.square(),
        difference.abs(),
        (-difference).clamp(min=0.0),
    )
    return AccuracyTally(*(float((term * weight).sum()) for term in terms))


def join_tallies(tallies: Iterable[Mapping[str, AccuracyTally]]) -> dict[str, AccuracyTally]:
    """Add up what was tallied under the same name."""
    total: dict[str, AccuracyTally] = {}
    for one in tallies:
        for name, value in one.items():
            total[name] = total.get(name, AccuracyTally()) + value
    return total


def average_accuracy(tallies: Mapping[str, AccuracyTally]) -> dict[str, float]:
    """`r2`, `mae`, `under`: of each rate, then the mean over rates.

    R^2 is 0, that of their mean, where no rate's true values vary.
    """
    known = [value for value in tallies.values() if value.tiles]
    if not known:
        return {}
    determined = [r2 for t in known if (r2 := t.determination) is not None]
    return {
        "r2": sum(determined) / len(determined) if determined else 0.0,
        "mae": sum(t.absolute / t.tiles for t in known) / len(known),
        "under": sum(t.under / t.tiles for t in known) / len(known),
    }


def tallies_from_plain(values: Mapping[str, Iterable[float]]) -> dict[str, AccuracyTally]:
    """Undo `tallies_to_plain`."""
    return {name: AccuracyTally(*numbers) for name, numbers in values.items()}


def tallies_to_plain(tallies: Mapping[str, AccuracyTally]) -> dict[str, list[float]]:
    """Lists of numbers in the order of the fields."""
    names = [field.name for field in fields(AccuracyTally)]
    return {name: [getattr(value, field) for field in names] for name, value in tallies.items()}
