"""The camera of one frame: matrices, jitter and exposure, and what follows from them.

Matrices act on row vectors, `p_cam = [x y z 1] . world_to_camera`; camera space is right-handed,
x right, y up, looking along -z. NDC: x -1..1 left to right, y -1..1 bottom to top.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.frames.vector_length import normalize_vectors, vector_length
from rtsr_cli.core.shapes import Plane, Size, Vector3

GIVE_CAMERAS = (
    "write them into the headers, or into a file beside capture.toml that it names "
    "(docs/frames.md, Cameras)"
)
"""What to do where matrices are missing."""

MIN_POINTS_FOR_CAMERA = 64
"""Fewer surface points than this do not fix the twelve unknowns of `camera_from_positions`."""


@dataclass(frozen=True, kw_only=True)
class View:
    """The part of the image plane that an image shows, in pixels of its own resolution.

    `display` is the (height, width) that NDC spans; the image's first pixel is (`top`, `left`).
    """

    display: Size
    top: int = 0
    left: int = 0

    def at_scale(self, scale: int) -> View:
        """Return the same part at `scale` times the resolution."""
        height, width = self.display
        return View(
            display=(height * scale, width * scale), top=self.top * scale, left=self.left * scale
        )


@dataclass(frozen=True, kw_only=True)
class CameraMetadata:
    """Per-frame facts about the camera; None where the files do not say.

    Attributes:
        world_to_camera: 4x4 float64, row-vector convention.
        world_to_ndc: 4x4 float64, row-vector convention, w = view depth.
        jitter_px: sample position minus pixel centre, pixels of the frame's own resolution.
        pre_exposure: factor already applied to the radiance.
        cut: True where temporal history must not reach back beyond this frame.
        fault: why matrices that the files do have are none; empty if they are not at fault.
        of_lens: whether world_to_ndc was made of world_to_camera and a field of view.
    """

    world_to_camera: Tensor | None = None
    world_to_ndc: Tensor | None = None
    jitter_px: Jitter = (0.0, 0.0)
    pre_exposure: float = 1.0
    cut: bool = False
    fault: str = ""
    of_lens: bool = False

    @property
    def has_matrices(self) -> bool:
        """Tell whether both matrices are known."""
        return self.world_to_camera is not None and self.world_to_ndc is not None

    @property
    def position(self) -> Tensor | None:
        """Camera position in world space (3 values), None if unknown."""
        if self.world_to_camera is None:
            return None
        to_world: Tensor = torch.linalg.inv(self.world_to_camera)
        return to_world[3, :3]

    @property
    def projection(self) -> Tensor | None:
        """Camera space to clip space, 4x4, None if unknown."""
        if self.world_to_camera is None or self.world_to_ndc is None:
            return None
        to_world: Tensor = torch.linalg.inv(self.world_to_camera)
        return to_world @ self.world_to_ndc


def ndc_axes(view: View, size: Size, jitter_px: Jitter = (0.0, 0.0)) -> tuple[Tensor, Tensor]:
    """NDC of the samples of every column (1 x 1 x 1 x w) and row (1 x 1 x h x 1) of an image."""
    height, width = view.display
    columns = torch.arange(size[1], dtype=torch.float32) + (view.left + 0.5 + jitter_px[0])
    rows = torch.arange(size[0], dtype=torch.float32) + (view.top + 0.5 + jitter_px[1])
    x, y = 2.0 * columns / width - 1.0, 1.0 - 2.0 * rows / height
    return x.view(1, 1, 1, -1), y.view(1, 1, -1, 1)


def is_orthographic(projection: Tensor) -> bool:
    """Tell whether w does not depend on the depth."""
    return abs(float(projection[2, 3])) < abs(float(projection[3, 3]))


def ray_axes(
    camera: CameraMetadata, view: View, size: Size, *, jitter_px: Jitter = (0.0, 0.0)
) -> tuple[Tensor, Tensor] | None:
    """x of every column and y of every row of the camera-space rays (x, y, -1).

        x_cam = ndc_x / P[0][0] * depth,  y_cam = ndc_y / P[1][1] * depth,  z_cam = -depth

    An off-centre projection adds P[2][0] and P[2][1] (their factor z_cam / depth is -1); the rays
    of an orthographic camera are all (0, 0, -1).
    Returns 1 x 1 x 1 x w and 1 x 1 x h x 1, or None where the camera has no matrices.
    """
    projection = camera.projection
    if projection is None:
        return None
    p = projection.to(torch.float32)
    ndc_x, ndc_y = ndc_axes(view, size, jitter_px)
    if is_orthographic(p):
        return torch.zeros_like(ndc_x), torch.zeros_like(ndc_y)
    return (ndc_x + p[2, 0]) / p[0, 0], (ndc_y + p[2, 1]) / p[1, 1]


def place_in_camera_space(depth_m: Plane, camera: CameraMetadata, view: View) -> Vector3 | None:
    """Camera-space points (1 x 3 x h x w) of planar depths; None without matrices.

    Clip space of a point at (x, y, -depth) has w = P33 - P23 depth, and its x is
        ndc_x w = P00 x - P20 depth + P30   =>   x = (ndc_x w + P20 depth - P30) / P00
    """
    projection = camera.projection
    if projection is None:
        return None
    p = projection.to(depth_m)
    size = (depth_m.shape[-2], depth_m.shape[-1])
    w = p[3, 3] - p[2, 3] * depth_m
    across = [
        (ndc.to(depth_m) * w + p[2, i] * depth_m - p[3, i]) / p[i, i]
        for i, ndc in enumerate(ndc_axes(view, size, camera.jitter_px))
    ]
    return torch.cat([*across, -depth_m], dim=1)


def list_near_planes(projection: Tensor) -> tuple[float, ...]:
    """Depths of what may be the near plane: z of NDC 0 or -1 there, or 1 where it is reversed.

    z = (P32 - P22 depth) / (P33 - P23 depth); the first that is in front of the camera leads.
    """
    p = projection.double()
    if is_orthographic(p):
        return ()
    ends = (1.0, 0.0) if _is_reversed(projection) else (0.0, -1.0)
    slopes = [(end, float(p[2, 2] - end * p[2, 3])) for end in ends]
    depths = [float(p[3, 2] - end * p[3, 3]) / slope for end, slope in slopes if slope]
    return tuple(d for d in depths if 0.0 < d < SKY_DEPTH_M)


def view_cosine(normal: Vector3, to_camera: Vector3) -> Plane:
    """NoV = clamp(dot(normal, normalize(camera - position)), 0, 1); both in one space."""
    cosine = (normalize_vectors(normal) * normalize_vectors(to_camera)).sum(1, keepdim=True)
    return cosine.clamp(0.0, 1.0)


def view_cosine_from_camera(
    normal: Vector3, camera: CameraMetadata, view: View, *, jitter_px: Jitter = (0.0, 0.0)
) -> Plane | None:
    """NoV of world-space normals seen through the pixels of a camera; None without matrices.

    The direction to the camera does not depend on depth: it is minus the pixel's ray.
    """
    axes = ray_axes(camera, view, (normal.shape[-2], normal.shape[-1]), jitter_px=jitter_px)
    if axes is None or camera.world_to_camera is None:
        return None
    x, y = (axis.to(normal) for axis in axes)
    # row vectors: world = cam . inverse(rotation), and a rotation's inverse is its transpose,
    # so that component i of minus the ray (x, y, -1) is M[i][2] - x M[i][0] - y M[i][1]
    rotation = camera.world_to_camera[:3, :3].tolist()
    cosine = torch.zeros_like(normal[:, :1])
    for i, (right, up, back) in enumerate(rotation):
        cosine.addcmul_(normal[:, i : i + 1], back - y * up - x * right)
    lengths = (1.0 + y * y + x * x).sqrt() * vector_length(normal)
    return cosine.div_(lengths.clamp_(min=1e-12)).clamp_(0.0, 1.0)


def camera_from_positions(position: Vector3, depth_m: Plane) -> Tensor | None:
    """Recover the camera's position from world positions and planar depths of one frame.

    A pinhole camera's world position of pixel (x, y) at depth d is affine in (x d, y d, d):
        P = C + d F + x d R + y d U        (twelve unknowns, linear least squares)
    Returns C (3 values), or None where too few surface points are visible.
    """
    height, width = depth_m.shape[-2:]
    y, x = torch.meshgrid(
        torch.linspace(-1, 1, height, dtype=torch.float64),
        torch.linspace(-1, 1, width, dtype=torch.float64),
        indexing="ij",
    )
    depth = depth_m[0, 0].double()
    points = position[0].double()
    valid = (depth < SKY_DEPTH_M) & (depth > 0) & torch.isfinite(points).all(0)
    if int(valid.sum()) < MIN_POINTS_FOR_CAMERA:
        return None
    d = depth[valid]
    design = torch.stack([torch.ones_like(d), d, x[valid] * d, y[valid] * d], dim=1)
    scale = design.abs().amax(0)
    solution: Tensor = torch.linalg.lstsq(design / scale, points[:, valid].T).solution
    return (solution / scale[:, None])[0]


def device_to_planar_depth(
    device_depth: Plane, projection: Tensor, *, reversed_depth: bool
) -> Plane:
    """Linearise a depth-buffer value exactly.

        d = (P22 z + P32) / (P23 z + P33)   =>   z = (P32 - d P33) / (d P23 - P22),  depth = -z

    A file may hold 1 - d of its own matrix: `reversed_depth` says that far is 0; a matrix whose
    far limit P22 / P23 is 1 stores far as 1, and the value is turned round before use. Sky is what
    the buffer was cleared to, 1 (or 0), at a finite far plane too.
    """
    p = projection.double()
    matrix_reversed = _is_reversed(projection)
    d = device_depth.double()
    d = d if matrix_reversed == reversed_depth else 1.0 - d
    depth = -(p[3, 2] - d * p[3, 3]) / (d * p[2, 3] - p[2, 2])
    cleared = d <= 0.0 if matrix_reversed else d >= 1.0
    beyond = cleared | ~torch.isfinite(depth) | (depth < 0) | (depth >= SKY_DEPTH_M)
    return torch.where(beyond, torch.full_like(depth, SKY_DEPTH_M), depth).float()


def planar_to_device_depth(depth_m: Plane, projection: Tensor, *, reversed_depth: bool) -> Plane:
    """Invert `device_to_planar_depth`: d = (P32 - P22 depth) / (P33 - P23 depth), sky = cleared."""
    p = projection.double()
    matrix_reversed = _is_reversed(projection)
    depth = depth_m.double()
    d = (p[3, 2] - p[2, 2] * depth) / (p[3, 3] - p[2, 3] * depth)
    clear = torch.full_like(d, 0.0 if matrix_reversed else 1.0)
    d = torch.where(depth >= SKY_DEPTH_M, clear, d)
    return (d if matrix_reversed == reversed_depth else 1.0 - d).float()


def _is_reversed(projection: Tensor) -> bool:
    """Tell whether a projection's far limit is 0."""
    far = float(projection[2, 2] / projection[2, 3])
    return abs(far) < abs(1.0 - far)
