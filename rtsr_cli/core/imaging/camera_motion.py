"""Points of a frame in the world, and where they would be had nothing but the camera moved."""

from __future__ import annotations

import torch

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer
from rtsr_cli.core.frames.camera import place_in_camera_space
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.shapes import Mask, MotionPx, Vector3

STATIC_PX = 0.25
"""How far motion may differ from that of the camera on what stands still."""


def locate_points(frame: Frame) -> Vector3 | None:
    """World positions: stored, or from depth and camera; None where neither is there.

    P = (x, y, -depth, 1) . inverse(worldToCamera); sky lies 65504 m away
    """
    gbuffer, camera = frame.gbuffer, frame.camera
    if Buffer.POSITION in gbuffer:
        return gbuffer[Buffer.POSITION]
    if Buffer.DEPTH not in gbuffer:
        return None
    depth = gbuffer[Buffer.DEPTH].clamp(max=SKY_DEPTH_M)
    points = place_in_camera_space(depth, camera, frame.view)
    if points is None or camera.world_to_camera is None:
        return None
    to_world = torch.linalg.inv(camera.world_to_camera).to(depth)
    axes = (to_world[i, :3].view(1, 3, 1, 1) for i in range(4))
    right, up, back, origin = axes
    position: Vector3 = points[:, :1] * right + points[:, 1:2] * up + points[:, 2:] * back + origin
    return position


def find_camera_motion(position: Vector3, before: Frame) -> MotionPx | None:
    """Motion of points that stand still, from their samples to those of a frame before.

    Args:
        position: of the points, world.
        before: the frame before.

    Returns:
        NaN for points behind its camera; None where the camera is not known.
    """
    matrix = before.camera.world_to_ndc
    if matrix is None:
        return None
    p, m = position, matrix.to(position)
    x, y, w = (torch.einsum("nchw,c->nhw", p, m[:3, i]).unsqueeze(1) + m[3, i] for i in (0, 1, 3))
    # what lay behind the camera was seen nowhere
    w = torch.where(w > 0, w, torch.nan)
    height, width = before.view.display
    jitter_x, jitter_y = before.camera.jitter_px
    columns = (x / w * 0.5 + 0.5) * width - before.view.left - jitter_x - 0.5
    rows = (0.5 - 0.5 * y / w) * height - before.view.top - jitter_y - 0.5
    own_columns = torch.arange(p.shape[3], device=p.device).view(1, 1, 1, -1)
    own_rows = torch.arange(p.shape[2], device=p.device).view(1, 1, -1, 1)
    motion: MotionPx = torch.cat([columns - own_columns, rows - own_rows], dim=1)
    return motion


def differs_from_camera(motion_px: MotionPx, camera_motion_px: MotionPx) -> Mask:
    """1 where something moves by itself: its motion is not the camera's."""
    apart = (camera_motion_px - motion_px).abs().amax(1, keepdim=True)
    return (apart > STATIC_PX).to(motion_px)
