"""How files store what memory holds in one way: depth, normals, roughness, specular."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.errors import MissingBufferError
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer
from rtsr_cli.core.frames.camera import (
    GIVE_CAMERAS,
    CameraMetadata,
    View,
    device_to_planar_depth,
    list_near_planes,
    planar_to_device_depth,
    ray_axes,
)
from rtsr_cli.core.frames.motion import (
    Jitter,
    MotionConvention,
    motion_to_pixels,
)
from rtsr_cli.core.frames.ray_lengths import RayLengths, measure_ray_lengths
from rtsr_cli.core.frames.vector_length import normalize_vectors
from rtsr_cli.core.shapes import Plane, Vector3

SKY_MARKER_TOLERANCE = 1e-3
"""A stored normal this close to the marker of sky is it: the step of a half just below 2."""


class DepthKind(StrEnum):
    """What a stored depth measures."""

    PLANAR = "planar"
    RAY = "ray"
    DEVICE = "device"


class NormalSpace(StrEnum):
    """The axes of stored normals."""

    WORLD = "world"
    VIEW = "view"


class RoughnessKind(StrEnum):
    """What a stored roughness is."""

    PERCEPTUAL = "perceptual"
    ALPHA = "alpha"
    SMOOTHNESS = "smoothness"


class ColorSpace(StrEnum):
    """Primaries of linear scene-referred radiance; with `_scene` behind, its interchange name."""

    REC709 = "lin_rec709"
    REC2020 = "lin_rec2020"
    P3D65 = "lin_p3d65"
    AP1 = "lin_ap1"
    AP0 = "lin_ap0"

    @classmethod
    def _missing_(cls, value: object) -> ColorSpace | None:
        """Accept the names that the ACES spaces are better known by."""
        known = {"acescg": cls.AP1, "aces2065-1": cls.AP0}
        return known.get(value.lower()) if isinstance(value, str) else None


class SpecularWorkflow(StrEnum):
    """Whether F0 follows from base colour and metallic or is stored."""

    METALLIC = "metallic"
    F0 = "f0"


class SkyRule(StrEnum):
    """What is sky, where no stored value of depth is declared to be."""

    FAR = "far"
    NAN = "nan"
    NONE = "none"
    NORMAL = "normal"
    OBJECT_ID = "object_id"
    ALPHA = "alpha"


SKY_MARKERS: Mapping[SkyRule, Buffer] = {
    SkyRule.NORMAL: Buffer.NORMAL,
    SkyRule.OBJECT_ID: Buffer.OBJECT_ID,
    SkyRule.ALPHA: Buffer.ALPHA,
}
"""Buffers whose zeros are sky."""


@dataclass(frozen=True, kw_only=True)
class DepthConvention:
    """How a file stores depth.

    Attributes:
        kind: along the camera axis, along the ray, or the depth buffer's own value.
        reversed: device depth only: 1 is near and 0 is far.
        unit_m: metres in one stored unit.
        sky: stored values from here on are sky: upwards if above 0, else downwards; or a rule:
            infinite and from `SKY_DEPTH_M` metres on (the default; of device depth the far end),
            nothing, or also where depth is NaN, or the normal, the object id or the coverage is 0.
        from_near: ray distance only: it is measured from the near plane, not from the camera.
        near_m: depth of that plane in metres; None takes it from the camera's matrices.
    """

    kind: DepthKind = DepthKind.PLANAR
    reversed: bool = False
    unit_m: float = 1.0
    sky: float | SkyRule | None = None
    from_near: bool = False
    near_m: float | None = None


@dataclass(frozen=True, kw_only=True)
class NormalConvention:
    """How a file stores normals.

    Attributes:
        space: their axes.
        packed: (n + 1) / 2 is stored.
        sky: stored vector that marks sky; such a normal is zero in memory, and its depth sky.
    """

    space: NormalSpace = NormalSpace.WORLD
    packed: bool = False
    sky: tuple[float, float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class Conventions:
    """Everything about a dump that its channel names do not say.

    `colorspace` is None where nobody declared it: pictures then take it for Rec.709, and outputs
    carry no tag. `position_unit_m` is metres in one stored unit of world positions, None where
    that is depth's unit.
    """

    motion: MotionConvention = field(default_factory=MotionConvention)
    depth: DepthConvention = field(default_factory=DepthConvention)
    normal: NormalConvention = field(default_factory=NormalConvention)
    roughness: RoughnessKind = RoughnessKind.PERCEPTUAL
    specular: SpecularWorkflow = SpecularWorkflow.METALLIC
    colorspace: ColorSpace | None = None
    position_unit_m: float | None = None

    @property
    def metres_per_position(self) -> float:
        """Metres in one stored unit of world positions."""
        return self.depth.unit_m if self.position_unit_m is None else self.position_unit_m


def depth_to_metres(
    stored: Plane,
    convention: DepthConvention,
    camera: CameraMetadata,
    view: View,
    *,
    where: str,
    position_m: Vector3 | None = None,
) -> Plane:
    """Convert stored depth to planar metres, sky = `SKY_DEPTH_M`.

    Args:
        stored: as files hold it.
        convention: how they do.
        camera: of the frame.
        view: where the frame lies in the image plane.
        where: folder and frame, for messages.
        position_m: world positions, which ray distances become planar by without a camera.

    Raises:
        MissingBufferError: ray or device depth without camera matrices.
    """
    if convention.kind is DepthKind.DEVICE:
        projection = _require_projection(camera, where)
        metres = device_to_planar_depth(stored, projection, reversed_depth=convention.reversed)
        return _mark_sky(metres, is_sky_depth(stored, convention), convention)
    metres = stored * convention.unit_m
    plain = convention.kind is DepthKind.PLANAR and convention.sky in {None, *_BY_FAR}
    if plain and convention.unit_m == 1.0:
        # what lies beyond the sky is the sky, so that a bound says it all, but for -inf
        return metres.clamp_(max=SKY_DEPTH_M).masked_fill_(stored == -torch.inf, SKY_DEPTH_M)
    sky = is_sky_depth(stored, convention)
    if convention.kind is DepthKind.RAY:
        if position_m is None:
            metres = metres / _measure_rays(stored, camera, view, where)
        else:
            rays = _fit_rays(torch.where(sky, 0.0, metres), position_m, where)
            return _mark_sky(metres / rays.length + rays.start_m, sky, convention)
        metres = metres + _measure_start(convention, camera, where)
    return _mark_sky(metres, sky, convention)


_BY_FAR = (SkyRule.FAR, SkyRule.NORMAL, SkyRule.OBJECT_ID, SkyRule.ALPHA)
"""Rules by which far and infinite depth is sky; other buffers mark more of it."""

FARTHEST_M = float(np.nextafter(np.float32(SKY_DEPTH_M), np.float32(0.0)))
"""Depth of surfaces that lie as far as the sky, where nothing is sky."""


def is_sky_depth(stored: Plane, convention: DepthConvention) -> Tensor:
    """True where stored depth itself is the sky's."""
    rule = convention.sky
    if rule is SkyRule.NONE:
        return torch.zeros_like(stored, dtype=torch.bool)
    if rule is not None and not isinstance(rule, SkyRule):
        return (stored >= rule if rule > 0.0 else stored <= rule) | torch.isinf(stored)
    if convention.kind is DepthKind.DEVICE:
        cleared = stored <= 0.0 if convention.reversed else stored >= 1.0
        return cleared | torch.isnan(stored) if rule is SkyRule.NAN else cleared
    # half files cannot hold more than their largest value, whatever the unit
    far = stored * convention.unit_m >= SKY_DEPTH_M
    beyond = far | (stored == SKY_DEPTH_M) | torch.isinf(stored)
    return beyond | torch.isnan(stored) if rule is SkyRule.NAN else beyond


