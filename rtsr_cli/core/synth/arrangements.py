"""Random scenes: places indoors and outdoors, furnished, lit, and filmed on a moving path."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from rtsr_cli.core.synth import materials as mat
from rtsr_cli.core.synth import props
from rtsr_cli.core.synth.scene import (
    ZERO,
    Body,
    CameraPath,
    Light,
    Part,
    RigidMotion,
    Scene,
    Shape,
    Sky,
    Vec3,
)

Rng = np.random.Generator

EYE_CLEARANCE_M = 1.3
"""No body comes nearer than that to the camera's path."""

ATTEMPTS = 40
"""Tries to find a free spot before a thing is left out."""


def uniform(rng: Rng, low: float, high: float) -> float:
    """Random number."""
    return float(rng.uniform(low, high))


def _scaled(color: Vec3, factor: float) -> Vec3:
    r, g, b = (c * factor for c in color)
    return r, g, b


@dataclass
class Builder:
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
            x, y = uniform(self.rng, x0, x1), uniform(self.rng, y0, y1)
            free = all(math.hypot(x - a, y - b) > radius + r for a, b, r in self.taken)
            if free and self._clear_of_camera(x, y, radius):
                self.taken.append((x, y, radius))
                return x, y
        return None

    def furnish(self, count: int, kinds: tuple[Callable[..., tuple[Part, ...]], ...]) -> None:
        """Stand things on free spots."""
        for _ in range(count):
            kind = kinds[int(self.rng.integers(len(kinds)))]
            size = uniform(self.rng, 0.3, 0.65)
            parts = kind(self.rng, size)
            reach = max(math.hypot(p.offset_m[0], p.offset_m[1]) + max(p.half_m[:2]) for p in parts)
            if kind is props.railing:
                reach = 2.4 * size
            found = self.spot(reach)
            if found is not None:
                turn = (0.0, 0.0, uniform(self.rng, 0.0, 2 * math.pi))
                self.add(kind.__name__, parts, RigidMotion(origin_m=(*found, 0.0), turn=turn))

    def fly(self, count: int, height: tuple[float, float]) -> None:
        """Let things move through the air above the floor, turning."""
        x0, x1, y0, y1 = self.floor
        for _ in range(count):
            kind = props.FLYING[int(self.rng.integers(len(props.FLYING)))]
            size = uniform(self.rng, 0.35, 0.75)
            for _ in range(ATTEMPTS):
                x, y = uniform(self.rng, x0, x1), uniform(self.rng, y0, y1)
                reach = uniform(self.rng, 0.3, 1.4)
                if self._clear_of_camera(x, y, reach + 1.2 * size):
                    motion = self._flight(x, y, uniform(self.rng, *height), reach)
                    self.add(kind.__name__, kind(self.rng, size), motion)
                    break

    def _flight(self, x: float, y: float, z: float, reach: float) -> RigidMotion:
        rng = self.rng
        heading = uniform(rng, 0.0, 2 * math.pi)
        spin = rng.normal(size=3)
        spin *= uniform(rng, 0.01, 0.06) / np.linalg.norm(spin)
        return RigidMotion(
            origin_m=(x, y, z),
            drift_m=(reach * math.cos(heading), reach * math.sin(heading), uniform(rng, -0.3, 0.3)),
            sway_m=(-0.5 * reach * math.sin(heading), 0.5 * reach * math.cos(heading), 0.1),
            rate=uniform(rng, 0.02, 0.07),
            phase=uniform(rng, 0.0, 6.28),
            turn=(uniform(rng, -3, 3), uniform(rng, -3, 3), uniform(rng, -3, 3)),
            spin=(float(spin[0]), float(spin[1]), float(spin[2])),
        )

    def lamp(self, at: RigidMotion, color: Vec3, *, radius: float, reach_m: float = 12.0) -> None:
        """Add a shining ball with its light."""
        glow = _scaled(color, 1.0 / (math.pi * radius * radius) * 0.05)
        self.add("lamp", (props.ball(radius, mat.lamp(glow)),), at, casts_shadow=False)
        self.lights.append(Light(color=color, motion=at, softness=radius, reach_m=reach_m))

    def scene(self, seed: int, name: str, sky: Sky, ambient: Sky, room=None) -> Scene:  # type: ignore[no-untyped-def]
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


