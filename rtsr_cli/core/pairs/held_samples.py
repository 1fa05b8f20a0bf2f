"""LR samples held against the HR pixels in which they lie: what lies where, and what is alike.

Conventions: sample (S//2, S//2) of each S x S block, moved by the frame's jitter (`alignment`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.alignment import block_shift
from rtsr_cli.core.shapes import Color, Image, Mask

GUIDES = (Buffer.ALBEDO, Buffer.NORMAL, Buffer.DEPTH)
"""Buffers that tell more, where they are there."""

TOLERANCE = 1.1
"""What 8 bits, coarser textures and normals of half leave of material that is right."""

BLACK = 1e-3
"""Base colour up to here is none: the third level above 0 of 8 bits in sRGB."""

MOST_DIELECTRIC = 0.17
"""F0 of dielectrics is up to that of diamond."""

FACING, APARTS, APART_THERE = 0.7, (0.02, 0.1), 0.02
"""Least cosine between normals of one surface, and differences of depth, as a share of it: between
samples (a flat one, or one that is seen at a slant), and of a sample from its pixel."""

LIKE = 1.5
"""Ratio of materials, in every channel, up to which a pixel is like a sample."""

AT_ONCE = 1 << 12
"""Samples whose blocks are held in memory."""


@dataclass(frozen=True, kw_only=True)
class HeldSamples:
    """LR samples held against the HR pixels in which they lie.

    Attributes:
        lr, hr: the frames.
        scale: S.
        placed: HR material at the samples.
        told: True where both are surfaces with material; of one surface, where that is known.
        guides: normal and depth of the samples; None where a size lacks them.
    """

    lr: Frame
    hr: Frame
    scale: int
    placed: Color
    told: Mask
    guides: Image | None

    @property
    def material(self) -> Color:
        """The samples'."""
        return self.lr.gbuffer[Buffer.MATERIAL]

    @cached_property
    def means(self) -> Color:
        """Of HR material over the samples' blocks."""
        return average_blocks(self.hr, self.scale)

    @cached_property
    def of_own_surface(self) -> HeldSamples:
        """The same, less what `keep_own_surface` leaves out."""
        return keep_own_surface(self)

    @cached_property
    def bare(self) -> tuple[Mask, Mask]:
        """Where LR's and HR's surfaces have no base colour."""
        lr, hr = (is_colourless(frame.gbuffer) for frame in (self.lr, self.hr))
        return lr, hr

    def place(self, image: Image) -> Image:
        """Pixels of an HR image in which the samples lie."""
        return place_pixels(image, self.lr, self.scale)


def name_colour(held: HeldSamples) -> Buffer:
    """Base colour where both sizes have it, else material."""
    known = all(Buffer.ALBEDO in frame.gbuffer for frame in (held.lr, held.hr))
    return Buffer.ALBEDO if known else Buffer.MATERIAL


def find_colours(held: HeldSamples) -> tuple[Color, Color]:
    """Base colours of samples and of the pixels in which they lie; else their materials."""
    name = name_colour(held)
    return held.lr.gbuffer[name], held.place(held.hr.gbuffer[name])


def is_colourless(gbuffer: GBuffer) -> Mask:
    """True where the base colour is stored, and is none: what is left is a specular term.

    A diffuse colour of 0 beside an F0 above dielectrics' is that of metal.
    """
    if Buffer.ALBEDO not in gbuffer:
        return torch.zeros_like(gbuffer[Buffer.SKY], dtype=torch.bool)
    albedo = gbuffer[Buffer.ALBEDO]
    # one fast pass tells frames in which nothing is black
    if float(albedo.amin()) > BLACK:
        return torch.zeros_like(gbuffer[Buffer.SKY], dtype=torch.bool)
    bare = albedo.amax(1, keepdim=True) <= BLACK
    if Buffer.SPECULAR not in gbuffer:
        return bare
    return bare & (gbuffer[Buffer.SPECULAR].amax(1, keepdim=True) <= MOST_DIELECTRIC)