def _mark_sky(metres: Plane, sky: Tensor, convention: DepthConvention) -> Plane:
    """Give the sky its depth; where nothing is sky, nothing lies as far."""
    if convention.sky is SkyRule.NONE:
        return metres.nan_to_num(nan=torch.nan, neginf=FARTHEST_M).clamp(max=FARTHEST_M)
    return torch.where(sky, torch.full_like(metres, SKY_DEPTH_M), metres.clamp(max=SKY_DEPTH_M))


def depth_from_metres(
    depth_m: Plane, convention: DepthConvention, camera: CameraMetadata, view: View, *, where: str
) -> Plane:
    """Invert `depth_to_metres`; sky is stored as `convention.sky`, or the value of memory.

    Raises:
        MissingBufferError: ray or device depth without camera matrices.
    """
    if convention.kind is DepthKind.DEVICE:
        projection = _require_projection(camera, where)
        return planar_to_device_depth(depth_m, projection, reversed_depth=convention.reversed)
    stored = depth_m / convention.unit_m
    if convention.kind is DepthKind.RAY:
        start = _measure_start(convention, camera, where)
        stored = (depth_m - start) / convention.unit_m * _measure_rays(depth_m, camera, view, where)
    rule = convention.sky
    sky = SKY_DEPTH_M if rule is None or isinstance(rule, SkyRule) else rule
    return torch.where(depth_m >= SKY_DEPTH_M, torch.full_like(stored, sky), stored)


