"""`demod-temporal`: what it starts from, and its settings."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.system import FrameWindow, Prediction
from rtsr_cli.models import load_system
from rtsr_cli.models.temporal import DemodTemporalConfig

SCALE = 4
SYSTEM = load_system("demod-temporal")

MakeWindows = Callable[..., list[FrameWindow]]


def run(windows: list[FrameWindow], name: str = "demod-temporal") -> list[Prediction]:
    system = load_system(name)
    network, state, made = system.build(system.config(), SCALE), None, []
    for window in windows:
        made.append(system.predict(network, window, state))
        state = made[-1].state
    return made


def test_the_first_frame_is_enlarged_along_surfaces(make_windows: MakeWindows) -> None:
    windows = make_windows(SYSTEM, SCALE, optional=True)
    first, guided = run(windows)[0].image, run(windows[:1], "demod-guided")[0].image
    assert first is not None
    assert guided is not None
    # what jitter moves in from beyond the border is not known
    inner = (..., slice(SCALE, -SCALE), slice(SCALE, -SCALE))
    torch.testing.assert_close(first[inner], guided[inner], rtol=1e-3, atol=1e-4)


def test_later_frames_gain_from_it(make_windows: MakeWindows) -> None:
    """The shot's light is a function of the place on the surface, and moves along."""
    windows = make_windows(SYSTEM, SCALE, count=3, optional=True)
    worth = [made.debug["worth"] for made in run(windows)]
    inner = (..., slice(4 * SCALE, None), slice(None, -4 * SCALE))
    means = [float(w[inner].mean()) for w in worth]
    assert means[0] < means[1] < means[2]
    assert all(bool(torch.isfinite(made.debug["lighting"]).all()) for made in run(windows))


def test_hr_motion_and_ids_are_no_condition(make_windows: MakeWindows) -> None:
    windows = make_windows(SYSTEM, SCALE, optional=False)
    hr = windows[-1].require_hr().gbuffer
    assert Buffer.MOTION not in hr
    assert Buffer.OBJECT_ID not in hr
    image = run(windows)[-1].image
    assert image is not None
    assert bool(torch.isfinite(image).all())


@pytest.mark.parametrize("wrong", [{"age": 1.5}, {"change_spread": 0.0}, {"fit_power": -1.0}])
def test_weights_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        DemodTemporalConfig(**wrong)
