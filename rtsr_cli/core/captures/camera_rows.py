"""One row of a camera side-car: its columns, the spellings of their names, and its matrices."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Annotated, Any, Self

import torch
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, model_validator
from torch import Tensor

from rtsr_cli.core.captures.capture_file import JitterPx, refuse_truth
from rtsr_cli.core.captures.nss_cameras import INFINITE_FAR, make_perspective
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.camera_convention import (
    CameraConvention,
    StoredMatrices,
    invert_matrix,
    matrices_to_memory,
)
from rtsr_cli.core.limits import LARGEST_FACTOR, LARGEST_FRAME, SMALLEST_FACTOR
from rtsr_cli.core.shapes import Size

ROW, CELLS = 4, 16
"""Numbers of a matrix."""

MATRIX_COLUMNS = ("worldToCamera", "cameraToWorld", "worldToNDC", "projection")

SPELLINGS: Mapping[str, tuple[str, ...]] = {
    "frame": ("frameNumber",),
    "worldToCamera": ("view", "viewMatrix", "worldToView"),
    "cameraToWorld": ("viewToWorld", "inverseView", "toWorld", "matrixWorld"),
    "worldToNDC": ("worldToNdc", "viewProjection", "viewProj", "worldToClip"),
    "projection": ("projectionMatrix", "cameraToNDC", "cameraToNdc", "cameraToClip"),
    "fov_x": ("fovX", "horizontalFov", "hfov"),
    "fov_y": ("fovY", "verticalFov", "vfov"),
    "near": ("nearPlane", "nearClip"),
    "far": ("farPlane", "farClip"),
    "width": (),
    "height": (),
    "jitter_px": ("jitterPx",),
    "pre_exposure": ("preExposure",),
    "cut": ("cameraCut",),
}
"""Columns, and what else they are called: as written here, `with_underscores`, and `Capital`."""


def _list_spellings(column: str) -> set[str]:
    names = {column, *SPELLINGS[column]}
    names |= {re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower() for name in names}
    return names | {name[0].upper() + name[1:] for name in names}


KNOWN_NAMES: Mapping[str, str] = {
    name: column for column in SPELLINGS for name in _list_spellings(column)
}
"""Spelling -> column."""


def _flatten_numbers(value: object) -> object:
    """Let a cell of a CSV, or a nested list, be a flat list of numbers."""
    if isinstance(value, str):
        return value.replace(",", " ").replace(";", " ").split()
    if isinstance(value, list | tuple) and any(isinstance(row, list | tuple) for row in value):
        if not all(isinstance(row, list | tuple) for row in value):
            raise ValueError("holds rows and numbers mixed")
        return [number for row in value for number in row]
    return value


def _check_numbers(value: object, info: ValidationInfo) -> object:
    """Hold a matrix to sixteen numbers; whether they make a camera is the survey's to say.

    Raises:
        ValueError: says the frame, and which cell is wrong.
    """
    where = f"frame {info.data['frame']}: " if "frame" in info.data else ""
    flattened = _flatten_numbers(value)
    flat = flattened if isinstance(flattened, list | tuple) else ()
    if len(flat) != CELLS:
        raise ValueError(f"{where}holds {len(flat)} numbers; a matrix is {CELLS}, row by row")
    return _read_all(flat) or [_read_number(cell, i, where) for i, cell in enumerate(flat)]


def _read_all(cells: Sequence[object]) -> list[float] | None:
    """Numbers of cells; None where one is none, which `_read_number` names."""
    try:
        return [*map(float, cells)]  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return None


def _read_number(cell: object, index: int, where: str) -> float:
    try:
        return float(cell)  # type: ignore[arg-type]
    except OverflowError:
        return math.inf
    except (TypeError, ValueError) as error:
        row, column = divmod(index, ROW)
        raise ValueError(
            f"{where}cell {index + 1} (row {row + 1}, column {column + 1}) is no number"
        ) from error


Matrix = Annotated[list[float], BeforeValidator(_check_numbers)]

Degrees = Annotated[float, Field(gt=0.0, lt=180.0), BeforeValidator(refuse_truth)]

Metres = Annotated[
    float, Field(gt=SMALLEST_FACTOR, le=LARGEST_FACTOR), BeforeValidator(refuse_truth)
]

Side = Annotated[int, Field(ge=1, le=LARGEST_FRAME), BeforeValidator(refuse_truth)]


class CameraRow(BaseModel):
    """One frame of a camera side-car, as written; matrices are 16 numbers, row by row."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    frame: Annotated[int, Field(ge=-LARGEST_FRAME, le=LARGEST_FRAME), BeforeValidator(refuse_truth)]
    world_to_camera: Matrix | None = Field(default=None, alias="worldToCamera")
    camera_to_world: Matrix | None = Field(default=None, alias="cameraToWorld")
    world_to_ndc: Matrix | None = Field(default=None, alias="worldToNDC")
    projection: Matrix | None = None
    fov_x: Degrees | None = None
    fov_y: Degrees | None = None
    near: Metres | None = None
    far: Metres | None = None
    width: Side | None = None
    height: Side | None = None
    jitter_px: Annotated[JitterPx, BeforeValidator(_flatten_numbers)] | None = None
    pre_exposure: Annotated[float, BeforeValidator(refuse_truth)] = Field(
        default=1.0, ge=SMALLEST_FACTOR, le=LARGEST_FACTOR
    )
    cut: bool = False
    fault: str = ""

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        where = f"frame {self.frame}: "
        if self.world_to_camera is not None and self.camera_to_world is not None:
            raise ValueError(f"{where}give worldToCamera or cameraToWorld, not both")
        angles = self.fov_x is not None or self.fov_y is not None
        if angles and self.near is None:
            raise ValueError(f"{where}fields of view need the column 'near' (metres) beside them")
        if self.near is not None and self.far is not None and self.far <= self.near:
            raise ValueError(f"{where}'far' has to lie beyond 'near'")
        if (self.width is None) != (self.height is None):
            raise ValueError(f"{where}give width and height, or neither")
        return self

    @property
    def is_placed(self) -> bool:
        """Tell whether it says where the camera is."""
        return self.world_to_camera is not None or self.camera_to_world is not None

    def list_matrices(self) -> dict[str, Tensor]:
        """Matrices as written, by the names of their columns."""
        stored = self.world_to_camera, self.camera_to_world, self.world_to_ndc, self.projection
        made = zip(MATRIX_COLUMNS, map(make_matrix, stored), strict=True)
        return {column: matrix for column, matrix in made if matrix is not None}

    def metadata(
        self, size: Size | None = None, convention: CameraConvention | None = None
    ) -> CameraMetadata:
        """The row as camera metadata, in memory's convention.

        Args:
            size: (height, width) of the picture, where the row names none.
            convention: how the matrices are stored.
        """
        view = make_matrix(self.world_to_camera)
        if self.camera_to_world is not None:
            view = invert_matrix(torch.tensor(self.camera_to_world).double().view(ROW, ROW))
        matrices = StoredMatrices(
            view=view,
            ndc=make_matrix(self.world_to_ndc),
            projection=make_matrix(self.projection),
            lens=self._make_lens(size),
        )
        view, ndc = matrices_to_memory(matrices, convention or CameraConvention())
        return CameraMetadata(
            world_to_camera=view,
            world_to_ndc=ndc,
            jitter_px=self.jitter_px or (0.0, 0.0),
            pre_exposure=self.pre_exposure,
            cut=self.cut,
            fault=self.fault,
            of_lens=ndc is not None and matrices.lens is not None and not self._names_clip_space,
        )

    @property
    def _names_clip_space(self) -> bool:
        return self.world_to_ndc is not None or self.projection is not None

    def _make_lens(self, size: Size | None) -> Tensor | None:
        """Perspective of one field of view or both; the other one follows from the size."""
        if self.near is None or (self.fov_x is None and self.fov_y is None):
            return None
        height, width = size or (1, 1)
        aspect = (self.width or width) / (self.height or height)
        half_x = math.tan(math.radians(self.fov_x or 0.0) / 2.0)
        half_y = math.tan(math.radians(self.fov_y or 0.0) / 2.0)
        projection = make_perspective(
            2.0 * math.atan(half_x or half_y * aspect),
            2.0 * math.atan(half_y or half_x / aspect),
            self.near,
            INFINITE_FAR if self.far is None else self.far,
            reversed_depth=False,
        )
        return torch.from_numpy(projection)


