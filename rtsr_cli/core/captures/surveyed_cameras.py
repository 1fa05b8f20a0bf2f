"""Cameras of a surveyed sequence: headers, side-car and capture.toml together."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

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

        Raises:
            FrameFolderError: a frame has none where others have, or one that is no camera.
        """
        frames = self._reader.frames
        there = {n: source for n, source in self._sources.items() if source in headers}
        if self._side_car:
            matrices = {n: _read_matrix(headers[n], WORLD_TO_CAMERA) for n in there.values()}
            bare = {n for n, matrix in matrices.items() if matrix is None}
            _check_table(frames, "camera", self._side_car, bare)
        _check_table(frames, "jitter_px", self._capture.jitter_px, set(self._sources.values()))
        cameras = {n: self._read(n, headers[source]) for n, source in there.items()}
        _check_matrices(frames, cameras)
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
            cut=row.cut or number in capture.camera_cuts,
        )

    def _read_later(self, number: int) -> CameraMetadata:
        camera = self._read(number, self._files.of(self._reader.path(number)))
        _check_matrices(self._reader.frames, {number: camera})
        return camera


def _check_table(frames: FrameSet, name: str, table: object, numbers: set[int]) -> None:
    """Raise where a table by frame leaves frames out: what stands in for them would be a guess."""
    lacking = numbers - set(table) if isinstance(table, Mapping) else set()
    if lacking:
        raise FrameFolderError(
            f"{frames.root}: capture.toml's {name} has no entry for frames "
            f"{format_ranges(lacking)}; add them"
        )


def _check_matrices(frames: FrameSet, cameras: Mapping[int, CameraMetadata]) -> None:
    """Raise where a matrix of a camera is none; all are looked at together, frame by frame."""
    named = [
        (number, name, matrix)
        for number, camera in cameras.items()
        for name, matrix in (
            (WORLD_TO_CAMERA, camera.world_to_camera),
            (WORLD_TO_NDC, camera.world_to_ndc),
        )
        if matrix is not None
    ]
    if not named:
        return
    matrices = torch.stack([matrix for _, _, matrix in named])
    finite = torch.isfinite(matrices).flatten(1).all(1)
    ranks = torch.linalg.matrix_rank(matrices.nan_to_num(0.0, 0.0, 0.0))
    wrong = (~finite | (ranks < MATRIX_RANK)).tolist()
    for number, name, _ in itertools.compress(named, wrong):
        raise FrameFolderError(
            f"{frames.root}, frame {number}: {name} is not a camera matrix (it is "
            "singular or not finite); give the cameras in a side-car, "
            'capture.toml: camera = "camera.csv"'
        )


def _read_matrix(header: ExrHeader, name: str) -> Tensor | None:
    value = header.attributes.get(name)
    if not isinstance(value, np.ndarray) or value.shape != (4, 4):
        return None
    return torch.from_numpy(value.astype(np.float64))
