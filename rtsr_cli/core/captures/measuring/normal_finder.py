"""Finding how a dump stores normals: their length tells packing, what faces the camera axes."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.geometry_finder import LEAST_POINTS, ThinnedFrame
from rtsr_cli.core.errors import MissingBufferError
from rtsr_cli.core.frames.camera import CameraMetadata, View, view_cosine_from_camera
from rtsr_cli.core.frames.conventions import NormalConvention, NormalSpace, normal_to_world
from rtsr_cli.core.frames.vector_length import normalize_vectors, vector_length
from rtsr_cli.core.shapes import Vector3

LEAST_LENGTH = 0.1
"""Shorter vectors are no normals: sky."""

UNIT_TOLERANCE = 0.1
"""Unit normals: mean deviation of their length from 1."""

ONE_VALUE = 0.99
"""Share of the surfaces that have one vector where a pass holds nothing else."""

SAME = 1e-3
"""Difference up to which components of vectors are one."""


def measure_likeness(vectors: Tensor) -> float:
    """Share of vectors, 3 n, that are the most usual one; of none all are."""
    if not vectors.shape[1]:
        return 1.0
    usual = vectors.median(dim=1, keepdim=True).values
    return float(((vectors - usual).abs() < SAME).all(0).float().mean())


@dataclass(frozen=True, kw_only=True)
class NormalFinding:
    """What the stored normals are; a part is None where the files do not tell.

    Attributes:
        packed: whether (n + 1) / 2 is stored.
        space: axes.
        facing: share of surfaces that face the camera, for each space that could be tried.
    """

    packed: bool | None = None
    space: NormalSpace | None = None
    facing: dict[str, float]


def find_packing(stored: Vector3) -> bool | None:
    """Tell whether (n + 1) / 2 is stored, by which reading has unit length; None if none has."""
    lengths = {False: vector_length(stored), True: vector_length(stored * 2.0 - 1.0)}
    there = {packed: size > LEAST_LENGTH for packed, size in lengths.items()}
    if min(int(mask.sum()) for mask in there.values()) < LEAST_POINTS:
        return None
    deviation = {p: float((lengths[p][there[p]] - 1.0).abs().mean()) for p in lengths}
    packed = deviation[True] < deviation[False]
    return None if deviation[packed] > UNIT_TOLERANCE else packed


def unpack_normals(stored: Vector3) -> Vector3 | None:
    """Stored normals as vectors of length 1, or 0 where there is none; None if they are none.

    One vector everywhere is no normal of surfaces: it tells nothing of a camera.
    """
    packed = find_packing(stored)
    if packed is None:
        return None
    normal = stored * 2.0 - 1.0 if packed else stored
    there = torch.isfinite(normal).all(1, keepdim=True) & (vector_length(normal) > LEAST_LENGTH)
    if measure_likeness(normal[0][:, there[0, 0]]) > ONE_VALUE:
        return None
    return normalize_vectors(torch.where(there, normal, torch.zeros_like(normal)))


def find_normals(stored: Vector3, camera: CameraMetadata, view: View) -> NormalFinding:
    """Tell packed from plain by length, and world from view space by what faces the camera."""
    thinning = ThinnedFrame.of(stored)
    stored, camera, view = thinning.image(stored), thinning.camera(camera), thinning.view(view)
    packed = find_packing(stored)
    if packed is None:
        return NormalFinding(facing={})
    nonzero = vector_length(stored * 2.0 - 1.0 if packed else stored) > LEAST_LENGTH
    if measure_likeness(stored[0][:, nonzero[0, 0]]) > ONE_VALUE:
        return NormalFinding(packed=packed, facing={})
    facing = {}
    for space in NormalSpace:
        convention = NormalConvention(space=space, packed=packed)
        try:
            world = normal_to_world(stored, convention, camera, where="")
        except MissingBufferError:
            continue
        cosine = view_cosine_from_camera(world, camera, view, jitter_px=camera.jitter_px)
        if cosine is not None:
            facing[space.value] = float((cosine[nonzero] > 0).float().mean())
    best = max(facing, key=lambda name: facing[name]) if facing else None
    clear = len(facing) == 2 and max(facing.values()) - min(facing.values()) > 0.02
    return NormalFinding(
        packed=packed,
        space=NormalSpace(best) if best is not None and clear else None,
        facing=facing,
    )