def make_matrix(values: list[float] | None) -> Tensor | None:
    """Sixteen numbers as a matrix."""
    return None if values is None else torch.tensor(values, dtype=torch.float64).view(ROW, ROW)


def unify_names(row: Mapping[Any, Any]) -> dict[Any, Any]:
    """Call the columns of a row by one name each, and join the sixteen columns of a matrix.

    Raises:
        ValueError: a column is there twice, in two spellings.
    """
    named: dict[Any, Any] = {}
    spelled: dict[Any, object] = {}
    for name, value in _join_cells(row).items():
        column = KNOWN_NAMES.get(name, name) if isinstance(name, str) else name
        if column in named:
            raise ValueError(f"'{spelled[column]}' and '{name}' are the same column")
        named[column], spelled[column] = value, name
    return named


def _join_cells(row: Mapping[Any, Any]) -> dict[Any, Any]:
    """Columns NAME_0 .. NAME_15, or NAME_00 .. NAME_33 (row, column), as one of NAME."""
    joined = dict(row)
    # most rows have none, and there may be thousands of rows
    for first in joined.keys() & _SPREAD_MATRICES.keys():
        name, cells = _SPREAD_MATRICES[first]
        if all(cell in joined for cell in cells):
            joined[name] = [joined.pop(cell) for cell in cells]
    return joined


_INDICES = tuple(str(i) for i in range(CELLS))
_PLACES = tuple(f"{i}{j}" for i, j in product(range(ROW), repeat=2))

_SPREAD_MATRICES = {
    f"{name}_{cells[0]}": (name, [f"{name}_{cell}" for cell in cells])
    for name, column in KNOWN_NAMES.items()
    if column in MATRIX_COLUMNS
    for cells in (_INDICES, _PLACES)
}
"""First column of a matrix in sixteen -> the matrix' name, and all of them."""
