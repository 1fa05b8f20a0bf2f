"""Frames of one resolution: surveyed by their headers first, then read into memory's convention."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.errors import FrameFolderError, RtsrError
from rtsr_cli.core.frames import conventions as conv
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.motion import MotionDirection, motion_to_pixels
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.io.capture import CameraRow, Capture, suggestion
from rtsr_cli.core.io.exr import ExrHeader, Plane, Window, read_channels, read_header
from rtsr_cli.core.io.layouts import LAYOUTS, Binding, BoundComponent, Layout, bind, detect
from rtsr_cli.core.io.shots import FrameSet

WORLD_TO_CAMERA, WORLD_TO_NDC = "worldToCamera", "worldToNDC"
"""Standard OpenEXR attributes, row-vector matrices."""

SURVEY_THREADS = 4


class MissingPolicy(StrEnum):
    """What a hole in the numbering means for the run."""

    ERROR = "error"
    SKIP = "skip"
    HOLD = "hold"


@dataclass(frozen=True, kw_only=True)
class FrameReader:
    """A surveyed sequence of frames of one resolution.

    Attributes:
        frames: the files.
        layout: how they are named.
        binding: where each buffer is.
        conventions: what is stored in them.
        region: pixels that are read, in the image plane `display`.
        display: the image plane.
        numbers: frames that can be read, ascending.
        held: number -> number of the frame that stands in for it.
        cameras: per frame, header and side-car and capture.toml together.
        step: numbers that one motion vector spans.
    """

    frames: FrameSet
    layout: Layout
    binding: Binding
    conventions: conv.Conventions
    region: Window
    display: Window
    numbers: tuple[int, ...]
    held: Mapping[int, int]
    cameras: Mapping[int, CameraMetadata]
    step: int

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) of every frame."""
        return self.region.height, self.region.width

    @property
    def stored(self) -> frozenset[Buffer]:
        """Buffers that the files hold."""
        return frozenset(self.binding)

    @property
    def has_camera(self) -> bool:
        """Tell whether every frame has camera matrices."""
        return all(
            camera.world_to_camera is not None and camera.world_to_ndc is not None
            for camera in self.cameras.values()
        )

    @property
    def resets(self) -> frozenset[int]:
        """Frames before which history ends: declared cuts, and stand-ins on both sides."""
        cuts = {n for n, camera in self.cameras.items() if camera.cut}
        return frozenset(cuts | set(self.held) | {n + self.step for n in self.held})

    @property
    def declaration(self) -> object:
        """What, beside the files' bytes, decides how they are understood; plain values."""
        return [self.layout.name, asdict(self.conventions), self.step, asdict(self.region)]

    def camera_values(self, number: int) -> object:
        """Return a frame's camera as plain values."""
        camera = self.cameras[number]
        matrices = (camera.world_to_camera, camera.world_to_ndc)
        listed = [None if m is None else m.flatten().tolist() for m in matrices]
        return [listed, camera.jitter_px, camera.pre_exposure, number in self.resets]

    @property
    def view(self) -> View:
        """Where the frames lie in the image plane."""
        return View(
            display=(self.display.height, self.display.width),
            top=self.region.top - self.display.top,
            left=self.region.left - self.display.left,
        )

    def where(self, number: int) -> str:
        """Folder and frame, for messages."""
        return f"{self.frames.root}, frame {number}"

    def path(self, number: int, stream: str | None = None) -> Path:
        """File of a frame; of the main stream if none is named."""
        files = self.frames.streams[stream or self.main_stream].files
        return files[self.held.get(number, number)]

    @property
    def main_stream(self) -> str:
        """The stream whose names and attributes outputs take: colour's, or the first bound."""
        first = next(iter(self.binding.values()))
        return self.binding.get(Buffer.COLOR, first)[0].stream

    @property
    def base(self) -> str:
        """Base name of the main stream."""
        return self.frames.streams[self.main_stream].base

    def files(self, number: int, buffers: Iterable[Buffer]) -> tuple[Path, ...]:
        """Files that hold the named buffers of a frame."""
        streams = {c.stream for b in buffers if b in self.binding for c in self.binding[b]}
        return tuple(self.path(number, stream) for stream in sorted(streams))

    def read(self, number: int, buffers: Collection[Buffer]) -> Frame:
        """Read the named buffers of a frame, converted to memory's convention.

        Raises:
            FrameFolderError: a file is damaged, or has changed since the survey.
        """
        planes = self._read_planes(number, buffers)
        camera = self.cameras[number]
        context = _Context(
            reader=self,
            camera=camera,
            jitter_prev=self.cameras.get(number - self.step, camera).jitter_px,
            where=self.where(number),
        )
        tensors = {
            buffer: _canonical(buffer, _stack(self.binding[buffer], planes), context)
            for buffer in buffers
        }
        return Frame(
            number=number,
            gbuffer=GBuffer(tensors, self.where(number)),
            camera=camera,
            view=self.view,
        )

    def _read_planes(
        self, number: int, buffers: Collection[Buffer]
    ) -> dict[tuple[str, str], Plane]:
        wanted: dict[str, set[str]] = defaultdict(set)
        for buffer in buffers:
            for component in self.binding[buffer]:
                wanted[component.stream].add(component.channel)
        planes: dict[tuple[str, str], Plane] = {}
        for stream, channels in wanted.items():
            path = self.path(number, stream)
            window = read_header(path).data_window
            for channel, plane in read_channels(path, channels).items():
                planes[stream, channel] = _place(plane, window, self.region)
        return planes


