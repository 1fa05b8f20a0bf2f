"""rt-percept: sizes, transforms, inputs, and what it never looks at."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.choices import VrsMetric
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.network.acceleration import accelerate_network
from rtsr_cli.core.network.cost import count_macs, count_parameters
from rtsr_cli.core.system import FrameWindow
from rtsr_cli.core.vrs.rates import ShadingRate
from rtsr_cli.core.vrs.reprojection import encode_display, reproject
from rtsr_cli.core.vrs.shading_error import ErrorConfig, tile_errors
from rtsr_cli.models import load_system
from rtsr_cli.models.rt_percept.config import (
    ConvolutionGroups,
    ErrorTransform,
    NetworkInputs,
    RtPerceptConfig,
)
from rtsr_cli.models.rt_percept.inputs import SETS, prepare
from rtsr_cli.models.rt_percept.loss import goal, loss, restore_errors, transform_errors
from rtsr_cli.models.rt_percept.network import pool_sizes

SYSTEM = load_system("rt-percept")
CONFIG = RtPerceptConfig(mean=0.5)

MakeWindows = Callable[..., list[FrameWindow]]


@pytest.mark.parametrize(
    ("config", "parameters"),
    [
        (CONFIG, 5_388),
        (RtPerceptConfig(groups=ConvolutionGroups.TABLE_3), 4_524),
        (RtPerceptConfig(rates=("1x2", "2x1")), 5_094),
        (RtPerceptConfig(inputs=NetworkInputs.FOUR), 5_388),
        (RtPerceptConfig(inputs=NetworkInputs.SIXTEEN), 7_116),
        (RtPerceptConfig(inputs=NetworkInputs.NINETEEN), 7_548),
    ],
    ids=["luma", "table 3", "two rates", "4", "16", "19"],
)
def test_a_network_has_the_published_size(config: RtPerceptConfig, parameters: int) -> None:
    assert count_parameters(SYSTEM.build(config, 1)) == parameters


def test_the_published_multiplications() -> None:
    # 1080 rows are padded to 1088
    assert count_macs(SYSTEM, CONFIG, 1, (1080, 1920)) / 1e9 == pytest.approx(6.71, abs=5e-3)


def test_pools_make_one_value_a_tile() -> None:
    expected = {
        1: (1, 1, 1, 1, 1),
        2: (1, 2, 1, 1, 1),
        4: (1, 2, 2, 1, 1),
        8: (1, 2, 2, 2, 1),
        16: (1, 2, 2, 2, 2),
        32: (1, 2, 2, 2, 4),
        64: (1, 2, 2, 2, 8),
    }
    for tile, sizes in expected.items():
        assert pool_sizes(tile) == sizes
        assert math.prod(sizes) == tile


@pytest.mark.parametrize("tile", [1, 2, 4, 8, 16, 32, 64])
def test_no_tile_is_lost_whatever_the_size(make_windows: MakeWindows, tile: int) -> None:
    config = replace(CONFIG, error=ErrorConfig(metric=VrsMetric.JNYANG, tile=tile))
    network = SYSTEM.build(config, 1).eval()
    window = make_windows(SYSTEM, 1)[-1]
    small = replace(window, lr=tuple(frame.crop(0, 0, (13, 21)) for frame in window.lr))
    with torch.inference_mode():
        tiles = SYSTEM.predict(network, small, None).tiles
    assert tiles is not None
    assert tiles.shape == (1, 4, -(-13 // tile), -(-21 // tile))
    wanted = goal(config, small, small.current)["errors"]
    assert wanted.shape == tiles.shape


@pytest.mark.parametrize("tile", [0, 3, 24, 128])
def test_other_tiles_are_refused(tile: int) -> None:
    with pytest.raises(ConfigError, match="power of two from 1 to 64"):
        RtPerceptConfig(error=ErrorConfig(tile=tile))


@pytest.mark.parametrize(
    "rates", [("1x2",), ("1x2", "2x1", "3x3"), ("2x2", "4x4"), ("1x2", "1x2", "2x1")]
)
def test_rates_that_others_do_not_follow_from_are_refused(rates: tuple[str, ...]) -> None:
    with pytest.raises(ConfigError, match="1x2 and 2x1"):
        RtPerceptConfig(rates=rates)


@pytest.mark.parametrize("name", ["mean", "margin", "threshold", "squared", "unseen_weight"])
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_numbers_below_zero_are_refused(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"network.{name}"):
        RtPerceptConfig(**{name: value})


def mean_of(value: float) -> Tensor:
    return torch.full((1, 1, 1, 1), value)


def test_the_clamped_transform_is_its_equation() -> None:
    errors = torch.tensor([0.0, 0.25, 0.5, 1.0, 3.0])
    found = transform_errors(errors, mean_of(0.5), CONFIG)
    assert found.flatten().tolist() == pytest.approx([0.0, 0.25, 0.5, 1.0, 1.0])


def test_the_logistic_transform_is_its_equation() -> None:
    config = replace(CONFIG, transform=ErrorTransform.LOGISTIC)

    def curve(y: float) -> float:
        return 1.0 / (1.0 + math.exp(-10.0 * (y - 0.3)))

    found = transform_errors(torch.tensor([0.0, 0.3, 1.0]), mean_of(0.3), config)
    middle = (0.5 - curve(0.0)) / (curve(1.0) - curve(0.0))
    assert found.flatten().tolist() == pytest.approx([0.0, middle, 1.0], abs=1e-6)


@pytest.mark.parametrize("kind", list(ErrorTransform))
@pytest.mark.parametrize("metric", [VrsMetric.FLIP, VrsMetric.PSNR])
@pytest.mark.parametrize("level", [0.5, 2.0])
def test_transforms_are_undone(kind: ErrorTransform, metric: VrsMetric, level: float) -> None:
    config = replace(CONFIG, transform=kind, error=ErrorConfig(metric=metric))
    errors = torch.linspace(0.0, 0.9, 20) * (60.0 if metric is VrsMetric.PSNR else 1.0)
    mean = mean_of(level)
    back = restore_errors(transform_errors(errors, mean, config), mean, config)
    assert torch.allclose(back.flatten(), errors, atol=1e-4, rtol=1e-4)
    for edge in (0.0, 1.0):
        assert torch.isfinite(restore_errors(torch.tensor([edge]), mean, config)).all()


def test_psnr_has_the_published_transform() -> None:
    config = replace(CONFIG, error=ErrorConfig(metric=VrsMetric.PSNR))
    found = transform_errors(torch.tensor([0.0, 20.0, 100.0]), mean_of(1.0), config)
    assert found.flatten().tolist() == pytest.approx([1.0, 0.7, 0.0])


@pytest.mark.parametrize("inputs", list(NetworkInputs))
def test_the_radiance_of_the_frame_itself_is_not_looked_at(
    make_windows: MakeWindows, inputs: NetworkInputs
) -> None:
    config = replace(CONFIG, inputs=inputs)
    window = make_windows(SYSTEM, 1, optional=True)[-1]
    seen = prepare(config, window)
    assert seen["seen"].shape[1] == SETS[inputs][0]
    now = window.current
    dark = {Buffer.COLOR: torch.zeros_like(now.gbuffer[Buffer.COLOR])}
    changed = replace(now, gbuffer=now.gbuffer.with_buffers(dark))
    other = prepare(config, replace(window, lr=(changed, *window.lr[1:])))
    assert torch.equal(seen["seen"], other["seen"])


def test_without_a_frame_before_nothing_is_seen(make_windows: MakeWindows) -> None:
    window = make_windows(SYSTEM, 1, count=1)[0]
    before = reproject(window)
    picture, seen = before.picture, before.seen
    assert not picture.any()
    assert not seen.any()
    assert not prepare(CONFIG, window)["mask"].any()


def test_what_the_frame_before_shows_comes_along(make_windows: MakeWindows) -> None:
    window = make_windows(SYSTEM, 1)[-1]
    before = reproject(window)
    picture, seen = before.picture, before.seen
    # the pattern moves one pixel to the left a frame
    expected = encode_display(window.lr[1].gbuffer[Buffer.COLOR]).roll(-1, dims=3)
    there = seen.expand_as(picture) > 0
    assert seen[..., 4:, 2:-2].mean() > 0.9
    assert torch.allclose(picture[there], expected[there], atol=1e-5)
    assert not picture[~there].any()


def flat(frame: Frame, value: float) -> Frame:
    color = torch.full_like(frame.gbuffer[Buffer.COLOR], value)
    return replace(frame, gbuffer=frame.gbuffer.with_buffers({Buffer.COLOR: color}))


def test_labels_are_errors_of_each_rate(make_windows: MakeWindows) -> None:
    config = replace(CONFIG, error=ErrorConfig(metric=VrsMetric.JNYANG, tile=8))
    window = make_windows(SYSTEM, 1)[-1]
    assert not goal(config, window, flat(window.current, 0.5))["errors"].any()
    stripes = window.current.gbuffer[Buffer.COLOR].clone()
    stripes[:] = 0.2
    stripes[..., ::2] = 0.8
    vertical = replace(
        window.current, gbuffer=window.current.gbuffer.with_buffers({Buffer.COLOR: stripes})
    )
    errors = goal(config, window, vertical)["errors"]
    by_rate = dict(zip(config.predicted, errors.unbind(1), strict=True))
    assert not by_rate[ShadingRate.HALF_Y].any()
    assert by_rate[ShadingRate.HALF_X].min() > 0.1


def test_the_loss_is_the_mean_absolute_difference_in_transformed_space() -> None:
    errors = torch.tensor([0.2, 2.0]).view(1, 1, 1, 2)
    outputs = {"predicted": torch.tensor([0.5, 0.5]).view(1, 1, 1, 2), "mean": mean_of(0.5)}
    inputs = {"mask": torch.ones(1, 1, 16, 32)}
    terms = loss(CONFIG, inputs, outputs, {"errors": errors})
    assert float(terms["error"]) == pytest.approx((0.3 + 0.5) / 2)
    inputs = {"mask": torch.cat([torch.ones(1, 1, 16, 16), torch.zeros(1, 1, 16, 16)], dim=3)}
    weighted = loss(replace(CONFIG, unseen_weight=3.0), inputs, outputs, {"errors": errors})
    assert float(weighted["error"]) == pytest.approx((0.3 + 3.0 * 0.5) / 4)


def test_the_mean_runs_with_the_errors_and_keeps_still_when_judged() -> None:
    config = RtPerceptConfig()
    network = cast(Any, SYSTEM.build(config, 1))
    outputs = {"predicted": torch.zeros(1, 1, 1, 2), "mean": network.mean}
    inputs = {"mask": torch.ones(1, 1, 16, 32)}
    errors = torch.tensor([0.2, 0.6]).view(1, 1, 1, 2)
    loss(config, inputs, outputs, {"errors": errors})
    assert float(network.mean) == pytest.approx(0.4)
    loss(config, inputs, outputs, {"errors": errors + 1e9})
    assert float(network.mean) == pytest.approx(0.99 * 0.4 + 0.01 * 10.0)
    kept = float(network.mean)
    with torch.no_grad():
        loss(config, inputs, outputs, {"errors": errors})
    assert float(network.mean) == kept


def test_what_reuse_predicts_is_the_error_of_the_frame_before(make_windows: MakeWindows) -> None:
    config = RtPerceptConfig(mean=0.5, reuse=True, error=ErrorConfig(metric=VrsMetric.JNYANG))
    window = make_windows(SYSTEM, 1)[-1]
    picture = reproject(window).picture
    found = goal(config, window, window.current)["errors"]
    shown = encode_display(window.current.gbuffer[Buffer.COLOR])
    assert found.shape[1] == 1
    assert torch.equal(found, tile_errors(picture, shown, config.error))
    assert count_parameters(SYSTEM.build(config, 1)) == 4_947


@pytest.mark.parametrize("tile", [1, 2, 16, 64])
def test_the_order_for_inference_is_the_same_function(tile: int) -> None:
    torch.manual_seed(3)
    config = replace(CONFIG, error=ErrorConfig(tile=tile))
    network = SYSTEM.build(config, 1).eval().requires_grad_(False)
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            for held, low, high in (
                (module.running_mean, -0.5, 0.5),
                (module.running_var, 0.3, 3.0),
                # of both signs: a maximum of what is negated is a minimum
                (module.weight, -2.0, 2.0),
                (module.bias, -0.5, 0.5),
            ):
                assert held is not None
                held.uniform_(low, high)
    fast = accelerate_network(network)
    for size in ((1, 1), (1, 7), (33, 21)):
        inputs = {"seen": torch.rand(2, 4, *size)}
        with torch.inference_mode():
            expected, found = (net(inputs, None)[0]["predicted"] for net in (network, fast))
        assert torch.allclose(found, expected, atol=1e-5)
