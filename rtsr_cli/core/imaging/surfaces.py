"""What tells the surfaces of a shot's frames apart: how they face, where they lie, what they are.

    likeness(p, q) = exp(-a (1 - n(p).n(q)) - |n(p).(P(q) - P(p))| / (c(p) z(p)))   of one kind
                   = 0                                                              else

n is the normal; P lies in one space for all frames, so that a static surface keeps its plane; z is
the depth. Sky is a kind of its own. A normal of 0 says nothing: the first term is 0 where p or q
has such a one, and p's plane is then that of its depth. Edge-stopping functions as in Dammertz et
al., "Edge-Avoiding A-Trous Wavelet Transform", HPG 2010, with the distance from p's plane in place
of that of the positions.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor
from torch.nn.functional import normalize

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.camera_motion import (
    differs_from_camera,
    find_camera_motion,
    locate_points,
)
from rtsr_cli.core.shapes import Image, Mask, MotionPx, Plane, Vector3

FACING = 32.0
"""a: neighbours whose normals are 12 degrees apart count half."""

PLANE_SHARE = 0.02
"""c: distance from the plane, as a share of the depth, that takes off a factor of e."""

MOVING_SHARE = 0.1
"""c of what moves: it need not stay in its plane."""

MIN_DEPTH = 1e-6

SKY_KIND = -0.5
"""Kind of the sky; those of surfaces are whole numbers."""


@dataclass(frozen=True, kw_only=True)
class Surfaces:
    """Surfaces of a frame.

    Attributes:
        facing: n 4 h w, the normal (0 on sky), and 1 where there is one.
        position: n 3 h w, in the space of all frames; where no camera is known, (0, 0, -depth).
        plane: n 3 h w, the normal in the space of the positions; where there is none, the axis
            along which depth is measured, and 0 on sky.
        tolerance: n 1 h w, c z: distance from the plane that takes off a factor of e.
        kind: n 1 h w, whole numbers, `SKY_KIND` on sky: pixels of different ones are never alike.
    """

    facing: Image
    position: Vector3
    plane: Vector3
    tolerance: Plane
    kind: Plane

    @property
    def on_sky(self) -> Tensor:
        """True on sky, n 1 h w."""
        return self.kind == SKY_KIND

    def pack(self) -> Image:
        """Return what another pixel is held against, n 8 h w.

        Normal, 1 where there is none, position, kind.
        """
        normal, seen = self.facing.split_with_sizes([3, 1], dim=1)
        return torch.cat([normal, 1.0 - seen, self.position, self.kind], dim=1)

    def take(self, pixels: Tensor | slice) -> Surfaces:
        """Return the surfaces of some pixels, by index or in a row, as an image of one row."""

        def pick(image: Tensor) -> Tensor:
            planes = image[0].flatten(1)
            if isinstance(pixels, slice):
                return planes[None, :, None, pixels]
            return planes.index_select(1, pixels)[None, :, None]

        return Surfaces(**{f.name: pick(getattr(self, f.name)) for f in fields(self)})

    def pick(self, index: int) -> Surfaces:
        """Return those of one frame of a batch, 1 . h w."""
        return Surfaces(**{f.name: getattr(self, f.name)[index, None] for f in fields(self)})

    def widen(self, moving: Mask) -> Surfaces:
        """Return the same with the tolerance of what moves where `moving` is 1."""
        factor = 1.0 + (MOVING_SHARE / PLANE_SHARE - 1.0) * moving
        return replace(self, tolerance=self.tolerance * factor)


def describe_surfaces(frame: Frame, divided: Mask) -> Surfaces:
    """Describe a frame's surfaces.

    Args:
        frame: holds normal and depth; object ids, positions and a camera where they are there.
        divided: 1 where radiance is divided by a material; such pixels and others are no kin.
    """
    gbuffer = frame.gbuffer
    normal, depth = gbuffer[Buffer.NORMAL], gbuffer[Buffer.DEPTH]
    sky = (depth >= SKY_DEPTH_M).to(normal)
    normal = normal * (1.0 - sky)
    seen = (normal != 0).any(1, keepdim=True).to(normal)
    position = locate_points(frame)
    axis = _find_depth_axis(frame, in_world=position is not None).to(normal)
    if position is None:
        position = torch.cat([torch.zeros_like(normal[:, :2]), -depth], dim=1)
        plane = axis * (1.0 - sky)
    else:
        plane = normal + axis * (1.0 - seen) * (1.0 - sky)
    numbers = gbuffer.buffers.get(Buffer.OBJECT_ID)
    kind = divided if numbers is None else 2.0 * numbers.to(normal) + divided
    return Surfaces(
        facing=torch.cat([normal, seen], dim=1),
        # where sky lies says nothing, and its depth would spoil sums
        position=position * (1.0 - sky),
        plane=plane,
        tolerance=PLANE_SHARE * depth.clamp(min=MIN_DEPTH, max=SKY_DEPTH_M),
        kind=kind.masked_fill(sky > 0.5, SKY_KIND),
    )


def _find_depth_axis(frame: Frame, *, in_world: bool) -> Tensor:
    """Unit vector along which depth is measured, 1 3 1 1; 0 in a world whose camera is unknown."""
    matrix, axis = frame.camera.world_to_camera, torch.tensor([0.0, 0.0, 1.0])
    if in_world:
        # row vectors: what a point's place along the axis is multiplied by
        axis = torch.zeros(3) if matrix is None else normalize(matrix[:3, 2].float(), dim=0)
    return axis.view(1, 3, 1, 1)


def find_moving(surfaces: Surfaces, motion_px: MotionPx, before: Frame) -> Mask:
    """1 where motion is not that of the camera; everywhere where no camera is known.

    Args:
        surfaces: of the current frame.
        motion_px: from its samples to those of the frame before.
        before: the frame before.
    """
    camera_px = find_camera_motion(surfaces.position, before)
    if camera_px is None:
        return torch.ones_like(motion_px[:, :1])
    return differs_from_camera(motion_px, camera_px).masked_fill(surfaces.on_sky, 0.0)


def weigh_likeness(own: Surfaces, packed: Tensor) -> Plane:
    """Return how much pixels are of the surface of each pixel, 0..1.

    Args:
        own: surfaces, n . h w.
        packed: `Surfaces.pack` of the pixel that each is held against, n 8 h w.
    """
    facing, position, kind = packed[:, :4], packed[:, 4:7], packed[:, 7:8]
    # 1 - n(p).n(q) where both have a normal, else 0
    turned = own.facing[:, 3:] - (own.facing * facing).sum(1, keepdim=True)
    apart = (own.plane * (position - own.position)).sum(1, keepdim=True).abs_()
    likeness = turned.mul_(-FACING).sub_(apart.div_(own.tolerance)).exp_()
    return likeness.mul_(kind == own.kind)
