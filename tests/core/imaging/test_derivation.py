from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from rtsr_cli.core.choices import DemodulationMode, LutConvention
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.brdf_lut import integrate_lut, sample_lut
from rtsr_cli.core.imaging.derivation import (
    CAMERA,
    DerivationConfig,
    derive,
    derive_material,
    resolve_needs,
)
from rtsr_cli.core.imaging.derived_geometry import derive_nov, derive_sky

BRDF = DerivationConfig()
ALBEDO = DerivationConfig(mode=DemodulationMode.ALBEDO)
GLOSSY = DerivationConfig(mode=DemodulationMode.GLOSSY_ALBEDO)
SOFTPLUS = DerivationConfig(mode=DemodulationMode.SOFTPLUS)

SIZE = (12, 14)

MakeFrame = Callable[..., Frame]


def image(channels: int, seed: int, low: float = 0.0, high: float = 1.0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return low + (high - low) * torch.rand(1, channels, *SIZE, generator=generator)


@pytest.fixture
def buffers() -> dict[Buffer, torch.Tensor]:
    """Stored buffers of a frame whose two upper rows are sky; radiance is at least emission."""
    depth = image(1, 1, 1.0, 9.0)
    depth[..., :2, :] = SKY_DEPTH_M
    normal = torch.nn.functional.normalize(image(3, 2, -1.0, 1.0), dim=1)
    normal[..., :2, :] = 0.0
    return {
        Buffer.COLOR: image(3, 3, 0.2, 4.0),
        Buffer.ALBEDO: image(3, 4, 0.1, 0.9),
        Buffer.METALLIC: image(1, 5).round(),
        Buffer.ROUGHNESS: image(1, 6),
        Buffer.NORMAL: normal,
        Buffer.DEPTH: depth,
        Buffer.EMISSION: image(3, 7, 0.0, 0.2),
        Buffer.MATERIAL: image(3, 8, 0.1, 1.0),
    }


STORED = (
    Buffer.COLOR,
    Buffer.ALBEDO,
    Buffer.METALLIC,
    Buffer.ROUGHNESS,
    Buffer.NORMAL,
    Buffer.DEPTH,
)


def test_lighting_is_resolved_down_to_stored_buffers() -> None:
    found = resolve_needs([Buffer.LIGHTING], STORED, has_camera=True, config=BRDF)
    assert found.missing == ()
    assert found.read == set(STORED)


def test_without_a_camera_the_camera_is_what_is_missing() -> None:
    found = resolve_needs([Buffer.LIGHTING], STORED, has_camera=False, config=BRDF)
    assert found.missing == (CAMERA,)


def test_positions_and_depth_stand_in_for_a_camera() -> None:
    found = resolve_needs([Buffer.NOV], [*STORED, Buffer.POSITION], has_camera=False, config=BRDF)
    assert found.missing == ()
    assert found.read == {Buffer.NORMAL, Buffer.POSITION, Buffer.DEPTH}


def test_a_stored_view_cosine_is_preferred_to_a_derived_one() -> None:
    found = resolve_needs([Buffer.NOV], [*STORED, Buffer.NOV], has_camera=True, config=BRDF)
    assert found.read == {Buffer.NOV}


def test_a_stored_material_spares_everything_it_is_made_of() -> None:
    found = resolve_needs(
        [Buffer.LIGHTING], [Buffer.COLOR, Buffer.MATERIAL], has_camera=False, config=BRDF
    )
    assert found.missing == ()
    assert found.read == {Buffer.COLOR, Buffer.MATERIAL}


def test_stored_buffers_that_change_the_result_are_read_though_not_asked_for() -> None:
    stored = [*STORED, Buffer.SPECULAR, Buffer.EMISSION]
    found = resolve_needs([Buffer.LIGHTING], stored, has_camera=True, config=BRDF)
    assert {Buffer.SPECULAR, Buffer.EMISSION, Buffer.DEPTH} <= found.read


@pytest.mark.parametrize(
    ("config", "missing"),
    [
        (BRDF, ("albedo", "metallic", "roughness", "normal", CAMERA)),
        (SOFTPLUS, ("albedo", "metallic", "roughness", "normal", CAMERA)),
        (ALBEDO, ("albedo",)),
        (GLOSSY, ("albedo", "metallic")),
    ],
)
def test_each_mode_misses_what_its_divisor_is_made_of(
    config: DerivationConfig, missing: tuple[str, ...]
) -> None:
    found = resolve_needs([Buffer.LIGHTING], [Buffer.COLOR], has_camera=False, config=config)
    assert found.missing == missing
    assert not resolve_needs([Buffer.LIGHTING], STORED, has_camera=True, config=config).missing


def test_what_lacks_least_is_what_is_asked_for() -> None:
    stored = [Buffer.NORMAL, Buffer.POSITION]
    found = resolve_needs([Buffer.NOV], stored, has_camera=False, config=BRDF)
    assert len(found.missing) == 1


def test_each_missing_buffer_is_listed_once() -> None:
    wanted = [Buffer.MOTION, Buffer.LIGHTING, Buffer.COLOR, Buffer.MOTION]
    found = resolve_needs(wanted, [Buffer.MATERIAL], has_camera=False, config=BRDF)
    assert found.missing == ("motion", "color")


def test_sky_is_never_missing() -> None:
    assert resolve_needs([Buffer.SKY], [], has_camera=False, config=BRDF).missing == ()


def test_sky_comes_from_depth_then_from_zero_normals_then_there_is_none(
    buffers: dict[Buffer, torch.Tensor],
) -> None:
    rows = derive_sky(GBuffer(buffers))[0, 0].mean(dim=1).tolist()
    assert rows == [1.0, 1.0] + [0.0] * 10
    by_normal = {Buffer.NORMAL: buffers[Buffer.NORMAL]}
    assert torch.equal(derive_sky(GBuffer(by_normal)), derive_sky(GBuffer(buffers)))
    assert derive_sky(GBuffer({Buffer.COLOR: buffers[Buffer.COLOR]})).sum() == 0


def test_the_view_cosine_from_positions_agrees_with_that_from_the_camera(
    make_frame: MakeFrame,
    make_camera: Callable[..., CameraMetadata],
    unproject: Callable[..., np.ndarray],
    buffers: dict[Buffer, torch.Tensor],
) -> None:
    camera = make_camera()
    parts = {Buffer.NORMAL: buffers[Buffer.NORMAL], Buffer.DEPTH: buffers[Buffer.DEPTH]}
    world = unproject(camera, SIZE, parts[Buffer.DEPTH][0, 0].numpy().astype(np.float64))
    position = torch.from_numpy(world).permute(2, 0, 1)[None].float()
    by_camera = derive_nov(make_frame(parts, camera=camera))
    by_position = derive_nov(make_frame({**parts, Buffer.POSITION: position}))
    assert torch.allclose(by_camera, by_position, atol=1e-4)
    assert 0.2 < float((by_camera > 0.1).float().mean()) < 0.9


def test_a_surface_without_normal_is_taken_to_face_the_camera_and_sky_is_not(
    make_frame: MakeFrame,
    make_camera: Callable[..., CameraMetadata],
    buffers: dict[Buffer, torch.Tensor],
) -> None:
    normal, depth = buffers[Buffer.NORMAL].clone(), buffers[Buffer.DEPTH]
    right = derive_nov(
        make_frame({Buffer.NORMAL: normal, Buffer.DEPTH: depth}, camera=make_camera())
    )
    normal[..., 5, 3] = 0.0
    found = derive_nov(
        make_frame({Buffer.NORMAL: normal, Buffer.DEPTH: depth}, camera=make_camera())
    )
    assert found[0, 0, 5, 3] == 1.0
    right[..., 5, 3] = 1.0
    assert torch.equal(found, right)
    assert found[derive_sky(GBuffer(buffers)) > 0.5].max() == 0.0


def test_the_brdf_divisor_is_diffuse_plus_the_split_sum(
    monkeypatch: pytest.MonkeyPatch, make_frame: MakeFrame, buffers: dict[Buffer, torch.Tensor]
) -> None:
    table = integrate_lut(size=16, samples=32)
    monkeypatch.setattr(
        "rtsr_cli.core.imaging.derivation.load_default_lut", lambda convention: table
    )
    nov = image(1, 9)
    parts = {b: buffers[b] for b in (Buffer.ALBEDO, Buffer.METALLIC, Buffer.ROUGHNESS)}
    found = derive_material(make_frame({**parts, Buffer.NOV: nov}), BRDF)
    c, m = parts[Buffer.ALBEDO], parts[Buffer.METALLIC]
    a, b = sample_lut(table, nov, parts[Buffer.ROUGHNESS]).split(1, dim=1)
    assert torch.allclose(found, (1 - m) * c + (0.04 * (1 - m) + c * m) * a + b, atol=1e-6)


def test_the_table_is_that_of_the_configured_convention(
    monkeypatch: pytest.MonkeyPatch, make_frame: MakeFrame, buffers: dict[Buffer, torch.Tensor]
) -> None:
    asked: list[LutConvention] = []

    def table(convention: LutConvention) -> torch.Tensor:
        asked.append(convention)
        return torch.full((1, 2, 4, 4), 0.25)

    monkeypatch.setattr("rtsr_cli.core.imaging.derivation.load_default_lut", table)
    parts = {b: buffers[b] for b in (Buffer.ALBEDO, Buffer.METALLIC, Buffer.ROUGHNESS)}
    frame = make_frame({**parts, Buffer.NOV: image(1, 9)})
    derive_material(frame, DerivationConfig(lut=LutConvention.SEED))
    assert asked == [LutConvention.SEED]


def test_the_modes_divide_by_what_their_names_say(
    make_frame: MakeFrame, buffers: dict[Buffer, torch.Tensor]
) -> None:
    buffers[Buffer.ALBEDO][..., 5, 5] = 0.0
    frame = make_frame(buffers)
    c, m, f = (buffers[b] for b in (Buffer.ALBEDO, Buffer.METALLIC, Buffer.MATERIAL))
    assert torch.equal(derive_material(frame, BRDF), f)
    assert torch.allclose(
        derive_material(frame, SOFTPLUS), f + torch.log1p(torch.exp(-100 * f)) / 100
    )
    assert torch.equal(derive_material(frame, ALBEDO), c.clamp(min=0.05))
    # a dielectric adds its F0 of 0.04, a metal nothing; metallic is 0 or 1 here
    glossy = (c + 0.04 * (1 - m)).clamp(min=0.05)
    assert torch.allclose(derive_material(frame, GLOSSY), glossy, atol=1e-6)


@pytest.mark.parametrize("config", [BRDF, SOFTPLUS, ALBEDO, GLOSSY])
def test_what_no_surface_reflects_counts_as_the_most_that_one_does(
    config: DerivationConfig, make_frame: MakeFrame, buffers: dict[Buffer, torch.Tensor]
) -> None:
    usual = derive_material(make_frame(buffers), config)
    for buffer in (Buffer.ALBEDO, Buffer.MATERIAL):
        buffers[buffer][..., 5, 5] = 8.0
        buffers[buffer][..., 6, 6] = torch.nan
    found = derive_material(make_frame(buffers), config)
    assert (found[..., 5, 5] == 2.0).all()
    assert found[..., 6, 6].isnan().all()
    for pixel in (5, 6):
        found[..., pixel, pixel] = usual[..., pixel, pixel]
    assert torch.equal(found, usual)


def test_lighting_mask_material_and_scale_come_from_one_division(
    make_frame: MakeFrame, buffers: dict[Buffer, torch.Tensor]
) -> None:
    wanted = (Buffer.LIGHTING, Buffer.LIGHTING_MASK, Buffer.MATERIAL, Buffer.EMISSION)
    frame = derive(make_frame(buffers), wanted, BRDF)
    g = frame.gbuffer
    assert set(g) == set(wanted)
    assert g[Buffer.LIGHTING_MASK][..., :2, :].sum() == 0
    assert g[Buffer.LIGHTING_MASK][..., 2:, :].min() == 1
    recomposed = g[Buffer.LIGHTING] * g[Buffer.MATERIAL] + g[Buffer.EMISSION]
    assert torch.allclose(recomposed, buffers[Buffer.COLOR], rtol=1e-5)
    surface = g[Buffer.LIGHTING][..., 2:, :].double()
    scale = torch.exp(torch.log(surface + 1e-3).mean())
    assert frame.lighting_scale == pytest.approx(float(scale), rel=1e-6)


def test_lighting_that_is_stored_is_taken_as_it_is(
    make_frame: MakeFrame, buffers: dict[Buffer, torch.Tensor]
) -> None:
    lighting = image(3, 10, 1.0, 2.0)
    parts = {Buffer.LIGHTING: lighting, Buffer.MATERIAL: buffers[Buffer.MATERIAL]}
    frame = derive(make_frame(parts), (Buffer.LIGHTING, Buffer.LIGHTING_MASK), BRDF)
    assert torch.equal(frame.gbuffer[Buffer.LIGHTING], lighting)
    assert frame.gbuffer[Buffer.LIGHTING_MASK].min() == 1


def test_softplus_divides_the_sky_too_and_leaves_emission_in(
    make_frame: MakeFrame, buffers: dict[Buffer, torch.Tensor]
) -> None:
    frame = derive(
        make_frame(buffers), (Buffer.LIGHTING, Buffer.LIGHTING_MASK, Buffer.MATERIAL), SOFTPLUS
    )
    g = frame.gbuffer
    assert g[Buffer.LIGHTING_MASK].min() == 1
    recomposed = g[Buffer.LIGHTING] * g[Buffer.MATERIAL]
    assert torch.allclose(recomposed, buffers[Buffer.COLOR], rtol=1e-5)


def test_only_what_is_wanted_is_kept_and_a_wanted_buffer_that_is_absent_is_left_out(
    make_frame: MakeFrame, buffers: dict[Buffer, torch.Tensor]
) -> None:
    frame = derive(make_frame(buffers), (Buffer.COLOR, Buffer.SKY, Buffer.REACTIVE), BRDF)
    assert set(frame.gbuffer) == {Buffer.COLOR, Buffer.SKY}
    assert frame.lighting_scale == 1.0


def test_bad_pixels_of_the_gbuffer_are_not_divided(
    make_frame: MakeFrame, buffers: dict[Buffer, torch.Tensor]
) -> None:
    buffers[Buffer.MATERIAL][0, 1, 6, 6] = float("nan")
    frame = derive(make_frame(buffers), (Buffer.LIGHTING, Buffer.LIGHTING_MASK), BRDF)
    assert float(frame.gbuffer[Buffer.LIGHTING_MASK][0, 0, 6, 6]) == 0.0
    assert torch.isfinite(frame.gbuffer[Buffer.LIGHTING]).all()


def test_diffuse_colour_with_f0_is_the_base_colour_that_systems_know(
    make_frame: MakeFrame, buffers: dict[Buffer, torch.Tensor]
) -> None:
    c, m = buffers[Buffer.ALBEDO], buffers[Buffer.METALLIC]
    del buffers[Buffer.METALLIC], buffers[Buffer.MATERIAL]
    buffers[Buffer.ALBEDO] = (1.0 - m) * c
    buffers[Buffer.SPECULAR] = 0.04 * (1.0 - m) + m * c
    frame = make_frame(buffers)
    found = derive(frame, {Buffer.ALBEDO}, BRDF).gbuffer
    assert torch.allclose(found[Buffer.ALBEDO], c, atol=1e-5)
    assert torch.allclose(found[Buffer.METALLIC], m, atol=1e-5)
    # who asks for F0 as well gets what the files hold
    stored = derive(frame, {Buffer.ALBEDO, Buffer.SPECULAR}, BRDF).gbuffer
    assert torch.equal(stored[Buffer.ALBEDO], buffers[Buffer.ALBEDO])
    assert Buffer.METALLIC not in stored


def test_base_colour_beside_f0_and_metallic_is_left_as_it_is(
    make_frame: MakeFrame, buffers: dict[Buffer, torch.Tensor]
) -> None:
    buffers[Buffer.SPECULAR] = torch.full_like(buffers[Buffer.ALBEDO], 0.3)
    found = resolve_needs([Buffer.ALBEDO], buffers, has_camera=True, config=BRDF)
    assert found.read == {Buffer.ALBEDO, Buffer.SPECULAR, Buffer.METALLIC}
    made = derive(make_frame(buffers), {Buffer.ALBEDO}, BRDF).gbuffer
    assert torch.equal(made[Buffer.ALBEDO], buffers[Buffer.ALBEDO])
