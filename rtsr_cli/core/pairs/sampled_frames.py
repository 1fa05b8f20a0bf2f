"""Captures of several samples a pixel, every sample of which is handed on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.errors import FrameFolderError
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
class SampledFrames(SimulatedPairs):
    """A capture's frames as they are; outputs hold a pixel for each K x K of their samples."""

    def load(self, number: int, inputs: PairInputs) -> FramePair:
        """Read every sample of a frame."""
        reads = self.resolve(inputs).lr
        checked = check_frame(self.capture.read(number, reads.stored), inputs)
        frame = build_lr(checked.frame, reads, inputs.derivation)
        return FramePair(frame, None, checked.fixed, checked.negative, checked.covered)


def open_sampled_frames(
    folder: Path, options: ReadOptions, samples_per_pixel: int
) -> Iterator[tuple[str, PairSource]]:
    """Survey every shot of IN as captures, by relative path.

    Args:
        folder: IN.
        options: how frames are read.
        samples_per_pixel: K, samples of a pixel along an axis.

    Raises:
        RtsrError: a folder, file or declaration is wrong, or frames do not divide into pixels.
    """
    files = open_declarations(folder, options)
    for shot in find_shots_of(folder, options, files=files):
        opened = open_shot(shot, folder, options, files=files)
        check_shot(opened)
        capture = open_capture(opened)
        (height, width), region = capture.size, capture.region
        if any(v % samples_per_pixel for v in (height, width, region.left, region.top)):
            raise FrameFolderError(
                f"{capture.frames.root}: {width} x {height} samples at ({region.left}, "
                f"{region.top}) are no whole pixels of {samples_per_pixel} x {samples_per_pixel}; "
                "name the number of samples that was rendered with --samples-per-pixel"
            )
        simulation = Simulation(scale=1, samples_per_pixel=samples_per_pixel)
        yield shot.name, SampledFrames(capture=capture, simulation=simulation)
