"""Frames of several samples a pixel, every sample of which is handed on: captures, or channels."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import torch

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.sample_channels import count_samples
from rtsr_cli.core.errors import FrameFolderError, RequestError
from rtsr_cli.core.frames.buffers import VECTOR_BUFFERS, Buffer, GBuffer
from rtsr_cli.core.frames.camera import View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.sample_ranges import join_samples
from rtsr_cli.core.pairs.opening import (
    ReadOptions,
    check_shot,
    find_shots_of,
    open_capture,
    open_declarations,
    open_shot,
)
from rtsr_cli.core.pairs.simulated_pairs import SimulatedPairs
from rtsr_cli.core.pairs.simulation import Simulation
from rtsr_cli.core.pairs.sources import FramePair, PairInputs, PairSource, check_frame
from rtsr_cli.core.pairs.window import build_lr


@dataclass(frozen=True, kw_only=True)
class SampleArrangement:
    """The samples of a pixel, as frames hand them on.

    Attributes:
        side: K, of blocks of K x K samples.
        count: of samples; the rest of a block repeats the first.
        on_grid: the samples lie in the pixel as they do in the block; else anywhere.
    """

    side: int
    count: int
    on_grid: bool


@dataclass(frozen=True, kw_only=True)
class SampledFrames(SimulatedPairs):
    """A capture's frames as they are; outputs hold a pixel for each K x K of their samples."""

    @property
    def arrangement(self) -> SampleArrangement:
        """A block of the capture a pixel."""
        side = self.simulation.samples_per_pixel
        return SampleArrangement(side=side, count=side * side, on_grid=True)

    @property
    def buffers(self) -> frozenset[Buffer]:
        """Buffers of which samples are read."""
        return self.capture.readable

    def load(self, number: int, inputs: PairInputs) -> FramePair:
        """Read every sample of a frame."""
        reads = self.resolve(inputs).lr
        checked = check_frame(self._read(number, reads.stored), inputs)
        frame = build_lr(checked.frame, reads, inputs.derivation)
        return FramePair(frame, None, checked.fixed, checked.negative, checked.covered)

    def _read(self, number: int, buffers: Collection[Buffer]) -> Frame:
        return self.capture.read(number, buffers)


@dataclass(frozen=True, kw_only=True)
class SampleChannels(SampledFrames):
    """Frames whose channels hold a sample each, handed on as the capture that they would be.

    Attributes:
        on_grid: samples lie on a grid, row by row.
    """

    on_grid: bool

    @property
    def arrangement(self) -> SampleArrangement:
        """The smallest block that holds all samples."""
        count = count_samples(self.capture.samples)
        side = math.isqrt(count - 1) + 1
        return SampleArrangement(side=side, count=count, on_grid=self.on_grid)

    @property
    def buffers(self) -> frozenset[Buffer]:
        """Buffers of which samples are read."""
        return self.capture.readable & self.capture.samples.keys()

    @property
    def frame_bytes(self) -> int:
        """The pixels', as often as there are samples."""
        return self.capture.frame_bytes * self.arrangement.side**2

    def files(self, number: int, inputs: PairInputs) -> tuple[Path, ...]:
        """Files of every sample."""
        stored = self.resolve(inputs).lr.stored
        found = (path for reader in self._readers for path in reader.files(number, stored))
        return tuple(sorted(set(found)))

    @cached_property
    def _readers(self) -> tuple[FrameReader, ...]:
        return self.capture.list_sample_readers()

    def _read(self, number: int, buffers: Collection[Buffer]) -> Frame:
        held = tuple(b for b in buffers if b in self.buffers)
        return join_frames([reader.read(number, held) for reader in self._readers])


