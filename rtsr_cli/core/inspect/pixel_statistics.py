"""Looking at the pixels of a sequence: their range, NaN and Inf, motion that cannot be right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.choices import MOST_MATERIAL
from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.frames.conventions import SkyRule
from rtsr_cli.core.wording import join_names, say_count, say_verb

COARSE_STEP_PX = 0.25
"""Vectors stored in coarser steps than this have lost the sub-pixel part."""

HALF_STEP = 2.0**-11
"""Relative step of half precision: values of 0.5 to 1 are this far apart."""


LEAST_SHARE = 1e-3
"""Fewer values than this share are no more than a renderer's rounding."""

NEVER_NEGATIVE = frozenset({Buffer.COLOR, Buffer.LIGHTING, Buffer.EMISSION})
"""Buffers of light."""


@dataclass(frozen=True, kw_only=True)
class PixelStatistics:
    """What the pixels of a buffer are, over the frames that were looked at, as stored.

    Attributes:
        low, high, median: of the finite values.
        nonfinite: frame -> number of NaN and Inf.
        not_numbers: frame -> number of NaN.
        negative: frame -> number of values below 0.
        zero: frames in which every value is 0.
        fractional: share of the values that are no whole numbers.
        above_one: share of the values that are above 1.
    """

    low: float
    high: float
    median: float
    nonfinite: Mapping[int, int] = field(default_factory=dict)
    not_numbers: Mapping[int, int] = field(default_factory=dict)
    negative: Mapping[int, int] = field(default_factory=dict)
    zero: tuple[int, ...] = ()
    fractional: float = 0.0
    above_one: float = 0.0


