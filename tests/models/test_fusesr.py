"""FuseSR: sizes of the published networks, geometry of what they see, history, where they start."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import pytest
import torch
from torch import Tensor, nn

from rtsr_cli.core.choices import DemodulationMode, Preset
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.resampling import decimate, sample_jitter
from rtsr_cli.core.lighting.lighting import MAX_LIGHTING, EnlargementBase, LossWeights
from rtsr_cli.core.network.cost import count_macs, count_parameters
from rtsr_cli.core.settings import SettingsSource, resolve_settings
from rtsr_cli.core.system import FrameWindow, System
from rtsr_cli.models import load_system
from rtsr_cli.models.fusesr import compose
from rtsr_cli.models.fusesr.config import (
    FuseSRConfig,
    FuseSRDirectConfig,
    FuseSRFastConfig,
    Fusion,
    Variant,
)
from rtsr_cli.models.fusesr.inputs import SURROUNDINGS, derivation, history_inputs, prepare
from rtsr_cli.models.fusesr.loss import goal, loss
from rtsr_cli.models.fusesr.network import WarpAttention

FULL, FAST, DIRECT = (load_system(n) for n in ("fusesr", "fusesr-fast", "fusesr-direct"))

HEAD = FuseSRConfig()
FIRST_RELEASE = FuseSRConfig(variant=Variant.FIRST_RELEASE)

MakeWindows = Callable[..., list[FrameWindow]]

NETWORKS = [
    (FULL, HEAD, 4, 2_274_662, 317.356),
    (FULL, FIRST_RELEASE, 4, 2_164_006, 303.024),
    (DIRECT, FuseSRDirectConfig(), 4, 2_247_014, 313.773),
    (FAST, FuseSRFastConfig(), 4, 68_108, 8.835),
    (FULL, HEAD, 8, 2_800_118, 96.485),
    (FULL, FIRST_RELEASE, 8, 2_578_870, 89.319),
    (DIRECT, FuseSRDirectConfig(), 8, 2_689_526, 92.902),
    (FAST, FuseSRFastConfig(), 8, 192_668, 6.366),
    (FAST, FuseSRFastConfig(), 2, 36_968, 18.710),
]
"""System, config, scale, parameters, GMAC for a 1920 x 1080 output."""


def scrambled(system: System, config: Any, scale: int) -> nn.Module:
    """Return a network whose every layer matters, and which differs from its start."""
    torch.manual_seed(3)
    network = system.build(config, scale).eval()
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            fan_in = module.weight[0].numel()
            nn.init.normal_(module.weight, std=math.sqrt(2.0 / fan_in))
            if module.bias is not None:
                nn.init.uniform_(module.bias, 0.0, 0.1)
    return network


def run(network: nn.Module, inputs: Any, state: Any = None) -> tuple[Tensor, Any]:
    with torch.inference_mode():
        outputs, kept = network(inputs, state)
    return outputs["predicted"], kept


@pytest.mark.parametrize(("system", "config", "scale", "parameters", "gmac"), NETWORKS)
def test_a_network_has_the_size_of_the_published_one(
    system: System, config: Any, scale: int, parameters: int, gmac: float
) -> None:
    assert count_parameters(system.build(config, scale)) == parameters
    # every layer costs the same at each LR pixel
    macs_a_pixel = count_macs(system, config, scale, (3, 5)) / 15
    pixels = 1920 * 1080 / scale**2
    assert round(macs_a_pixel * pixels / 1e9, 3) == gmac


def test_blocks_of_the_full_network_have_the_published_sizes() -> None:
    network = cast(Any, FULL.build(HEAD, 4))
    sizes = {
        "encoder": 88_240,
        "expand": 18_496,
        "attention": 306,
        "compact": 92_224,
        "backbone": 1_992_320,
    }
    assert {name: count_parameters(getattr(network, name)) for name in sizes} == sizes
    assert count_parameters(network.decoder.upsample) == 82_992
    assert count_parameters(network.decoder.refine) == 84


def test_blocks_of_the_fast_network_have_the_published_sizes() -> None:
    network = cast(Any, FAST.build(FuseSRFastConfig(), 4))
    # depthwise 9 n + n, pointwise n m + m, batch norm 2 m
    separable = sum(
        10 * n + (n + 1) * m + 2 * m for n, m in ((32, 16), (16, 12), (12, 12), (12, 16))
    )
    assert count_parameters(network.shallow) == 7 * 32 * 9 + 32
    assert count_parameters(network.main) == separable
    assert count_parameters(network.expand) == 16 * 32 * 9 + 32
    # a dense layer over 32 + 3 * 4 * 4 channels, then six of dw, BN, pw, BN without biases
    assert count_parameters(network.backbone) == (80 * 9 + 1) * 32 + 6 * (9 + 2 + 32 + 2) * 32
    assert count_parameters(network.decoder.upsample) == (64 * 9 + 1) * 48
    assert count_parameters(network.decoder.refine) == 84


@pytest.mark.parametrize(("system", "scale"), [(FAST, 2), (FULL, 4), (DIRECT, 4), (FULL, 8)])
def test_odd_sizes_give_the_target_size(
    make_windows: MakeWindows, system: System, scale: int
) -> None:
    windows = make_windows(system, scale)
    cut = [cropped(w, (13, 7)) for w in windows]
    network = scrambled(system, system.config(), scale)
    with torch.inference_mode():
        prediction = system.predict(network, cut[-1], None)
    assert prediction.image is not None
    assert prediction.image.shape == (1, 3, 13 * scale, 7 * scale)
    assert torch.isfinite(prediction.image).all()


def cropped(window: FrameWindow, size: tuple[int, int]) -> FrameWindow:
    assert window.hr is not None
    large = (size[0] * window.scale, size[1] * window.scale)
    lr = tuple(frame.crop(0, 0, size) for frame in window.lr)
    return replace(window, lr=lr, hr=window.hr.crop(0, 0, large))


@pytest.mark.parametrize("config", [replace(HEAD, fusion=f) for f in Fusion], ids=list(Fusion))
@pytest.mark.parametrize("history", [True, False], ids=["history", "no history"])
def test_ablations_run(make_windows: MakeWindows, config: FuseSRConfig, history: bool) -> None:
    config = replace(config, history=history)
    window = make_windows(FULL, 4)[-1]
    predicted, state = run(scrambled(FULL, config, 4), prepare(config, window))
    assert predicted.shape == (1, 3, 64, 96)
    assert torch.isfinite(predicted).all()
    assert (state is not None) == history


def test_attention_is_its_equation() -> None:
    attention = WarpAttention().requires_grad_(False)
    for layer, weight in ((attention.first, 1.0), (attention.second, -1.0)):
        nn.init.dirac_(layer.weight)
        layer.weight.data *= weight
        nn.init.zeros_(cast(Tensor, layer.bias))
    nn.init.dirac_(attention.last.weight)
    attention.last.weight.data *= 2.0
    nn.init.constant_(cast(Tensor, attention.last.bias), -0.5)
    motion = torch.tensor([0.1, -0.2]).view(1, 2, 1, 1)
    past, now = torch.full((1, 1, 1, 1), 0.3), torch.full((1, 1, 1, 1), 0.05)
    # ReLU(x) + ReLU(-x) = |x|, summed over the four channels
    expected = 2.0 * math.tanh(0.1 + 0.2 + 0.3 + 0.05) - 0.5
    assert float(attention(motion, past, now)) == pytest.approx(expected, abs=1e-6)
    nothing = torch.zeros(1, 1, 1, 1)
    assert float(attention(0.0 * motion, nothing, nothing)) == 0.0


@pytest.mark.parametrize("system", [FULL, DIRECT], ids=["fusesr", "fusesr-direct"])
def test_features_kept_from_past_frames_change_no_bit(
    make_windows: MakeWindows, system: System
) -> None:
    config = system.config()
    network = scrambled(system, config, 4)
    state = None
    for window in make_windows(system, 4, count=5):
        inputs = prepare(config, window)
        kept, state = run(network, inputs, state)
        encoded, _ = run(network, inputs, None)
        assert torch.equal(kept, encoded)


@pytest.mark.parametrize("rows", [3, 8])
def test_a_large_frame_in_strips_is_the_whole(
    make_windows: MakeWindows, monkeypatch: pytest.MonkeyPatch, rows: int
) -> None:
    network = scrambled(FULL, HEAD, 4)
    window = make_windows(FULL, 4)[-1]
    inputs = prepare(HEAD, window)
    whole, _ = run(network, inputs)
    width = window.current.size[1]
    monkeypatch.setattr("rtsr_cli.models.fusesr.network.WHOLE_PIXELS", rows * width)
    strips, _ = run(network, inputs)
    assert torch.allclose(strips, whole, rtol=1e-4, atol=1e-4)
    monkeypatch.setattr("rtsr_cli.models.fusesr.network.STRIP_HALO", 1)
    assert not torch.allclose(run(network, inputs)[0], whole, rtol=1e-4, atol=1e-4)


def test_features_are_kept_after_a_start_in_the_middle(make_windows: MakeWindows) -> None:
    network = scrambled(FULL, HEAD, 4)
    state = None
    for window in make_windows(FULL, 4, count=5)[2:]:
        inputs = prepare(HEAD, window)
        kept, state = run(network, inputs, state)
        encoded, _ = run(network, inputs, None)
        assert torch.equal(kept, encoded)


def test_history_changes_the_output(make_windows: MakeWindows) -> None:
    network = scrambled(FULL, HEAD, 4)
    window = make_windows(FULL, 4)[-1]
    with_history, _ = run(network, prepare(HEAD, window))
    without, _ = run(network, prepare(HEAD, replace(window, lr=window.lr[:1])))
    assert not torch.allclose(with_history, without, rtol=1e-3)


@pytest.mark.parametrize("system", [FULL, FAST], ids=["fusesr", "fusesr-fast"])
@pytest.mark.parametrize("scale", [2, 4, 8])
@pytest.mark.parametrize(
    ("base", "name"),
    [(EnlargementBase.GUIDED, "demod-guided"), (EnlargementBase.CUBIC, "demod-bicubic")],
)
def test_a_fresh_network_is_its_base(
    make_windows: MakeWindows, system: System, scale: int, base: EnlargementBase, name: str
) -> None:
    if scale not in system.scales:
        pytest.skip(f"{system.name} has no {scale}x")
    baseline = load_system(name)
    window = make_windows(system, scale, optional=True)[-1]
    with torch.inference_mode():
        network = system.build(system.config(base=base), scale).eval()
        ours = system.predict(network, window, None).image
        theirs = baseline.predict(baseline.build(baseline.config(), scale), window, None).image
    assert ours is not None
    assert theirs is not None
    # the block's shift replicates fewer than S border rows and columns
    inner = (..., slice(scale, -scale), slice(scale, -scale))
    assert torch.allclose(ours[inner], theirs[inner], rtol=1e-5, atol=1e-5)


def ramp(height: int, width: int) -> Tensor:
    """Return distinct positive values: column and row of every pixel, and their sum."""
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    return (torch.stack([x, y, x + y])[None] + 1.0) / (height + width)


def jittered(frame: Frame, scale: int, offset: tuple[int, int], lighting: Tensor) -> Frame:
    jitter_px = (sample_jitter(offset[0], scale), sample_jitter(offset[1], scale))
    divided = {Buffer.LIGHTING: lighting, Buffer.LIGHTING_MASK: torch.ones_like(lighting[:, :1])}
    return replace(
        frame,
        gbuffer=frame.gbuffer.with_buffers(divided),
        camera=CameraMetadata(jitter_px=jitter_px),
    )


@pytest.mark.parametrize("scale", [2, 4, 8])
def test_lr_samples_are_one_pixel_of_their_block_whatever_the_jitter(
    make_windows: MakeWindows, scale: int
) -> None:
    config = FuseSRFastConfig()
    (window,) = make_windows(FAST, scale, count=1)
    assert window.hr is not None
    image = ramp(*window.hr.size)
    hr = replace(window.hr, gbuffer=window.hr.gbuffer.with_buffers({Buffer.MATERIAL: image}))
    middle = (..., slice(scale // 2, None, scale), slice(scale // 2, None, scale))
    for offset in [(x, y) for x in range(scale) for y in range(scale)]:
        sampled = decimate(image, scale, offset)
        lr = jittered(window.current, scale, offset, sampled)
        inputs = prepare(config, replace(window, lr=(lr,), hr=hr))
        assert torch.equal(inputs["hr"][middle], sampled), offset
        assert torch.equal(inputs["material"][middle], sampled), offset
        # the enlargement interpolates: it passes through the samples
        encoded = torch.log1p(sampled / lr.lighting_scale)
        assert torch.allclose(inputs["base"][middle], encoded, atol=1e-6), offset


def lit(window: FrameWindow, lighting: Tensor, mask: Tensor) -> Frame:
    """Return the current frame with other lighting, its radiance that over a material of 1/2."""
    frame = window.current
    buffers = {Buffer.LIGHTING: lighting, Buffer.LIGHTING_MASK: mask, Buffer.COLOR: lighting / 2}
    return replace(frame, gbuffer=frame.gbuffer.with_buffers(buffers))


def test_what_is_not_divided_is_black_and_the_rest_is_bounded(make_windows: MakeWindows) -> None:
    (window,) = make_windows(FULL, 4, count=1)
    mask = torch.ones(1, 1, *window.current.size)
    mask[..., 1:] = 0.0
    frame = lit(window, 1e4 * mask.new_ones(1, 3, *window.current.size), mask)
    shown = SURROUNDINGS[Preset.RTSR].show_lighting(frame)
    bound = math.log(1 + MAX_LIGHTING / frame.lighting_scale)
    assert torch.allclose(shown[..., :1], torch.tensor(bound))
    assert not shown[..., 1:].any()


def test_paper_bounds_the_radiance_that_is_divided(make_windows: MakeWindows) -> None:
    (window,) = make_windows(FULL, 4, count=1)
    height, width = window.current.size
    lighting = torch.linspace(0.0, 80.0, width).expand(1, 3, height, width)
    frame = lit(window, lighting, torch.ones(1, 1, height, width))
    shown = SURROUNDINGS[Preset.PAPER].show_lighting(frame)
    # radiance of up to 10 over 1/2
    assert torch.allclose(shown, lighting.clamp(max=20.0))


def test_the_loss_of_paper_is_of_bounded_radiance_whatever_the_config_says(
    make_windows: MakeWindows,
) -> None:
    (window,) = make_windows(FULL, 4, count=1)
    assert window.hr is not None
    config = FuseSRConfig(preset=Preset.PAPER, loss=LossWeights(tonemapped=3.0))
    color = torch.full_like(window.hr.gbuffer[Buffer.MATERIAL], 30.0)
    captured = replace(window.hr, gbuffer=window.hr.gbuffer.with_buffers({Buffer.COLOR: color}))
    inputs, target = prepare(config, window), goal(config, window, captured)
    terms = loss(config, inputs, {"predicted": torch.zeros_like(color)}, target)
    assert {name: float(term) for name, term in terms.items()} == {"radiance": 10.0}


def test_paper_has_no_base_and_divides_by_softplus(make_windows: MakeWindows) -> None:
    config = FuseSRConfig(preset=Preset.PAPER)
    assert derivation(config).mode is DemodulationMode.SOFTPLUS
    assert derivation(HEAD).mode is DemodulationMode.BRDF
    assert derivation(FuseSRDirectConfig(preset=Preset.PAPER)).mode is DemodulationMode.NONE
    window = make_windows(FULL, 4)[-1]
    inputs = prepare(config, window)
    assert "base" not in inputs
    frame = window.current.gbuffer
    seen = [frame[b] for b in (Buffer.LIGHTING, Buffer.DEPTH, Buffer.NORMAL)]
    assert torch.equal(inputs["frame_0"], torch.cat(seen, dim=1))


def test_paper_multiplies_everything_back(make_windows: MakeWindows) -> None:
    config = FuseSRConfig(preset=Preset.PAPER)
    (window,) = make_windows(FULL, 4, count=1)
    level = replace(window.current, camera=CameraMetadata(jitter_px=(0.125, 0.125)))
    window = replace(window, lr=(level,))
    inputs = prepare(config, window)
    image = compose(config, window, inputs, {"predicted": torch.full((1, 3, 64, 96), 2.0)}).image
    assert window.hr is not None
    assert image is not None
    assert torch.equal(image, 2.0 * window.hr.gbuffer[Buffer.MATERIAL])


def with_motion(frame: Frame, motion: Tensor) -> Frame:
    gbuffer = frame.gbuffer.with_buffers({Buffer.MOTION: motion})
    return replace(frame, gbuffer=gbuffer, camera=CameraMetadata())


def test_motion_to_the_frame_before_the_last_is_chained_in_order(
    make_windows: MakeWindows,
) -> None:
    window = make_windows(FULL, 4)[-1]
    height, width = window.current.size
    newer, older = torch.zeros(1, 2, height, width), torch.zeros(1, 2, height, width)
    newer[:, 0], newer[:, 1] = 3.0, -2.0
    columns = torch.arange(width, dtype=torch.float32)
    older[:, 0], older[:, 1] = 0.25 * columns, -0.5 * columns
    frames = (with_motion(window.lr[0], newer), with_motion(window.lr[1], older), window.lr[2])
    frames = (*frames[:2], replace(frames[2], camera=CameraMetadata()))
    inputs = history_inputs(replace(window, lr=frames), SURROUNDINGS[Preset.RTSR])
    fetched = (columns + 3.0).clamp(max=width - 1)
    assert torch.equal(inputs["motion_1"], newer)
    assert torch.allclose(inputs["motion_2"][0, 0], 3.0 + 0.25 * fetched)
    assert torch.allclose(inputs["motion_2"][0, 1], -2.0 - 0.5 * fetched)
    # screen units: the whole width or height is 2
    screen = torch.tensor([2.0 / width, 2.0 / height]).view(1, 2, 1, 1)
    assert torch.allclose(inputs["motion_ndc_2"], inputs["motion_2"] * screen)


def test_motion_is_between_samples(make_windows: MakeWindows) -> None:
    window = make_windows(FULL, 4)[-1]
    zero = torch.zeros(1, 2, *window.current.size)
    moved = [
        replace(with_motion(frame, zero), camera=CameraMetadata(jitter_px=jitter_px))
        for frame, jitter_px in zip(
            window.lr, ((0.25, -0.125), (-0.25, 0.0), (0.0, 0.375)), strict=True
        )
    ]
    inputs = history_inputs(replace(window, lr=tuple(moved)), SURROUNDINGS[Preset.RTSR])
    # p + jitter in frame t is p' + jitter' in the frame before
    assert torch.allclose(inputs["motion_1"][0, :, 0, 0], torch.tensor([0.5, -0.125]))
    assert torch.allclose(inputs["motion_2"][0, :, 5, 5], torch.tensor([0.25, -0.5]))


@pytest.mark.parametrize("known", [0, 1])
def test_missing_history_is_the_current_frame_at_rest(
    make_windows: MakeWindows, known: int
) -> None:
    window = make_windows(FULL, 4)[known]
    inputs = prepare(HEAD, window)
    for age in range(known + 1, 3):
        assert torch.equal(inputs[f"frame_{age}"], inputs["frame_0"])
        assert not inputs[f"motion_{age}"].any()
    for age in range(1, known + 1):
        assert not torch.equal(inputs[f"frame_{age}"], inputs["frame_0"])
        assert inputs[f"motion_{age}"].any()


@pytest.mark.parametrize(
    ("system", "variant"), [(FULL, "fast"), (FULL, "direct"), (FAST, "head"), (DIRECT, "fast")]
)
def test_the_network_of_another_system_is_refused(system: System, variant: str) -> None:
    with pytest.raises(ConfigError, match=f"'{variant}' is another system's"):
        resolve_settings(system.config, SettingsSource("a file", {"variant": variant}))
