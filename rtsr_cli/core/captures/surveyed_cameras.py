"""Cameras of a surveyed sequence: headers, side-car and capture.toml together."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.captures.camera_rows import CameraRow
from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.header_files import HeaderFiles
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.shots import FrameSet
from rtsr_cli.core.captures.surveyed import SurveyedValues
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import ExrHeader
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.camera_convention import StoredMatrices, matrices_to_memory
from rtsr_cli.core.frames.selection import format_ranges

WORLD_TO_CAMERA, WORLD_TO_NDC = "worldToCamera", "worldToNDC"
"""Standard OpenEXR attributes, row-vector matrices."""

MATRIX_RANK = 4
"""Of every camera matrix, an infinite far plane included."""

LARGEST_STORED_NUMBER = 1e30
"""Entries of matrices go so far; products of two stay finite."""


class CameraSource:
    """Cameras of frames; one that stands in brings its own camera and jitter along."""

    def __init__(
        self,
        reader: FrameReader,
        files: HeaderFiles,
        capture: CaptureDeclaration,
        side_car: Mapping[int, CameraRow],
        *,
        jittered: bool,
    ) -> None:
        """Remember what tells them."""
        self._reader, self._files = reader, files
        self._capture, self._side_car, self._jittered = capture, side_car, jittered
        self._sources = {n: reader.held.get(n, n) for n in reader.numbers}

    def survey(self, headers: Mapping[int, ExrHeader]) -> SurveyedValues[CameraMetadata]:
        """Read the cameras of all frames whose headers are there.

        Matrices that are none are taken for unknown, and the camera says why.

        Raises:
            FrameFolderError: a table has no entry for a frame.
        """
        frames = self._reader.frames
        there = {n: source for n, source in self._sources.items() if source in headers}
        if self._side_car:
            matrices = {n: _read_matrix(headers[n], WORLD_TO_CAMERA) for n in there.values()}
            bare = {n for n, matrix in matrices.items() if matrix is None}
            _check_table(frames, "camera", self._side_car, bare)
        _check_table(frames, "jitter_px", self._capture.jitter_px, set(self._sources.values()))
        cameras = {n: self._read(n, headers[source]) for n, source in there.items()}
        wrong = {n: self._drop(n, cameras[n], headers[there[n]]) for n in _find_impossible(cameras)}
        cameras.update(wrong)
        return SurveyedValues(cameras, self._sources.keys() - there.keys(), self._read_later)

    def list_cuts(self) -> frozenset[int]:
        """Frames of the whole sequence that are declared to begin anew."""
        cut = {n for n, row in self._side_car.items() if row.cut} | self._capture.camera_cuts
        return frozenset(n for n, source in self._sources.items() if source in cut)

    def _read(self, frame: int, header: ExrHeader) -> CameraMetadata:
        """Camera of a side-car's row, or of a header; in memory's convention."""
        number, capture = self._sources[frame], self._capture
        convention = capture.camera.matrices
        display = self._reader.display
        row = CameraMetadata()
        if number in self._side_car:
            row = self._side_car[number].metadata((display.height, display.width), convention)
        matrices = row.world_to_camera, row.world_to_ndc
        if matrices == (None, None):
            stored = StoredMatrices(
                view=_read_matrix(header, WORLD_TO_CAMERA), ndc=_read_matrix(header, WORLD_TO_NDC)
            )
            matrices = matrices_to_memory(stored, convention)
        declared = capture.jitter(number)
        jitter = row.jitter_px if declared is None else declared
        return CameraMetadata(
            world_to_camera=matrices[0],
            world_to_ndc=matrices[1],
            jitter_px=jitter if self._jittered else (0.0, 0.0),
            pre_exposure=row.pre_exposure,
            fault=_describe_half(*matrices) if matrices != (None, None) else row.fault,
            cut=row.cut or number in capture.camera_cuts,
            of_lens=row.of_lens,
        )

    def _read_later(self, number: int) -> CameraMetadata:
        header = self._files.of(self._reader.path(number))
        camera = self._read(number, header)
        return self._drop(number, camera, header) if _find_impossible({number: camera}) else camera

    def _drop(self, frame: int, camera: CameraMetadata, header: ExrHeader) -> CameraMetadata:
        """Take the matrices of a frame for unknown, and say what is wrong with them."""
        row = self._side_car.get(self._sources[frame])
        stored = {} if row is None else row.list_matrices()
        if not stored:
            read = {name: _read_matrix(header, name) for name in (WORLD_TO_CAMERA, WORLD_TO_NDC)}
            stored = {name: matrix for name, matrix in read.items() if matrix is not None}
        return replace(
            camera, world_to_camera=None, world_to_ndc=None, fault=_describe_fault(stored)
        )


def _check_table(frames: FrameSet, name: str, table: object, numbers: set[int]) -> None:
    """Raise where a table by frame leaves frames out: what stands in for them would be a guess."""
    lacking = numbers - set(table) if isinstance(table, Mapping) else set()
    if lacking:
        raise FrameFolderError(
            f"{frames.root}: capture.toml's {name} has no entry for frames "
            f"{format_ranges(lacking)}; add them"
        )


def _describe_half(view: Tensor | None, ndc: Tensor | None) -> str:
    """Say which half of a camera is not there; empty where both are."""
    if view is not None and ndc is None:
        return (
            "worldToCamera is there, the projection is not (worldToNDC, or in a side-car "
            "projection, or fov_x or fov_y with near)"
        )
    return "worldToNDC is there, worldToCamera is not" if view is None else ""


def _find_impossible(cameras: Mapping[int, CameraMetadata]) -> set[int]:
    """Frames of whose matrices one is none; all are looked at together."""
    named = [
        (number, matrix)
        for number, camera in cameras.items()
        for matrix in (camera.world_to_camera, camera.world_to_ndc)
        if matrix is not None
    ]
    if not named:
        return set()
    matrices = torch.stack([matrix for _, matrix in named])
    finite = (matrices.abs() <= LARGEST_STORED_NUMBER).flatten(1).all(1)
    known = torch.where(finite[:, None, None], matrices, torch.zeros_like(matrices))
    wrong = (torch.linalg.matrix_rank(known) < MATRIX_RANK).tolist()
    return {number for number, _ in itertools.compress(named, wrong)}


def _describe_fault(stored: Mapping[str, Tensor]) -> str:
    """Say which of the matrices of a frame, as they are stored, is none, and why."""
    for name, matrix in stored.items():
        strange = ~(matrix.abs() <= LARGEST_STORED_NUMBER)
        if bool(strange.any()):
            row, column = strange.nonzero()[0].tolist()
            cell = row * MATRIX_RANK + column + 1
            return f"cell {cell} (row {row + 1}, column {column + 1}) of {name} is no finite number"
        if int(torch.linalg.matrix_rank(matrix)) < MATRIX_RANK:
            return f"{name} is singular (it has no inverse)"
    return f"{' and '.join(stored)} make no camera together"


def _read_matrix(header: ExrHeader, name: str) -> Tensor | None:
    value = header.attributes.get(name)
    if not isinstance(value, np.ndarray) or value.shape != (4, 4):
        return None
    return torch.from_numpy(value.astype(np.float64))
