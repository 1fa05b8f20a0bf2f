"""Reading frames of one resolution into memory's convention."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.captures.bound_channels import Binding, BoundChannel
from rtsr_cli.core.captures.computed_buffers import compute_buffer
from rtsr_cli.core.captures.layouts import Layout
from rtsr_cli.core.captures.pixel_places import clear_outside, find_common, place_pixels
from rtsr_cli.core.captures.regions import FilePlaces
from rtsr_cli.core.captures.sample_channels import (
    Samples,
    count_samples,
    join_samples_into,
)
from rtsr_cli.core.captures.shots import FrameSet
from rtsr_cli.core.captures.surveyed import SurveyedValues
from rtsr_cli.core.files.exr import ExrHeader, Plane, read_header, read_pixels
from rtsr_cli.core.files.pixel_window import PixelWindow
from rtsr_cli.core.frames import conventions as conv
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, VECTOR_BUFFERS, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.camera_convention import CameraConvention
from rtsr_cli.core.frames.camera_needs import UnmetNeed, describe_faults, find_unmet_needs
from rtsr_cli.core.frames.sequence import Frame

FLOAT_BYTES = 4

_Place = tuple[str, str]
"""A file sequence and a channel of it."""

_NOTHING = {Buffer.DEPTH: SKY_DEPTH_M}
"""What a buffer is in memory where no file has pixels; 0 if it is not named here."""


class MotionSource(Protocol):
    """Vectors that are not read from a frame's own files."""

    @property
    def note(self) -> str:
        """Say where the vectors come from."""

    def files(self, number: int) -> Iterable[Path]:
        """Files that a frame's vectors are read from."""

    def read(self, number: int) -> Tensor:
        """Read a frame's vectors, in memory's convention."""


