"""Closed-form shadows against rays that are marched through the solids."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.synth.placement import place_parts
from rtsr_cli.core.synth.render import render_frame
from rtsr_cli.core.synth.scene import (
    Body,
    CameraPath,
    Light,
    Material,
    Part,
    RigidMotion,
    Scene,
    Shape,
    Sky,
)
from rtsr_cli.core.synth.shadows import lit_share, make_shadow_hull

SIZE = (64, 96)
SUN = np.array([0.0, 0.0, 1.0, 0.0])
SLANTED = np.array([0.36, -0.48, 0.8, 0.0])
LAMP = np.array([1.5, -0.7, 4.0, 1.0])
DARK = Sky(zenith=(0.2,) * 3, horizon=(0.2,) * 3, ground=(0.2,) * 3, clouds=0.0)


def lone(shape: Shape, half: tuple[float, float, float], at=(0.0, 0.0, 2.0), turn=(0.4, 0.9, 0.2)):
    """A single solid in the air."""
    part = Part(shape=shape, half_m=half, material=Material())
    body = Body(name="x", object_id=1, parts=(part,), motion=RigidMotion(origin_m=at, turn=turn))
    scene = Scene(
        seed=0,
        arrangement="test",
        bodies=(body,),
        lights=(),
        sky=DARK,
        ambient=DARK,
        camera=CameraPath(eye=RigidMotion(), target=RigidMotion(origin_m=(0.0, 1.0, 0.0))),
    )
    return place_parts(scene, 1)[0]


def inside(solid, points):
    """Which world points (n, 3) lie in a solid."""
    local = (points - solid.centre) @ solid.axes.T
    half = np.array(solid.part.half_m)
    if solid.part.shape is Shape.BOX:
        return (np.abs(local) < half).all(1)
    if solid.part.shape is Shape.SPHERE:
        return np.linalg.norm(local, axis=1) < half[0]
    return (np.hypot(local[:, 0], local[:, 1]) < half[0]) & (np.abs(local[:, 2]) < half[2])


def marched(solid, points, light):
    """1 where no step of the way to the light (up to 8 m) is inside the solid."""
    lit = np.ones(len(points), bool)
    for share in np.linspace(1e-4, 1.0, 1500):
        there = points + share * ((light[:3] - points) if light[3] else 8.0 * light[:3])
        lit &= ~inside(solid, there)
    return lit


@pytest.mark.parametrize("light", [SUN, SLANTED, LAMP], ids=["zenith", "slanted", "lamp"])
@pytest.mark.parametrize(
    ("shape", "half"),
    [
        (Shape.BOX, (0.5, 0.3, 0.2)),
        (Shape.SPHERE, (0.5, 0.5, 0.5)),
        (Shape.CYLINDER, (0.3, 0.3, 0.6)),
    ],
    ids=["box", "sphere", "cylinder"],
)
def test_a_hard_shadow_is_where_rays_to_the_light_are_blocked(shape, half, light):
    solid = lone(shape, half)
    hull = make_shadow_hull(0, solid, light, softness=0.0, reach_m=1.0)
    assert hull is not None
    rng = np.random.default_rng(7)
    points = np.column_stack([rng.uniform(-1.3, 1.3, (3000, 2)), rng.uniform(0.0, 2.8, 3000)])
    points = points[~inside(solid, points)]
    homogeneous = torch.from_numpy(np.column_stack([points, np.ones(len(points))]).T).float()
    lit = lit_share(hull, light, homogeneous.contiguous()).numpy()
    expected = marched(solid, points, light)
    assert 0.02 < np.mean(~expected) < 0.5
    # a cylinder's shadow is that of a prism around it
    assert np.mean((lit > 0.5) != expected) < (0.02 if shape is Shape.CYLINDER else 0.005)


def ground_scene(softness: float) -> Scene:
    """A box one metre wide floats two metres above white ground, the sun overhead."""
    white = Material(colors=((0.8,) * 3, (0.8,) * 3), tone=0.0)
    ground = Part(shape=Shape.PLANE, half_m=(1.0, 1.0, 1.0), material=white)
    box = Part(shape=Shape.BOX, half_m=(0.5, 0.5, 0.1), material=white)
    sun = Light(
        color=(3.0,) * 3,
        motion=RigidMotion(origin_m=(0.0, 0.0, 1.0)),
        distant=True,
        softness=softness,
    )
    return Scene(
        seed=0,
        arrangement="test",
        bodies=(
            Body(name="ground", object_id=1, parts=(ground,)),
            Body(
                name="box", object_id=2, parts=(box,), motion=RigidMotion(origin_m=(0.0, 0.0, 2.1))
            ),
        ),
        lights=(sun,),
        sky=DARK,
        ambient=DARK,
        camera=CameraPath(
            eye=RigidMotion(origin_m=(0.0, -4.0, 1.5)), target=RigidMotion(origin_m=(0.0, 0.0, 0.3))
        ),
    )


@pytest.mark.parametrize("softness", [0.0, 0.1])
def test_ground_behind_an_occluder_is_darker(values, softness):
    frame = render_frame(ground_scene(softness), 1, SIZE)
    ground = values(frame, Buffer.OBJECT_ID)[0] == 1
    x, y, _ = values(frame, Buffer.POSITION)
    radiance = values(frame, Buffer.COLOR)[0]
    blur = 2.0 * softness
    away = np.maximum(np.abs(x), np.abs(y))
    dark = radiance[ground & (away < 0.5 - blur - 0.02)]
    # the zenith's own wide shadow ends well before the second ring
    bright = radiance[ground & (away > 2.5) & (away < 4.0)]
    assert len(dark) > 20
    # sun: 0.8 / pi * 3 = 0.76; what is left in the shadow is at most the ambient 0.8 * 0.2
    assert dark.max() < 0.16
    assert bright.min() > 0.76
    edge = radiance[ground & (np.abs(away - 0.5) < 0.5 * blur)]
    if softness:
        assert len(edge) > 10
        assert edge.std() > 0.05
        assert edge.min() > dark.min()
