"""Both resolutions of a pair from one HR capture."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.regions import OutputWindows, place_output
from rtsr_cli.core.choices import JitterMode
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import ExrHeader
from rtsr_cli.core.pairs.nonfinite import apply_policy
from rtsr_cli.core.pairs.simulation import Simulation, decimate_frame
from rtsr_cli.core.pairs.sources import (
    FramePair,
    PairInputs,
    PairReads,
    check_frame,
    describe_lacking,
    describe_missing,
    resolve_buffers,
)
from rtsr_cli.core.pairs.window import build_hr, build_lr, select_hr
from rtsr_cli.core.shapes import Size


@dataclass(frozen=True, kw_only=True)
class SimulatedPairs:
    """Both resolutions from one HR capture."""

    capture: FrameReader
    simulation: Simulation

    @property
    def reader(self) -> FrameReader:
        """The capture's reader."""
        return self.capture

    @property
    def scale(self) -> int:
        """Output pixels per LR pixel."""
        return self.simulation.scale

    @property
    def lr_size(self) -> Size:
        """(height, width) of the LR frames."""
        height, width = self.capture.size
        return height // self.simulation.block, width // self.simulation.block

    def place_output(self, header: ExrHeader) -> OutputWindows:
        """In the capture's windows, less the samples of a pixel."""
        ratio = Fraction(1, self.simulation.samples_per_pixel)
        return place_output(header, self.capture.main_channel, self.capture.region, ratio)

    @property
    def readers(self) -> tuple[FrameReader, ...]:
        """The capture's."""
        return (self.capture,)

    @property
    def jitters(self) -> bool:
        """Tell whether the samples that are kept differ."""
        return self.simulation.jitter is not JitterMode.NONE

    @property
    def filter_width_px(self) -> float:
        """The simulation's."""
        return self.simulation.filter_width_px

    @property
    def filter_measured(self) -> bool:
        """It is known."""
        return False

    @property
    def looks_filtered(self) -> bool:
        """The simulation's."""
        return self.filter_width_px > 0.0

    @property
    def filter_doubt(self) -> str:
        """There is none."""
        return ""

    @property
    def misfit(self) -> str:
        """There is none: both sizes are of one capture."""
        return ""

    @property
    def misfit_doubt(self) -> str:
        """There is none."""
        return ""

    @property
    def frame_bytes(self) -> int:
        """The capture's."""
        return self.capture.frame_bytes

    @cached_property
    def _resolved(self) -> dict[PairInputs, PairReads]:
        """Of inputs that were asked for; nothing else about a source ever changes."""
        return {}

    def resolve(self, inputs: PairInputs) -> PairReads:
        """Say what is read for a system."""
        if inputs not in self._resolved:
            self._resolved[inputs] = PairReads(
                lr=resolve_buffers(inputs.lr, inputs.lr_optional, self.capture, inputs),
                hr=resolve_buffers(inputs.hr, inputs.hr_optional, self.capture, inputs),
            )
        return self._resolved[inputs]

    def missing(
        self, inputs: PairInputs, numbers: Collection[int] | None = None
    ) -> tuple[str, ...]:
        """Name what the capture lacks."""
        reads = self.resolve(inputs)
        read = self.capture.numbers if numbers is None else numbers
        stored = reads.lr.stored | reads.hr.stored
        return (
            *describe_missing((*reads.lr.missing, *reads.hr.missing), self.capture),
            *describe_lacking(read, stored, self.capture),
        )

    def files(self, number: int, inputs: PairInputs) -> tuple[Path, ...]:
        """Files of the capture."""
        reads = self.resolve(inputs)
        return self.capture.files(number, reads.lr.stored | reads.hr.stored)

    def load(self, number: int, inputs: PairInputs) -> FramePair:
        """Read the capture once; radiance goes to the LR frame only, and only its samples do."""
        reads, derivation = self.resolve(inputs), inputs.derivation
        full = self.capture.read(number, reads.lr.stored | reads.hr.stored)
        small = decimate_frame(full, reads.lr.stored, self.simulation)
        checked = check_frame(small, inputs)
        lr = build_lr(checked.frame, reads.lr, derivation)
        pair = FramePair(lr, None, checked.fixed, checked.negative, checked.covered)
        if not reads.hr.used:
            return pair
        hr, fixed_hr = apply_policy(select_hr(full, reads.hr), inputs.on_nonfinite)
        hr = build_hr(hr, reads.hr, derivation, self.simulation.samples_per_pixel)
        return replace(pair, hr=hr, fixed=pair.fixed + fixed_hr)


def open_simulated_pairs(capture: FrameReader, simulation: Simulation) -> SimulatedPairs:
    """Check that a capture can be decimated.

    Raises:
        FrameFolderError: its size is not a multiple of the block.
    """
    height, width = capture.size
    offsets = (capture.region.left, capture.region.top)
    if any(v % simulation.block for v in (height, width, *offsets)):
        raise FrameFolderError(
            f"{capture.frames.root}: {width} x {height} pixels at {offsets} cannot be decimated "
            f"by {simulation.block}; choose a scale that divides them, or crop the frames"
        )
    return SimulatedPairs(capture=capture, simulation=simulation)
