"""Exact motion of surface points between two frames.

With a rigid map M from camera space now to camera space then, B = M - I, and a ray (x, y, -1):

    q = (x, y, -1) . B + T / depth
    x' - x = (q_x + x q_z) / (1 - q_z),    y likewise

Only differences are formed, so that what does not move has motion 0 and small motion is exact.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.synth.placement import PlacedPart
from rtsr_cli.core.synth.rays import Hits, Rays
from rtsr_cli.core.synth.scene import Matrix

MIN_AHEAD = 1e-3
"""Points that were behind the camera are taken to be this share of their depth before it."""


def camera_to_camera(pose: Matrix, pose_then: Matrix, now: Matrix, then: Matrix) -> Matrix:
    """Map camera space now to camera space then, for points fixed to a moving pose.

    Args:
        pose, pose_then: local to world.
        now, then: world to camera.
    """
    moves = not np.array_equal(pose, pose_then)
    if not moves and np.array_equal(now, then):
        return np.eye(4)
    matrix = np.linalg.inv(now)
    if moves:
        matrix = matrix @ np.linalg.inv(pose) @ pose_then
    result: Matrix = matrix @ then
    return result


def slope_change(x: Tensor, y: Tensor, inverse_depth: Tensor, matrix: Matrix) -> Tensor:
    """Change of the ray slopes (x, y) of points under a map; stacked in front."""
    difference = (matrix - np.eye(4)).tolist()
    qx, qy, qz = (
        (x * difference[0][i])
        .add_(y, alpha=difference[1][i])
        .sub_(difference[2][i])
        .add_(inverse_depth, alpha=difference[3][i])
        for i in range(3)
    )
    ahead = (1.0 - qz).clamp_(min=MIN_AHEAD)
    return torch.stack([torch.addcmul(qx, x, qz) / ahead, torch.addcmul(qy, y, qz) / ahead])


def motion_px(
    rays: Rays,
    hits: Hits,
    solids: tuple[PlacedPart, ...],
    cameras: tuple[CameraMetadata, CameraMetadata],
    *,
    display: Size,
    forward: bool = False,
) -> Tensor:
    """Motion (2, tiles, pixels of a tile) to the other frame, pixels, x right, y down.

    Sky moves with the rotation of the camera only.

    Args:
        rays, hits, solids: of this frame.
        cameras: this frame's and the other's.
        display: (height, width) of the image.
        forward: the other frame is the next one, not the previous.
    """
    now, then = (_to_camera(camera) for camera in cameras)
    inverse_depth = hits.depth_m.reciprocal()
    world = np.eye(4)
    moved = slope_change(
        rays.x, rays.y, inverse_depth, camera_to_camera(world, world, now, then)
    ).view(2, -1)
    x, y, inverse = rays.x.view(-1), rays.y.view(-1), inverse_depth.view(-1)
    for number, (solid, tiles) in enumerate(zip(solids, hits.tiles, strict=True)):
        if not solid.body.motion.moving or not len(tiles):
            continue
        tile, within = (hits.index.index_select(0, tiles) == number).nonzero(as_tuple=True)
        pixels = tiles.index_select(0, tile) * rays.x.shape[1] + within
        pose_then = solid.following if forward else solid.previous
        moved[:, pixels] = slope_change(
            x[pixels],
            y[pixels],
            inverse[pixels],
            camera_to_camera(solid.pose, pose_then, now, then),
        )
    projection = cameras[0].projection
    assert projection is not None
    factor = torch.tensor(
        [projection[0, 0] * display[1] / 2.0, -projection[1, 1] * display[0] / 2.0]
    )
    return (moved * factor.float()[:, None]).view(2, *rays.x.shape)


def _to_camera(camera: CameraMetadata) -> Matrix:
    assert camera.world_to_camera is not None
    return camera.world_to_camera.numpy()
