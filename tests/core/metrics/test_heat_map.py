from __future__ import annotations

import torch

from rtsr_cli.core.imaging.color import decode_srgb, luminance
from rtsr_cli.core.metrics.heat_map import heat_map, heat_ramp


def test_the_ramp_runs_from_black_to_a_pale_colour_and_brightens_with_every_step() -> None:
    ramp = heat_ramp()
    assert ramp[0].tolist() == [0.0, 0.0, 0.0]
    assert ramp[-1].min() > 0.7
    lightness = luminance(decode_srgb(ramp.t()[None, :, None])).flatten() ** (1.0 / 3.0)
    assert (lightness.diff() > 0.0).all()
    # even steps: no quarter of the ramp takes less than half its share of lightness
    assert (lightness[::51].diff() > 0.1).all()


def test_values_find_their_colour_and_what_lies_outside_the_ends() -> None:
    ramp = heat_ramp()
    values = torch.tensor([[[-1.0, 0.0, 1.0, 2.0, 5.0, torch.nan]]])
    picture = heat_map(values, largest=2.0)
    assert picture.shape == (1, 3, 1, 6)
    expected = ramp[[0, 0, 128, 255, 255, 0]]
    assert torch.equal(picture[0, :, 0].t(), expected)
