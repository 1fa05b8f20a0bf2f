"""What the samples of a pixel span: ranges of depth and colour, all normals.

A capture of K x K samples a pixel is an image of K times the size, whose blocks are the pixels.
Depth is reversed here, as classifier guided supersampling [Guo et al. 2022] has it:

    D = 1 / z,  sky 0        (larger = nearer)

which along a plane is linear in image coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from rtsr_cli.core.frames.buffers import Buffer, sky_mask
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.disocclusion import bound_depth, depth_slope
from rtsr_cli.core.shapes import Color, Image, Mask, MotionPx, Plane

SLOPE_PIXELS = 3
"""Pixels in a row that a slope is told by."""


@dataclass(frozen=True, kw_only=True)
class SampleRanges:
    """Ranges of the samples of every pixel, at the pixels' resolution.

    Attributes:
        nearest, farthest: largest and smallest D, 1/m.
        slope_range: how far the samples of one plane lie apart in D there, 1/m.
        color_min, color_max: corners of the box of linear radiance, channel by channel.
        motion_px: of the nearest sample, in pixels.
        normals, geonormals: of every sample, n 3 k*k h w; the latter without normal map. None where
            the frame holds none.
        other_ids: 1 where samples show several objects; None where the frame holds no ids.
    """

    nearest: Plane
    farthest: Plane
    slope_range: Plane
    color_min: Color
    color_max: Color
    motion_px: MotionPx
    normals: Tensor | None
    geonormals: Tensor | None
    other_ids: Mask | None


def split_samples(capture: Image, k: int) -> Tensor:
    """Take a capture apart: n c k*h k*w -> n c k*k h w, the samples of a pixel row by row.

    Args:
        capture: k x k samples a pixel.
        k: samples along an axis; it divides both sides.
    """
    n, c, height, width = capture.shape
    blocks = capture.reshape(n, c, height // k, k, width // k, k).permute(0, 1, 3, 5, 2, 4)
    return blocks.reshape(n, c, k * k, height // k, width // k)


def join_samples(samples: Tensor, k: int) -> Image:
    """Lay samples out as a capture: n c k*k h w -> n c k*h k*w; undoes `split_samples`.

    Args:
        samples: of each pixel, row by row.
        k: samples along an axis.
    """
    n, c, _, height, width = samples.shape
    blocks = samples.reshape(n, c, k, k, height, width).permute(0, 1, 4, 2, 5, 3)
    return blocks.reshape(n, c, height * k, width * k)


def reverse_depth(depth_m: Plane) -> Plane:
    """D = 1 / z; 0 on sky, and where there is no depth."""
    depth = bound_depth(depth_m)
    nowhere = (sky_mask(depth) > 0) | (depth <= 0)
    return torch.where(nowhere, 0.0, 1.0 / depth.masked_fill(nowhere, 1.0))


def pick_nearest(capture: Image, depth_m: Plane, k: int) -> Image:
    """Of each pixel's samples, what the nearest one holds; of several as near, the first.

    Args:
        capture: k x k samples a pixel.
        depth_m: of the same samples.
        k: samples along an axis.
    """
    nearness, samples = split_samples(reverse_depth(depth_m), k), split_samples(capture, k)
    nearest, picked = nearness[:, :, 0], samples[:, :, 0]
    # an argmax over so few samples takes many times as long
    for own, sample in zip(nearness.unbind(2)[1:], samples.unbind(2)[1:], strict=True):
        picked = torch.where(own > nearest, sample, picked)
        nearest = torch.maximum(nearest, own)
    return picked


def gather_ranges(frame: Frame, k: int, *, on_grid: bool = True) -> SampleRanges:
    """Gather what the samples of each pixel span.

    Args:
        frame: a capture of k x k samples a pixel, with colour, depth and motion; normals, normals
            without normal map, and object ids where they are there.
        k: samples along an axis; it divides both sides.
        on_grid: samples lie in the pixel as they do in the capture; else anywhere in it, one
            number of them in the same place of every pixel.

    Raises:
        MissingBufferError: colour, depth or motion is not there.
    """
    gbuffer = frame.gbuffer
    depth, color = gbuffer[Buffer.DEPTH], split_samples(gbuffer[Buffer.COLOR], k)
    reversed_depth = reverse_depth(depth)
    nearness = split_samples(reversed_depth, k)
    ids = gbuffer.buffers.get(Buffer.OBJECT_ID)
    return SampleRanges(
        nearest=nearness.amax(2),
        farthest=nearness.amin(2),
        slope_range=_span_slope(reversed_depth, k) if on_grid else _span_pixel_slope(nearness),
        color_min=color.amin(2),
        color_max=color.amax(2),
        motion_px=pick_nearest(gbuffer[Buffer.MOTION], depth, k) / k,
        normals=_split_buffer(frame, Buffer.NORMAL, k),
        geonormals=_split_buffer(frame, Buffer.GEONORMAL, k),
        other_ids=None if ids is None else _tell_apart(split_samples(ids, k)).to(depth),
    )


def _span_slope(reversed_depth: Plane, k: int) -> Plane:
    """What the k samples of a plane span on a grid, by the steps between them."""
    # an edge is one step wide between samples: the slope beside it is that of the surface
    return (k - 1) * functional.max_pool2d(depth_slope(reversed_depth), k)


def _span_pixel_slope(samples: Tensor) -> Plane:
    """What a plane spans across a pixel, by the steps of each sample from pixel to pixel."""
    slopes = torch.stack([depth_slope(layer) for layer in samples.unbind(2)]).amax(0)
    if min(slopes.shape[2:]) < SLOPE_PIXELS:
        return slopes
    # at the frame's border there is a step to one side only: the pixel beside it tells
    return functional.pad(slopes[..., 1:-1, 1:-1], (1, 1, 1, 1), mode="replicate")


def _split_buffer(frame: Frame, buffer: Buffer, k: int) -> Tensor | None:
    held = frame.gbuffer.buffers.get(buffer)
    return None if held is None else split_samples(held, k)


def _tell_apart(samples: Tensor) -> Tensor:
    """True where not all samples are one value."""
    return samples.amax(2) != samples.amin(2)