def _place(plane: Plane, window: Window, region: Window) -> Plane:
    """Move pixels from a file's data window to the region that is read; 0 where there are none."""
    if window == region:
        return plane
    placed = np.zeros((region.height, region.width), plane.dtype)
    top, left = max(window.top, region.top), max(window.left, region.left)
    bottom = min(window.top + window.height, region.top + region.height)
    right = min(window.left + window.width, region.left + region.width)
    if bottom > top and right > left:
        placed[top - region.top : bottom - region.top, left - region.left : right - region.left] = (
            plane[top - window.top : bottom - window.top, left - window.left : right - window.left]
        )
    return placed


def _stack(
    components: tuple[BoundComponent, ...], planes: Mapping[tuple[str, str], Plane]
) -> Tensor:
    """Channels of one buffer as 1 x c x h x w; whole numbers stay whole (32 bits)."""
    stored = [planes[c.stream, c.channel] for c in components]
    if len(stored) == 1 and stored[0].dtype == np.uint32:
        return torch.from_numpy(stored[0].view(np.int32))[None, None]
    return torch.stack(
        [
            (torch.from_numpy(plane.astype(np.float32)) - c.offset) * c.factor
            if c.offset or c.factor != 1.0
            else torch.from_numpy(plane.astype(np.float32))
            for plane, c in zip(stored, components, strict=True)
        ]
    )[None]


@dataclass(frozen=True, kw_only=True)
class _Context:
    reader: FrameReader
    camera: CameraMetadata
    jitter_prev: tuple[float, float]
    where: str


def _canonical(buffer: Buffer, stored: Tensor, context: _Context) -> Tensor:
    """Convert one buffer from its file's convention to memory's."""
    convert = _CONVERSIONS.get(buffer)
    return convert(stored, context) if convert else stored


def _depth(stored: Tensor, context: _Context) -> Tensor:
    reader = context.reader
    return conv.depth_to_metres(
        stored, reader.conventions.depth, context.camera, reader.view, context.where
    )


def _motion(stored: Tensor, context: _Context) -> Tensor:
    return motion_to_pixels(
        stored,
        context.reader.conventions.motion,
        jitter_px=context.camera.jitter_px,
        jitter_px_prev=context.jitter_prev,
    )


def _forward(stored: Tensor, context: _Context) -> Tensor:
    """Forward vectors lead to the next frame in every layout; only unit and axis can differ."""
    convention = replace(
        context.reader.conventions.motion,
        direction=MotionDirection.PREVIOUS_MINUS_CURRENT,
        jittered=False,
    )
    return motion_to_pixels(stored, convention)