def _require_projection(camera: CameraMetadata, where: str) -> Tensor:
    projection = camera.projection
    if projection is None:
        raise MissingBufferError(_needs_camera(where, "device depth"))
    return projection


def _measure_start(convention: DepthConvention, camera: CameraMetadata, where: str) -> float:
    """Depth at which ray distances begin: 0, or that of the near plane.

    A ray that starts on the near plane (planar depth n) and is t long ends at n + t / L, where L
    is the length of a ray to the plane one metre ahead.
    """
    if not convention.from_near:
        return 0.0
    if convention.near_m is not None:
        return convention.near_m
    planes = list_near_planes(_require_projection(camera, where))
    if not planes:
        raise MissingBufferError(
            f"{where}: the camera matrices tell no near plane, from which distances are declared "
            "to be measured; declare it in capture.toml: [depth] near = 0.05"
        )
    return planes[0]


def _measure_rays(depth: Plane, camera: CameraMetadata, view: View, where: str) -> Plane:
    """Length of every pixel's view ray from the camera to the plane one metre ahead."""
    size = (depth.shape[-2], depth.shape[-1])
    axes = ray_axes(camera, view, size, jitter_px=camera.jitter_px)
    if axes is None:
        raise MissingBufferError(_needs_camera(where, "ray distance"))
    return (1.0 + axes[0] ** 2 + axes[1] ** 2).sqrt()


def _fit_rays(distance_m: Plane, position_m: Vector3, where: str) -> RayLengths:
    lengths = measure_ray_lengths(distance_m, position_m)
    if lengths is None:
        raise MissingBufferError(
            f"{where}: depth is ray distance, and the world positions do not tell the camera that "
            f"makes it planar: too few surfaces, or not at these distances; {GIVE_CAMERAS}"
        )
    return lengths


def normal_to_world(
    stored: Vector3, convention: NormalConvention, camera: CameraMetadata, *, where: str
) -> Vector3:
    """Unpack, rotate to world space and normalise; a zero normal stays zero, and so does sky.

    Raises:
        MissingBufferError: view-space normals without a camera matrix.
    """
    normal = stored * 2.0 - 1.0 if convention.packed else stored
    if convention.space is NormalSpace.VIEW:
        if camera.world_to_camera is None:
            raise MissingBufferError(_needs_camera(where, "view-space normals"))
        rotation = camera.world_to_camera[:3, :3].to(normal)
        normal = torch.einsum("nchw,dc->ndhw", normal, rotation)
    if convention.sky is None:
        return normalize_vectors(normal)
    marker = torch.tensor(convention.sky, dtype=stored.dtype).view(1, 3, 1, 1)
    sky = ((stored - marker).abs() < SKY_MARKER_TOLERANCE).all(1, keepdim=True)
    return normalize_vectors(normal).masked_fill(sky, 0.0)


def normal_from_world(
    normal: Vector3, convention: NormalConvention, camera: CameraMetadata, *, where: str
) -> Vector3:
    """Invert `normal_to_world`; a zero normal is stored as the marker of sky.

    Raises:
        MissingBufferError: view-space normals without a camera matrix.
    """
    stored = normal
    if convention.space is NormalSpace.VIEW:
        if camera.world_to_camera is None:
            raise MissingBufferError(_needs_camera(where, "view-space normals"))
        rotation = torch.linalg.inv(camera.world_to_camera[:3, :3]).to(normal)
        stored = torch.einsum("nchw,dc->ndhw", normal, rotation)
    stored = (stored + 1.0) / 2.0 if convention.packed else stored
    if convention.sky is None:
        return stored
    marker = torch.tensor(convention.sky, dtype=normal.dtype).view(1, 3, 1, 1)
    return torch.where((normal == 0).all(1, keepdim=True), marker, stored)