def hold_samples(lr: Frame, hr: Frame, scale: int) -> HeldSamples:
    """Find the pixels in which samples lie."""
    material, divided = lr.gbuffer[Buffer.MATERIAL], lr.gbuffer[Buffer.SKY] < 0.5
    divided &= (material > MATERIAL_EPSILON).all(1, keepdim=True)
    if Buffer.LIGHTING_MASK in lr.gbuffer:
        # the material of what is not divided is 1
        divided &= lr.gbuffer[Buffer.LIGHTING_MASK] > 0.5
    placed, sky = (place_pixels(hr.gbuffer[b], lr, scale) for b in (Buffer.MATERIAL, Buffer.SKY))
    told = divided & (sky < 0.5) & (placed > MATERIAL_EPSILON).all(1, keepdim=True)
    return HeldSamples(lr=lr, hr=hr, scale=scale, placed=placed, told=told, guides=None)


def average_blocks(hr: Frame, scale: int) -> Color:
    """What a filter of a pixel's width leaves of HR material: sky has none."""
    material, surface = hr.gbuffer[Buffer.MATERIAL], hr.gbuffer[Buffer.SKY] < 0.5
    rows = (~surface.flatten(0, 2).all(1)).nonzero()[:, 0] // scale
    if not len(rows):
        return F.avg_pool2d(material, scale)
    first, last = int(rows[0]) * scale, (int(rows[-1]) + 1) * scale
    parts = [material[:, :, :first], material[:, :, first:last], material[:, :, last:]]
    parts[1] = parts[1] * surface[:, :, first:last]
    return torch.cat([F.avg_pool2d(part, scale) for part in parts if part.shape[2]], 2)


def find_mixed(hr: Frame, scale: int, tolerance: float) -> Mask:
    """True at blocks whose HR materials are further apart than a ratio; sky has none."""
    material = hr.gbuffer[Buffer.MATERIAL] * (hr.gbuffer[Buffer.SKY] < 0.5)
    most, least = (sign * F.max_pool2d(sign * material, scale) for sign in (1.0, -1.0))
    return (most > least * tolerance).any(1, keepdim=True)


def is_filtered(held: HeldSamples, means: Color) -> bool:
    """Tell whether most LR samples in mixed blocks are like the mean, and not like the pixel."""
    mixed = held.told & ~is_near(held.placed, means, TOLERANCE)
    to_pixel, to_mean = (
        (held.material - image).abs().sum(1, keepdim=True)[mixed] for image in (held.placed, means)
    )
    return 2 * int((to_mean < to_pixel).sum()) > len(to_mean)


def is_near(one: Tensor, other: Tensor, tolerance: float | Tensor) -> Tensor:
    """Whether materials are within a ratio in all channels."""
    return ((one <= other * tolerance) & (other <= one * tolerance)).all(1, keepdim=True)