def _path(rng: Rng, eye: Vec3, target: Vec3, reach: float) -> CameraPath:
    """A slow loop about a point, looking at another that wanders."""
    heading = uniform(rng, 0.0, 2 * math.pi)
    rate = math.exp(uniform(rng, math.log(0.02), math.log(0.12)))
    rate *= 1 if rng.random() < 0.5 else -1
    along = (reach * math.cos(heading), reach * math.sin(heading), uniform(rng, -0.15, 0.15))
    across = (-0.5 * along[1], 0.5 * along[0], uniform(rng, -0.1, 0.1))
    wander = (uniform(rng, -1.2, 1.2), uniform(rng, -1.2, 1.2), uniform(rng, -0.3, 0.3))
    phase = uniform(rng, 0.0, 6.28)
    return CameraPath(
        eye=RigidMotion(origin_m=eye, drift_m=along, sway_m=across, rate=rate, phase=phase),
        target=RigidMotion(
            origin_m=target, drift_m=wander, rate=uniform(rng, 0.03, 0.09), phase=phase
        ),
        fov_deg=uniform(rng, 48.0, 75.0),
    )


def _day_sky(rng: Rng) -> tuple[Sky, Light]:
    """A sky and its sun: noon, late or overcast."""
    kind = rng.random()
    elevation = uniform(rng, 0.5, 1.1) if kind < 0.55 else uniform(rng, 0.2, 0.45)
    azimuth = uniform(rng, 0.0, 2 * math.pi)
    towards = (
        math.cos(elevation) * math.cos(azimuth),
        math.cos(elevation) * math.sin(azimuth),
        math.sin(elevation),
    )
    low_sun = max(0.0, 1.0 - elevation / 0.6)
    overcast = kind > 0.85
    blue = uniform(rng, 0.7, 1.1)
    sun = (12.0, 11.4 - 3.6 * low_sun, 10.2 - 6.5 * low_sun)
    sky = Sky(
        zenith=(0.30, 0.58, 1.35 * blue),
        horizon=(1.20 + 0.8 * low_sun, 1.30, 1.60 - 0.5 * low_sun),
        ground=(0.16, 0.14, 0.12),
        clouds=uniform(rng, 0.2, 1.0),
        sun_glow=_scaled(sun, 2.0),
        ambient=0.7,
    )
    if overcast:
        sun = (1.6, 1.6, 1.65)
        sky = Sky(
            zenith=(0.55, 0.58, 0.64), horizon=(0.75, 0.77, 0.8), ground=(0.18, 0.17, 0.16),
            clouds=0.9, sun_glow=(0.3, 0.3, 0.3),
        )  # fmt: skip
    swing = uniform(rng, -0.004, 0.004) if rng.random() < 0.3 else 0.0
    motion = RigidMotion(origin_m=towards, drift_m=(0.3, -0.3, 0.0), rate=swing)
    return sky, Light(
        color=sun,
        motion=motion,
        distant=True,
        softness=0.25 if overcast else uniform(rng, 0.008, 0.03),
    )


def _ground(builder: Builder) -> None:
    plane = Part(
        shape=Shape.PLANE, half_m=(1.0, 1.0, 1.0), material=mat.one_of(builder.rng, mat.GROUNDS)
    )
    builder.add("ground", (plane,))


def plaza(seed: int, rng: Rng) -> Scene:
    """An open square with walls, columns, fences and things that fly."""
    distance, height = uniform(rng, 5.5, 8.0), uniform(rng, 1.3, 2.6)
    path = _path(rng, (0.0, -distance, height), (0.0, 0.0, uniform(rng, 0.8, 1.4)), 1.2)
    builder = Builder(rng, path, (-6.0, 6.0, -4.5, 6.0))
    _ground(builder)
    for side in range(int(rng.integers(1, 4))):
        angle = math.pi / 2 + (side - 1) * uniform(rng, 0.8, 1.3)
        far = uniform(rng, 8.0, 12.0)
        half = (uniform(rng, 3.0, 7.0), 0.25, uniform(rng, 1.2, 2.8))
        wall = props.box(half, mat.one_of(rng, mat.WALLS), (0.0, 0.0, half[2]))
        at = RigidMotion(
            origin_m=(far * math.cos(angle), far * math.sin(angle), 0.0),
            turn=(0.0, 0.0, angle - math.pi / 2),
        )
        builder.add("wall", (wall,), at)
    builder.furnish(int(rng.integers(9, 15)), props.STANDING)
    builder.fly(int(rng.integers(2, 5)), (0.9, 2.6))
    sky, sun = _day_sky(rng)
    builder.lights.append(sun)
    return builder.scene(seed, "plaza", sky, sky)