def _object_id(stored: Tensor, _: _Context) -> Tensor:
    return stored if stored.dtype == torch.int32 else stored.round().to(torch.int32)


def _nonnegative(stored: Tensor, _: _Context) -> Tensor:
    return conv.nonnegative(stored)


def _unit_interval(stored: Tensor, _: _Context) -> Tensor:
    return stored.clamp(0.0, 1.0)


_CONVERSIONS: Mapping[Buffer, Any] = {
    Buffer.DEPTH: _depth,
    Buffer.MOTION: _motion,
    Buffer.FORWARD: _forward,
    Buffer.OBJECT_ID: _object_id,
    Buffer.ALBEDO: _nonnegative,
    Buffer.SPECULAR: _nonnegative,
    Buffer.MATERIAL: _nonnegative,
    Buffer.EMISSION: _nonnegative,
    Buffer.METALLIC: _unit_interval,
    Buffer.ROUGHNESS: lambda s, c: conv.roughness_to_perceptual(
        s.clamp(0.0, 1.0), c.reader.conventions.roughness
    ),
    Buffer.NORMAL: lambda s, c: conv.normal_to_world(
        s, c.reader.conventions.normal, c.camera, c.where
    ),
    Buffer.POSITION: lambda s, c: s * c.reader.conventions.depth.unit_m,
}


def layout_named(name: str) -> Layout:
    """Return a preset.

    Raises:
        FrameFolderError: there is no such preset; suggests one.
    """
    if name not in LAYOUTS:
        raise FrameFolderError(f"no layout is called '{name}'{suggestion(name, LAYOUTS)}")
    return LAYOUTS[name]


def open_frames(
    frames: FrameSet,
    *,
    layout: str | None,
    capture: Capture,
    side_car: Mapping[int, CameraRow],
    on_missing: MissingPolicy = MissingPolicy.ERROR,
    jittered: bool = True,
) -> FrameReader:
    """Survey a sequence by its headers and bind its buffers.

    Args:
        frames: the files.
        layout: name of a preset; capture.toml's, or the best match, if None.
        capture: what the user declares.
        side_car: camera rows by frame number, in place of the headers' matrices.
        on_missing: what to do about holes in the numbering.
        jittered: whether declared jitter applies to these frames (LR) or not (HR).

    Raises:
        FrameFolderError: no layout fits, a buffer or frame is missing, sizes differ.
    """
    headers = _survey(frames)
    first = {key: next(iter(by_number.values())) for key, by_number in headers.items()}
    streams = {key: header.channels - header.subsampled for key, header in first.items()}
    chosen, binding = _choose(layout or capture.layout, streams, str(frames.root))
    used = sorted({c.stream for components in binding.values() for c in components})
    _check_channels(frames, headers, binding)
    numbers, held = _numbers(frames, used, capture.frame_step, on_missing)
    region, display = _regions(frames, {key: headers[key] for key in used})
    reader = FrameReader(
        frames=frames,
        layout=chosen,
        binding=binding,
        conventions=capture.conventions(chosen.conventions),
        region=region,
        display=display,
        numbers=numbers,
        held=held,
        cameras={},
        step=capture.frame_step,
    )
    main = headers[reader.main_stream]
    cameras = {
        n: _camera(n, main[held.get(n, n)], capture, side_car, jittered=jittered) for n in numbers
    }
    return replace(reader, cameras=cameras)


def _survey(frames: FrameSet) -> dict[str, dict[int, ExrHeader]]:
    with ThreadPoolExecutor(SURVEY_THREADS) as pool:
        return {
            key: dict(zip(stream.files, pool.map(read_header, stream.files.values()), strict=True))
            for key, stream in frames.streams.items()
        }


def _choose(
    name: str | None, streams: Mapping[str, Collection[str]], where: str
) -> tuple[Layout, Binding]:
    try:
        if name is None:
            return detect(streams, LAYOUTS.values(), where)
        chosen = layout_named(name)
        binding = bind(chosen, streams)
    except RtsrError as error:
        prefix = "" if str(error).startswith(where) else f"{where}: "
        raise FrameFolderError(f"{prefix}{error}") from error
    if not binding:
        raise FrameFolderError(f"{where}: layout '{name}' matches no channel of these files")
    return chosen, binding


