"""Telling from the offsets that fit best whether vectors contain jitter, and its sign.

A frame whose samples lie at +j shows a point at its position minus j, so that along jitter-free
vectors the picture's own offset is d = jitter - jitter_prev, which the search accounts for already.
What is left over is 0 if all is declared right; -d if the vectors contain the jitter; +d if they
contain it inverted; -2 d if the declared jitter has the wrong sign.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from torch import Tensor

from rtsr_cli.core.captures.measuring.motion_finder import STILL_PX
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.motion import Jitter

LEAST_JITTER_PX = 0.05
"""Declared jitter that varies less than this, root mean square, tells nothing."""

LEAST_OFFSET_PX = 0.15
"""Offsets that vary more than this are no accident of the search."""

TEXTURED = (Buffer.COLOR, Buffer.ALBEDO)
"""Buffers in which things at rest show whether samples are."""

LEAST_DETAIL, MOST_RESTING = 256, 0.9
"""Pixels at rest that differ from their neighbours, and the share of them that is as it was, where
samples rest: shadows may move."""


class JitterVerdict(StrEnum):
    """What the offsets say."""

    CONSISTENT = "consistent"
    IN_VECTORS = "in the vectors"
    IN_VECTORS_INVERTED = "in the vectors, inverted"
    WRONG_SIGN = "declared with the wrong sign"
    UNDECLARED = "not declared"
    CONSTANT_OFFSET = "a constant offset"
    UNKNOWN = "unknown"


_SLOPES = {
    0.0: JitterVerdict.CONSISTENT,
    -1.0: JitterVerdict.IN_VECTORS,
    1.0: JitterVerdict.IN_VECTORS_INVERTED,
    -2.0: JitterVerdict.WRONG_SIGN,
}
"""Left-over offset per declared difference."""


@dataclass(frozen=True, kw_only=True)
class JitterFinding:
    """What was found out about jitter.

    Attributes:
        verdict: in words.
        slope: left-over offset per declared difference, None where none is declared.
        spread_px: largest left-over offset.
    """

    verdict: JitterVerdict
    slope: float | None = None
    spread_px: float = 0.0

    @property
    def in_vectors(self) -> bool | None:
        """Whether the vectors contain jitter; None where it cannot be told."""
        if self.verdict in {JitterVerdict.IN_VECTORS, JitterVerdict.IN_VECTORS_INVERTED}:
            return True
        if self.verdict is JitterVerdict.UNDECLARED:
            return True
        return None if self.verdict is JitterVerdict.UNKNOWN else False


def find_jitter(offsets_px: Sequence[Jitter], differences_px: Sequence[Jitter]) -> JitterFinding:
    """Judge the left-over offsets of the pairs of frames.

    Args:
        offsets_px: that fit best, after the declared jitter.
        differences_px: jitter - jitter_prev as declared, for the same pairs.
    """
    if not offsets_px:
        return JitterFinding(verdict=JitterVerdict.UNKNOWN)
    left = [v for offset in offsets_px for v in offset]
    declared = [v for difference in differences_px for v in difference]
    spread = max(abs(v) for v in left)
    power = sum(d * d for d in declared)
    if power / len(declared) > LEAST_JITTER_PX**2:
        slope = sum(a * d for a, d in zip(left, declared, strict=True)) / power
        nearest = min(_SLOPES, key=lambda s: abs(s - slope))
        close = abs(nearest - slope) < 0.3
        verdict = _SLOPES[nearest] if close else JitterVerdict.UNKNOWN
        return JitterFinding(verdict=verdict, slope=slope, spread_px=spread)
    if spread < LEAST_OFFSET_PX:
        return JitterFinding(verdict=JitterVerdict.CONSISTENT, spread_px=spread)
    varies = max(
        max(o[axis] for o in offsets_px) - min(o[axis] for o in offsets_px) for axis in (0, 1)
    )
    one = len(offsets_px) == 1
    verdict = (
        JitterVerdict.UNDECLARED
        if varies > LEAST_OFFSET_PX or one
        else JitterVerdict.CONSTANT_OFFSET
    )
    return JitterFinding(verdict=verdict, spread_px=spread)


def do_samples_rest(stored: Mapping[int, Mapping[Buffer, Tensor]], step: int, zero: float) -> bool:
    """Tell whether what rests, by its vectors, shows the very picture of the frame before it.

    Samples that jitter show another one wherever there is detail.

    Args:
        stored: number -> motion as stored, and what else was read of a frame.
        step: between the numbers of frames.
        zero: stored value of no motion.
    """
    shares: list[float] = []
    for number, buffers in stored.items():
        before = stored.get(number - step)
        if before is None:
            continue
        rests = ((buffers[Buffer.MOTION] - zero).abs() <= STILL_PX).all(1, keepdim=True)[..., 1:]
        same = [0.0]
        for buffer in set(TEXTURED) & buffers.keys() & before.keys():
            picture = buffers[buffer]
            detail = rests & (picture.diff(dim=-1) != 0).any(1, keepdim=True)
            kept = (picture == before[buffer]).all(1, keepdim=True)[..., 1:][detail]
            same.append(float(kept.float().mean()) if len(kept) >= LEAST_DETAIL else 0.0)
        shares.append(max(same))
    return bool(shares) and min(shares) > MOST_RESTING