def join_frames(samples: list[Frame]) -> Frame:
    """Lay frames of one sample a pixel each out as a capture, in blocks as large as it takes.

    Args:
        samples: row by row; the first fills what is left of a block.
    """
    first, side = samples[0], math.isqrt(len(samples) - 1) + 1
    filled = [*samples, *[first] * (side * side - len(samples))]

    def join(buffer: Buffer) -> torch.Tensor:
        image = join_samples(torch.stack([s.gbuffer[buffer] for s in filled], dim=2), side)
        return image * side if buffer in VECTOR_BUFFERS else image

    (height, width), view = first.view.display, first.view
    jitter_x, jitter_y = first.camera.jitter_px
    return replace(
        first,
        gbuffer=GBuffer({buffer: join(buffer) for buffer in first.gbuffer}, first.gbuffer.where),
        camera=replace(first.camera, jitter_px=(jitter_x * side, jitter_y * side)),
        view=View(
            display=(height * side, width * side), top=view.top * side, left=view.left * side
        ),
    )


def open_sampled_frames(
    folder: Path,
    options: ReadOptions,
    buffers: Collection[Buffer],
    samples_per_pixel: int | None,
) -> Iterator[tuple[str, PairSource]]:
    """Survey every shot of IN, of captures or of channels with a sample each, by relative path.

    Args:
        folder: IN.
        options: how frames are read.
        buffers: of which every sample must be there.
        samples_per_pixel: K, samples of a pixel along an axis; None where channels hold them, and
            nobody says that they lie on a grid.

    Raises:
        RtsrError: a folder, file or declaration is wrong, frames do not divide into pixels, or
            hold a sample a pixel.
    """
    files = open_declarations(folder, options)
    for shot in find_shots_of(folder, options, files=files):
        opened = open_shot(shot, folder, options, files=files)
        check_shot(opened)
        capture = open_capture(opened)
        if capture.sample_fault:
            raise FrameFolderError(f"{capture.frames.root}: {capture.sample_fault}")
        if capture.samples:
            yield shot.name, _open_channels(capture, buffers, samples_per_pixel)
        else:
            yield shot.name, _open_blocks(capture, samples_per_pixel)


def _open_blocks(capture: FrameReader, samples_per_pixel: int | None) -> SampledFrames:
    """Take a capture of K times the size."""
    if samples_per_pixel is None:
        raise RequestError(
            f"{capture.frames.root}: --kind cgts needs --samples-per-pixel K: frames that hold K x "
            "K samples of each pixel, such as rtsr synth --samples K writes; or channels with a "
            "sample each (color.0.R, color.1.R, ...)"
        )
    (height, width), region = capture.size, capture.region
    if any(v % samples_per_pixel for v in (height, width, region.left, region.top)):
        raise FrameFolderError(
            f"{capture.frames.root}: {width} x {height} samples at ({region.left}, "
            f"{region.top}) are no whole pixels of {samples_per_pixel} x {samples_per_pixel}; "
            "name the number of samples that was rendered with --samples-per-pixel"
        )
    simulation = Simulation(scale=1, samples_per_pixel=samples_per_pixel)
    return SampledFrames(capture=capture, simulation=simulation)


def _open_channels(
    capture: FrameReader, buffers: Collection[Buffer], samples_per_pixel: int | None
) -> SampleChannels:
    """Take frames whose channels hold a sample each."""
    count, root = count_samples(capture.samples), capture.frames.root
    whole = [b for b in buffers if b in capture.readable and b not in capture.samples]
    if whole:
        sampled = ", ".join(f"'{b}'" for b in capture.samples)
        raise FrameFolderError(
            f"{root}: {sampled} {'has' if len(capture.samples) == 1 else 'have'} {count} samples a "
            f"pixel, but {', '.join(repr(b.value) for b in whole)} only one; write as many of each"
        )
    if samples_per_pixel is not None and samples_per_pixel**2 != count:
        raise FrameFolderError(
            f"{root}: channels hold {count} samples a pixel, not {samples_per_pixel} x "
            f"{samples_per_pixel}; leave --samples-per-pixel out where they lie on no grid"
        )
    return SampleChannels(
        capture=capture, simulation=Simulation(scale=1), on_grid=samples_per_pixel is not None
    )
