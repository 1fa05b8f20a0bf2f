"""What every random scene is put together with: free spots, flights, lamps, paths, skies."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from rtsr_cli.core.synth import materials as mat
from rtsr_cli.core.synth import props
from rtsr_cli.core.synth.scene import Body, CameraPath, Light, Part, RigidMotion, Scene, Sky, Vec3

Rng = np.random.Generator

EYE_CLEARANCE_M = 1.3
"""No body comes nearer than that to the camera's path."""

ATTEMPTS = 40
"""Tries to find a free spot before a thing is left out."""


def draw_uniform(rng: Rng, low: float, high: float) -> float:
    """Random number."""
    return float(rng.uniform(low, high))


def scale_color(color: Vec3, factor: float) -> Vec3:
    """Brighter or darker colour."""
    r, g, b = (c * factor for c in color)
    return r, g, b


@dataclass
class SceneBuilder:
    """A scene in the making.

    Attributes:
        rng: source of every choice.
        camera: path that must stay free.
        floor: (x0, x1, y0, y1) where things may stand.
        bodies, lights: so far.
        taken: circles (x, y, radius) that are occupied.
    """

    rng: Rng
    camera: CameraPath
    floor: tuple[float, float, float, float]
    bodies: list[Body] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    taken: list[tuple[float, float, float]] = field(default_factory=list)

    def add(
        self,
        name: str,
        parts: tuple[Part, ...],
        motion: RigidMotion | None = None,
        *,
        casts_shadow: bool = True,
        shell: bool = False,
    ) -> None:
        """Add a body with the next id."""
        self.bodies.append(
            Body(
                name=name,
                object_id=len(self.bodies) + 1,
                parts=parts,
                motion=motion or RigidMotion(),
                casts_shadow=casts_shadow,
                shell=shell,
            )
        )

    def _clear_of_camera(self, x: float, y: float, radius: float) -> bool:
        for number in range(0, 200, 4):
            eye = self.camera.eye.position(number)
            if math.hypot(eye[0] - x, eye[1] - y) < radius + EYE_CLEARANCE_M:
                return False
        return True

    def spot(self, radius: float) -> tuple[float, float] | None:
        """Find a free circle on the floor."""
        x0, x1, y0, y1 = self.floor
        for _ in range(ATTEMPTS):
            x, y = draw_uniform(self.rng, x0, x1), draw_uniform(self.rng, y0, y1)
            free = all(math.hypot(x - a, y - b) > radius + r for a, b, r in self.taken)
            if free and self._clear_of_camera(x, y, radius):
                self.taken.append((x, y, radius))
                return x, y
        return None

    def furnish(self, count: int, kinds: tuple[Callable[..., tuple[Part, ...]], ...]) -> None:
        """Stand things on free spots."""
        for _ in range(count):
            kind = kinds[int(self.rng.integers(len(kinds)))]
            size = draw_uniform(self.rng, 0.3, 0.65)
            parts = kind(self.rng, size)
            reach = max(math.hypot(p.offset_m[0], p.offset_m[1]) + max(p.half_m[:2]) for p in parts)
            if kind is props.railing:
                reach = 2.4 * size
            free_spot = self.spot(reach)
            if free_spot is not None:
                turn = (0.0, 0.0, draw_uniform(self.rng, 0.0, 2 * math.pi))
                self.add(kind.__name__, parts, RigidMotion(origin_m=(*free_spot, 0.0), turn=turn))

    def fly(self, count: int, height: tuple[float, float]) -> None:
        """Let things move through the air above the floor, turning."""
        x0, x1, y0, y1 = self.floor
        for _ in range(count):
            kind = props.FLYING[int(self.rng.integers(len(props.FLYING)))]
            size = draw_uniform(self.rng, 0.35, 0.75)
            for _ in range(ATTEMPTS):
                x, y = draw_uniform(self.rng, x0, x1), draw_uniform(self.rng, y0, y1)
                reach = draw_uniform(self.rng, 0.3, 1.4)
                if self._clear_of_camera(x, y, reach + 1.2 * size):
                    motion = self._flight(x, y, draw_uniform(self.rng, *height), reach)
                    self.add(kind.__name__, kind(self.rng, size), motion)
                    break

    def _flight(self, x: float, y: float, z: float, reach: float) -> RigidMotion:
        rng = self.rng
        heading = draw_uniform(rng, 0.0, 2 * math.pi)
        spin = rng.normal(size=3)
        spin *= draw_uniform(rng, 0.01, 0.06) / np.linalg.norm(spin)
        return RigidMotion(
            origin_m=(x, y, z),
            drift_m=(
                reach * math.cos(heading),
                reach * math.sin(heading),
                draw_uniform(rng, -0.3, 0.3),
            ),
            sway_m=(-0.5 * reach * math.sin(heading), 0.5 * reach * math.cos(heading), 0.1),
            rate=draw_uniform(rng, 0.02, 0.07),
            phase=draw_uniform(rng, 0.0, 6.28),
            turn=(draw_uniform(rng, -3, 3), draw_uniform(rng, -3, 3), draw_uniform(rng, -3, 3)),
            spin=(float(spin[0]), float(spin[1]), float(spin[2])),
        )

    def lamp(self, at: RigidMotion, color: Vec3, *, radius: float, reach_m: float = 12.0) -> None:
        """Add a shining ball with its light."""
        glow = scale_color(color, 1.0 / (math.pi * radius * radius) * 0.05)
        self.add("lamp", (props.ball(radius, mat.lamp(glow)),), at, casts_shadow=False)
        self.lights.append(Light(color=color, motion=at, softness=radius, reach_m=reach_m))

    def scene(
        self, seed: int, name: str, sky: Sky, ambient: Sky, room: tuple[Vec3, Vec3] | None = None
    ) -> Scene:
        """Put it together."""
        return Scene(
            seed=seed,
            arrangement=name,
            bodies=tuple(self.bodies),
            lights=tuple(self.lights),
            sky=sky,
            ambient=ambient,
            camera=self.camera,
            room_m=room,
        )


