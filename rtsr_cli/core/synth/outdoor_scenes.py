"""Random places under the sky: a square, a street, open ground."""

from __future__ import annotations

import math

from rtsr_cli.core.synth import materials as mat
from rtsr_cli.core.synth import props
from rtsr_cli.core.synth.scene import Light, Part, RigidMotion, Scene, Shape, Sky, Vec3
from rtsr_cli.core.synth.scene_builder import (
    Rng,
    SceneBuilder,
    draw_day_sky,
    draw_loop_path,
    draw_uniform,
    scale_color,
)


def _ground(builder: SceneBuilder) -> None:
    plane = Part(
        shape=Shape.PLANE, half_m=(1.0, 1.0, 1.0), material=mat.one_of(builder.rng, mat.GROUNDS)
    )
    builder.add("ground", (plane,))


def draw_plaza(seed: int, rng: Rng) -> Scene:
    """An open square with walls, columns, fences and things that fly."""
    distance, height = draw_uniform(rng, 5.5, 8.0), draw_uniform(rng, 1.3, 2.6)
    path = draw_loop_path(
        rng, (0.0, -distance, height), (0.0, 0.0, draw_uniform(rng, 0.8, 1.4)), 1.2
    )
    builder = SceneBuilder(rng, path, (-6.0, 6.0, -4.5, 6.0))
    _ground(builder)
    for side in range(int(rng.integers(1, 4))):
        angle = math.pi / 2 + (side - 1) * draw_uniform(rng, 0.8, 1.3)
        far = draw_uniform(rng, 8.0, 12.0)
        half = (draw_uniform(rng, 3.0, 7.0), 0.25, draw_uniform(rng, 1.2, 2.8))
        wall = props.box(half, mat.one_of(rng, mat.WALLS), (0.0, 0.0, half[2]))
        at = RigidMotion(
            origin_m=(far * math.cos(angle), far * math.sin(angle), 0.0),
            turn=(0.0, 0.0, angle - math.pi / 2),
        )
        builder.add("wall", (wall,), at)
    builder.furnish(int(rng.integers(9, 15)), props.STANDING)
    builder.fly(int(rng.integers(2, 5)), (0.9, 2.6))
    sky, sun = draw_day_sky(rng)
    builder.lights.append(sun)
    return builder.scene(seed, "plaza", sky, sky)


def draw_street(seed: int, rng: Rng) -> Scene:
    """Houses on both sides, posts, railings, cables; by day or in the evening."""
    height = draw_uniform(rng, 1.4, 3.0)
    path = draw_loop_path(rng, (draw_uniform(rng, -1.2, 1.2), -9.0, height), (0.0, 4.0, 1.8), 1.4)
    builder = SceneBuilder(rng, path, (-4.0, 4.0, -5.0, 12.0))
    _ground(builder)
    for side in (-1, 1):
        y = -12.0
        while y < 26.0:
            depth, tall = draw_uniform(rng, 2.5, 4.5), draw_uniform(rng, 2.5, 7.0)
            maker = mat.windows if rng.random() < 0.65 else mat.brick
            half = (3.0, depth, tall)
            house = props.box(half, maker(rng), (0.0, 0.0, tall))
            builder.add("house", (house,), RigidMotion(origin_m=(side * 8.4, y + depth, 0.0)))
            y += 2 * depth + (0.0 if rng.random() < 0.6 else 1.5)
    evening = rng.random() < 0.35
    _posts(builder, lit=evening)
    for index in range(3):
        y, z = -2.0 + 5.0 * index, draw_uniform(rng, 3.7, 4.6)
        cable = props.rod(0.012, 5.6, mat.paint(rng), turn=(0.0, props.QUARTER, 0.0))
        builder.add("cable", (cable,), RigidMotion(origin_m=(0.0, y, z)))
    builder.furnish(int(rng.integers(6, 11)), props.STANDING)
    builder.fly(int(rng.integers(2, 4)), (1.0, 3.0))
    sky, sun = draw_day_sky(rng)
    if evening:
        sky = Sky(
            zenith=(0.03, 0.05, 0.14), horizon=(0.42, 0.22, 0.16), ground=(0.04, 0.03, 0.03),
            clouds=0.4, sun_glow=(1.2, 0.6, 0.3),
        )  # fmt: skip
        sun = Light(color=(0.35, 0.22, 0.16), motion=sun.motion, distant=True, softness=0.03)
    builder.lights.append(sun)
    return builder.scene(seed, "street", sky, sky)


def _posts(builder: SceneBuilder, *, lit: bool) -> None:
    """Lamp posts on both sides."""
    rng = builder.rng
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
        if lit and index < 3:
            builder.lamp(globe, scale_color(warm, 1.5), radius=0.12)
        else:
            builder.add("globe", (props.ball(0.14, mat.paint(rng)),), globe)


def draw_field(seed: int, rng: Rng) -> Scene:
    """Stacked blocks, spheres and bars on open ground: much sky, long shadows."""
    distance = draw_uniform(rng, 4.5, 6.5)
    angle = draw_uniform(rng, 0.0, 2 * math.pi)
    eye = (distance * math.cos(angle), distance * math.sin(angle), draw_uniform(rng, 0.9, 3.2))
    path = draw_loop_path(rng, eye, (0.0, 0.0, draw_uniform(rng, 0.5, 1.2)), 0.9)
    builder = SceneBuilder(rng, path, (-5.0, 5.0, -5.0, 5.0))
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
    sky, sun = draw_day_sky(rng)
    builder.lights.append(sun)
    if rng.random() < 0.4:
        at = RigidMotion(
            origin_m=(0.0, 0.0, 2.2), drift_m=(2.0, 0.0, 0.0), sway_m=(0.0, 2.0, 0.0), rate=0.05
        )
        builder.lamp(at, mat.color(rng, (0.0, 1.0), (0.3, 0.8), (8.0, 14.0)), radius=0.1)
    return builder.scene(seed, "field", sky, sky)
