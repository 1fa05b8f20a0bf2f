"""What the numbers of camera matrices say by themselves: affine, rigid, and a projection between.

Memory's projection P, worldToNDC = worldToCamera . P, has few entries: x and y of clip space are
scaled (P00, P11 > 0) and shifted (P20, P21), and w is the view depth (P23 = -1), or 1 where the
camera is orthographic.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

Matrix4 = NDArray[np.float64]

TOLERANCE = 2e-3
"""Largest entry that counts as 0 beside entries of 1: float32 matrices, multiplied, inverted."""

FAR_TOLERANCE = 2e-4
"""The same for each unit of the distance from the origin, in what translation adds to."""

LEAST_SCALE = 1e-12
"""Square of the smallest factor between units of world and camera."""


@dataclass(frozen=True, eq=False)
class CameraMatrices:
    """World to camera and world to clip space, 4x4 float64."""

    view: Matrix4
    ndc: Matrix4

    @cached_property
    def projection(self) -> Matrix4:
        """Camera to clip space; not a number where the view has no inverse."""
        try:
            projection: Matrix4 = np.linalg.inv(self.view) @ self.ndc
        except np.linalg.LinAlgError:
            return np.full((4, 4), np.nan)
        return projection

    @cached_property
    def digits(self) -> bytes:
        """The same for matrices that differ by rounding alone, as good as always."""
        return b"".join(
            (np.round(m / np.abs(m).max(), 5) + 0.0).tobytes() for m in (self.view, self.ndc)
        )


def _name_axes(order: tuple[int, ...], signs: tuple[float, ...]) -> Matrix4:
    matrix = np.zeros((4, 4))
    matrix[3, 3] = 1.0
    for row, (column, sign) in enumerate(zip(order, signs, strict=True)):
        matrix[row, column] = sign
    return matrix


SIGNED_AXES: tuple[Matrix4, ...] = tuple(
    _name_axes(order, signs)
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
)
"""Every way to name three axes, as 4x4 matrices; the first changes nothing."""


def find_view_fault(view: Matrix4) -> str:
    """Say why a matrix is not world to camera of row vectors; empty if it is."""
    if not np.isfinite(view).all():
        return "has numbers that are not finite"
    if np.abs(view[:, 3] - (0.0, 0.0, 0.0, 1.0)).max() > TOLERANCE:
        return "has a last column other than 0, 0, 0, 1"
    gram = view[:3, :3] @ view[:3, :3].T
    scale = float(gram.trace()) / 3.0
    if not scale > LEAST_SCALE or np.abs(gram / scale - np.eye(3)).max() > 10.0 * TOLERANCE:
        return "shears: its first three rows are not at right angles and of one length"
    return ""


def is_mirrored(view: Matrix4) -> bool:
    """Tell whether world and camera space are of different handedness."""
    return float(np.linalg.det(view[:3, :3])) < 0.0


def is_projection(p: Matrix4, reach: float) -> bool:
    """Tell whether a matrix is a projection of memory's camera space.

    Args:
        p: camera to clip space.
        reach: distance of the camera from the origin, which rounding grows with.
    """
    if not (p[0, 0] > 0.0 and p[1, 1] > 0.0 and np.isfinite(p).all()):
        return False
    far = TOLERANCE + FAR_TOLERANCE * reach
    across = max(
        np.abs(p[0, 1:]).max() / p[0, 0],
        np.abs(
            p[
                1,
                (0, 2, 3),
            ]
        ).max()
        / p[1, 1],
    )
    if across > 5.0 * TOLERANCE:
        return False
    perspective = (
        abs(p[2, 3] + 1.0) < 5.0 * TOLERANCE
        and np.abs(
            p[
                3,
                (0, 1, 3),
            ]
        ).max()
        < far
    )
    flat = (
        abs(p[3, 3] - 1.0) < far
        and np.abs(
            p[
                2,
                (0, 1, 3),
            ]
        ).max()
        < TOLERANCE
    )
    return bool(perspective or flat)


def measure_reach(view: Matrix4) -> float:
    """Distance of the camera from the origin, in its own units."""
    return float(np.abs(view[3, :3]).max())


def is_sound(matrices: CameraMatrices) -> bool:
    """Tell whether matrices can be a camera of memory's convention."""
    reach = measure_reach(matrices.view)
    return not find_view_fault(matrices.view) and is_projection(matrices.projection, reach)


def find_axes(matrices: CameraMatrices) -> Matrix4 | None:
    """Axes that make a projection of what leads from the camera to clip space.

    Returns the matrix A with p_memory = p_camera . A, or None where no axes do.
    """
    projection, reach = matrices.projection, measure_reach(matrices.view)
    return next((a for a in SIGNED_AXES if is_projection(a.T @ projection, reach)), None)


AXIS_NAMES: Mapping[str, str] = {
    "-x": "left",
    "+x": "right",
    "-y": "down",
    "+y": "up",
}


def describe_axes(axes: Matrix4) -> str:
    """Say how axes lie: "looks along +z, x left, y up".

    Args:
        axes: A of p_memory = p_camera . A; row i is where the camera's own axis i points.
    """
    names = {}
    for row, own in zip(axes[:3, :3].tolist(), "xyz", strict=True):
        column = [abs(entry) for entry in row].index(max(abs(entry) for entry in row))
        names[column] = own, row[column]
    looks = f"looks along {'-' if names[2][1] > 0 else '+'}{names[2][0]}"
    right, up = (
        f"{own} {AXIS_NAMES[('+' if sign > 0 else '-') + memory]}"
        for memory, (own, sign) in zip("xy", (names[0], names[1]), strict=True)
    )
    return f"{looks}, {right}, {up}"