@dataclass(frozen=True, kw_only=True)
class FrameReader:
    """A surveyed sequence of frames of one resolution.

    Attributes:
        frames: the files.
        layout: how they are named.
        binding: where each buffer is.
        conventions: what is stored in them.
        region: pixels that are read, seen from the image plane's first pixel.
        places: where in the image plane the files' pixels lie.
        numbers: frames that can be read, ascending.
        held: number -> number of the frame that stands in for it.
        cameras: per frame, header and side-car and capture.toml together.
        foreign_tag: what files call the space of their radiance, if rtsr does not know it.
        cuts: frames before which history is declared to end.
        step: numbers that one motion vector spans.
        filter_width_px: standard deviation of the pixel filter that went over radiance, pixels, as
            declared; None if it is not.
        channels: names of the channels of every file, by sequence and number.
        subsampled: by sequence, channels with fewer samples than pixels.
        header_of: reads the header of a file.
        predicted: frames whose files say that a system predicted them.
        warnings, notes: what was found out about the files, for the user.
        motion_undecided: why vectors cannot be read, with the choices; empty if they can.
        undecided: why nothing but radiance can be read, empty if the rest can.
        matrices: how the files store camera matrices; `cameras` are in memory's convention.
        camera_unfit: why camera matrices are not used; empty if they are.
        camera_unfit_singly: whether that is so for those of single frames.
        camera_certain: whether what the frames show proves them.
        camera_doubt: what the frames show that does not agree with them; empty if nothing does.
        faulty: buffers in which something is wrong in frames that were looked at.
        contradicted: buffers that what the frames show speaks against -> why; they are not read.
        motion_trusted: whether vectors are read as declared or measured, and nothing contradicts.
        motion_distrust: what would make vectors relied upon that are not; empty if unknown.
        jitter_trusted: whether nothing contradicts the jitter that is declared.
        views: by sequence, channel -> the stereo view that it belongs to.
        layers: names of the layers and views of the files; empty where they name none.
        layer: the one that is read.
        lent_motion: vectors of another resolution, in place of those that there are none of.
        lacking: buffer -> frames whose files do not hold it: radiance where they were not rendered,
            and buffers that are therefore not bound.
        partial: those of them that are not bound since some frames lack them, rendered or not.
        partial_said: the warnings of those.
        samples: where each sample of a pixel is, of buffers whose channels hold a sample each;
            `binding` has what stands for the pixel.
        sample_fault: why samples cannot be read; empty if they can, or there are none.
    """

    frames: FrameSet
    layout: Layout
    binding: Binding
    conventions: conv.Conventions
    region: PixelWindow
    places: tuple[FilePlaces, ...]
    numbers: tuple[int, ...]
    held: Mapping[int, int]
    cameras: Mapping[int, CameraMetadata]
    step: int
    channels: Mapping[str, Mapping[int, frozenset[str]]]
    subsampled: Mapping[str, frozenset[str]]
    filter_width_px: float | None = None
    header_of: Callable[[Path], ExrHeader] = read_header
    foreign_tag: str = ""
    cuts: frozenset[int] = frozenset()
    predicted: frozenset[int] = frozenset()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    motion_undecided: str = ""
    undecided: str = ""
    matrices: CameraConvention = field(default_factory=CameraConvention)
    camera_unfit: str = ""
    camera_unfit_singly: bool = False
    camera_certain: bool = False
    camera_doubt: str = ""
    faulty: frozenset[Buffer] = frozenset()
    contradicted: Mapping[Buffer, str] = field(default_factory=dict)
    motion_trusted: bool = False
    motion_distrust: str = ""
    jitter_trusted: bool = True
    views: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    layers: tuple[str, ...] = ()
    layer: str = ""
    lent_motion: MotionSource | None = None
    lacking: Mapping[Buffer, frozenset[int]] = field(default_factory=dict)
    partial: Mapping[Buffer, frozenset[int]] = field(default_factory=dict)
    partial_said: tuple[str, ...] = ()
    samples: Samples = field(default_factory=dict)
    sample_fault: str = ""

    @property
    def display(self) -> PixelWindow:
        """The image plane, as the first file has it."""
        return self.places[0].display

    @property
    def fills_region(self) -> bool:
        """Tell whether every file has every pixel that is read."""
        return all(place.holds(self.region) for file in self.places for place in file.places)

    def without_matrices(self, reason: str) -> FrameReader:
        """Return a reader that takes all cameras for unknown, and says why."""

        def drop(camera: CameraMetadata) -> CameraMetadata:
            return replace(camera, world_to_camera=None, world_to_ndc=None)

        cameras = self.cameras
        bare = (
            cameras.mapped(drop)
            if isinstance(cameras, SurveyedValues)
            else {number: drop(camera) for number, camera in cameras.items()}
        )
        return replace(self, cameras=bare, camera_unfit=reason)

    def with_matrices_of(self, other: FrameReader, numbers: Collection[int] | None) -> FrameReader:
        """Return a reader that takes the matrices of another resolution, whose camera is the same.

        Jitter, exposure and cuts stay its own.

        Args:
            other: of the same frames.
            numbers: those in which that is so; None for all that the other one has matrices of.
        """

        def lend(number: int, camera: CameraMetadata) -> CameraMetadata:
            lender = other.cameras.get(number, camera)
            if not lender.has_matrices or (numbers is not None and number not in numbers):
                return camera
            return replace(
                camera,
                world_to_camera=lender.world_to_camera,
                world_to_ndc=lender.world_to_ndc,
                fault="",
                of_lens=lender.of_lens,
            )

        cameras = self.cameras
        taken = (
            cameras.numbered(lend)
            if isinstance(cameras, SurveyedValues)
            else {number: lend(number, camera) for number, camera in cameras.items()}
        )
        return replace(self, cameras=taken, camera_unfit="", camera_unfit_singly=False)

    def list_sample_readers(self) -> tuple[FrameReader, ...]:
        """Return a reader of each sample of a pixel; of what has none, the pixel's own value."""
        held = {b: several for b, several in self.samples.items() if b in self.binding}
        return tuple(
            replace(self, binding={**self.binding, **{b: s[i] for b, s in held.items()}})
            for i in range(count_samples(held))
        )

    def narrowed(self, numbers: Iterable[int]) -> FrameReader:
        """Return a reader of what the files of some frames all have pixels for, if anything."""
        numbers = tuple(numbers)
        channels = {
            (number, c.stream, c.channel)
            for number in numbers
            for buffer in self.stored_in([number])
            for c in self.binding[buffer]
        }
        headers = {
            (number, stream): self.header_of(self.path(number, stream))
            for number, stream in {(number, stream) for number, stream, _ in channels}
        }
        places = [headers[n, stream].place_of(channel) for n, stream, channel in channels]
        common = find_common(self.region, places)
        return self if common is None else replace(self, region=common)

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) of every frame."""
        return self.region.height, self.region.width

    @property
    def frame_bytes(self) -> int:
        """Memory that reading a frame takes: its channels as float32, and as stored."""
        channels = sum(max(len(bound), len(bound.components)) for bound in self.binding.values())
        return self.region.width * self.region.height * channels * 2 * FLOAT_BYTES

    @cached_property
    def stored(self) -> frozenset[Buffer]:
        """Buffers that the files hold."""
        return frozenset(self.binding)

    @property
    def unrendered(self) -> frozenset[int]:
        """Frames that were surveyed and hold no radiance, where others do."""
        return self.lacking.get(Buffer.COLOR, frozenset())

    def stored_in(self, numbers: Iterable[int]) -> frozenset[Buffer]:
        """Buffers that the files of some frames all hold."""
        sources = {self.held.get(number, number) for number in numbers}
        return frozenset(b for b in self.binding if sources.isdisjoint(self.lacking.get(b, ())))

    def list_lacking(
        self, numbers: Collection[int], buffers: Collection[Buffer]
    ) -> dict[Buffer, tuple[int, ...]]:
        """Return which frames lack a buffer that is read of them, and of what marks their sky."""
        needed = self._needed(tuple(buffers))
        sources = {n: self.held.get(n, n) for n in numbers}
        found = {
            b: tuple(
                sorted(n for n, source in sources.items() if source in self.lacking.get(b, ()))
            )
            for b in needed
        }
        return {buffer: without for buffer, without in found.items() if without}

    @cached_property
    def readable(self) -> frozenset[Buffer]:
        """Buffers that are known how to read, in every frame that was surveyed."""
        if self.undecided:
            return self.stored & {Buffer.COLOR, Buffer.ALPHA}
        undecided = VECTOR_BUFFERS if self.motion_undecided else ()
        lent = {Buffer.MOTION} if self.lent_motion is not None else set[Buffer]()
        return self.stored.difference(undecided, self.unmet, self.contradicted) | lent

    @cached_property
    def unmet(self) -> Mapping[Buffer, UnmetNeed]:
        """Buffers whose conversion lacks the camera of a frame that was surveyed."""
        unmet = find_unmet_needs(self.conventions, self.stored, self.cameras)
        if self.has_rays_by_positions:
            unmet = {buffer: need for buffer, need in unmet.items() if buffer is not Buffer.DEPTH}
        if (
            Buffer.NORMAL in unmet
            and Buffer.DEPTH in self.stored
            and self._sky_marker is Buffer.NORMAL
        ):
            return {Buffer.DEPTH: unmet[Buffer.NORMAL], **unmet}
        return unmet

    @cached_property
    def has_rays_by_positions(self) -> bool:
        """Tell whether ray distances become planar by world positions: no camera tells how."""
        depth = self.conventions.depth
        return (
            depth.kind is conv.DepthKind.RAY
            and not depth.from_near
            and self.stored >= {Buffer.DEPTH, Buffer.POSITION}
            and not self.has_camera
        )

    @cached_property
    def without_camera(self) -> tuple[int, ...]:
        """Frames that were surveyed and whose camera matrices nothing tells."""
        return tuple(n for n, camera in self.cameras.items() if not camera.has_matrices)

    @cached_property
    def camera_faults(self) -> str:
        """Frames whose files hold matrices that are none, and why; empty if there are none."""
        return describe_faults(self.cameras)

    @cached_property
    def has_matrices(self) -> bool:
        """Tell whether any frame that was surveyed has camera matrices, used or not."""
        return bool(self.camera_unfit) or len(self.without_camera) < len(self.cameras)

    @cached_property
    def has_camera(self) -> bool:
        """Tell whether every frame that was surveyed has camera matrices."""
        return not self.without_camera

    @cached_property
    def resets(self) -> frozenset[int]:
        """Frames before which history ends: cuts, stand-ins on both sides, and lost vectors."""
        lost = {n for n in self.numbers if self._motion_number(n) is None}
        return frozenset(self.cuts | lost | set(self.held) | {n + self.step for n in self.held})

    def _motion_number(self, number: int) -> int | None:
        """Number of the file that holds a frame's vectors; None where the sequence ends before."""
        offset = self.conventions.motion.file_offset
        if not offset or Buffer.MOTION not in self.binding:
            return number
        other = number + offset * self.step
        return other if other in self._with_own_files else None

    @cached_property
    def _with_own_files(self) -> frozenset[int]:
        """Frames that no other one stands in for."""
        return frozenset(self.numbers) - set(self.held)

    @property
    def declaration(self) -> object:
        """What, beside the files' bytes, decides how they are understood; plain values."""
        whole = join_samples_into(self.binding, self.samples)
        places = {b.value: bound.list_values() for b, bound in whole.items()}
        return [places, asdict(self.conventions), self.step, asdict(self.region)]

    def camera_values(self, number: int) -> object:
        """Return a frame's camera as plain values."""
        camera = self.cameras[number]
        matrices = (camera.world_to_camera, camera.world_to_ndc)
        listed = [None if m is None else m.flatten().tolist() for m in matrices]
        return [listed, camera.jitter_px, camera.pre_exposure, number in self.resets]

    @cached_property
    def view(self) -> View:
        """Where the frames lie in the image plane."""
        return View(
            display=(self.display.height, self.display.width),
            top=self.region.top,
            left=self.region.left,
        )

    def where(self, number: int) -> str:
        """Folder and frame, for messages."""
        return f"{self.frames.root}, frame {number}"

    def path(self, number: int, stream: str | None = None) -> Path:
        """File of a frame; of the main stream if none is named, or of the first that has one."""
        source = self.held.get(number, number)
        files = self.frames.streams[stream or self.main_stream].files
        if stream is None and source not in files:
            bound = (c.stream for parts in self.binding.values() for c in parts)
            held = (self.frames.streams[key].files for key in bound)
            files = next(other for other in held if source in other)
        return files[source]

    def named_like(self, number: int) -> Path:
        """File that says how an output of a frame is called: the main stream's, if it has one."""
        files = self.frames.streams[self.main_stream].files
        return files.get(self.held.get(number, number)) or next(iter(files.values()))

    def channels_of(self, number: int, stream: str) -> frozenset[str]:
        """Names of the channels that a frame has in a file sequence; none without a file."""
        return self.channels[stream].get(self.held.get(number, number), frozenset())

    @property
    def main_stream(self) -> str:
        """The stream whose names and attributes outputs take: colour's, or the first bound."""
        return self._main_channel.stream

    @property
    def main_channel(self) -> str:
        """Its first channel of colour, or of what is bound first."""
        return self._main_channel.channel

    def channel_of(self, header: ExrHeader) -> str:
        """Return the channel of a frame's file whose window outputs take."""
        bound = (c.channel for parts in self.binding.values() for c in parts)
        held = (channel for channel in (self.main_channel, *bound) if channel in header.channels)
        return next(held, self.main_channel)

    @cached_property
    def _main_channel(self) -> BoundChannel:
        first = next(bound for bound in self.binding.values() if len(bound))
        return self.binding.get(Buffer.COLOR, first)[0]

    @property
    def base(self) -> str:
        """Base name of the main stream."""
        return self.frames.streams[self.main_stream].base

    def files(self, number: int, buffers: Iterable[Buffer]) -> tuple[Path, ...]:
        """Files that hold the named buffers of a frame."""
        buffers = tuple(buffers)
        needed = self._needed(tuple(b for b in buffers if b in self.binding))
        paths = {self.path(number, stream) for stream in self._streams_of(needed)}
        other = self._motion_number(number)
        if Buffer.MOTION in needed and other not in {None, number}:
            moved = self._streams_of((Buffer.MOTION,))
            paths |= {self.path(int(other or 0), stream) for stream in moved}
        if self.lent_motion is not None and Buffer.MOTION in buffers:
            paths |= set(self.lent_motion.files(number))
        return tuple(sorted(paths))

    def _streams_of(self, buffers: tuple[Buffer, ...]) -> frozenset[str]:
        """File sequences that hold some buffers; asked for again for every frame."""
        if buffers not in self._known_streams:
            streams = frozenset(c.stream for b in buffers for c in self.binding[b])
            self._known_streams[buffers] = streams
        return self._known_streams[buffers]

    @cached_property
    def _known_streams(self) -> dict[tuple[Buffer, ...], frozenset[str]]:
        return {}

    def read(self, number: int, buffers: Collection[Buffer]) -> Frame:
        """Read the named buffers of a frame, converted to memory's convention.

        Raises:
            FrameFolderError: a file is damaged, or has changed since the survey.
        """
        lent = self.lent_motion if Buffer.MOTION in buffers else None
        needed = self._needed(tuple(b for b in buffers if lent is None or b is not Buffer.MOTION))
        planes, places = self._read_planes(number, needed)
        if Buffer.MOTION in needed and self._motion_number(number) != number:
            moved, moved_places = self._moved_planes(number)
            planes, places = planes | moved, places | moved_places
        camera = self.cameras[number]
        stored = conv.StoredFrame(
            conventions=self.conventions,
            camera=camera,
            view=self.view,
            jitter_px_prev=self.cameras.get(number - self.step, camera).jitter_px,
            where=self.where(number),
        )
        uses = Counter((c.stream, c.channel) for b in needed for c in self.binding[b])
        tensors: dict[Buffer, Tensor] = {}
        for buffer in needed:
            bound = self.binding[buffer]
            image = compute_buffer(bound, planes, self.size)
            # a number that is none would turn into some number: it stays, and is counted as bad
            is_number = buffer is Buffer.OBJECT_ID and image.is_floating_point()
            spoilt = is_number and not bool(torch.isfinite(image).all())
            held = find_common(self.region, [places[c.stream, c.channel] for c in bound])
            if buffer is Buffer.DEPTH and self.has_rays_by_positions:
                stored = replace(stored, position_m=tensors[Buffer.POSITION])
            known = image if spoilt else conv.to_memory(buffer, image, stored)
            tensors[buffer] = clear_outside(known, held, self.region, _NOTHING.get(buffer, 0))
            # what is converted is let go, so that a frame is in memory once and a half, not twice
            uses.subtract((c.stream, c.channel) for c in bound)
            for key in [k for k in planes if uses[k] <= 0]:
                del planes[key]
        marker = self._sky_marker
        if marker is not None and Buffer.DEPTH in tensors:
            sky = (tensors[marker] <= 0 if marker is Buffer.ALPHA else tensors[marker] == 0).all(
                1, keepdim=True
            )
            tensors[Buffer.DEPTH] = tensors[Buffer.DEPTH].masked_fill(sky, SKY_DEPTH_M)
        if lent is not None:
            tensors[Buffer.MOTION] = lent.read(number)
        return Frame(
            number=number,
            gbuffer=GBuffer(tensors, self.where(number)).only(buffers),
            camera=camera,
            view=self.view,
        )

    def read_raw(self, number: int, buffers: Collection[Buffer]) -> dict[Buffer, Tensor]:
        """Read the named buffers of a frame as the files hold them, factors applied.

        Raises:
            FrameFolderError: a file is damaged, or has changed since the survey.
        """
        planes, _ = self._read_planes(number, buffers)
        return {b: compute_buffer(self.binding[b], planes, self.size) for b in buffers}

    def _moved_planes(self, number: int) -> tuple[dict[_Place, Plane], dict[_Place, PixelWindow]]:
        """Vectors of a frame that lie in another frame's file; none where there is no such file."""
        other = self._motion_number(number)
        if other is not None:
            return self._read_planes(other, (Buffer.MOTION,))
        still = np.full(self.size, self.conventions.motion.zero, np.float32)
        keys = [(c.stream, c.channel) for c in self.binding[Buffer.MOTION]]
        return dict.fromkeys(keys, still), dict.fromkeys(keys, self.region)

    @property
    def _sky_marker(self) -> Buffer | None:
        """Return the buffer that marks sky, which depth then takes from it."""
        rule = self.conventions.depth.sky
        marker = conv.SKY_MARKERS.get(rule) if isinstance(rule, conv.SkyRule) else None
        if marker is None and self.conventions.normal.sky is not None:
            marker = Buffer.NORMAL
        return marker if marker in self.binding else None

    def _needed(self, buffers: tuple[Buffer, ...]) -> tuple[Buffer, ...]:
        """Buffers to read for the ones asked for."""
        if Buffer.DEPTH not in buffers:
            return buffers
        marker = self._sky_marker
        # what depth is made of is read before it
        first = (Buffer.POSITION,) if self.has_rays_by_positions else ()
        rest = (marker,) if marker is not None else ()
        return tuple(dict.fromkeys((*first, *buffers, *rest)))

    def _read_planes(
        self, number: int, buffers: Collection[Buffer]
    ) -> tuple[dict[_Place, Plane], dict[_Place, PixelWindow]]:
        wanted = {(c.stream, c.channel) for buffer in buffers for c in self.binding[buffer]}
        return self._read_placed(number, wanted)

    def read_stored(self, number: int, wanted: Iterable[_Place]) -> dict[_Place, Plane]:
        """Read channels, named with the stream that holds them, as they are stored.

        Raises:
            FrameFolderError: a file is damaged, or lacks a channel.
        """
        return self._read_placed(number, wanted)[0]

    def _read_placed(
        self, number: int, wanted: Iterable[_Place]
    ) -> tuple[dict[_Place, Plane], dict[_Place, PixelWindow]]:
        """Channels in the region that is read, 0 where a file has no pixels; and where it has."""
        streams: dict[str, set[str]] = defaultdict(set)
        for stream, channel in wanted:
            streams[stream].add(channel)
        planes: dict[_Place, Plane] = {}
        places: dict[_Place, PixelWindow] = {}
        for stream, channels in streams.items():
            stored, header = read_pixels(self.path(number, stream), channels)
            for channel, plane in stored.items():
                place = places[stream, channel] = header.place_of(channel)
                planes[stream, channel] = place_pixels(plane, place, self.region)
        return planes, places


def read_planes(path: Path, channels: Collection[str]) -> dict[str, Plane]:
    """Read channels of a file that need not be a buffer's, as they are stored.

    Raises:
        FrameFolderError: the file is damaged, or lacks a channel.
    """
    return read_pixels(path, channels)[0]
