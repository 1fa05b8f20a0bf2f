"""Finding how a dump stores normals: their length tells packing, what faces the camera axes."""

from __future__ import annotations

from dataclasses import dataclass

from rtsr_cli.core.captures.measuring.geometry_finder import LEAST_POINTS, ThinnedFrame
from rtsr_cli.core.errors import MissingBufferError
from rtsr_cli.core.frames.camera import CameraMetadata, View, view_cosine_from_camera
from rtsr_cli.core.frames.conventions import NormalConvention, NormalSpace, normal_to_world
from rtsr_cli.core.frames.vector_length import vector_length
from rtsr_cli.core.shapes import Vector3

UNIT_TOLERANCE = 0.1
"""Unit normals: mean deviation of their length from 1."""


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


def find_normals(stored: Vector3, camera: CameraMetadata, view: View) -> NormalFinding:
    """Tell packed from plain by length, and world from view space by what faces the camera."""
    thinning = ThinnedFrame.of(stored)
    stored, camera, view = thinning.image(stored), thinning.camera(camera), thinning.view(view)
    plain, unpacked = stored, stored * 2.0 - 1.0
    lengths = {False: vector_length(plain), True: vector_length(unpacked)}
    there = {packed: size > 0.1 for packed, size in lengths.items()}
    if min(int(mask.sum()) for mask in there.values()) < LEAST_POINTS:
        return NormalFinding(facing={})
    deviation = {p: float((lengths[p][there[p]] - 1.0).abs().mean()) for p in lengths}
    packed = deviation[True] < deviation[False]
    nonzero = there[packed]
    if deviation[packed] > UNIT_TOLERANCE:
        return NormalFinding(facing={})
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
