"""Surveying a sequence by its headers, so that what is wrong is said before work starts."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.captures.bound_channels import Binding
from rtsr_cli.core.captures.camera_rows import CameraRow
from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.color_tags import (
    describe_contradictions,
    find_foreign_tag,
    read_color_space,
)
from rtsr_cli.core.captures.frame_numbers import choose_numbers
from rtsr_cli.core.captures.header_files import HeaderFiles, Headers, read_headers
from rtsr_cli.core.captures.layers import bind_layers, list_luminance_layers, list_readable
from rtsr_cli.core.captures.layouts import Layout
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.regions import find_region, list_places
from rtsr_cli.core.captures.shots import FrameSet
from rtsr_cli.core.captures.surveyed import SurveyedValues
from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import ExrHeader
from rtsr_cli.core.files.provenance import is_predicted
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.camera_convention import StoredMatrices, matrices_to_memory
from rtsr_cli.core.frames.conventions import Conventions, SpecularWorkflow
from rtsr_cli.core.frames.selection import format_ranges

WORLD_TO_CAMERA, WORLD_TO_NDC = "worldToCamera", "worldToNDC"
"""Standard OpenEXR attributes, row-vector matrices."""

LUMINANCE_NOT_READ = (
    "pictures are stored as luminance and chroma (channels Y, RY, BY), which rtsr does not read; "
    "write them as R, G, B"
)

MATRIX_RANK = 4
"""Of every camera matrix, an infinite far plane included."""


def open_frames(
    frames: FrameSet,
    *,
    headers: Headers | None = None,
    files: HeaderFiles | None = None,
    layout: Layout | None,
    capture: CaptureDeclaration,
    side_car: Mapping[int, CameraRow],
    layer: str | None = None,
    on_missing: MissingPolicy = MissingPolicy.ERROR,
    wanted: frozenset[int] | None = None,
    jittered: bool = True,
) -> FrameReader:
    """Survey a sequence by its headers and bind its buffers.

    Args:
        frames: the files.
        headers: of those that are needed; of all if None.
        files: reads those that are asked for later.
        layout: that is named; the best match if None.
        capture: what the user declares.
        side_car: camera rows by frame number; their matrices replace the headers'.
        layer: layer or view that is read of files with several.
        on_missing: what to do about holes in the numbering.
        wanted: frames that are asked for; holes before and behind them are no matter.
        jittered: whether declared jitter applies to these frames (LR) or not (HR).

    Raises:
        FrameFolderError: no layout fits, a buffer or frame is missing, sizes differ, or a buffer is
            in several layers.
    """
    files = files or HeaderFiles()
    headers = headers if headers is not None else read_headers(frames, files)
    first = {key: next(iter(by_number.values())) for key, by_number in headers.items()}
    _check_usable(frames, first)
    bound = bind_layers(layout, capture, first, str(frames.root), layer)
    binding = bound.binding
    if capture.specular is SpecularWorkflow.F0:
        # base colour is then the diffuse colour already, and no metal takes from it
        binding = {b: c for b, c in binding.items() if b is not Buffer.METALLIC}
    used = sorted({c.stream for components in binding.values() for c in components})
    _check_channels(frames, headers, binding)
    numbers, held = choose_numbers(frames, used, capture.frame_step, on_missing, wanted)
    places = list_places({key: headers[key] for key in used}, binding)
    region = find_region(places, str(frames.root), capture.region)
    conventions, contradictions = _settle_colors(frames, headers, binding, capture, bound.layout)
    reader = FrameReader(
        frames=frames,
        layout=bound.layout,
        binding=binding,
        conventions=conventions,
        warnings=contradictions,
        region=region,
        places=tuple(places),
        numbers=numbers,
        held=held,
        cameras={},
        step=capture.frame_step,
        channels={key: {n: h.channels for n, h in by_n.items()} for key, by_n in headers.items()},
        subsampled={key: header.subsampled for key, header in first.items()},
        header_of=files.of,
        views={key: header.views for key, header in first.items()},
        layers=bound.layers,
        layer=bound.layer,
        matrices=capture.camera.matrices,
        notes=(*bound.notes, *_list_notes(first), *_list_unread(bound.layout, binding, first)),
    )
    main = headers[reader.main_stream]
    foreign_tag = _find_foreign_tag(reader, capture, headers)
    cameras = _CameraSource(reader, files, capture, side_car, jittered=jittered)
    predicted = {
        n for n in numbers if (h := main.get(held.get(n, n))) and is_predicted(h.attributes)
    }
    return replace(
        reader,
        cameras=cameras.survey(main),
        cuts=cameras.list_cuts(),
        foreign_tag=foreign_tag,
        predicted=frozenset(predicted),
    )


def _settle_colors(
    frames: FrameSet,
    headers: Headers,
    binding: Binding,
    capture: CaptureDeclaration,
    layout: Layout,
) -> tuple[Conventions, tuple[str, ...]]:
    """Conventions with the primaries that files name, and what contradicts how they are read."""
    conventions = capture.conventions(layout.conventions)
    if Buffer.COLOR not in binding:
        return conventions, ()
    by_number = headers[binding[Buffer.COLOR][0].stream]
    attributes = [header.attributes for header in by_number.values()]
    declared = conventions.colorspace is not None
    if not declared:
        space = read_color_space(attributes, str(frames.root))
        conventions = replace(conventions, colorspace=space)
    contradictions = describe_contradictions(attributes, conventions.colorspace, declared=declared)
    return conventions, contradictions


def _find_foreign_tag(reader: FrameReader, capture: CaptureDeclaration, headers: Headers) -> str:
    """Name the tag of radiance that is no space rtsr converts, if nothing is declared."""
    if capture.colorspace is not None or Buffer.COLOR not in reader.binding:
        return ""
    by_number = headers[reader.binding[Buffer.COLOR][0].stream]
    return find_foreign_tag(header.attributes for header in by_number.values())


class _CameraSource:
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


def _list_notes(first: Mapping[str, ExrHeader]) -> tuple[str, ...]:
    held = any(list_luminance_layers(header) for header in first.values())
    return (LUMINANCE_NOT_READ,) if held else ()


def _list_unread(layout: Layout, binding: Binding, first: Mapping[str, ExrHeader]) -> Iterator[str]:
    """Say of what a layout knows and does not read why that is so."""
    found = layout.list_unread({key: header.channels for key, header in first.items()})
    said = {
        unread.why: name for name, unread in reversed(found.items()) if unread.unless not in binding
    }
    yield from (f"'{name}' is not read: {why}" for why, name in said.items())


def _check_usable(frames: FrameSet, first: Mapping[str, ExrHeader]) -> None:
    if any(list_readable(header) for header in first.values()):
        return
    if any(list_luminance_layers(header) for header in first.values()):
        raise FrameFolderError(f"{frames.root}: {LUMINANCE_NOT_READ}")
    subsampled = sorted({c for header in first.values() for c in header.subsampled})
    raise FrameFolderError(
        f"{frames.root}: every channel ({', '.join(subsampled)}) is subsampled; write channels of "
        "the full size (R, G, B)"
    )


def _check_channels(frames: FrameSet, headers: Headers, binding: Binding) -> None:
    for buffer, components in binding.items():
        for c in components:
            by_number = headers[c.stream]
            lacking = [n for n, h in by_number.items() if c.channel not in h.channels]
            if lacking:
                raise FrameFolderError(
                    f"{frames.root}, frames {format_ranges(lacking)}: buffer '{buffer}' is missing "
                    f"(channel '{c.channel}' is in other frames of '{c.stream}'); "
                    "render these frames again, or move them out of the folder"
                )
            view = next(iter(by_number.values())).views.get(c.channel)
            others = [n for n, h in by_number.items() if h.views.get(c.channel) != view]
            if others:
                raise FrameFolderError(
                    f"{frames.root}, frames {format_ranges(others)}: buffer '{buffer}' (channel "
                    f"'{c.channel}') is of another view than in other frames; write all frames "
                    "with the same views"
                )


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