def draw_loop_path(rng: Rng, eye: Vec3, target: Vec3, reach: float) -> CameraPath:
    """A slow loop about a point, looking at another that wanders."""
    heading = draw_uniform(rng, 0.0, 2 * math.pi)
    rate = math.exp(draw_uniform(rng, math.log(0.02), math.log(0.12)))
    rate *= 1 if rng.random() < 0.5 else -1
    along = (reach * math.cos(heading), reach * math.sin(heading), draw_uniform(rng, -0.15, 0.15))
    across = (-0.5 * along[1], 0.5 * along[0], draw_uniform(rng, -0.1, 0.1))
    wander = (
        draw_uniform(rng, -1.2, 1.2),
        draw_uniform(rng, -1.2, 1.2),
        draw_uniform(rng, -0.3, 0.3),
    )
    phase = draw_uniform(rng, 0.0, 6.28)
    return CameraPath(
        eye=RigidMotion(origin_m=eye, drift_m=along, sway_m=across, rate=rate, phase=phase),
        target=RigidMotion(
            origin_m=target, drift_m=wander, rate=draw_uniform(rng, 0.03, 0.09), phase=phase
        ),
        fov_deg=draw_uniform(rng, 48.0, 75.0),
    )


def draw_day_sky(rng: Rng) -> tuple[Sky, Light]:
    """A sky and its sun: noon, late or overcast."""
    kind = rng.random()
    elevation = draw_uniform(rng, 0.5, 1.1) if kind < 0.55 else draw_uniform(rng, 0.2, 0.45)
    azimuth = draw_uniform(rng, 0.0, 2 * math.pi)
    towards = (
        math.cos(elevation) * math.cos(azimuth),
        math.cos(elevation) * math.sin(azimuth),
        math.sin(elevation),
    )
    low_sun = max(0.0, 1.0 - elevation / 0.6)
    overcast = kind > 0.85
    blue = draw_uniform(rng, 0.7, 1.1)
    sun = (12.0, 11.4 - 3.6 * low_sun, 10.2 - 6.5 * low_sun)
    sky = Sky(
        zenith=(0.30, 0.58, 1.35 * blue),
        horizon=(1.20 + 0.8 * low_sun, 1.30, 1.60 - 0.5 * low_sun),
        ground=(0.16, 0.14, 0.12),
        clouds=draw_uniform(rng, 0.2, 1.0),
        sun_glow=scale_color(sun, 2.0),
        ambient=0.7,
    )
    if overcast:
        sun = (1.6, 1.6, 1.65)
        sky = Sky(
            zenith=(0.55, 0.58, 0.64), horizon=(0.75, 0.77, 0.8), ground=(0.18, 0.17, 0.16),
            clouds=0.9, sun_glow=(0.3, 0.3, 0.3),
        )  # fmt: skip
    swing = draw_uniform(rng, -0.004, 0.004) if rng.random() < 0.3 else 0.0
    motion = RigidMotion(origin_m=towards, drift_m=(0.3, -0.3, 0.0), rate=swing)
    return sky, Light(
        color=sun,
        motion=motion,
        distant=True,
        softness=0.25 if overcast else draw_uniform(rng, 0.008, 0.03),
    )
