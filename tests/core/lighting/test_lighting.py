"""Lighting as networks see it, and what they are judged on."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.enlargement import enlarge_masked_radiance
from rtsr_cli.core.imaging.resampling import decimate, sample_jitter
from rtsr_cli.core.lighting.lighting import (
    FADING_SHARE,
    LOG_LIGHTING,
    MAX_LIGHTING,
    LossWeights,
    Surroundings,
    align_image,
    batch_masked_mean,
    build_lighting_goal,
    build_lighting_inputs,
    compose_lighting,
    decode_lighting,
    encode_lighting,
    inverse_depth,
    keep_lighting,
    keep_picture,
    keep_unseen,
    lighting_loss,
    recompose_prediction,
    stored_depth,
    unalign_image,
)
from rtsr_cli.core.lighting.radiance import add_sky
from rtsr_cli.core.system import FrameWindow

SCALE, SIZE = 4, (24, 32)

K = 0.6
"""Lighting scale of the frame."""


def frame(buffers: dict[Buffer, Tensor], jitter_px: tuple[float, float] = (0.0, 0.0)) -> Frame:
    gbuffer = GBuffer(buffers, "made by a test")
    return Frame(
        number=1,
        gbuffer=gbuffer,
        camera=CameraMetadata(jitter_px=jitter_px),
        view=View(display=gbuffer.size),
        lighting_scale=K,
    )


def capture() -> Frame:
    """Surfaces over sky, a strip of black metal that is not divided, a lamp."""
    torch.manual_seed(4)
    sky, mask = torch.zeros(1, 1, *SIZE), torch.ones(1, 1, *SIZE)
    sky[..., :4, :] = 1.0
    mask[..., :8, :] = 0.0
    material = torch.where(mask > 0, 0.2 + 0.6 * torch.rand(1, 3, *SIZE), torch.ones(1, 3, *SIZE))
    emission = torch.zeros(1, 3, *SIZE)
    emission[..., 12:14, :] = 5.0
    lighting = 0.1 + torch.rand(1, 3, *SIZE)
    return frame(
        {
            Buffer.COLOR: lighting * material + emission,
            Buffer.LIGHTING: lighting,
            Buffer.LIGHTING_MASK: mask,
            Buffer.SKY: sky,
            Buffer.MATERIAL: material,
            Buffer.EMISSION: emission,
        }
    )


def window(offset: tuple[int, int] = (2, 2)) -> FrameWindow:
    hr = capture()
    jitter_px = (sample_jitter(offset[0], SCALE), sample_jitter(offset[1], SCALE))
    lr = {b: decimate(t, SCALE, offset) for b, t in hr.gbuffer.items()}
    known = dict(hr.gbuffer.only((Buffer.MATERIAL, Buffer.SKY, Buffer.EMISSION)).buffers)
    # what black metal's quotient is multiplied by is 1, its material is not
    known[Buffer.MATERIAL] = known[Buffer.MATERIAL] * hr.gbuffer[Buffer.LIGHTING_MASK]
    hr_frame = frame(known)
    return FrameWindow(lr=(frame(lr, jitter_px),), hr=hr_frame, scale=SCALE)


def test_encoding_is_undone_by_decoding() -> None:
    lighting = torch.tensor([0.0, 1e-3, 0.5, 7.0, 64.0]).view(1, 1, 1, 5)
    scale = torch.full((1, 1, 1, 1), K)
    encoded = encode_lighting(lighting, scale)
    assert float(encoded[..., 2]) == pytest.approx(math.log(1 + 0.5 / K))
    assert torch.allclose(decode_lighting(encoded, scale), lighting, rtol=1e-5)


def test_negative_predictions_are_no_light() -> None:
    scale = torch.ones(1, 1, 1, 1)
    assert float(decode_lighting(torch.full((1, 3, 1, 1), -2.0), scale).abs().max()) == 0.0


def test_depth_of_sky_is_zero_for_a_network() -> None:
    depth = torch.tensor([SKY_DEPTH_M, 0.0, 1.0, 3.0]).view(1, 1, 1, 4)
    expected = torch.tensor([0.0, 1.0, 0.5, 0.25]).view(1, 1, 1, 4)
    assert torch.equal(inverse_depth(depth), expected)
    assert torch.equal(stored_depth(depth), depth)


@pytest.mark.parametrize("offset", [(0, 0), (2, 2), (3, 1)])
def test_alignment_is_undone_inside(offset: tuple[int, int]) -> None:
    seen, image = window(offset), torch.rand(1, 3, *SIZE)
    back = unalign_image(seen, align_image(seen, image))
    assert torch.equal(back[..., 2:-2, 2:-2], image[..., 2:-2, 2:-2])


@pytest.mark.parametrize("offset", [(2, 2), (1, 3)])
def test_a_perfect_prediction_has_no_loss(offset: tuple[int, int]) -> None:
    seen = window(offset)
    inputs, goal = (
        build_lighting_inputs(seen, LOG_LIGHTING),
        build_lighting_goal(LOG_LIGHTING, seen, capture()),
    )
    terms = lighting_loss(LOG_LIGHTING, LossWeights(), goal["encoded"], inputs=inputs, goal=goal)
    assert set(terms) == {"log", "tonemapped"}
    assert all(float(term) < 1e-6 for term in terms.values())


BARE = Surroundings(
    show_depth=stored_depth,
    decode=keep_lighting,
    corrects_base=False,
    finish=keep_picture,
    goal=lambda reference, scale: {},
    max_radiance=2.0,
)
"""Of a network that predicts lighting itself, with nothing around it."""


def test_without_surroundings_a_perfect_prediction_is_the_quotient() -> None:
    seen = window()
    # everything is divided by the same material that it is multiplied by, without emission
    hr = capture()
    seen = replace(seen, hr=frame(dict(hr.gbuffer.only((Buffer.MATERIAL, Buffer.SKY)).buffers)))
    color = hr.gbuffer[Buffer.COLOR].clamp(max=BARE.max_radiance)
    quotient = color / capture().gbuffer[Buffer.MATERIAL]
    inputs, goal = build_lighting_inputs(seen, BARE), build_lighting_goal(BARE, seen, capture())
    assert set(inputs) == {"material", "lighting_scale"}
    assert set(goal) == {"color", "surface_mask"}
    weights = LossWeights(log=1.0, tonemapped=0.0, radiance=1.0)
    terms = lighting_loss(BARE, weights, quotient, inputs=inputs, goal=goal)
    assert set(terms) == {"radiance"}
    assert float(terms["radiance"]) < 1e-6
    image = compose_lighting(BARE, seen, inputs, quotient).image
    assert image is not None
    assert torch.allclose(image, color, rtol=1e-5)


def test_masked_pixels_do_not_count() -> None:
    seen = window()
    inputs, goal = (
        build_lighting_inputs(seen, LOG_LIGHTING),
        build_lighting_goal(LOG_LIGHTING, seen, capture()),
    )

    def terms(predicted: Tensor) -> dict[str, float]:
        found = lighting_loss(LOG_LIGHTING, LossWeights(), predicted, inputs=inputs, goal=goal)
        return {name: float(term) for name, term in found.items()}

    right = goal["encoded"]
    assert terms(torch.where(goal["surface_mask"] > 0, right, right + 9.0))["tonemapped"] < 1e-6
    undivided = torch.where(goal["divided_mask"] > 0, right, right + 9.0)
    assert terms(undivided)["log"] < 1e-6
    assert terms(undivided)["tonemapped"] < 1e-6
    # an error of 1 in every divided pixel weighs what the log term weighs
    assert terms(right + 1.0)["log"] == pytest.approx(0.1, rel=1e-4)


def test_a_masked_mean_is_over_its_pixels_alone() -> None:
    values = torch.tensor([1.0, 5.0, 100.0]).view(1, 1, 1, 3).expand(1, 3, 1, 3)
    mask = torch.tensor([1.0, 1.0, 0.0]).view(1, 1, 1, 3)
    assert float(batch_masked_mean(values, mask)) == pytest.approx(3.0)
    assert float(batch_masked_mean(values, 0.0 * mask)) == 0.0


def test_a_perfect_prediction_is_the_capture() -> None:
    seen, whole = window(), capture().gbuffer
    inputs, goal = (
        build_lighting_inputs(seen, LOG_LIGHTING),
        build_lighting_goal(LOG_LIGHTING, seen, capture()),
    )
    every = whole[Buffer.LIGHTING_MASK].expand(1, 3, -1, -1) > 0.5
    image = recompose_prediction(goal["encoded"], inputs, LOG_LIGHTING)
    assert torch.allclose(image[every], whole[Buffer.COLOR][every], rtol=1e-4)
    composed = compose_lighting(LOG_LIGHTING, seen, inputs, goal["encoded"]).image
    assert composed is not None
    assert torch.allclose(composed[every], whole[Buffer.COLOR][every], rtol=1e-4)
    assert not torch.allclose(composed[~every], whole[Buffer.COLOR][~every], rtol=1e-2)


def test_sky_and_surfaces_without_material_are_never_the_networks() -> None:
    seen = window()
    inputs = build_lighting_inputs(seen, LOG_LIGHTING)
    own = capture().gbuffer[Buffer.LIGHTING_MASK].expand(1, 3, -1, -1) < 0.5
    dark, bright = (
        compose_lighting(LOG_LIGHTING, seen, inputs, torch.full((1, 3, *SIZE), value)).image
        for value in (0.0, 3.0)
    )
    assert dark is not None
    assert bright is not None
    assert torch.equal(dark[own], bright[own])
    assert (dark < bright)[~own].all()


@pytest.mark.parametrize(
    ("brightest", "believed"),
    [
        (1.0, 1.0),
        (FADING_SHARE * MAX_LIGHTING, 1.0),
        (48.0, 0.5),
        (MAX_LIGHTING, 0.0),
        (200.0, 0.0),
    ],
)
def test_lighting_brighter_than_networks_are_shown_keeps_its_enlargement(
    brightest: float, believed: float
) -> None:
    scale = torch.full((1, 1, 1, 1), K)
    base = encode_lighting(torch.tensor([0.1, brightest, 0.5]).view(1, 3, 1, 1), scale)
    predicted = base - 0.25
    kept = keep_unseen({"base": base, "lighting_scale": scale}, predicted)
    assert torch.allclose(kept, base - 0.25 * believed, atol=1e-5)
    # of what corrects no enlargement, nothing is known
    assert keep_unseen({"lighting_scale": scale}, predicted) is predicted


def test_what_a_network_makes_of_unseen_lighting_is_no_part_of_the_picture() -> None:
    seen = window()
    inputs = build_lighting_inputs(seen, LOG_LIGHTING)
    inputs["base"] = inputs["base"] + math.log(1000.0)
    expected = compose_lighting(LOG_LIGHTING, seen, inputs, inputs["base"]).image
    darkened = compose_lighting(LOG_LIGHTING, seen, inputs, inputs["base"] - 1.0).image
    assert expected is not None
    assert darkened is not None
    assert torch.equal(darkened, expected)


@pytest.mark.parametrize("rows", [(0, 3), (21, 26), (77, 80), (0, 80), (40, 40)])
def test_sky_is_the_same_as_if_the_whole_frame_were_enlarged(rows: tuple[int, int]) -> None:
    torch.manual_seed(5)
    size, jitter_px = (80, 48), (0.375, -0.125)
    sky = torch.zeros(1, 1, *size)
    sky[..., rows[0] : rows[1], 5:40] = 1.0
    color = 3.0 * torch.rand(1, 3, size[0] // SCALE, size[1] // SCALE)
    lr_sky = decimate(sky, SCALE, (2, 2))
    seen = FrameWindow(
        lr=(frame({Buffer.COLOR: color, Buffer.SKY: lr_sky}, jitter_px),),
        hr=frame({Buffer.SKY: sky}),
        scale=SCALE,
    )
    image = torch.rand(1, 3, *size)
    whole = enlarge_masked_radiance(color, lr_sky, SCALE, jitter_px)
    expected = torch.where(sky > 0.5, whole, image)
    assert torch.allclose(add_sky(seen, image), expected, atol=1e-6)
