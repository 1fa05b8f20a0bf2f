"""How files store camera matrices, and their conversion to the one convention in memory.

In memory: row vectors, `p_cam = [x y z 1] . world_to_camera`; x right, y up, looking along -z.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum

import torch
from torch import Tensor


class CameraWord(StrEnum):
    """What may be declared of camera matrices; one of each group at most.

    Order of the numbers: row or column vectors. Axes of camera space: `opengl` (x right, y up,
    looks along -z), `opencv` (x right, y down, along +z), `mitsuba` (x left, y up, along +z),
    `directx` (x right, y up, along +z), `unreal` (along +x, y right, z up). `camera-to-world`: the
    inverse of worldToCamera is stored. `ndc-y-down`: y of NDC grows from top to bottom.
    """

    ROW_VECTORS = "row-vectors"
    COLUMN_VECTORS = "column-vectors"
    OPENGL = "opengl"
    OPENCV = "opencv"
    MITSUBA = "mitsuba"
    DIRECTX = "directx"
    UNREAL = "unreal"
    CAMERA_TO_WORLD = "camera-to-world"
    NDC_Y_DOWN = "ndc-y-down"


ORDERS = frozenset({CameraWord.ROW_VECTORS, CameraWord.COLUMN_VECTORS})

AXES: Mapping[CameraWord, tuple[tuple[float, ...], ...]] = {
    CameraWord.OPENGL: ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    CameraWord.OPENCV: ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
    CameraWord.MITSUBA: ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    CameraWord.DIRECTX: ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    CameraWord.UNREAL: ((0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
}
"""Camera space as stored to memory's, row vectors: p_memory = p_stored . A."""


@dataclass(frozen=True, kw_only=True)
class CameraConvention:
    """How files store camera matrices; the default is the convention in memory.

    Attributes:
        words: what is declared, at most one order and one kind of axes.
    """

    words: frozenset[CameraWord] = frozenset()

    def __post_init__(self) -> None:
        """Hold the words to fit together.

        Raises:
            ValueError: two of them say the same thing differently.
        """
        for group in (ORDERS, AXES.keys()):
            chosen = sorted(self.words & group)
            if len(chosen) > 1:
                raise ValueError(f"{' and '.join(chosen)} exclude each other")

    @property
    def columns(self) -> bool:
        """Whether matrices act on column vectors."""
        return CameraWord.COLUMN_VECTORS in self.words

    @property
    def axes(self) -> CameraWord:
        """The axes of camera space."""
        return next(iter(self.words & AXES.keys()), CameraWord.OPENGL)

    def __str__(self) -> str:
        """Name the words, as they are declared."""
        return ", ".join(word for word in CameraWord if word in self.words)


@dataclass(frozen=True, kw_only=True)
class StoredMatrices:
    """Camera matrices of one frame as a file has them; None where it has none.

    Attributes:
        view: world to camera.
        ndc: world to clip space.
        projection: camera to clip space, of the file's own camera axes.
        lens: camera to clip space made of angles, of memory's axes.
    """

    view: Tensor | None = None
    ndc: Tensor | None = None
    projection: Tensor | None = None
    lens: Tensor | None = None


def widen(rotation: Iterable[Iterable[float]]) -> Tensor:
    """A 3x3 matrix as a 4x4 one."""
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, :3] = torch.tensor([list(row) for row in rotation], dtype=torch.float64)
    return matrix


def invert_matrix(matrix: Tensor) -> Tensor:
    """Inverse of a matrix; NaN throughout where it has none, which no camera has."""
    inverse, failed = torch.linalg.inv_ex(matrix)
    return torch.full_like(matrix, torch.nan) if bool(failed) else inverse


def matrices_to_memory(
    stored: StoredMatrices, convention: CameraConvention
) -> tuple[Tensor | None, Tensor | None]:
    """Return worldToCamera and worldToNDC of memory's convention.

    Where clip space is not given, it follows: worldToNDC = worldToCamera . projection.
    """

    def ordered(matrix: Tensor | None) -> Tensor | None:
        return matrix.T.contiguous() if matrix is not None and convention.columns else matrix

    view, ndc, projection = (ordered(m) for m in (stored.view, stored.ndc, stored.projection))
    if view is not None and CameraWord.CAMERA_TO_WORLD in convention.words:
        view = invert_matrix(view)
    if view is not None and ndc is None and projection is not None:
        ndc = view @ projection
    if ndc is not None and CameraWord.NDC_Y_DOWN in convention.words:
        ndc = ndc @ torch.diag(torch.tensor([1.0, -1.0, 1.0, 1.0], dtype=ndc.dtype))
    if view is not None and convention.axes is not CameraWord.OPENGL:
        view = view @ widen(AXES[convention.axes])
    if view is not None and ndc is None and stored.lens is not None:
        ndc = view @ stored.lens
    return view, ndc