def street(seed: int, rng: Rng) -> Scene:
    """Houses on both sides, posts, railings, cables; by day or in the evening."""
    height = uniform(rng, 1.4, 3.0)
    path = _path(rng, (uniform(rng, -1.2, 1.2), -9.0, height), (0.0, 4.0, 1.8), 1.4)
    builder = Builder(rng, path, (-4.0, 4.0, -5.0, 12.0))
    _ground(builder)
    for side in (-1, 1):
        y = -12.0
        while y < 26.0:
            depth, tall = uniform(rng, 2.5, 4.5), uniform(rng, 2.5, 7.0)
            maker = mat.windows if rng.random() < 0.65 else mat.brick
            half = (3.0, depth, tall)
            house = props.box(half, maker(rng), (0.0, 0.0, tall))
            builder.add("house", (house,), RigidMotion(origin_m=(side * 8.4, y + depth, 0.0)))
            y += 2 * depth + (0.0 if rng.random() < 0.6 else 1.5)
    evening = rng.random() < 0.35
    iron = mat.metal(rng)
    warm: Vec3 = (9.0, 6.5, 3.5)
    for index in range(4):
        side = 1 if index % 2 else -1
        at = (side * 4.6, -4.0 + 5.0 * index, 0.0)
        post = (
            props.rod(0.06, 1.8, iron, (0.0, 0.0, 1.8)),
            props.rod(0.03, 0.5, iron, (-side * 0.4, 0.0, 3.55), (0.0, props.QUARTER, 0.0)),
        )
        builder.add("post", post, RigidMotion(origin_m=at))
        builder.taken.append((at[0], at[1], 0.4))
        globe = RigidMotion(origin_m=(at[0] - side * 0.8, at[1], 3.45))
        if evening and index < 3:
            builder.lamp(globe, _scaled(warm, 1.5), radius=0.12)
        else:
            builder.add("globe", (props.ball(0.14, mat.paint(rng)),), globe)
    for index in range(3):
        y, z = -2.0 + 5.0 * index, uniform(rng, 3.7, 4.6)
        cable = props.rod(0.012, 5.6, mat.paint(rng), turn=(0.0, props.QUARTER, 0.0))
        builder.add("cable", (cable,), RigidMotion(origin_m=(0.0, y, z)))
    builder.furnish(int(rng.integers(6, 11)), props.STANDING)
    builder.fly(int(rng.integers(2, 4)), (1.0, 3.0))
    sky, sun = _day_sky(rng)
    if evening:
        sky = Sky(
            zenith=(0.03, 0.05, 0.14), horizon=(0.42, 0.22, 0.16), ground=(0.04, 0.03, 0.03),
            clouds=0.4, sun_glow=(1.2, 0.6, 0.3),
        )  # fmt: skip
        sun = Light(color=(0.35, 0.22, 0.16), motion=sun.motion, distant=True, softness=0.03)
    builder.lights.append(sun)
    return builder.scene(seed, "street", sky, sky)


def _shell(
    builder: Builder,
    half: tuple[float, float, float],
    window: tuple[float, float, float, float] | None,
) -> tuple[Vec3, Vec3]:
    """Floor, ceiling and walls of a room about (0, 0); a window (y0, y1, z0, z1) in the east wall."""
    rng, (x, y, z), t = builder.rng, half, 0.3
    top = 2 * z
    wall = mat.one_of(rng, mat.WALLS)
    other = mat.one_of(rng, mat.WALLS) if rng.random() < 0.5 else wall
    floor = props.box((x + t, y + t, t), mat.one_of(rng, mat.FLOORS), (0.0, 0.0, -t))
    ceiling = props.box((x + t, y + t, t), mat.plaster(rng), (0.0, 0.0, top + t))
    builder.add("floor", (floor,), shell=True)
    builder.add("ceiling", (ceiling,), shell=True)
    builder.add("north", (props.box((x + t, t, z + t), wall, (0.0, y + t, z)),), shell=True)
    builder.add("south", (props.box((x + t, t, z + t), wall, (0.0, -y - t, z)),), shell=True)
    builder.add("west", (props.box((t, y + t, z + t), other, (-x - t, 0.0, z)),), shell=True)
    if window is None:
        builder.add("east", (props.box((t, y + t, z + t), other, (x + t, 0.0, z)),), shell=True)
        return (-x, -y, 0.0), (x, y, top)
    y0, y1, z0, z1 = window

    def piece(a: float, b: float, low: float, high: float) -> Part:
        extent = (t, (b - a) / 2, (high - low) / 2)
        return props.box(extent, other, (x + t, (a + b) / 2, (low + high) / 2))

    parts = (
        piece(-y - t, y0, -t, top + t), piece(y1, y + t, -t, top + t),
        piece(y0 - t, y1 + t, -t, z0), piece(y0 - t, y1 + t, z1, top + t),
    )  # fmt: skip
    builder.add("east", parts, shell=True)
    frame = mat.paint(rng)
    middle, sill = (y0 + y1) / 2, (z0 + z1) / 2
    bars = [
        props.rod(0.02, (z1 - z0) / 2, frame, (x + 0.1, middle + k * (y1 - y0) / 4, sill))
        for k in (-1, 0, 1)
    ]
    bars.append(
        props.rod(0.02, (y1 - y0) / 2, frame, (x + 0.1, middle, sill), (props.QUARTER, 0.0, 0.0))
    )
    builder.add("window", tuple(bars))
    return (-x, -y, 0.0), (x, y, top)


