"""What a scene is made of: rigid bodies of simple convex parts, lights, a sky and a camera path.

Everything moves by closed formulas of the frame number, so that any frame can be had alone.
World space is right-handed, z up, in metres; matrices act on row vectors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
import torch
from numpy.typing import NDArray

from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.shapes import Size

Vec3 = tuple[float, float, float]
Matrix = NDArray[np.float64]
"""4 x 4, row-vector convention: `p_out = [x y z 1] . M`."""

NEAR_M = 0.05
"""Near plane of the projection; the far plane is at infinity."""

ZERO: Vec3 = (0.0, 0.0, 0.0)


class Shape(StrEnum):
    """Convex solids, each in a local frame of its own."""

    PLANE = "plane"
    BOX = "box"
    SPHERE = "sphere"
    CYLINDER = "cylinder"


class Pattern(StrEnum):
    """Baked texture patterns; see `textures`."""

    PLAIN = "plain"
    CHECKER = "checker"
    BRICKS = "bricks"
    TILES = "tiles"
    PLANKS = "planks"
    PLASTER = "plaster"
    STRIPES = "stripes"
    TEXT = "text"
    PANELS = "panels"
    WEAVE = "weave"
    DOTS = "dots"
    RUST = "rust"
    COBBLES = "cobbles"
    WINDOWS = "windows"


@dataclass(frozen=True, kw_only=True)
class Material:
    """How a pattern's mask (0..1) and tone (about -1..1) become surface properties.

    Attributes:
        pattern: the texture.
        colors: linear base colour where the mask is 0, and where it is 1.
        tone: relative change of the base colour by the pattern's tone.
        roughness: perceptual, where the mask is 0 and 1.
        metallic: where the mask is 0 and 1.
        bump: factor on the pattern's slopes.
        glow: emitted radiance where the mask is 1.
        size_m: one period of the pattern.
        shift: of the pattern, in periods.
    """

    pattern: Pattern = Pattern.PLAIN
    colors: tuple[Vec3, Vec3] = ((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))
    tone: float = 0.15
    roughness: tuple[float, float] = (0.6, 0.6)
    metallic: tuple[float, float] = (0.0, 0.0)
    bump: float = 0.0
    glow: Vec3 = ZERO
    size_m: float = 1.0
    shift: tuple[float, float] = (0.0, 0.0)


def rotation(vector: Vec3) -> Matrix:
    """3 x 3 matrix of a rotation vector (axis times angle), acting on row vectors [Rodrigues]."""
    angle = math.sqrt(sum(v * v for v in vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = (v / angle for v in vector)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    column = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    return np.ascontiguousarray(column.T)


def transform(turn: Matrix, shift: NDArray[np.float64]) -> Matrix:
    """4 x 4 matrix: turn, then shift."""
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    matrix[3, :3] = shift
    return matrix


@dataclass(frozen=True, kw_only=True)
class RigidMotion:
    """A pose for every frame number n.

        position = origin + drift sin(rate n + phase) + sway cos(rate n + phase)
        orientation = turn, then `spin` n

    Attributes:
        origin_m, drift_m, sway_m: see above.
        rate: rad a frame.
        phase: rad.
        turn: rotation vector at rest.
        spin: rotation vector of one frame.
    """

    origin_m: Vec3 = ZERO
    drift_m: Vec3 = ZERO
    sway_m: Vec3 = ZERO
    rate: float = 0.0
    phase: float = 0.0
    turn: Vec3 = ZERO
    spin: Vec3 = ZERO

    @property
    def moving(self) -> bool:
        """Tell whether any two frames can differ."""
        drifts = self.rate != 0.0 and (self.drift_m != ZERO or self.sway_m != ZERO)
        return drifts or self.spin != ZERO

    def position(self, number: float) -> NDArray[np.float64]:
        """Position at a frame."""
        angle = self.rate * number + self.phase
        drift, sway = np.array(self.drift_m), np.array(self.sway_m)
        return np.array(self.origin_m) + drift * math.sin(angle) + sway * math.cos(angle)

    def pose(self, number: float) -> Matrix:
        """Local to world at a frame."""
        x, y, z = (v * number for v in self.spin)
        return transform(rotation(self.turn) @ rotation((x, y, z)), self.position(number))


@dataclass(frozen=True, kw_only=True)
class Part:
    """One solid of a body.

    Attributes:
        shape: which one.
        half_m: half extents of a box; of a cylinder (axis along local z) radius, radius, half
            length; of a sphere the radius thrice; unused by a plane (local z = 0, upper side).
        material: its surface.
        offset_m, turn: pose in the body.
    """

    shape: Shape
    half_m: Vec3
    material: Material
    offset_m: Vec3 = ZERO
    turn: Vec3 = ZERO

    @property
    def pose(self) -> Matrix:
        """Part to body."""
        return transform(rotation(self.turn), np.array(self.offset_m))


@dataclass(frozen=True, kw_only=True)
class Body:
    """Parts that move as one and share an object id.

    Attributes:
        name: what it is.
        object_id: from 1.
        parts: its solids.
        motion: its pose by frame.
        casts_shadow: False for lamps, which would shade their own light.
        shell: True for what encloses the scene: it does not darken the ambient light.
    """

    name: str
    object_id: int
    parts: tuple[Part, ...]
    motion: RigidMotion = field(default_factory=RigidMotion)
    casts_shadow: bool = True
    shell: bool = False


@dataclass(frozen=True, kw_only=True)
class Light:
    """A light with a shadow.

    Attributes:
        color: irradiance of a surface facing it; at a distance of 1 m unless `distant`.
        motion: its position, or the direction towards it if `distant`.
        distant: True for a sun.
        softness: radius of the light, m (of a sun: tangent of its angular radius).
        aim_m: what a spot light points at, None for one that shines everywhere.
        cone_cos: cosines of the half angles at which a spot begins and ends to fade.
        reach_m: distance at which it has faded to nothing.
    """

    color: Vec3
    motion: RigidMotion
    distant: bool = False
    softness: float = 0.05
    aim_m: Vec3 | None = None
    cone_cos: tuple[float, float] = (0.95, 0.8)
    reach_m: float = 20.0


@dataclass(frozen=True, kw_only=True)
class Sky:
    """Radiance of what no ray hits, and the ambient light.

    Attributes:
        zenith, horizon, ground: radiance by elevation.
        clouds: strength of clouds, 0..1.
        ambient: factor on the light that the sky throws into the scene.
        sun_glow: radiance around the sun.
    """

    zenith: Vec3
    horizon: Vec3
    ground: Vec3
    clouds: float = 0.5
    ambient: float = 1.0
    sun_glow: Vec3 = ZERO


@dataclass(frozen=True, kw_only=True)
class CameraPath:
    """Where the camera is and what it looks at; `fov_deg` is horizontal."""

    eye: RigidMotion
    target: RigidMotion
    fov_deg: float = 60.0

    def still(self) -> CameraPath:
        """Return the path of a camera that stays where it is at frame 1."""

        def stop(motion: RigidMotion) -> RigidMotion:
            x, y, z = motion.position(1).tolist()
            return RigidMotion(origin_m=(x, y, z))

        return replace(self, eye=stop(self.eye), target=stop(self.target))

    def metadata(self, number: int, size: Size, jitter_px: Jitter = (0.0, 0.0)) -> CameraMetadata:
        """Matrices of a frame of `size` (height, width), float64."""
        eye = self.eye.position(number)
        forward = self.target.position(number) - eye
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        world_to_camera = np.eye(4)
        world_to_camera[:3, :3] = np.stack([right, up, -forward], axis=1)
        world_to_camera[3, :3] = -eye @ world_to_camera[:3, :3]
        focal = 1.0 / math.tan(math.radians(self.fov_deg) / 2.0)
        projection = np.zeros((4, 4))
        projection[0, 0], projection[1, 1] = focal, focal * size[1] / size[0]
        projection[2, 2] = projection[2, 3] = -1.0
        projection[3, 2] = -NEAR_M
        return CameraMetadata(
            world_to_camera=torch.from_numpy(world_to_camera),
            world_to_ndc=torch.from_numpy(world_to_camera @ projection),
            jitter_px=jitter_px,
        )


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A scene and its animation.

    Attributes:
        seed: what it was made from.
        arrangement: name of the kind of place.
        bodies, lights, sky, camera: its content.
        ambient: what lights it from all directions: the sky, or the walls of a room.
        exposure: factor on every radiance.
        room_m: lower and upper corner of an enclosing room, None outdoors.
    """

    seed: int
    arrangement: str
    bodies: tuple[Body, ...]
    lights: tuple[Light, ...]
    sky: Sky
    ambient: Sky
    camera: CameraPath
    exposure: float = 1.0
    room_m: tuple[Vec3, Vec3] | None = None

    def still(self) -> Scene:
        """Return the scene seen by a camera that does not move."""
        return replace(self, camera=self.camera.still())
