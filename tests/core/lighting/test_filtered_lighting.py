"""Lighting of filtered radiance: texture is taken out as it was filtered, and light is parted."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.resampling import filter_at_samples
from rtsr_cli.core.lighting.filtered_lighting import (
    describe_filter,
    match_filter,
    part_filtered,
)
from rtsr_cli.core.lighting.lighting import enlarge_cubic, guide_window
from rtsr_cli.core.system import FrameWindow

SCALE = 4
HEIGHT, WIDTH = 48, 64
FILTER_PX = 0.4
JITTER_PX = (0.125, -0.375)


def make_window(light: Tensor, material: Tensor, width: float = FILTER_PX) -> FrameWindow:
    """A wall that shines a little in one place; LR radiance is filtered as `width` says."""
    plane = torch.ones(1, 1, HEIGHT, WIDTH)
    emission = torch.zeros(1, 3, HEIGHT, WIDTH)
    emission[..., 20:24, 30:36] = 5.0
    normal = torch.zeros(1, 3, HEIGHT, WIDTH)
    normal[:, 2] = 1.0
    hr = {
        Buffer.MATERIAL: material,
        Buffer.SKY: 0.0 * plane,
        Buffer.NORMAL: normal,
        Buffer.DEPTH: 3.0 * plane,
        Buffer.EMISSION: emission,
    }
    x, y = (round((0.5 + j) * SCALE - 0.5) for j in JITTER_PX)
    lr = {buffer: image[..., y::SCALE, x::SCALE] for buffer, image in hr.items()}
    radiance = light * material + emission
    lr[Buffer.COLOR] = filter_at_samples(radiance, FILTER_PX, SCALE, JITTER_PX)
    lr[Buffer.LIGHTING] = lr[Buffer.COLOR] / lr[Buffer.MATERIAL]
    lr[Buffer.LIGHTING_MASK] = torch.ones_like(lr[Buffer.SKY])

    def frame(buffers: dict[Buffer, Tensor], **facts: float) -> Frame:
        gbuffer = GBuffer(buffers, "wall")
        return Frame(
            number=1, gbuffer=gbuffer, camera=CameraMetadata(),
            view=View(display=gbuffer.size), **facts,
        )  # fmt: skip

    small = frame(lr, filter_width_px=width)
    small = replace(small, camera=CameraMetadata(jitter_px=JITTER_PX))
    return FrameWindow(lr=(small,), hr=frame(hr), scale=SCALE)


def checkers(low: float, high: float, side: int) -> Tensor:
    y, x = torch.meshgrid(torch.arange(HEIGHT), torch.arange(WIDTH), indexing="ij")
    odd = ((y // side + x // side) % 2).float()
    return (low + (high - low) * odd).expand(1, 3, HEIGHT, WIDTH).contiguous()


def test_under_even_light_no_texture_is_left() -> None:
    """E(q) is the light whatever the material: c = G[L m] = L G[m]."""
    light = torch.full((1, 3, HEIGHT, WIDTH), 2.0)
    window = make_window(light, checkers(0.1, 0.9, 3))
    lighting = match_filter(window).current.gbuffer[Buffer.LIGHTING]
    torch.testing.assert_close(lighting, torch.full_like(lighting, 2.0), rtol=1e-4, atol=1e-4)
    plain = window.current.gbuffer[Buffer.LIGHTING]
    assert float((plain - 2.0).abs().max()) > 1.0


def test_point_samples_stay_as_they_are() -> None:
    window = make_window(torch.ones(1, 3, HEIGHT, WIDTH), checkers(0.1, 0.9, 3), width=0.0)
    assert match_filter(window) is window


def test_where_sky_is_mixed_in_nothing_is_divided() -> None:
    window = make_window(torch.ones(1, 3, HEIGHT, WIDTH), checkers(0.1, 0.9, 3))
    sky = torch.zeros(1, 1, HEIGHT, WIDTH)
    sky[..., :24] = 1.0
    hr = window.require_hr()
    covered = replace(hr, gbuffer=hr.gbuffer.with_buffers({Buffer.SKY: sky}))
    matched = match_filter(FrameWindow(lr=window.lr, hr=covered, scale=SCALE))
    mask = matched.current.gbuffer[Buffer.LIGHTING_MASK]
    assert not bool(mask[..., :7].any())
    assert bool((mask[..., 9:] > 0.5).all())


def describe(window: FrameWindow) -> dict[str, Tensor]:
    """What parting reads."""
    matched = match_filter(window)
    small, large = guide_window(window)
    gbuffer = matched.current.gbuffer
    encoded = torch.log1p(gbuffer[Buffer.LIGHTING])
    return describe_filter(window) | {
        "encoded": encoded,
        "mask": gbuffer[Buffer.LIGHTING_MASK],
        "small_normal": small.normal,
        "small_depth": small.depth,
        "normal": large.normal,
        "depth": large.depth,
        "cubic": enlarge_cubic(matched, encoded),
        "lighting_scale": torch.ones(1, 1, 1, 1),
    }


def test_light_that_was_mixed_is_parted() -> None:
    """A smooth change of light, of the filter's size: what was lost comes back."""
    x = torch.arange(WIDTH).view(1, 1, 1, WIDTH) / WIDTH
    light = (2.0 + torch.sin(2.0 * torch.pi * 5.0 * x)).expand(1, 3, HEIGHT, WIDTH).contiguous()
    window = make_window(light, torch.full((1, 3, HEIGHT, WIDTH), 0.5))
    inputs = describe(window)
    enlarged = inputs["cubic"]
    inner = (..., slice(12, -12), slice(12, -12))

    def error(encoded: Tensor) -> float:
        return min(
            float((encoded - torch.roll(torch.log1p(light), s, 3))[inner].square().mean())
            for s in range(-3, 4)
        )

    assert error(part_filtered(inputs, enlarged)) < 0.5 * error(enlarged)


