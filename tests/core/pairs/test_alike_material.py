"""What else is of a material that differs between the sizes."""

from __future__ import annotations

import torch

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.resampling import decimate
from rtsr_cli.core.pairs.alike_material import hold_all, leave_alike
from rtsr_cli.core.pairs.doubted_material import leave_doubted
from rtsr_cli.core.pairs.held_samples import hold_samples
from rtsr_cli.core.pairs.material_causes import DIFFERS, describe_difference
from tests.core.pairs.test_material_agreement import PART, SCALE, SIZE, frame, region
from tests.core.pairs.test_surface_factors import make_pair

FAR_AWAY = region(80, 92, 8, 20)
WALL, RIGHT, WRONG = 0.7, (0.5, 0.4, 0.1), (0.2, 0.4, 0.1)


def paint(where: torch.Tensor, colour: tuple[float, ...]) -> torch.Tensor:
    wall = torch.full((1, 3, *SIZE), WALL)
    return torch.where(where, torch.tensor(colour).view(1, 3, 1, 1), wall)


def test_parts_of_the_material_elsewhere_go_with_what_was_found() -> None:
    thing = PART | FAR_AWAY
    lr, hr = make_pair(paint(thing, WRONG), paint(thing, RIGHT), thing)
    found = decimate(PART, SCALE, (2, 2))
    left, bare, taken = leave_alike(hold_all(hold_samples(lr, hr, SCALE)), lr, hr, found, SCALE)
    assert torch.equal(taken, decimate(thing, SCALE, (2, 2)))
    gone = (left.gbuffer[Buffer.MATERIAL] == 0.0).all(1, keepdim=True)
    assert torch.equal(gone, decimate(FAR_AWAY, SCALE, (2, 2)))
    lost = (bare.gbuffer[Buffer.MATERIAL] == 0.0).all(1, keepdim=True)
    assert torch.equal(lost, thing)


def test_what_agrees_keeps_its_material() -> None:
    """A thing of the same colour elsewhere, which is right at both sizes."""
    both = PART | FAR_AWAY
    small = torch.where(PART, paint(PART, WRONG), paint(both, RIGHT))
    lr, hr = make_pair(small, paint(both, RIGHT), both)
    found = decimate(PART, SCALE, (2, 2))
    _, bare, taken = leave_alike(hold_all(hold_samples(lr, hr, SCALE)), lr, hr, found, SCALE)
    assert torch.equal(taken, found)
    lost = (bare.gbuffer[Buffer.MATERIAL] == 0.0).all(1, keepdim=True)
    assert torch.equal(lost, PART)


def test_samples_at_edges_that_see_a_thing_where_its_pixel_does_not_go_with_it() -> None:
    wider = region(20, 76, 36, 104)
    small, large = paint(wider, WRONG), paint(PART, RIGHT)
    lr, hr = make_pair(small, large, PART)
    found = decimate(PART, SCALE, (2, 2))
    *_, taken = leave_alike(hold_all(hold_samples(lr, hr, SCALE)), lr, hr, found, SCALE)
    assert torch.equal(taken, decimate(wider, SCALE, (2, 2)))


def test_both_colours_are_said() -> None:
    lr, hr = make_pair(paint(PART, WRONG), paint(PART, RIGHT), PART)
    pair = leave_doubted(lr, hr, SCALE, divided=False)
    assert list(pair.doubted) == [DIFFERS]
    assert pair.colours == {
        DIFFERS: "material about 0.2, 0.4, 0.1 at LR where HR has 0.5, 0.4, 0.1"
    }


def test_of_one_base_colour_the_material_is_said() -> None:
    """Metallic or roughness differs."""
    albedo = paint(PART, RIGHT)
    lr = frame(decimate(paint(PART, WRONG), SCALE, (2, 2)), albedo=decimate(albedo, SCALE, (2, 2)))
    hr = frame(paint(PART, RIGHT), albedo=albedo)
    said = describe_difference(hold_samples(lr, hr, SCALE), decimate(PART, SCALE, (2, 2)))
    assert said.startswith("material about 0.2, ")
    hr = frame(paint(PART, RIGHT), albedo=1.5 * albedo)
    said = describe_difference(hold_samples(lr, hr, SCALE), decimate(PART, SCALE, (2, 2)))
    assert said == "base colour about 0.5, 0.4, 0.1 at LR where HR has 0.75, 0.6, 0.15"