def _room_light(rng: Rng) -> Sky:
    """Light that walls throw back."""
    warm = uniform(rng, 0.75, 1.0)
    level = uniform(rng, 0.25, 0.45)
    return Sky(
        zenith=_scaled((1.0, 0.97, 0.92 * warm), level),
        horizon=_scaled((0.75, 0.72, 0.70 * warm), level),
        ground=_scaled((0.45, 0.42, 0.38 * warm), level),
        clouds=0.0,
    )


def _room_lights(builder: Builder, top: float) -> None:
    """Lamps under the ceiling, one of which swings; sometimes a moving spot."""
    rng = builder.rng
    warm = mat.color(rng, (0.05, 0.15), (0.1, 0.5), (7.0, 14.0))
    for _ in range(int(rng.integers(1, 3))):
        x, y = uniform(rng, -2.0, 2.0), uniform(rng, -1.0, 3.0)
        swing = RigidMotion(
            origin_m=(x, y, top - uniform(rng, 0.5, 0.9)),
            drift_m=(uniform(rng, 0.0, 0.5), uniform(rng, 0.0, 0.5), 0.0),
            rate=uniform(rng, 0.03, 0.12) if rng.random() < 0.6 else 0.0,
        )
        builder.lamp(swing, warm, radius=uniform(rng, 0.08, 0.16))
    if rng.random() < 0.5:
        tint = mat.color(rng, (0.0, 1.0), (0.0, 0.6), (20.0, 40.0))
        spot = RigidMotion(
            origin_m=(uniform(rng, -2.5, 2.5), -2.5, top - 0.3),
            drift_m=(1.0, 0.4, 0.0),
            rate=uniform(rng, 0.02, 0.08),
        )
        aim = (uniform(rng, -1.5, 1.5), uniform(rng, 1.0, 3.0), 0.3)
        builder.lights.append(
            Light(color=tint, motion=spot, softness=0.06, aim_m=aim, cone_cos=(0.93, 0.85))
        )


def room(seed: int, rng: Rng) -> Scene:
    """A furnished room with a window to the sun, pictures and lamps."""
    half = (uniform(rng, 3.2, 4.5), uniform(rng, 3.8, 5.0), uniform(rng, 1.4, 1.7))
    eye = (uniform(rng, -0.6, 0.6), -half[1] + 1.4, uniform(rng, 1.2, 1.8))
    path = _path(rng, eye, (uniform(rng, -0.5, 0.5), half[1] * 0.5, 1.0), 0.6)
    builder = Builder(rng, path, (-half[0] + 0.7, half[0] - 0.7, -half[1] + 0.8, half[1] - 0.7))
    middle = uniform(rng, 0.0, 2.0)
    window = (middle - uniform(rng, 0.7, 1.2), middle + uniform(rng, 0.7, 1.2), 0.7, 2.3)
    walls = _shell(builder, half, window if rng.random() < 0.75 else None)
    for _ in range(int(rng.integers(1, 4))):
        size = uniform(rng, 0.25, 0.6)
        page = mat.at_size(
            mat.one_of(rng, (mat.text, mat.dots, mat.checker, mat.stripes)), 2 * size
        )
        at = (uniform(rng, -2.2, 2.2), half[1] - 0.02, uniform(rng, 1.3, 1.9))
        builder.add("picture", (props.box((size, 0.02, size), page),), RigidMotion(origin_m=at))
    builder.furnish(
        int(rng.integers(7, 12)),
        (props.table, props.crate, props.globe, props.shelf, props.table, props.sign, props.globe),
    )
    builder.fly(int(rng.integers(1, 4)), (0.9, half[2] * 2 - 0.9))
    _room_lights(builder, walls[1][2])
    sky, sun = _day_sky(rng)
    azimuth, elevation = uniform(rng, -0.6, 0.6), uniform(rng, 0.35, 0.8)
    towards = (
        math.cos(elevation) * math.cos(azimuth),
        math.cos(elevation) * math.sin(azimuth),
        math.sin(elevation),
    )
    bright = Light(
        color=_scaled(sun.color, 0.8),
        motion=RigidMotion(origin_m=towards),
        distant=True,
        softness=0.012,
    )
    builder.lights.append(bright)
    return builder.scene(seed, "room", sky, _room_light(rng), walls)


