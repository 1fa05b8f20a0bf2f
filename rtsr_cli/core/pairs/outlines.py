"""Whose outlines a buffer follows: those of its own frame, or those of another one.

Of neighbouring samples p, q of a frame k, J = |b(p) - b(q)| is the jump of a buffer b, radiance by
its logarithm, and p, q are an edge where one of the other buffers shows two surfaces. Edges that k
has and n has not, none within one sample, are those that moved between both. Among them

    share = P(J at an edge of k alone > J at an edge of n alone)

is near 1 where b is of frame k, and near 0 where it is of frame n; half of it is chance. The
deviation of chance is that of the rank sum test (Mann and Whitney 1947),
sqrt((1 / a + 1 / b) / 12) of a and b edges.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer, GBuffer

STEPS: Mapping[Buffer, float] = {
    Buffer.OBJECT_ID: 0.0,
    Buffer.DEPTH: 0.1,
    Buffer.NORMAL: 0.5,
    Buffer.GEONORMAL: 0.5,
    Buffer.ALBEDO: 0.15,
    Buffer.MATERIAL: 0.15,
}
"""What neighbouring samples of one surface differ by at most; of depth relative to it."""

HDR = (Buffer.COLOR, Buffer.EMISSION)
"""Buffers whose jumps are ratios."""

DARK = 0.01
"""Radiance below which ratios tell less, as a share of the mean."""

MOST_PAIRS = 1 << 14
"""Neighbours of one direction that are looked at: of more, every second, third ... row is."""

LEAST_EDGES = 32
"""Edges of either frame alone that tell."""

OTHERS = 1 / 3
"""Share below which a buffer is of the other frame: frames of two renderers and of `rtsr synth` had
0.72 at least, exchanged ones 0.07 at most."""

OWN = 0.8
"""Share from which it is of its own for sure: a frame between both is nearer to its own than to the
other, too."""

DEVIATIONS = 4.0
"""By which chance does not explain either."""


@dataclass(frozen=True)
class Outlines:
    """Jumps of a buffer, and edges of the others, between neighbours in rows and in columns."""

    jumps: tuple[Tensor, Tensor]
    edges: tuple[Tensor, Tensor]


def draw_outlines(gbuffer: GBuffer, buffer: Buffer) -> Outlines | None:
    """Jumps of a buffer and edges of the others; None where there are no others.

    Args:
        gbuffer: of one frame.
        buffer: whose frame is in question.
    """
    known = [b for b in STEPS if b in gbuffer and b is not buffer]
    if buffer not in gbuffer or not known:
        return None
    rows, columns = (_draw(gbuffer, buffer, known, turned=turned) for turned in (False, True))
    return Outlines((rows[0], columns[0]), (rows[1], columns[1]))


def _draw(
    gbuffer: GBuffer, buffer: Buffer, known: list[Buffer], *, turned: bool
) -> tuple[Tensor, Tensor]:
    """Jumps and edges between neighbours of rows, or of columns where turned."""
    height, width = gbuffer.size
    every = math.ceil(height * width / MOST_PAIRS)

    def pick(b: Buffer) -> tuple[Tensor, Tensor]:
        image = gbuffer[b].transpose(-1, -2) if turned else gbuffer[b]
        image = torch.nan_to_num(image[..., ::every, :].float())
        if b is buffer and b in HDR:
            light = image.clamp(min=0.0)
            image = (light + DARK * light.mean() + torch.finfo(light.dtype).tiny).log()
        return image[..., 1:], image[..., :-1]

    one, other = pick(buffer)
    jumps = (one - other).abs_().amax(1)[0]
    edges = torch.zeros_like(jumps, dtype=torch.bool)
    for b in known:
        one, other = pick(b)
        step = STEPS[b] * torch.minimum(one, other) if b is Buffer.DEPTH else STEPS[b]
        edges |= ((one - other).abs_() > step).any(1)[0]
    return jumps, edges


@dataclass(frozen=True)
class Following:
    """How far a buffer follows the outlines of its own frame.

    Attributes:
        share: see above.
        deviation: of chance.
    """

    share: float
    deviation: float

    @property
    def of_other(self) -> bool:
        """Tell whether it is the other frame's."""
        return self.share < min(OTHERS, 0.5 - DEVIATIONS * self.deviation)

    @property
    def of_own(self) -> bool:
        """Tell whether it is its own frame's for sure."""
        return self.share > max(OWN, 0.5 + DEVIATIONS * self.deviation)


def hold_against(own: Outlines, other: Outlines) -> Following | None:
    """Say which of two frames' outlines the buffer of the first one follows.

    None where too few of them moved.
    """
    at_own, at_other = [], []
    for jumps, edges, others in zip(own.jumps, own.edges, other.edges, strict=True):
        at_own.append(jumps[edges & ~_widen(others)])
        at_other.append(jumps[others & ~_widen(edges)])
    return _rank(torch.cat(at_own), torch.cat(at_other))


def _widen(edges: Tensor) -> Tensor:
    return F.max_pool2d(edges[None, None].float(), 3, 1, padding=1)[0, 0] > 0.5


def _rank(values: Tensor, others: Tensor) -> Following | None:
    """P(a value > one of the others), ties by half."""
    first, second = len(values), len(others)
    if min(first, second) < LEAST_EDGES:
        return None
    ordered = others.sort().values
    below = torch.searchsorted(ordered, values)
    above = torch.searchsorted(ordered, values, right=True)
    share = float((below + above).double().mean()) / (2.0 * second)
    return Following(share, math.sqrt((1.0 / first + 1.0 / second) / 12.0))
