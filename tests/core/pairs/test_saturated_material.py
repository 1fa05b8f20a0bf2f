"""Surfaces of a saturated colour: divided by the channels that they have."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.demodulation import demodulate, lighting_scale
from rtsr_cli.core.imaging.resampling import decimate
from rtsr_cli.core.pairs.dark_material import leave_outshining
from rtsr_cli.core.pairs.saturated_material import LEAST_DIVISOR, divide_saturated

SCALE, SIZE = 4, (96, 128)
LIGHT = 0.8


def make_pair(colour: tuple[float, float, float], radiance: Tensor) -> tuple[Frame, Frame, Tensor]:
    """A grey wall, and a square thing of a colour before it that has some radiance."""
    material = torch.full((1, 3, *SIZE), 0.6)
    color = LIGHT * material
    material[..., 24:72, 32:96] = torch.tensor(colour).view(3, 1, 1)
    color[..., 24:72, 32:96] = radiance.view(3, 1, 1)
    sky = torch.zeros(1, 1, *SIZE)
    small = [decimate(image, SCALE, (2, 2)) for image in (color, material, sky)]
    parts = demodulate(small[0], small[1], sky=small[2])
    lr = {
        Buffer.SKY: small[2],
        Buffer.MATERIAL: parts.material,
        Buffer.LIGHTING: parts.lighting,
        Buffer.LIGHTING_MASK: parts.mask,
    }
    frames = [
        Frame(number=1, gbuffer=g, camera=CameraMetadata(), view=View(display=g.size))
        for g in (
            GBuffer(lr, "made by a test"),
            GBuffer({Buffer.MATERIAL: material, Buffer.SKY: sky}, "made by a test"),
        )
    ]
    scale = lighting_scale(parts.lighting, parts.mask)
    return replace(frames[0], lighting_scale=scale), frames[1], small[1]


@pytest.mark.parametrize(
    "colour", [(0.75, 0.0, 0.0), (0.0, 0.6, 0.0), (0.0, 0.0, 0.4), (0.75, 0.6, 0.0), (0.5, 3e-3, 0)]
)
@pytest.mark.parametrize("light", [0.02, LIGHT, 8.0])
def test_a_saturated_colour_is_divided_by_what_it_has(
    colour: tuple[float, float, float], light: float
) -> None:
    lr, hr, material = make_pair(colour, light * torch.tensor(colour))
    left, lifted = divide_saturated(lr, hr, lambda: material, SCALE)
    assert bool((left.gbuffer[Buffer.LIGHTING_MASK] > 0.5).all())
    thing = left.gbuffer[Buffer.LIGHTING][..., 8:16, 10:22]
    torch.testing.assert_close(thing, torch.full_like(thing, light))
    wanted = hr.gbuffer[Buffer.MATERIAL].clamp(min=LEAST_DIVISOR)
    torch.testing.assert_close(lifted.gbuffer[Buffer.MATERIAL], wanted)
    kept, bare = leave_outshining(left, lifted, SCALE)
    assert bool((kept.gbuffer[Buffer.LIGHTING_MASK] > 0.5).all())
    assert bare is lifted


def test_channels_that_have_radiance_without_material_are_lost() -> None:
    lr, hr, material = make_pair((0.75, 0.0, 0.0), LIGHT * torch.tensor([0.75, 0.4, 0.1]))
    assert divide_saturated(lr, hr, lambda: material, SCALE) == (lr, hr)
