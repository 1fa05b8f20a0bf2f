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
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AliasChoices,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    model_validator,
)

from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.limits import LARGEST_FACTOR

Matrix4 = NDArray[np.float64]

PLANES = ("NearPlane", "FarPlane")
"""What older data sets, and those for frame generation, have once a clip."""

INFINITE_FAR = -1.0
"""Far plane that stands for none."""

NO_FAR_PLANE = 1e-9
"""Smaller slopes of device depth are rounding: near / far of a plane that is not there."""

SPECIFICATION = "1.0.1"
"""Version of the specification that is written."""

MAX_AFFINE_ERROR = 0.05
"""Largest entry by which a view may differ from an affine one: float32 of a world 10 km wide."""


UNFIT_MATRIX = (
    "ViewProjection does not fit FovX, FovY, CameraNearPlane and CameraFarPlane (metres, radians)"
)
"""What is wrong with matrices that make no camera."""


def _flatten(value: object) -> object:
    if isinstance(value, list) and value and isinstance(value[0], list):
        return [number for row in value for number in row]
    return value


class _Liberal(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class NssOffset(_Liberal):
    """A pair of numbers."""

    x: float = Field(alias="X", allow_inf_nan=False, strict=True)
    y: float = Field(alias="Y", allow_inf_nan=False, strict=True)


class NssFrame(_Liberal):
    """One frame of a clip."""

    frame: int = Field(strict=True, validation_alias=AliasChoices("Frame", "FrameNumber"))
    fov_x: float = Field(alias="FovX", gt=0.0, lt=math.pi, strict=True)
    fov_y: float = Field(alias="FovY", gt=0.0, lt=math.pi, strict=True)
    near: float = Field(alias="CameraNearPlane", gt=1 / LARGEST_FACTOR, le=LARGEST_FACTOR)
    far: float = Field(
        default=INFINITE_FAR, alias="CameraFarPlane", ge=INFINITE_FAR, le=LARGEST_FACTOR
    )
    view_projection: Annotated[
        list[float],
        Field(min_length=16, max_length=16),
        BeforeValidator(_flatten),
    ] = Field(alias="ViewProjection")
    jitter: NssOffset = Field(alias="Jitter")
    cut: bool = Field(default=False, alias="CameraCut")

    def row(self) -> dict[str, Any]:
        """The frame as a row of a camera side-car; without matrices where they do not fit."""
        row = {
            "frame": self.frame,
            "jitter_px": (self.jitter.x, self.jitter.y),
            "cut": self.cut,
        }
        found = _view_and_projection(self)
        if found is None:
            return {**row, "fault": UNFIT_MATRIX}
        view, projection = found
        return {
            **row,
            "worldToCamera": view.flatten().tolist(),
            "worldToNDC": (view @ projection).flatten().tolist(),
        }


class NssClip(_Liberal):
    """What a clip's side-car says."""

    frames: list[NssFrame] = Field(alias="Frames")
    reverse_z: bool = Field(default=False, alias="ReverseZ")

    @model_validator(mode="before")
    @classmethod
    def _hand_down_planes(cls, content: Any) -> Any:
        """Planes that a clip has once are those of its frames that have none."""
        frames = content.get("Frames") if isinstance(content, Mapping) else None
        if not isinstance(frames, list):
            return content
        common = {f"Camera{name}": content[name] for name in PLANES if name in content}
        return {
            **content,
            "Frames": [{**common, **f} if isinstance(f, Mapping) else f for f in frames],
        }


def is_nss_content(content: object) -> bool:
    """Tell whether parsed JSON is such a side-car."""
    return isinstance(content, Mapping) and "Frames" in content


def make_perspective(
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


def _view_and_projection(frame: NssFrame) -> tuple[Matrix4, Matrix4] | None:
    """Matrices of a frame; None where ViewProjection fits no reading."""
    stored = np.array(frame.view_projection).reshape(4, 4)
    readings = []
    for combined, reversed_depth in product((stored, stored.T), (False, True)):
        projection = make_perspective(
            frame.fov_x, frame.fov_y, frame.near, frame.far, reversed_depth=reversed_depth
        )
        view = combined @ np.linalg.inv(projection)
        error = float(np.abs(view[:, 3] - (0.0, 0.0, 0.0, 1.0)).max())
        readings.append((error, view, projection))
    error, view, projection = min(readings, key=lambda reading: reading[0])
    if not error <= MAX_AFFINE_ERROR:
        return None
    view[:, 3] = (0.0, 0.0, 0.0, 1.0)
    return view, projection


def write_clip_json(
    frames: Sequence[Frame], *, scale: int, fps: int, reversed_depth: bool
) -> dict[str, Any]:
    """Return a clip's side-car, strictly as the specification has it.

    Raises:
        ValueError: there is no frame, or one has no perspective camera.
    """
    if not frames:
        raise ValueError("there are no frames")
    height, width = frames[0].view.display
    return {
        "Version": SPECIFICATION,
        "EmulatedFramerate": fps,
        "TargetResolution": {"X": width * scale, "Y": height * scale},
        "Samples": {"Sequence": "Unknown", "Count": len(frames), "Quantized": False},
        "Frames": [_write_frame_json(frame) for frame in frames],
        "ReverseZ": reversed_depth,
        "UpscalingRatiosIndices": {f"x{scale}_index": 0},
    }


def _write_frame_json(frame: Frame) -> dict[str, Any]:
    camera, (height, width) = frame.camera, frame.view.display
    if camera.projection is None or camera.world_to_ndc is None:
        raise ValueError(f"frame {frame.number} has no camera matrices")
    p = camera.projection.numpy()
    near, far = _find_depth_planes(p)
    return {
        "Frame": frame.number,
        "FovX": 2.0 * math.atan(1.0 / p[0, 0]),
        "FovY": 2.0 * math.atan(1.0 / p[1, 1]),
        "CameraNearPlane": near,
        "CameraFarPlane": far,
        # column-major: of the matrix that acts on columns, which is this one read by rows
        "ViewProjection": camera.world_to_ndc.flatten().tolist(),
        "Jitter": {"X": camera.jitter_px[0], "Y": camera.jitter_px[1]},
        "NormalizedPerRatioJitter": [
            {"X": camera.jitter_px[0] / width, "Y": camera.jitter_px[1] / height}
        ],
        "Exposure": 1.0,
        "CameraCut": camera.cut,
    }


def _find_depth_planes(p: Matrix4) -> tuple[float, float]:
    """Near and far plane (-1: none) of a projection with d = -P22 + P32 / depth.

    d is 0 and 1 on the planes, whichever is which: depths P32 / P22 and P32 / (1 + P22).
    """
    a, b = -float(p[2, 2]), float(p[3, 2])
    limits = (a, a - 1.0)
    near, far = sorted(-b / x if abs(x) > NO_FAR_PLANE else math.inf for x in limits)
    return near, far if math.isfinite(far) else INFINITE_FAR