def roughness_to_perceptual(stored: Plane, kind: RoughnessKind) -> Plane:
    """Perceptual roughness r, of which GGX alpha is the square."""
    if kind is RoughnessKind.ALPHA:
        return stored.clamp(min=0.0).sqrt()
    return 1.0 - stored if kind is RoughnessKind.SMOOTHNESS else stored


def roughness_from_perceptual(roughness: Plane, kind: RoughnessKind) -> Plane:
    """Invert `roughness_to_perceptual`."""
    if kind is RoughnessKind.ALPHA:
        return roughness.square()
    return 1.0 - roughness if kind is RoughnessKind.SMOOTHNESS else roughness


def _needs_camera(where: str, what: str) -> str:
    return (
        f"{where}: {what} needs the camera matrices worldToCamera and worldToNDC; "
        f"the header has none: {GIVE_CAMERAS}"
    )


@dataclass(frozen=True, kw_only=True)
class StoredFrame:
    """What is known about a frame whose buffers are about to be converted.

    Attributes:
        conventions: how the files store them.
        camera: of this frame.
        view: where the frame lies in the image plane.
        jitter_px_prev: jitter of the previous frame.
        where: folder and frame, for messages.
        position_m: world positions in memory's convention, where depth becomes planar by them.
    """

    conventions: Conventions
    camera: CameraMetadata
    view: View
    jitter_px_prev: Jitter
    where: str
    position_m: Vector3 | None = None


def to_memory(buffer: Buffer, stored: Tensor, frame: StoredFrame) -> Tensor:
    """Convert one buffer from its file's convention to memory's; `stored` may be overwritten.

    Raises:
        MissingBufferError: the conversion needs camera matrices that are not there.
    """
    convert = _CONVERSIONS.get(buffer)
    return convert(stored, frame) if convert else stored


def _depth(stored: Tensor, frame: StoredFrame) -> Tensor:
    return depth_to_metres(
        stored,
        frame.conventions.depth,
        frame.camera,
        frame.view,
        where=frame.where,
        position_m=frame.position_m,
    )


def _motion(stored: Tensor, frame: StoredFrame) -> Tensor:
    return motion_to_pixels(
        stored,
        frame.conventions.motion,
        screen=frame.view.display,
        jitter_px=frame.camera.jitter_px,
        jitter_px_prev=frame.jitter_px_prev,
    )


def _forward_motion(stored: Tensor, frame: StoredFrame) -> Tensor:
    return motion_to_pixels(stored, frame.conventions.motion.forward, screen=frame.view.display)


def _object_id(stored: Tensor, _: StoredFrame) -> Tensor:
    return stored if stored.dtype == torch.int32 else stored.round().to(torch.int32)


def _clamp_negative(stored: Tensor, _: StoredFrame) -> Tensor:
    """Colours below 0 are rounding of the renderer."""
    return stored.clamp_(min=0.0)


def _clamp_unit_interval(stored: Tensor, _: StoredFrame) -> Tensor:
    return stored.clamp_(0.0, 1.0)


def _roughness(stored: Tensor, frame: StoredFrame) -> Tensor:
    return roughness_to_perceptual(stored.clamp_(0.0, 1.0), frame.conventions.roughness)


def _normal(stored: Tensor, frame: StoredFrame) -> Tensor:
    return normal_to_world(stored, frame.conventions.normal, frame.camera, where=frame.where)


def _position(stored: Tensor, frame: StoredFrame) -> Tensor:
    return stored * frame.conventions.metres_per_position


_CONVERSIONS: Mapping[Buffer, Callable[[Tensor, StoredFrame], Tensor]] = {
    Buffer.DEPTH: _depth,
    Buffer.MOTION: _motion,
    Buffer.FORWARD: _forward_motion,
    Buffer.OBJECT_ID: _object_id,
    Buffer.ALBEDO: _clamp_negative,
    Buffer.SPECULAR: _clamp_negative,
    Buffer.MATERIAL: _clamp_negative,
    Buffer.EMISSION: _clamp_negative,
    Buffer.METALLIC: _clamp_unit_interval,
    Buffer.ROUGHNESS: _roughness,
    Buffer.NORMAL: _normal,
    Buffer.GEONORMAL: _normal,
    Buffer.POSITION: _position,
}