def test_without_a_filter_nothing_is_parted() -> None:
    window = make_window(torch.ones(1, 3, HEIGHT, WIDTH), checkers(0.1, 0.9, 3), width=0.0)
    encoded = torch.rand(1, 3, HEIGHT, WIDTH)
    assert part_filtered(describe(window), encoded) is encoded


def test_a_pixel_without_a_material_spoils_nothing_else() -> None:
    material = checkers(0.1, 0.9, 3)
    material[..., 20, 20] = torch.nan
    window = make_window(torch.ones(1, 3, HEIGHT, WIDTH), checkers(0.1, 0.9, 3))
    hr = window.require_hr()
    spoilt = replace(hr, gbuffer=hr.gbuffer.with_buffers({Buffer.MATERIAL: material}))
    inputs = describe(FrameWindow(lr=window.lr, hr=spoilt, scale=SCALE))
    assert bool(torch.isfinite(part_filtered(inputs, inputs["cubic"])).all())


def test_emission_that_lr_alone_holds_is_taken_out() -> None:
    light = torch.full((1, 3, HEIGHT, WIDTH), 2.0)
    window = make_window(light, checkers(0.1, 0.9, 3))
    hr, lr = window.require_hr(), window.current
    dark = {b: t for b, t in hr.gbuffer.buffers.items() if b is not Buffer.EMISSION}
    filtered = filter_at_samples(hr.gbuffer[Buffer.EMISSION], FILTER_PX, SCALE, JITTER_PX)
    small = lr.gbuffer.with_buffers({Buffer.EMISSION: filtered})
    changed = FrameWindow(
        lr=(replace(lr, gbuffer=small),),
        hr=replace(hr, gbuffer=GBuffer(dark, "wall")),
        scale=SCALE,
    )
    lighting = match_filter(changed).current.gbuffer[Buffer.LIGHTING]
    torch.testing.assert_close(lighting, torch.full_like(lighting, 2.0), rtol=1e-4, atol=1e-4)
