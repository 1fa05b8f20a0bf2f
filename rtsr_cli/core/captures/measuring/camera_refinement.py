"""Cameras a little beside those given: turned, shifted, or of another lens.

    V' = V T(q),   C' = V' P(q)

with V, C = V P the matrices as given and q eight small numbers that all frames share: a turn of
the camera about its axes (radians), a shift along them (shares of the usual distance), and
logarithms of both focal lengths. What is seen leaves residuals r(q); the q under which their sum
of lengths is least is found by Gauss-Newton steps of reweighted least squares:

    q <- q - (J' W J + R)^-1 J' W r,   W = 1 / |r|,   J = dr / dq

Rounding, filters and movers leave residuals that no other camera explains; where one far beside
the given one explains nearly all of them, that one is seen. So nothing has to be known of how
exactly a renderer wrote its buffers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rtsr_cli.core.captures.measuring.camera_hypotheses import Cameras
from rtsr_cli.core.captures.measuring.camera_structure import CameraMatrices, Matrix4

Residuals = Mapping[int, Tensor]
"""By frame, n x k: what is seen less what matrices say; rows that are not known are NaN."""

Measure = Callable[[Cameras], Residuals]

Numbers = NDArray[np.float64]

TURN, SHIFT, LENS, ALL = slice(0, 3), slice(3, 6), slice(6, 8), slice(0, 8)
"""Of the eight numbers."""

STEPS = 4
"""Steps after which the least sum does not move any more."""

SETTLED = 1e-4
"""Change of the numbers below which nothing is left to find."""

PROBE = 2e-3
"""Change of each number by which residuals are differentiated."""

RIDGE = 1e-5
"""R, a share of the number that is seen best: what cannot be seen stays 0."""

FARTHEST = 0.15
"""Largest of the numbers that counts as beside the matrices as given."""

MOST_ROWS, LEAST_ROWS = 2048, 64
"""Residuals of a frame that are looked at; and of all frames, fewer tell nothing."""

FAR_BETTER = 3.0
"""How many times smaller the residuals of a camera beside are where it is the right one."""

LEAST_BESIDE_PX = 0.6
"""Pixels by which that one shows a resting picture moved at least: samples may be anywhere in
their pixels, and a renderer may count its pixels from their middles."""

LEAST_BESIDE = 3e-3
"""The numbers that count at least: 0.17 degrees, 0.3 %."""

LEAST_SAID = 1e-3
"""Smaller residuals are of the last digits, and said as none."""

TOLD = 2.0
"""Degrees of turns, and per cent of lenses, which is no more than half of it, that are tried where
nothing disagrees: what moves nothing by that is not told."""


@dataclass(frozen=True)
class Beside:
    """A camera beside the one as given.

    Attributes:
        numbers: q.
        own, left: medians of the residuals' lengths by the matrices as given, and by it.
        unit: of these.
        distance: that shifts are shares of, in units of the camera.
    """

    numbers: Numbers
    own: float
    left: float
    unit: str
    distance: float

    def describe(self) -> str:
        """Say what the matrices as given look like, and by what."""
        parts = " and ".join(_list_parts(self.numbers, self.distance))
        left = 0.0 if self.left < LEAST_SAID else self.left
        return (
            f"{parts} (off by {self.own:.2g} {self.unit} with the matrices as given, "
            f"by {left:.2g} with that camera)"
        )


def move_camera(given: CameraMatrices, numbers: Numbers, distance: float) -> CameraMatrices:
    """The camera that is beside the one as given by these numbers.

    Args:
        given: V and C.
        numbers: q.
        distance: that shifts are shares of.
    """
    view = given.view @ _move(numbers[TURN], numbers[SHIFT] * distance)
    projection = given.projection.copy()
    projection[0, 0] *= math.exp(numbers[6])
    projection[1, 1] *= math.exp(numbers[7])
    return CameraMatrices(view, view @ projection)


def _move(turn: Numbers, shift: Numbers) -> Matrix4:
    """Turn row vectors about an axis by its length, and shift them."""
    angle = float(np.linalg.norm(turn))
    x, y, z = turn / angle if angle else turn
    cross = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    moved = np.eye(4)
    moved[:3, :3] += math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    moved[3, :3] = shift
    return moved


@dataclass(frozen=True, kw_only=True)
class NearbyView:
    """What is needed to hold one kind of evidence against cameras beside the given ones.

    Attributes:
        measure: residuals of matrices.
        given: the matrices.
        unit: what residuals are measured in.
        distance: usual depth of what is seen, in units of the camera.
        width: of the frames in pixels.
        floor: median length of residuals that digits alone may leave.
        others: residuals under other readings of depth, which a camera beside would explain nearly.
    """

    measure: Measure
    given: Cameras
    unit: str
    distance: float = 1.0
    width: int = 1
    floor: float = 0.0
    others: Sequence[Measure] = ()

    def look(self, numbers: Numbers) -> Tensor | None:
        """Residuals of all frames by the cameras beside, n x k; None where there are none."""
        cameras = {n: move_camera(m, numbers, self.distance) for n, m in self.given.items()}
        return _gather(self.measure(cameras))

    @property
    def focal_px(self) -> float:
        """Mean focal length, pixels."""
        lenses = [abs(m.projection[0, 0]) for m in self.given.values()]
        return 0.5 * self.width * float(np.mean(lenses))


def find_beside(view: NearbyView) -> Beside | None:
    """The camera beside the matrices as given that explains what these leave; None if none does."""
    own = view.look(np.zeros(8))
    if own is None or _measure_size(own) <= view.floor:
        return None
    for measure in view.others:
        other = replace(view, measure=measure)
        rows = other.look(np.zeros(8))
        if rows is not None and _measure_size(rows) < _measure_size(own):
            view, own = other, rows
    found = _try_free(view, own, ALL)
    if found is None:
        return None
    # fewer numbers that explain as much are what was meant
    tried = (_try_free(view, own, free) for free in (TURN, LENS, SHIFT))
    simple = min((one for one in tried if one is not None), key=lambda b: b.left, default=found)
    return simple if simple.left <= max(FAR_BETTER * found.left, LEAST_SAID) else found


def _try_free(view: NearbyView, own: Tensor, free: slice) -> Beside | None:
    """The camera beside the given ones of which some numbers are free; None if it is none."""
    numbers = _refine(view.look, own, range(8)[free])
    best = None if numbers is None else view.look(numbers)
    if numbers is None or best is None or best.shape != own.shape:
        return None
    sizes = _measure_size(own), _measure_size(best)
    found = Beside(numbers, *sizes, view.unit, view.distance)
    counts = _is_beside(numbers, view.focal_px)
    return found if counts and found.left * FAR_BETTER < found.own else None


TURNS = ("pitch", "yaw", "roll")
"""About x, y and z of the camera."""

OF_LENS = "lens"

PROBES: Mapping[str, Numbers] = {
    **{name: math.radians(TOLD) * np.eye(8)[index] for index, name in enumerate(TURNS)},
    OF_LENS: 0.015 * TOLD * np.array([0.0] * 6 + [1.0, 1.0]),
}
"""Cameras beside that are told from right ones, or said not to be."""


def say_untold(told: Collection[str]) -> Iterator[str]:
    """Say what matrices may be off by though they agree with all that is seen.

    Args:
        told: keys of `PROBES` that something tells.
    """
    turns = [name for name in TURNS if name not in told]
    if turns:
        yield f"turned by {TOLD:g} degrees ({', '.join(turns)})"
    if OF_LENS not in told:
        yield f"of a lens {1.5 * TOLD:g} % longer"


def list_told(view: NearbyView) -> set[str]:
    """Keys of `PROBES` that would leave far more than the matrices as given do."""
    own = view.look(np.zeros(8))
    if own is None:
        return set()
    least = max(FAR_BETTER * _measure_size(own), view.floor)
    return {
        name
        for name, numbers in PROBES.items()
        if (rows := view.look(numbers)) is not None
        and rows.shape == own.shape
        and _measure_size(rows - own) > least
    }


def _refine(
    look: Callable[[Numbers], Tensor | None], start: Tensor, free: Sequence[int]
) -> Numbers | None:
    """The numbers that leave least, of which some are free; None where residuals are too few."""
    numbers, rows = np.zeros(8), start
    for _ in range(STEPS):
        columns = []
        for index in free:
            changed = look(numbers + PROBE * np.eye(8)[index])
            if changed is None or changed.shape != rows.shape:
                return None
            columns.append((changed - rows) / PROBE)
        step = _solve(rows, torch.stack(columns, -1))
        if step is None:
            return None
        numbers[list(free)] -= step
        numbers = np.clip(numbers, -FARTHEST, FARTHEST)
        moved = look(numbers)
        if moved is None or moved.shape != rows.shape:
            return None
        rows = moved
        if float(np.abs(step).max()) < SETTLED:
            break
    return numbers


def _solve(rows: Tensor, slopes: Tensor) -> Numbers | None:
    """One step of least squares, each residual weighed by its length; None where they are few.

    Args:
        rows: residuals, n x k.
        slopes: their derivatives, n x k x m.
    """
    known = torch.isfinite(rows).all(1) & torch.isfinite(slopes).flatten(1).all(1)
    if int(known.sum()) < LEAST_ROWS:
        return None
    left, slope = rows[known], slopes[known]
    length = left.norm(dim=1)
    weight = 1.0 / length.clamp(min=max(0.1 * float(length.median()), 1e-12))
    normal = torch.einsum("nki,n,nkj->ij", slope, weight, slope)
    side = torch.einsum("nki,n,nk->i", slope, weight, left)
    ridge = RIDGE * float(normal.diagonal().max()) + 1e-30
    return np.linalg.solve(normal.numpy() + ridge * np.eye(len(side)), side.numpy())


def _gather(residuals: Residuals) -> Tensor | None:
    """Residuals of all frames, n x k; None where there are none."""
    rows = [keep_rows(part).double() for part in residuals.values()]
    return torch.cat(rows) if rows else None


def keep_rows(rows: Tensor) -> Tensor:
    """Every k-th row of a frame, so that at most about `MOST_ROWS` are left."""
    return rows[:: max(1, len(rows) // MOST_ROWS)]


def _measure_size(rows: Tensor) -> float:
    """Median length; residuals that are not known are the largest."""
    lengths = rows.norm(dim=1)
    return float(torch.where(torch.isfinite(lengths), lengths, torch.inf).median())


def _is_beside(numbers: Numbers, focal_px: float) -> bool:
    """Tell whether a camera shows another picture: not one whose samples lie otherwise alone."""
    far = np.abs(numbers) > max(LEAST_BESIDE, LEAST_BESIDE_PX / focal_px)
    return bool(far.any())


def _list_parts(numbers: Numbers, distance: float) -> Iterator[str]:
    """Say each of the numbers that counts beside the largest."""
    least = max(LEAST_BESIDE, 0.1 * float(np.abs(numbers).max()))
    turns = [
        f"{math.degrees(abs(q)):.1f} degrees ({name})"
        for q, name in zip(numbers[TURN], TURNS, strict=True)
        if abs(q) > least
    ]
    if turns:
        yield f"turned by {', '.join(turns)}"
    shifts = [
        f"{abs(q) * distance:.2g} along {axis}"
        for q, axis in zip(numbers[SHIFT], "xyz", strict=True)
        if abs(q) > least
    ]
    if shifts:
        yield f"moved by {', '.join(shifts)}"
    lens = numbers[LENS]
    if np.abs(lens).max() > least:
        each = " and ".join(f"{100.0 * (math.exp(-q) - 1.0):+.1f} %" for q in dict.fromkeys(lens))
        yield f"of another focal length ({each})"
