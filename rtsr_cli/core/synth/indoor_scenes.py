"""Random places between walls: a furnished room, a long hall."""

from __future__ import annotations

import math

from rtsr_cli.core.synth import materials as mat
from rtsr_cli.core.synth import props
from rtsr_cli.core.synth.scene import Light, Part, RigidMotion, Scene, Sky, Vec3
from rtsr_cli.core.synth.scene_builder import (
    Rng,
    SceneBuilder,
    draw_day_sky,
    draw_loop_path,
    draw_uniform,
    scale_color,
)


def _shell(
    builder: SceneBuilder,
    half: tuple[float, float, float],
    window: tuple[float, float, float, float] | None,
) -> tuple[Vec3, Vec3]:
    """Floor, ceiling and walls about (0, 0); a window (y0, y1, z0, z1) in the east wall."""
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
    warm = draw_uniform(rng, 0.75, 1.0)
    level = draw_uniform(rng, 0.25, 0.45)
    return Sky(
        zenith=scale_color((1.0, 0.97, 0.92 * warm), level),
        horizon=scale_color((0.75, 0.72, 0.70 * warm), level),
        ground=scale_color((0.45, 0.42, 0.38 * warm), level),
        clouds=0.0,
    )


def _room_lights(builder: SceneBuilder, top: float) -> None:
    """Lamps under the ceiling, one of which swings; sometimes a moving spot."""
    rng = builder.rng
    warm = mat.color(rng, (0.05, 0.15), (0.1, 0.5), (7.0, 14.0))
    for _ in range(int(rng.integers(1, 3))):
        x, y = draw_uniform(rng, -2.0, 2.0), draw_uniform(rng, -1.0, 3.0)
        swing = RigidMotion(
            origin_m=(x, y, top - draw_uniform(rng, 0.5, 0.9)),
            drift_m=(draw_uniform(rng, 0.0, 0.5), draw_uniform(rng, 0.0, 0.5), 0.0),
            rate=draw_uniform(rng, 0.03, 0.12) if rng.random() < 0.6 else 0.0,
        )
        builder.lamp(swing, warm, radius=draw_uniform(rng, 0.08, 0.16))
    if rng.random() < 0.5:
        tint = mat.color(rng, (0.0, 1.0), (0.0, 0.6), (20.0, 40.0))
        spot = RigidMotion(
            origin_m=(draw_uniform(rng, -2.5, 2.5), -2.5, top - 0.3),
            drift_m=(1.0, 0.4, 0.0),
            rate=draw_uniform(rng, 0.02, 0.08),
        )
        aim = (draw_uniform(rng, -1.5, 1.5), draw_uniform(rng, 1.0, 3.0), 0.3)
        builder.lights.append(
            Light(color=tint, motion=spot, softness=0.06, aim_m=aim, cone_cos=(0.93, 0.85))
        )


def draw_room(seed: int, rng: Rng) -> Scene:
    """A furnished room with a window to the sun, pictures and lamps."""
    half = (draw_uniform(rng, 3.2, 4.5), draw_uniform(rng, 3.8, 5.0), draw_uniform(rng, 1.4, 1.7))
    eye = (draw_uniform(rng, -0.6, 0.6), -half[1] + 1.4, draw_uniform(rng, 1.2, 1.8))
    path = draw_loop_path(rng, eye, (draw_uniform(rng, -0.5, 0.5), half[1] * 0.5, 1.0), 0.6)
    builder = SceneBuilder(
        rng, path, (-half[0] + 0.7, half[0] - 0.7, -half[1] + 0.8, half[1] - 0.7)
    )
    middle = draw_uniform(rng, 0.0, 2.0)
    window = (middle - draw_uniform(rng, 0.7, 1.2), middle + draw_uniform(rng, 0.7, 1.2), 0.7, 2.3)
    walls = _shell(builder, half, window if rng.random() < 0.75 else None)
    for _ in range(int(rng.integers(1, 4))):
        size = draw_uniform(rng, 0.25, 0.6)
        page = mat.at_size(
            mat.one_of(rng, (mat.text, mat.dots, mat.checker, mat.stripes)), 2 * size
        )
        at = (draw_uniform(rng, -2.2, 2.2), half[1] - 0.02, draw_uniform(rng, 1.3, 1.9))
        builder.add("picture", (props.box((size, 0.02, size), page),), RigidMotion(origin_m=at))
    builder.furnish(
        int(rng.integers(7, 12)),
        (props.table, props.crate, props.globe, props.shelf, props.table, props.sign, props.globe),
    )
    builder.fly(int(rng.integers(1, 4)), (0.9, half[2] * 2 - 0.9))
    _room_lights(builder, walls[1][2])
    sky, sun = draw_day_sky(rng)
    azimuth, elevation = draw_uniform(rng, -0.6, 0.6), draw_uniform(rng, 0.35, 0.8)
    towards = (
        math.cos(elevation) * math.cos(azimuth),
        math.cos(elevation) * math.sin(azimuth),
        math.sin(elevation),
    )
    bright = Light(
        color=scale_color(sun.color, 0.8),
        motion=RigidMotion(origin_m=towards),
        distant=True,
        softness=0.012,
    )
    builder.lights.append(bright)
    return builder.scene(seed, "room", sky, _room_light(rng), walls)


def draw_hall(seed: int, rng: Rng) -> Scene:
    """A long hall of metal and stone with columns, strips of light and moving machines."""
    half = (draw_uniform(rng, 3.5, 5.0), draw_uniform(rng, 8.0, 11.0), draw_uniform(rng, 1.8, 2.6))
    eye = (draw_uniform(rng, -1.0, 1.0), -half[1] + 2.0, draw_uniform(rng, 1.3, 2.4))
    path = draw_loop_path(rng, eye, (0.0, 0.0, draw_uniform(rng, 1.0, 1.6)), 0.8)
    builder = SceneBuilder(
        rng, path, (-half[0] + 1.2, half[0] - 1.2, -half[1] + 2.5, half[1] * 0.4)
    )
    walls = _shell(builder, half, None)
    top = walls[1][2]
    tint = mat.color(rng, (0.0, 1.0), (0.0, 0.5), (0.8, 1.0))
    strip = mat.lamp(scale_color(tint, draw_uniform(rng, 3.0, 7.0)))
    for side in (-1, 1):
        bar = props.box(
            (0.04, half[1] - 0.5, 0.05), strip, (side * (half[0] - 0.04), 0.0, top - 0.4)
        )
        builder.add("strip", (bar,), casts_shadow=False)
        stone = props.column(rng, draw_uniform(rng, 0.5, 0.8))
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
            Light(color=scale_color(tint, 11.0), motion=above, softness=0.25, reach_m=14.0)
        )
    builder.furnish(int(rng.integers(7, 12)), props.STANDING)
    builder.fly(int(rng.integers(2, 5)), (0.9, top - 1.0))
    return builder.scene(seed, "hall", _room_light(rng), _room_light(rng), walls)
