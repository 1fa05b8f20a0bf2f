from __future__ import annotations

import numpy as np
import pytest
import torch

from rtsr_cli.core.frames.camera import View
from rtsr_cli.core.imaging.warping import backward_warp
from rtsr_cli.core.training.augmentation import (
    AlbedoSwap,
    AugmentationConfig,
    PictureTurn,
    draw_gain,
    draw_swap,
    draw_turn,
    relight_planes,
    swap_albedo,
)
from rtsr_cli.core.training.clips import MATERIAL_GAIN

TURNS = [
    PictureTurn(transposed=t, mirror_x=x, mirror_y=y)
    for t in (False, True)
    for x in (False, True)
    for y in (False, True)
]


@pytest.mark.parametrize("turn", TURNS)
def test_motion_goes_along_with_the_picture(turn: PictureTurn) -> None:
    """Fetching and turning commute: the turned motion points at the turned pixel."""
    image = torch.rand(1, 3, 9, 13)
    motion = torch.randint(-3, 4, (1, 2, 9, 13)).float()
    fetched, _ = backward_warp(image, motion, mode="nearest")
    turned, _ = backward_warp(
        turn.plane("color", image), turn.plane("motion", motion), mode="nearest"
    )
    assert torch.equal(turn.plane("color", fetched), turned)


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("scale", [2, 3, 4])
def test_samples_that_are_kept_lie_at_their_offset_after_the_turn(
    turn: PictureTurn, scale: int
) -> None:
    image = torch.arange(float((6 * scale) * (5 * scale))).view(1, 1, 6 * scale, 5 * scale)
    for after in [(x, y) for x in range(scale) for y in range(scale)]:
        x, y = turn.source_offset(after, scale)
        kept = turn.image(image[..., y::scale, x::scale])
        assert torch.equal(kept, turn.image(image)[..., after[1] :: scale, after[0] :: scale])


@pytest.mark.parametrize("turn", TURNS)
def test_a_part_of_an_image_lies_where_the_turn_of_the_whole_brings_it(turn: PictureTurn) -> None:
    image = torch.arange(9.0 * 13).view(1, 1, 9, 13)
    view = turn.view(View(display=(9, 13), top=2, left=3), (4, 5))
    part = turn.image(image[..., 2:6, 3:8])
    whole = turn.image(image)
    assert view.display == whole.shape[-2:]
    rows, columns = part.shape[-2:]
    shown = whole[..., view.top : view.top + rows, view.left : view.left + columns]
    assert torch.equal(shown, part)


@pytest.mark.parametrize("turn", TURNS)
def test_a_jitter_goes_along_with_its_sample(turn: PictureTurn) -> None:
    scale = 4
    for column in range(scale):
        for row in range(scale):
            mark = torch.zeros(1, 1, scale, scale)
            mark[..., row, column] = 1.0
            turned_row, turned_column = divmod(int(turn.image(mark).flatten().argmax()), scale)
            offset = ((column + 0.5) / scale - 0.5, (row + 0.5) / scale - 0.5)
            assert turn.jitter(offset) == (
                (turned_column + 0.5) / scale - 0.5,
                (turned_row + 0.5) / scale - 0.5,
            )


def test_the_world_turns_with_the_handedness_of_the_picture() -> None:
    for seed in range(200):
        turn = draw_turn(np.random.default_rng(seed))
        world = np.eye(3)[list(turn.axes)] * np.array(turn.signs)[:, None]
        mirrored = (turn.transposed + turn.mirror_x + turn.mirror_y) % 2
        assert np.linalg.det(world) == pytest.approx(-1.0 if mirrored else 1.0)


def test_every_turn_of_picture_and_world_comes_up() -> None:
    drawn = {draw_turn(np.random.default_rng(seed)) for seed in range(3000)}
    assert len(drawn) == 8 * 24


def test_normals_keep_their_angles() -> None:
    normals = torch.nn.functional.normalize(torch.randn(1, 3, 4, 4))
    turn = draw_turn(np.random.default_rng(3))
    turned = turn.plane("normal", normals)
    before = (normals[..., :1, :1] * normals).sum(1)
    corner = turn.image(torch.arange(16.0).view(1, 1, 4, 4))
    row, column = divmod(int((corner == 0).flatten().nonzero()), 4)
    after = (turned[..., row : row + 1, column : column + 1] * turned).sum(1)
    assert torch.allclose(turn.image(before[None])[0], after, atol=1e-6)


def test_light_takes_the_gain_and_nothing_else_does() -> None:
    planes = {name: torch.ones(1, 3, 2, 2) for name in ("color", "emission", "albedo", "normal")}
    changed = relight_planes(planes, (2.0, 1.0, 0.5))
    expected = torch.tensor([2.0, 1.0, 0.5]).view(1, 3, 1, 1).expand(1, 3, 2, 2)
    assert torch.equal(changed["color"], expected)
    assert torch.equal(changed["emission"], expected)
    assert torch.equal(changed["albedo"], planes["albedo"])
    assert torch.equal(changed["normal"], planes["normal"])


def test_a_swap_leaves_the_lighting() -> None:
    """radiance' = lighting F' + emission with F' = gain c' + rest, by hand."""
    albedo = torch.tensor([0.8, 0.4, 0.2]).view(1, 3, 1, 1)
    lighting, emission, gain = 3.0, 0.5, 0.9
    material = gain * albedo + 0.02
    planes = {
        "albedo": albedo,
        "material": material,
        "color": lighting * material + emission,
        "emission": torch.full((1, 3, 1, 1), emission),
        MATERIAL_GAIN: torch.full((1, 1, 1, 1), gain),
    }
    changed = swap_albedo(planes, AlbedoSwap(permutation=(2, 0, 1), gain=(1.0, 0.5, 2.0)))
    new_albedo = torch.tensor([0.2, 0.4, 0.8]).view(1, 3, 1, 1)
    new_material = gain * new_albedo + 0.02
    assert torch.allclose(changed["albedo"], new_albedo)
    assert torch.allclose(changed["material"], new_material)
    assert torch.allclose(changed["color"], lighting * new_material + emission)


def test_a_swap_leaves_alone_what_cannot_be_divided() -> None:
    planes = {
        "albedo": torch.zeros(1, 3, 1, 1),
        "material": torch.full((1, 3, 1, 1), 1e-3),
        "color": torch.full((1, 3, 1, 1), 0.7),
        MATERIAL_GAIN: torch.ones(1, 1, 1, 1),
    }
    changed = swap_albedo(planes, AlbedoSwap(permutation=(0, 1, 2), gain=(4.0, 4.0, 4.0)))
    assert all(torch.equal(changed[name], planes[name]) for name in planes)


def test_without_albedo_nothing_is_swapped() -> None:
    planes = {"color": torch.rand(1, 3, 2, 2)}
    assert swap_albedo(planes, draw_swap(AugmentationConfig(), np.random.default_rng(1))) == planes


def test_gains_stay_within_their_stops() -> None:
    config = AugmentationConfig(exposure_stops=2.0, tint_stops=0.5)
    gains = np.array([draw_gain(config, np.random.default_rng(i)) for i in range(500)])
    assert np.abs(np.log2(gains)).max() <= 2.5
    assert np.ptp(np.log2(gains), axis=1).max() <= 1.0
    assert np.abs(np.log2(gains)).max() > 2.0
