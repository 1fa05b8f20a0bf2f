"""Enlargement that keeps to the surfaces of a large G-buffer: joint bilateral upsampling.

    out(p) = sum_q w(p, q) m(q) v(q) / sum_q w(p, q) m(q)
    w = exp(-|p - q|^2 / (2 s^2) - a (1 - n(p).n(q)) - d(p, q))
    d = max(0, |z(p) - z(q)| - b |grad z(p)| |p - q|) / (c z(p))

over the small frame's samples q near p: those whose normal is that of p and whose depth is that of
p's plane count [Kopf et al. 2007, with the edge-stopping functions of Dammertz et al. 2010].

Conventions: samples are pixel (S//2, S//2) of their S x S block (see `alignment`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.shapes import Image, Mask, Plane, Vector3

REACH = 2
"""Samples to each side."""

SPREAD = 0.7
"""s, small pixels."""

FACING = 32.0
"""a."""

SLOPE = 1.5
"""b: how much of the surface's own slope is no difference."""

DEPTH_SHARE = 0.02
"""c: difference in depth, as a share of it, that takes off a factor of e."""

MIN_DEPTH, MAX_DEPTH = 1e-6, 1e6
"""Bounds of the depth; the larger one stands for the sky's."""

FALLBACK_WEIGHT = 1e-4
"""Of the cubic enlargement, which is all there is where no sample fits."""

LEAST_WEIGHT = 0.01
"""Samples whose spatial weight stays below this at every pixel are left out."""


@dataclass(frozen=True, kw_only=True)
class SurfaceGuides:
    """What tells surfaces apart.

    Attributes:
        normal: n 3 h w, unit, 0 on sky.
        depth: n 1 h w, any unit, infinite on sky.
    """

    normal: Vector3
    depth: Plane


def _split_phases(image: Image, scale: int) -> Image:
    """n c S*h S*w -> n S*S c h w: pixel (y, x) of each block is phase y S + x."""
    n, channels, height, width = image.shape
    split = image.view(n, channels, height // scale, scale, width // scale, scale)
    return split.permute(0, 3, 5, 1, 2, 4).reshape(
        n, scale * scale, channels, height // scale, width // scale
    )


def _join_phases(phases: Image, scale: int) -> Image:
    """Undo `_split_phases`."""
    n, _, channels, height, width = phases.shape
    split = phases.view(n, scale, scale, channels, height, width)
    return split.permute(0, 3, 4, 1, 5, 2).reshape(n, channels, height * scale, width * scale)


def _gradient(depth: Plane) -> Plane:
    """Lesser absolute difference to both sides, the larger one of the two axes."""
    steps = []
    for dim in (-1, -2):
        before = depth.narrow(dim, 0, 1)
        after = depth.narrow(dim, depth.shape[dim] - 1, 1)
        left = depth.diff(dim=dim, prepend=before).abs()
        right = depth.diff(dim=dim, append=after).abs()
        # at the ends, there is one side only
        left.narrow(dim, 0, 1).copy_(right.narrow(dim, 0, 1))
        right.narrow(dim, depth.shape[dim] - 1, 1).copy_(left.narrow(dim, depth.shape[dim] - 1, 1))
        steps.append(torch.minimum(left, right))
    return torch.maximum(steps[0], steps[1])


def upsample_guided(
    values: Image,
    mask: Mask,
    small: SurfaceGuides,
    large: SurfaceGuides,
    *,
    scale: int,
    fallback: Image,
) -> Image:
    """Enlarge values along surfaces.

    Args:
        values: n c h w.
        mask: n 1 h w, 1 = counts.
        small: of the samples.
        large: of the output, n . S*h S*w.
        scale: S.
        fallback: n c S*h S*w; what stands where no sample fits.
    """
    height, width = values.shape[-2:]

    def around(image: Image) -> Image:
        """Replicate the borders, so that every sample has its neighbours."""
        return F.pad(image, (REACH,) * 4, mode="replicate").unsqueeze(1)

    counted = around(torch.cat([values * mask, mask], dim=1))
    normal = around(FACING * small.normal)
    depth = around(small.depth.clamp(max=MAX_DEPTH))
    normal_at = _split_phases(large.normal, scale)
    bounded = large.depth.clamp(min=MIN_DEPTH, max=MAX_DEPTH)
    per_depth = _split_phases(1.0 / (DEPTH_SHARE * bounded), scale)
    depth_at = _split_phases(bounded, scale) * per_depth
    slope_at = _split_phases(_gradient(bounded), scale) * per_depth * (SLOPE * scale)
    total = counted.new_zeros(*depth_at.shape[:2], counted.shape[2], height, width)
    for across, down in product(range(-REACH, REACH + 1), repeat=2):
        distance = _distances(across, down, scale, like=values)
        nearness = -distance.square() / (2.0 * SPREAD**2)
        if float(nearness.max()) < math.log(LEAST_WEIGHT):
            continue
        top, left = REACH + down, REACH + across
        here = (..., slice(top, top + height), slice(left, left + width))
        x, y, z = (normal[here][:, :, axis : axis + 1] for axis in range(3))
        # a (n(p).n(q) - 1) - d(p, q) - |p - q|^2 / (2 s^2)
        power = torch.addcmul(nearness - FACING, normal_at[:, :, :1], x)
        power = power.addcmul_(normal_at[:, :, 1:2], y).addcmul_(normal_at[:, :, 2:], z)
        apart = torch.addcmul(depth_at, depth[here], per_depth, value=-1.0).abs_()
        apart = apart.addcmul_(slope_at, distance, value=-1.0).clamp_(min=0.0)
        total.addcmul_(power.sub_(apart).exp_(), counted[here])
    sums = _join_phases(total, scale)
    weights = sums[:, -1:] + FALLBACK_WEIGHT
    return (sums[:, :-1] + FALLBACK_WEIGHT * fallback) / weights


def _distances(across: int, down: int, scale: int, *, like: Tensor) -> Tensor:
    """|p - q| of each phase's pixel and the sample of a block beside it: 1 S*S 1 1 1."""
    inside = (torch.arange(scale, device=like.device, dtype=like.dtype) - scale // 2) / scale
    squared = (down - inside).square().view(-1, 1) + (across - inside).square()
    return squared.sqrt().view(1, -1, 1, 1, 1)
