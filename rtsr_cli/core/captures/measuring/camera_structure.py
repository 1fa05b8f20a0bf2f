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

Matrices = NDArray[np.float64]
"""Any number of 4x4 matrices, in the last two dimensions."""

Flags = NDArray[np.bool_]
"""One for each matrix."""

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

    def equals(self, other: CameraMatrices) -> bool:
        """Tell whether these are the very same numbers: a camera that moves changes some."""
        return np.array_equal(self.view, other.view) and np.array_equal(self.ndc, other.ndc)

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


def are_affine(views: Matrices) -> Flags:
    """Tell of which matrices the last column is 0, 0, 0, 1."""
    return np.asarray(np.abs(views[..., :, 3] - (0.0, 0.0, 0.0, 1.0)).max(-1) <= TOLERANCE)


def are_rigid(views: Matrices) -> Flags:
    """Tell of which matrices the first three rows are at right angles and of one length."""
    axes = views[..., :3, :3]
    gram = axes @ axes.swapaxes(-1, -2)
    scale = gram.trace(axis1=-2, axis2=-1)[..., None, None] / 3.0
    unit = gram / np.where(scale > LEAST_SCALE, scale, np.nan)
    return np.asarray(np.abs(unit - np.eye(3)).max((-1, -2)) <= 10.0 * TOLERANCE)


def find_view_fault(view: Matrix4) -> str:
    """Say why a matrix is not world to camera of row vectors; empty if it is."""
    if not np.isfinite(view).all():
        return "has numbers that are not finite"
    if not are_affine(view):
        return "has a last column other than 0, 0, 0, 1"
    if not are_rigid(view):
        return "shears: its first three rows are not at right angles and of one length"
    return ""


def are_mirrored(views: Matrices) -> Flags:
    """Tell of which matrices world and camera space are of different handedness."""
    return np.asarray(np.linalg.det(views[..., :3, :3]) < 0.0)


def are_projections(projections: Matrices, reach: NDArray[np.float64]) -> Flags:
    """Tell which matrices are projections of memory's camera space.

    Args:
        projections: camera to clip space.
        reach: distances of the cameras from the origin, which rounding grows with.
    """
    p = np.moveaxis(projections, (-2, -1), (0, 1))
    off = np.abs(p)
    with np.errstate(invalid="ignore", divide="ignore"):
        across = np.maximum(off[0, 1:].max(0) / p[0, 0], off[1, (0, 2, 3)].max(0) / p[1, 1])
    far = TOLERANCE + FAR_TOLERANCE * reach
    perspective = (np.abs(p[2, 3] + 1.0) < 5.0 * TOLERANCE) & (off[3, (0, 1, 3)].max(0) < far)
    flat = (np.abs(p[3, 3] - 1.0) < far) & (off[2, (0, 1, 3)].max(0) < TOLERANCE)
    scaled = (p[0, 0] > 0.0) & (p[1, 1] > 0.0) & np.isfinite(projections).all((-1, -2))
    return np.asarray(scaled & (across <= 5.0 * TOLERANCE) & (perspective | flat))


def measure_reach(views: Matrices) -> NDArray[np.float64]:
    """Distance of each camera from the origin, in its own units."""
    return np.asarray(np.abs(views[..., 3, :3]).max(-1))


def is_sound(matrices: CameraMatrices) -> bool:
    """Tell whether matrices can be a camera of memory's convention."""
    reach = measure_reach(matrices.view)
    fits = not find_view_fault(matrices.view)
    return fits and bool(are_projections(matrices.projection, reach))


def find_axes(matrices: CameraMatrices) -> Matrix4 | None:
    """Axes that make a projection of what leads from the camera to clip space.

    Returns the matrix A with p_memory = p_camera . A, or None where no axes do.
    """
    projection, reach = matrices.projection, measure_reach(matrices.view)
    return next((a for a in SIGNED_AXES if are_projections(a.T @ projection, reach)), None)


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