@dataclass
class _RunningStatistics:
    """Statistics of a buffer while frames come in."""

    low: float = float("inf")
    high: float = float("-inf")
    medians: list[float] = field(default_factory=list)
    nonfinite: dict[int, int] = field(default_factory=dict)
    not_numbers: dict[int, int] = field(default_factory=dict)
    negative: dict[int, int] = field(default_factory=dict)
    zero: list[int] = field(default_factory=list)
    fractional: list[float] = field(default_factory=list)
    above_one: list[float] = field(default_factory=list)

    def add(self, number: int, stored: Tensor) -> None:
        values = stored.flatten().float()
        finite = values[torch.isfinite(values)]
        if finite.numel() < values.numel():
            self.nonfinite[number] = values.numel() - finite.numel()
            self.not_numbers |= {number: n} if (n := int(values.isnan().sum())) else {}
        if finite.numel():
            lowest = float(finite.amin())
            self.low = min(self.low, lowest)
            if lowest < 0:
                self.negative[number] = int((finite < 0).sum())
            self.high = max(self.high, float(finite.amax()))
            self.medians.append(float(finite.median()))
            self.fractional.append(float((finite != finite.round()).float().mean()))
            self.above_one.append(float((finite > 1.0).float().mean()))
        if not bool(values.any()):
            self.zero.append(number)

    def result(self) -> PixelStatistics:
        nothing = not self.medians
        return PixelStatistics(
            low=0.0 if nothing else self.low,
            high=0.0 if nothing else self.high,
            median=0.0 if nothing else sorted(self.medians)[len(self.medians) // 2],
            nonfinite=self.nonfinite,
            not_numbers=self.not_numbers,
            negative=self.negative,
            zero=tuple(self.zero),
            fractional=_mean(self.fractional),
            above_one=_mean(self.above_one),
        )


def _mean(shares: Sequence[float]) -> float:
    return sum(shares) / len(shares) if shares else 0.0


def measure_statistics(
    reader: FrameReader, numbers: Sequence[int]
) -> tuple[dict[Buffer, PixelStatistics], list[str]]:
    """Look at the pixels; frames that cannot be read are problems."""
    running = {buffer: _RunningStatistics() for buffer in sorted(reader.stored)}
    damaged = []
    for number in numbers:
        try:
            stored = reader.narrowed([number]).read_raw(number, reader.stored_in([number]))
        except RtsrError as error:
            damaged.append(str(error))
            continue
        for buffer, tensor in stored.items():
            running[buffer].add(number, tensor)
    return {buffer: r.result() for buffer, r in running.items()}, damaged


def describe_nonfinite(
    reader: FrameReader, statistics: Mapping[Buffer, PixelStatistics]
) -> list[str]:
    """Say which buffers hold NaN or Inf; depth may, on sky: Inf, and NaN where that is its rule."""
    found: dict[Buffer, Mapping[int, int]] = {
        b: s.nonfinite for b, s in statistics.items() if b != Buffer.DEPTH
    }
    if Buffer.DEPTH in statistics and reader.conventions.depth.sky is not SkyRule.NAN:
        found[Buffer.DEPTH] = statistics[Buffer.DEPTH].not_numbers
    return [
        f"{say_count(count, 'value')} of '{buffer}' {say_verb(count)} NaN or Inf in "
        f"{say_frames(frames)}: render {'it' if len(frames) == 1 else 'them'} again, or use "
        "--on-nonfinite zero|inpaint"
        for buffer, frames in found.items()
        if (count := sum(frames.values()))
    ]


def describe_negative(statistics: Mapping[Buffer, PixelStatistics]) -> list[str]:
    """Say which radiance is below 0, which no light is."""
    return [
        f"{say_count(count, 'value')} of '{buffer}' {say_verb(count)} below 0 in "
        f"{say_frames(s.negative)}, which no light is; if that is not meant, render "
        f"{'this frame' if len(s.negative) == 1 else 'these frames'} again, or clamp the values"
        for buffer, s in statistics.items()
        if buffer in NEVER_NEGATIVE and (count := sum(s.negative.values()))
    ]


def list_doubts(reader: FrameReader, statistics: Mapping[Buffer, PixelStatistics]) -> list[str]:
    """Pixels that may not be what they should, though commands take them."""
    problems = [
        *_doubt_ids(statistics),
        *_doubt_colors(reader, statistics),
        *_doubt_zeros(statistics),
    ]
    motion = statistics.get(Buffer.MOTION)
    if motion is None:
        return problems
    if motion.low == motion.high == 0.0:
        problems.append(
            "motion is zero in every pixel of every frame: unless nothing moves, the motion pass "
            "was not rendered"
        )
    elif motion.zero and len(motion.zero) < len(reader.numbers):
        problems.append(
            f"motion is zero in every pixel of {say_frames(motion.zero)}: nothing moves there, or "
            "the pass was not rendered"
        )
    step = _motion_step_px(reader)
    if step > COARSE_STEP_PX:
        problems.append(
            f"motion is stored as half centred at {reader.conventions.motion.zero:g}: its steps "
            f"are {step:.2f} px, sub-pixel motion is lost; write it as float, or uncentred"
        )
    return problems


NEVER_EMPTY = (Buffer.NORMAL, Buffer.ALBEDO, Buffer.MATERIAL, Buffer.ROUGHNESS, Buffer.POSITION)
"""Buffers that are 0 in every pixel of a frame only where nothing but sky is seen."""


def _doubt_zeros(statistics: Mapping[Buffer, PixelStatistics]) -> list[str]:
    """Say of passes that some frames lack; of those that all lack surfaces tell."""
    return [
        f"'{buffer}' is 0 in every pixel of {say_frames(s.zero)}, and not in others: a pass that "
        f"was not rendered there; render {'this frame' if len(s.zero) == 1 else 'these frames'} "
        "again"
        for buffer, s in statistics.items()
        if buffer in NEVER_EMPTY and s.zero and s.high > s.low
    ]


def _doubt_ids(statistics: Mapping[Buffer, PixelStatistics]) -> list[str]:
    """Ids between two whole numbers are of no object: a pixel filter has averaged them."""
    ids = statistics.get(Buffer.OBJECT_ID)
    if ids is None or not ids.fractional:
        return []
    return [
        f"{ids.fractional:.1%} of 'object_id' are no whole numbers: the renderer's pixel filter "
        "averaged ids, depth and normals over edges; render buffers of one sample in the middle of "
        "the pixel (a box filter, one sample a pixel)"
    ]


def _doubt_colors(reader: FrameReader, statistics: Mapping[Buffer, PixelStatistics]) -> list[str]:
    """Base colours above 1 reflect more than they receive: they hold highlights or light.

    So do materials above 2. Where all of them do, more is known, and said.
    """
    doubted: dict[tuple[float, float], list[Buffer]] = {}
    for buffer, most in ((Buffer.ALBEDO, 1.0), (Buffer.MATERIAL, MOST_MATERIAL)):
        colour = statistics.get(buffer)
        if colour is None or colour.above_one < LEAST_SHARE or buffer in reader.faulty:
            continue
        if colour.high > most:
            doubted.setdefault((colour.above_one, colour.high), []).append(buffer)
    remedy = (
        f"which no base colour is: {reader.layout.bright_albedo}; write base colours of 0 to 1, "
        "linear, as an AOV of your own where no pass holds them"
    )
    texts: list[str] = []
    for (share, high), buffers in doubted.items():
        names = join_names([f"'{buffer}'" for buffer in buffers])
        bound = f" (above {MOST_MATERIAL:g} counts as {MOST_MATERIAL:g})"
        known = bound if Buffer.MATERIAL in buffers else ""
        texts.append(f"{share:.1%} of {names} are above 1 (up to {high:.3g}), {remedy}{known}")
    return texts


def _motion_step_px(reader: FrameReader) -> float:
    """Pixels between neighbouring stored values near the centre; 0 for float files."""
    convention = reader.conventions.motion
    if not convention.zero or not len(reader.binding.get(Buffer.MOTION, ())):
        return 0.0
    component = reader.binding[Buffer.MOTION][0]
    place = (component.stream, component.channel)
    if reader.read_stored(reader.numbers[0], [place])[place].dtype != np.float16:
        return 0.0
    return (
        HALF_STEP * convention.zero * 2.0 * max(map(abs, convention.factors(reader.view.display)))
    )
