"""Settings of a run are refused before any work starts."""

from __future__ import annotations

import math

import pytest

from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.lighting.lighting import LossWeights
from rtsr_cli.core.training.config import TrainingConfig
from rtsr_cli.models.nsrd.config import NSRDConfig, NSRDLossWeights


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("steps", 0),
        ("batch", 0),
        ("crop", 0),
        ("accumulate", 0),
        ("validate_every", 0),
        ("learning_rate", -1.0),
        ("learning_rate", math.nan),
        ("ema", -0.1),
    ],
)
def test_numbers_that_nothing_can_be_trained_with_are_refused(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=rf"training\.{name} = "):
        TrainingConfig(**{name: value})


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_terms_of_a_loss_weigh_nothing_or_more(value: float) -> None:
    with pytest.raises(ConfigError, match=r"network\.loss\.temporal"):
        NSRDLossWeights(temporal=value)


def test_a_loss_of_no_terms_is_refused() -> None:
    with pytest.raises(ConfigError, match="one of log, tonemapped, tonemapped_squared, radiance"):
        LossWeights(log=0.0, tonemapped=0.0)


def test_a_gradient_flows_through_one_frame_at_least() -> None:
    with pytest.raises(ConfigError, match=r"network\.gradient_frames = 0"):
        NSRDConfig(gradient_frames=0)
