"""Camera side-cars of Arm's NSS captures: `<clip>.json`, an object a clip, a row a frame.

Taken: `Frame` (or `FrameNumber`, which its Unreal exporter writes), `FovX` and `FovY` (radians),
`CameraNearPlane` and `CameraFarPlane` (metres, -1 = infinite), `ViewProjection`, `Jitter` (pixels
of the LR frame), `CameraCut`, and the clip's `ReverseZ`. `Exposure` is a display factor that is
*not* applied to the stored radiance, so that pre-exposure stays 1.

**Jitter** is taken as sample position minus pixel centre, x right, y down, which is memory's own
sense: Arm's Unreal exporter samples its capture at `pixel + 0.5 + Jitter`.

**Matrices.** 16 numbers, nested or flat, are said to be column-major; exporters differ in whether
vectors are rows or columns. The projection P follows from fields of view and planes, and the view
is V = ViewProjection . P^-1, which is affine for one reading only: that one is taken.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import AliasChoices, BaseModel, BeforeValidator, ConfigDict, Field

Matrix4 = NDArray[np.float64]

INFINITE_FAR = -1.0
"""Far plane that stands for none."""

MAX_AFFINE_ERROR = 0.05
"""Largest entry by which a view may differ from an affine one: float32 of a world 10 km wide."""


def _flat(value: object) -> object:
    if isinstance(value, list) and value and isinstance(value[0], list):
        return [number for row in value for number in row]
    return value


class _Liberal(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class NssOffset(_Liberal):
    """A pair of numbers."""

    x: float = Field(alias="X")
    y: float = Field(alias="Y")


class NssFrame(_Liberal):
    """One frame of a clip."""

    frame: int = Field(validation_alias=AliasChoices("Frame", "FrameNumber"))
    fov_x: float = Field(alias="FovX", gt=0.0, lt=math.pi)
    fov_y: float = Field(alias="FovY", gt=0.0, lt=math.pi)
    near: float = Field(alias="CameraNearPlane", gt=0.0)
    far: float = Field(default=INFINITE_FAR, alias="CameraFarPlane")
    view_projection: Annotated[
        list[float], Field(min_length=16, max_length=16), BeforeValidator(_flat)
    ] = Field(alias="ViewProjection")
    jitter: NssOffset = Field(alias="Jitter")
    cut: bool = Field(default=False, alias="CameraCut")

    def row(self) -> dict[str, Any]:
        """The frame as a row of a camera side-car.

        Raises:
            ValueError: ViewProjection does not fit fields of view and planes.
        """
        view, projection = _view_and_projection(self)
        return {
            "frame": self.frame,
            "worldToCamera": view.flatten().tolist(),
            "worldToNDC": (view @ projection).flatten().tolist(),
            "jitter_px": (self.jitter.x, self.jitter.y),
            "cut": self.cut,
        }


class NssClip(_Liberal):
    """What a clip's side-car says."""

    frames: list[NssFrame] = Field(alias="Frames")
    reverse_z: bool = Field(default=False, alias="ReverseZ")


def is_nss(content: object) -> bool:
    """Tell whether parsed JSON is such a side-car."""
    return isinstance(content, Mapping) and "Frames" in content


def perspective(
    fov_x: float, fov_y: float, near: float, far: float, *, reversed_depth: bool
) -> Matrix4:
    """Projection of memory's camera space (looking along -z), row vectors, w = view depth.

    Depth in the buffer is 0 at `near` and 1 at `far` (-1: infinity), or the reverse:
        d = A + B / depth,   A = far / (far - near),  B = -near A     (A = 1 for no far plane)
    """
    a = 1.0 if far <= 0.0 else far / (far - near)
    b = -near * a
    if reversed_depth:
        a, b = 1.0 - a, -b
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = 1.0 / math.tan(fov_x / 2.0), 1.0 / math.tan(fov_y / 2.0)
    matrix[2, 2], matrix[2, 3], matrix[3, 2] = -a, -1.0, b
    return matrix


def _view_and_projection(frame: NssFrame) -> tuple[Matrix4, Matrix4]:
    stored = np.array(frame.view_projection).reshape(4, 4)
    readings = []
    for combined, reversed_depth in product((stored, stored.T), (False, True)):
        projection = perspective(
            frame.fov_x, frame.fov_y, frame.near, frame.far, reversed_depth=reversed_depth
        )
        view = combined @ np.linalg.inv(projection)
        error = float(np.abs(view[:, 3] - (0.0, 0.0, 0.0, 1.0)).max())
        readings.append((error, view, projection))
    error, view, projection = min(readings, key=lambda reading: reading[0])
    if not error <= MAX_AFFINE_ERROR:
        raise ValueError(
            f"frame {frame.frame}: ViewProjection does not fit FovX, FovY, CameraNearPlane and "
            "CameraFarPlane (metres, radians)"
        )
    view[:, 3] = (0.0, 0.0, 0.0, 1.0)
    return view, projection
