"""Baked patterns: they repeat, and coarser levels are means."""

from __future__ import annotations

import pytest
import torch

from rtsr_cli.core.synth.scene import Pattern
from rtsr_cli.core.synth.textures import LEVELS, TEXELS, bake_texture, look_up


@pytest.fixture
def places() -> tuple[torch.Tensor, torch.Tensor]:
    """Random positions in one period."""
    generator = torch.Generator().manual_seed(3)
    u, v = torch.rand(2, 500, generator=generator)
    return u, v


def test_patterns_repeat_with_period_one(places):
    u, v = places
    level = torch.full_like(u, 1.5)
    bricks = bake_texture(Pattern.BRICKS)
    first, other = look_up(bricks, u, v, level), look_up(bricks, u + 3.0, v - 2.0, level)
    torch.testing.assert_close(first, other, rtol=0.0, atol=2e-2)


def test_a_texel_centre_returns_the_texel():
    checker = bake_texture(Pattern.CHECKER)
    column, row = 700, 31
    u, v = (torch.tensor([(i + 0.5) / TEXELS]) for i in (column, row))
    found = look_up(checker, u, v, torch.zeros(1))[0]
    torch.testing.assert_close(found, checker.texels[row * TEXELS + column].float())


@pytest.mark.parametrize("pattern", list(Pattern))
def test_the_coarsest_level_is_the_mean_and_masks_stay_in_range(pattern):
    texels = bake_texture(pattern).texels.float()
    finest = texels[: TEXELS * TEXELS]
    torch.testing.assert_close(texels[-1], finest.mean(0), rtol=5e-3, atol=2e-3)
    assert finest[:, 0].min() >= 0
    assert finest[:, 0].max() <= 1
    assert finest[:, 1].std() > 0
    assert texels.shape == (sum((TEXELS >> i) ** 2 for i in range(LEVELS)), 4)


def test_between_levels_values_are_blended(places):
    u, v = places
    cobbles = bake_texture(Pattern.COBBLES)
    low, middle, high = (look_up(cobbles, u, v, torch.full_like(u, x)) for x in (2.0, 2.5, 3.0))
    torch.testing.assert_close(middle, (low + high) / 2, rtol=1e-4, atol=1e-5)