def hall(seed: int, rng: Rng) -> Scene:
    """A long hall of metal and stone with columns, strips of light and moving machines."""
    half = (uniform(rng, 3.5, 5.0), uniform(rng, 8.0, 11.0), uniform(rng, 1.8, 2.6))
    eye = (uniform(rng, -1.0, 1.0), -half[1] + 2.0, uniform(rng, 1.3, 2.4))
    path = _path(rng, eye, (0.0, 0.0, uniform(rng, 1.0, 1.6)), 0.8)
    builder = Builder(rng, path, (-half[0] + 1.2, half[0] - 1.2, -half[1] + 2.5, half[1] * 0.4))
    walls = _shell(builder, half, None)
    top = walls[1][2]
    tint = mat.color(rng, (0.0, 1.0), (0.0, 0.5), (0.8, 1.0))
    strip = mat.lamp(_scaled(tint, uniform(rng, 3.0, 7.0)))
    for side in (-1, 1):
        bar = props.box(
            (0.04, half[1] - 0.5, 0.05), strip, (side * (half[0] - 0.04), 0.0, top - 0.4)
        )
        builder.add("strip", (bar,), casts_shadow=False)
        stone = props.column(rng, uniform(rng, 0.5, 0.8))
        for index in range(4):
            y = -half[1] + 3.0 + index * (2 * half[1] - 4.0) / 4
            at = (side * (half[0] - 0.7), y, 0.0)
            builder.add("column", stone, RigidMotion(origin_m=at))
    for index in range(3):
        y = -half[1] + 3.0 + index * half[1] * 0.6
        panel = props.box((0.7, 0.25, 0.02), strip, (0.0, y, top - 0.03))
        builder.add("panel", (panel,), casts_shadow=False)
        above = RigidMotion(origin_m=(0.0, y, top - 0.25))
        builder.lights.append(
            Light(color=_scaled(tint, 11.0), motion=above, softness=0.25, reach_m=14.0)
        )
    builder.furnish(int(rng.integers(7, 12)), props.STANDING)
    builder.fly(int(rng.integers(2, 5)), (0.9, top - 1.0))
    return builder.scene(seed, "hall", _room_light(rng), _room_light(rng), walls)


def field_of_things(seed: int, rng: Rng) -> Scene:
    """Stacked blocks, spheres and bars on open ground: much sky, long shadows."""
    distance = uniform(rng, 4.5, 6.5)
    angle = uniform(rng, 0.0, 2 * math.pi)
    eye = (distance * math.cos(angle), distance * math.sin(angle), uniform(rng, 0.9, 3.2))
    path = _path(rng, eye, (0.0, 0.0, uniform(rng, 0.5, 1.2)), 0.9)
    builder = Builder(rng, path, (-5.0, 5.0, -5.0, 5.0))
    _ground(builder)
    builder.furnish(
        int(rng.integers(12, 20)),
        (
            props.crate,
            props.globe,
            props.globe,
            props.column,
            props.sign,
            props.railing,
            props.crate,
        ),
    )
    builder.fly(int(rng.integers(3, 6)), (0.8, 2.4))
    sky, sun = _day_sky(rng)
    builder.lights.append(sun)
    if rng.random() < 0.4:
        at = RigidMotion(
            origin_m=(0.0, 0.0, 2.2), drift_m=(2.0, 0.0, 0.0), sway_m=(0.0, 2.0, 0.0), rate=0.05
        )
        builder.lamp(at, mat.color(rng, (0.0, 1.0), (0.3, 0.8), (8.0, 14.0)), radius=0.1)
    return builder.scene(seed, "field", sky, sky)


ARRANGEMENTS: tuple[Callable[[int, Rng], Scene], ...] = (plaza, room, street, hall, field_of_things)


def arranged(seed: int) -> Scene:
    """Scene of a seed, exposure not set; seeds that follow each other go through the places."""
    rng = np.random.default_rng([seed, 20])
    return ARRANGEMENTS[seed % len(ARRANGEMENTS)](seed, rng)


__all__ = ["ARRANGEMENTS", "ZERO", "arranged"]
