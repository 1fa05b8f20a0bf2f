"""Sky, view cosine and normals in the camera's space, from what of them is stored."""

from __future__ import annotations

import torch

from rtsr_cli.core.errors import MissingBufferError
from rtsr_cli.core.frames.buffers import Buffer, GBuffer, sky_mask
from rtsr_cli.core.frames.camera import (
    camera_from_positions,
    view_cosine,
    view_cosine_from_camera,
)
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.shapes import Mask, Plane, Vector3


def derive_sky(gbuffer: GBuffer) -> Mask:
    """1 = sky: by depth; by zero normals where there is no depth; nowhere if neither is there."""
    if Buffer.DEPTH in gbuffer:
        return sky_mask(gbuffer[Buffer.DEPTH])
    if Buffer.NORMAL in gbuffer:
        normal = gbuffer[Buffer.NORMAL]
        return (normal == 0).all(1, keepdim=True).to(normal.dtype)
    return torch.zeros(1, 1, *gbuffer.size, device=gbuffer.device)


def derive_nov(frame: Frame) -> Plane:
    """View cosine: stored, from the camera, or from positions and depth (first that is there).

    A surface whose normal is 0, which says nothing, is taken to face the camera.
    """
    gbuffer = frame.gbuffer
    if Buffer.NOV in gbuffer:
        return gbuffer[Buffer.NOV].clamp(0.0, 1.0)
    nov = _find_view_cosine(frame)
    unfaced = (gbuffer[Buffer.NORMAL] == 0).all(1, keepdim=True) & (derive_sky(gbuffer) < 0.5)
    return nov.masked_fill_(unfaced, 1.0)


def _find_view_cosine(frame: Frame) -> Plane:
    gbuffer = frame.gbuffer
    normal = gbuffer[Buffer.NORMAL]
    nov = view_cosine_from_camera(
        normal, frame.camera, frame.view, jitter_px=frame.camera.jitter_px
    )
    if nov is not None:
        return nov
    position = gbuffer[Buffer.POSITION]
    camera = camera_from_positions(position, gbuffer[Buffer.DEPTH])
    if camera is None:
        return torch.ones_like(normal[:, :1])
    return view_cosine(normal, camera.to(normal).view(1, 3, 1, 1) - position)


def derive_view_normal(frame: Frame) -> Vector3:
    """Normals in the space of the camera; sky stays 0.

    n_view = n_world . R,   R the rotation of `worldToCamera` without its scale, row vectors
    """
    if Buffer.VIEW_NORMAL in frame.gbuffer:
        return frame.gbuffer[Buffer.VIEW_NORMAL]
    normal, matrix = frame.gbuffer[Buffer.NORMAL], frame.camera.world_to_camera
    if matrix is None:
        raise MissingBufferError(
            f"{frame.gbuffer.where}: normals cannot be brought to camera space without the "
            "camera's matrices; write worldToCamera and worldToNDC into the headers or a side-car"
        )
    rotation = matrix[:3, :3] / matrix[:3, :3].norm(dim=0, keepdim=True)
    return torch.einsum("nihw,ij->njhw", normal, rotation.to(normal))