def place_pixels(image: Image, lr: Frame, scale: int) -> Image:
    """Pixels of an HR image in which LR samples lie."""
    shift = block_shift(lr.camera.jitter_px, scale)
    columns, rows = (
        (torch.arange(scale // 2, side, scale) + by).clamp_(0, side - 1)
        for by, side in zip(shift, image.shape[:-3:-1], strict=True)
    )
    return image[..., rows[:, None], columns]


def keep_own_surface(held: HeldSamples) -> HeldSamples:
    """Leave out samples whose pixel is of another surface, as far as that can be told."""
    lr, hr = held.lr.gbuffer, held.hr.gbuffer
    parts = (Buffer.NORMAL, Buffer.DEPTH)
    if not all(part in gbuffer for gbuffer in (lr, hr) for part in parts):
        return held
    own = torch.cat([lr[part] for part in parts], 1)
    there = torch.cat([held.place(hr[part]) for part in parts], 1)
    return replace(held, told=held.told & is_alike(own, there, APART_THERE), guides=own)


def is_alike(one: Tensor, other: Tensor, apart: float) -> Mask:
    """Of one surface, by normal and depth; a normal of 0 tells nothing."""
    (normal, z), (other_normal, other_z) = (
        image.split_with_sizes([3, 1], dim=1) for image in (one, other)
    )
    facing = (normal * other_normal).sum(1, keepdim=True)
    unfaced = (normal == 0).all(1, keepdim=True) | (other_normal == 0).all(1, keepdim=True)
    near = (z - other_z).abs() <= apart * torch.minimum(z, other_z)
    return ((facing > FACING) | unfaced) & near


def hold_at_depths(held: HeldSamples) -> HeldSamples:
    """Tell surfaces apart by depth alone."""
    lr, hr = held.lr.gbuffer, held.hr.gbuffer
    own, there = lr[Buffer.DEPTH], held.place(hr[Buffer.DEPTH])
    near = (own - there).abs() <= APART_THERE * torch.minimum(own, there)
    unfaced = torch.zeros_like(own).expand(-1, 3, -1, -1)
    return replace(held, told=held.told & near, guides=torch.cat([unfaced, own], 1))


def has_like(held: HeldSamples, picked: Tensor, ratio: float | Tensor) -> Tensor:
    """Whether HR pixels of a sample's surface in the 3 x 3 blocks around are of its material.

    Args:
        held: the samples.
        picked: rows and columns of some, k 2.
        ratio: of materials, in every channel, up to which they are one; of all, or k 1 1.
    """
    ratios = torch.as_tensor(ratio, dtype=held.material.dtype).expand(len(picked), 1, 1)
    chunks = zip(torch.split(picked, AT_ONCE), torch.split(ratios, AT_ONCE), strict=True)
    return torch.cat([_has_like_of(held, some, ratio) for some, ratio in chunks])


def _has_like_of(held: HeldSamples, picked: Tensor, ratio: Tensor) -> Tensor:
    seen = gather_around(held.hr.gbuffer[Buffer.MATERIAL], picked, 1, held.scale)
    own = held.material[0][:, picked[:, 0], picked[:, 1]].t().unsqueeze(2)
    like = is_near(own, seen, ratio)
    if held.guides is not None:
        depth = gather_around(held.hr.gbuffer[Buffer.DEPTH], picked, 1, held.scale)
        normal = torch.zeros_like(depth).expand(-1, 3, -1)
        if Buffer.NORMAL in held.hr.gbuffer:
            normal = gather_around(held.hr.gbuffer[Buffer.NORMAL], picked, 1, held.scale)
        pixels = torch.cat([normal, depth], 1)
        surface = held.guides[0][:, picked[:, 0], picked[:, 1]].t().unsqueeze(2)
        like &= is_alike(pixels, surface, APARTS[-1])
    return like.any(2)[:, 0]


def gather_around(image: Image, picked: Tensor, reach: int, scale: int) -> Tensor:
    """The blocks up to `reach` from those of the picked samples, k c n; 0 beyond the borders."""
    steps = torch.arange(-reach * scale, (reach + 1) * scale)
    (rows, row_there), (columns, column_there) = (
        (at.clamp(0, size - 1), (at >= 0) & (at < size))
        for at, size in zip((picked * scale).T[:, :, None] + steps, image.shape[-2:], strict=True)
    )
    values: Tensor = image[0].float()[:, rows[:, :, None], columns[:, None]]
    values = values * (row_there[:, :, None] & column_there[:, None])
    return values.flatten(2).movedim(0, 1)


def mark_samples(picked: Tensor, like: Mask) -> Mask:
    """True at the picked samples (rows and columns, k 2) of a mask's size."""
    marked = torch.zeros_like(like)
    marked[0, 0][picked[:, 0], picked[:, 1]] = True
    return marked