def _check_channels(
    frames: FrameSet, headers: Mapping[str, Mapping[int, ExrHeader]], binding: Binding
) -> None:
    for buffer, components in binding.items():
        for c in components:
            lacking = [n for n, h in headers[c.stream].items() if c.channel not in h.channels]
            if lacking:
                raise FrameFolderError(
                    f"{frames.root}, frames {ranges(lacking)}: buffer '{buffer}' is missing "
                    f"(channel '{c.channel}' is in other frames of '{c.stream}'); "
                    "render these frames again, or leave them out with --frames"
                )


def _numbers(
    frames: FrameSet, used: list[str], step: int, policy: MissingPolicy
) -> tuple[tuple[int, ...], dict[int, int]]:
    """Frames that every used stream has, and stand-ins for the others where they are held."""
    present = [frozenset(frames.streams[key].files) for key in used]
    union, complete = frozenset.union(*present), frozenset.intersection(*present)
    expected = range(min(union), max(union) + 1, step) if step else union
    missing = {
        key: sorted(set(expected) - files)
        for key, files in zip(used, present, strict=True)
        if set(expected) - files
    }
    if missing and policy is MissingPolicy.ERROR:
        listed = "; ".join(f"'{key}' lacks {ranges(m)}" for key, m in missing.items())
        raise FrameFolderError(
            f"{frames.root}: frames are missing: {listed}. Render them, or use --on-missing "
            "skip|hold (history restarts there); dumps numbered in steps declare frame_step"
        )
    held: dict[int, int] = {}
    if policy is MissingPolicy.HOLD:
        last = None
        for number in expected:
            last = number if number in complete else last
            if last is not None and last != number:
                held[number] = last
    return tuple(sorted(complete | set(held))), held


def ranges(numbers: Iterable[int]) -> str:
    """Write numbers compactly: 1-4, 7."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{r[0]}-{r[-1]}" if len(r) > 1 else str(r[0]) for r in runs)


def _regions(
    frames: FrameSet, headers: Mapping[str, Mapping[int, ExrHeader]]
) -> tuple[Window, Window]:
    """Return the pixels to read and the image plane, the same for every frame and stream."""
    displays: dict[Window, str] = {}
    data: set[Window] = set()
    for key, by_number in headers.items():
        for number, header in by_number.items():
            displays.setdefault(header.display_window, f"'{key}' frame {number}")
            data.add(header.data_window)
    if len({(w.width, w.height) for w in displays}) > 1:
        listed = ", ".join(f"{who} is {w.width} x {w.height}" for w, who in displays.items())
        raise FrameFolderError(
            f"{frames.root}: sizes differ: {listed}; all buffers and frames of one resolution "
            "need one size"
        )
    display = next(iter(displays))
    region = next(iter(data)) if len(data) == 1 else display
    return region, display


def _camera(
    number: int,
    header: ExrHeader,
    capture: Capture,
    side_car: Mapping[int, CameraRow],
    *,
    jittered: bool,
) -> CameraMetadata:
    if number in side_car:
        camera = side_car[number].metadata()
    else:
        camera = CameraMetadata(
            world_to_camera=_matrix(header, WORLD_TO_CAMERA),
            world_to_ndc=_matrix(header, WORLD_TO_NDC),
        )
    jitter = capture.jitter(number) if capture.jitter(number) is not None else camera.jitter_px
    return replace(
        camera,
        jitter_px=jitter if jittered and jitter is not None else (0.0, 0.0),
        cut=camera.cut or number in capture.camera_cuts,
    )


def _matrix(header: ExrHeader, name: str) -> Tensor | None:
    value = header.attributes.get(name)
    if not isinstance(value, np.ndarray) or value.shape != (4, 4):
        return None
    return torch.from_numpy(value.astype(np.float64))
