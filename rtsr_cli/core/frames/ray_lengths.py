"""How long view rays are, out of world positions and ray distances: where no camera is known.

A point P of pixel (x, y), seen by a pinhole camera C at planar depth d, whose stored distance r is
measured along the ray from a plane n ahead of the camera (0, or the near plane), is

    |P - C| = r + n L                  L(x, y): the ray from the camera to the plane one metre ahead
    P = C + d (F + x R + y U)          so  (P - C) x (F + x R + y U) = 0 (nine, up to a factor)

Depth is measured along N = R x U / |R x U|, so that

    L = |F + x R + y U| / |N.(F + x R + y U)|,    d = r / L + n.

With n = 0 the first is linear in C and |C|^2, which is where the search begins: it goes on from
rays to C and n by Gauss and Newton, and back to rays.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M
from rtsr_cli.core.frames.camera import MIN_POINTS_FOR_CAMERA
from rtsr_cli.core.shapes import Plane, Vector3

MOST_POINTS = 1 << 14
"""Points that the unknowns are fitted to; of more, evenly chosen ones."""

ROUNDS, STRAY = 8, 4.0
"""Fits, each without points that the one before misses by more than so many times the median: a
pixel filter mixes positions at edges."""

FITS = 1e-3
"""Median error, as a share of the distance, up to which positions are those of the distances."""


@dataclass(frozen=True, kw_only=True)
class RayLengths:
    """How distances become planar: d = r / length + start.

    Attributes:
        length: of every pixel's ray from the camera to the plane one metre ahead, at least 1.
        start_m: depth at which the distances begin, metres.
    """

    length: Plane
    start_m: float


def measure_ray_lengths(distance_m: Plane, position_m: Vector3) -> RayLengths | None:
    """Find what makes ray distances planar.

    Args:
        distance_m: along the ray, metres; 0, not finite or far where nothing is.
        position_m: in the world, metres.

    Returns:
        None where too few points are seen, or where these are not the distances of the positions
        from one point.
    """
    height, width = distance_m.shape[-2:]
    y, x = torch.meshgrid(
        torch.linspace(-1, 1, height, dtype=torch.float64),
        torch.linspace(-1, 1, width, dtype=torch.float64),
        indexing="ij",
    )
    pixels = torch.stack([torch.ones_like(x), x, y], -1)
    distance, points = distance_m[0, 0].double(), position_m[0].double().permute(1, 2, 0)
    seen = (distance > 0) & (distance < SKY_DEPTH_M) & torch.isfinite(points).all(-1)
    places = seen.flatten().nonzero()[:, 0]
    if len(places) < MIN_POINTS_FOR_CAMERA:
        return None
    places = places[:: -(-len(places) // MOST_POINTS)]
    r, p = distance.flatten()[places], points.flatten(0, 1)[places]
    # about their middle, so that squares keep their digits
    found = _fit(r, p - p.mean(0), pixels.flatten(0, 1)[places])
    if found is None:
        return None
    frame, start = found
    return RayLengths(length=_measure(pixels, frame)[None, None].to(distance_m), start_m=start)


def _fit(r: Tensor, p: Tensor, q: Tensor) -> tuple[Tensor, float] | None:
    """Rays and start that fit distances r, points p and pixels q; None if none do."""
    fits = torch.ones_like(r, dtype=torch.bool)
    camera, start = _find_camera(r, p), r.new_zeros(())
    frame, error = torch.eye(3, dtype=r.dtype), r
    for _ in range(ROUNDS):
        frame = _find_frame((p - camera)[fits], q[fits])
        lengths = _measure(q, frame)
        away = p - camera
        far = away.norm(dim=1)
        # r = |p - C| - n L, changed by -(p - C)/|p - C| . dC - L dn
        slopes = torch.cat([-away / far[:, None], -lengths[:, None]], 1)
        left = r - (far - start * lengths)
        step = torch.linalg.lstsq(slopes[fits], left[fits][:, None]).solution[:, 0]
        camera, start = camera + step[:3], start + step[3]
        error = ((p - camera).norm(dim=1) - start * lengths - r).abs() / r
        fits = error <= STRAY * error.median() + torch.finfo(torch.float32).eps
    return (frame, float(start)) if float(error.median()) <= FITS else None


def _find_camera(r: Tensor, p: Tensor) -> Tensor:
    """The point that all distances are from: 2 p.C - |C|^2 = |p|^2 - r^2."""
    design = torch.cat([2.0 * p, -torch.ones_like(r)[:, None]], 1)
    squares = p.square().sum(1) - r.square()
    found: Tensor = torch.linalg.lstsq(design, squares[:, None]).solution
    return found[:3, 0]


def _find_frame(rays: Tensor, pixels: Tensor) -> Tensor:
    """F, R and U, up to a common factor, a row each; rays from the camera of any length.

    The square sum of |D x (q0 F + q1 R + q2 U)|^2, D of length 1, is a quadratic form in the nine
    numbers; where it is least, at length 1, is its first eigenvector.
    """
    unit = rays / rays.norm(dim=1, keepdim=True)
    across = torch.eye(3, dtype=rays.dtype) - unit[:, :, None] * unit[:, None, :]
    of_pixels = (pixels[:, :, None] * pixels[:, None, :]).flatten(1)
    form = (of_pixels.T @ across.flatten(1)).view(3, 3, 3, 3).transpose(1, 2).reshape(9, 9)
    vectors: Tensor = torch.linalg.eigh(form).eigenvectors
    return vectors[:, 0].reshape(3, 3)


def _measure(pixels: Tensor, frame: Tensor) -> Tensor:
    """Lengths of the rays of pixels, (..., 3) -> (...)."""
    rays = pixels @ frame
    normal: Tensor = torch.linalg.cross(frame[1], frame[2])
    lengths: Tensor = rays.norm(dim=-1) / (rays @ (normal / normal.norm())).abs()
    return lengths
