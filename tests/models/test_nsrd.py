"""NSRD: sizes of the published network, its equations, what is carried from frame to frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from rtsr_cli.core.choices import DemodulationMode, Preset, SsimConvention
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.lighting.lighting import EnlargementBase, encode_lighting
from rtsr_cli.core.metrics.ssim import ssim
from rtsr_cli.core.network.cost import count_macs, count_parameters
from rtsr_cli.core.system import FrameWindow
from rtsr_cli.models import load_system
from rtsr_cli.models.nsrd.config import NSRDConfig, NSRDLossWeights
from rtsr_cli.models.nsrd.inputs import SURROUNDINGS, prepare
from rtsr_cli.models.nsrd.loss import goal, loss
from rtsr_cli.models.nsrd.network import (
    ChannelAttentionBlock,
    ConvLSTM,
    GatedConvolution,
    double_size,
)
from rtsr_cli.models.nsrd.published import warp_frame, warp_output

NSRD = load_system("nsrd")
CONFIG = NSRDConfig()
PAPER = NSRDConfig(preset=Preset.PAPER)

MakeWindows = Callable[..., list[FrameWindow]]


def scrambled(config: NSRDConfig, scale: int) -> nn.Module:
    """Return a network whose every layer matters."""
    torch.manual_seed(3)
    network = NSRD.build(config, scale).eval()
    output = cast(Any, network).output
    nn.init.normal_(output.weight, std=0.05)
    return network


def run(network: nn.Module, inputs: Any, state: Any = None) -> tuple[Tensor, Any]:
    with torch.inference_mode():
        outputs, kept = network(inputs, state)
    return outputs["predicted"], kept


def replayed(config: NSRDConfig, windows: list[FrameWindow]) -> list[Tensor]:
    """Predictions of successive windows."""
    network, state, found = scrambled(config, windows[0].scale), None, []
    for window in windows:
        predicted, state = run(network, prepare(config, window), state)
        found.append(predicted)
    return found


@pytest.mark.parametrize(
    ("scale", "parameters", "gmac"),
    [(4, 1_610_852, 145.3668), (2, 1_590_080, 570.771), (6, 1_645_472, 66.604)],
)
def test_the_network_has_the_published_size(scale: int, parameters: int, gmac: float) -> None:
    assert count_parameters(NSRD.build(CONFIG, scale)) == parameters
    assert count_parameters(NSRD.build(PAPER, scale)) == parameters
    size = (1080 // scale, 1920 // scale)
    assert count_macs(NSRD, CONFIG, scale, size) / 1e9 == pytest.approx(gmac, abs=5e-4)


def test_blocks_have_the_published_sizes() -> None:
    network = cast(Any, NSRD.build(CONFIG, 4))
    sizes = {
        "current": 2_048,
        "reliable": 4_736,
        "last": 13_856,
        "memory": 442_624,
        "output": 13_872,
    }
    assert {name: count_parameters(getattr(network, name)) for name in sizes} == sizes
    unet = network.reconstruction
    sizes = {
        "encoder_1": 223_308,
        "encoder_2": 148_872,
        "centre": 223_308,
        "decoder_2": 222_664,
        "decoder_1": 297_100,
        "narrow": 18_464,
    }
    assert {name: count_parameters(getattr(unet, name)) for name in sizes} == sizes
    assert count_parameters(ChannelAttentionBlock(64)) == 74_436


def identity_(layer: nn.Conv2d, gain: float = 1.0, bias: float = 0.0) -> None:
    nn.init.dirac_(layer.weight)
    layer.weight.data *= gain
    nn.init.constant_(cast(Tensor, layer.bias), bias)


def test_the_gated_convolution_is_its_equation() -> None:
    block = GatedConvolution(2, 2).eval().requires_grad_(False)
    identity_(block.feature)
    identity_(block.gate, 3.0, 0.5)
    value = torch.tensor([-0.5, 0.8]).view(1, 2, 1, 1)
    gate = torch.sigmoid(3.0 * value + 0.5)
    # leaky slope 0.2; fresh batch statistics are mean 0 and variance 1
    expected = torch.where(value < 0, 0.2 * value, value) * gate / math.sqrt(1.0 + 1e-5)
    assert torch.allclose(block(value), expected, atol=1e-6)


def test_the_lstm_is_its_equation_in_the_published_order() -> None:
    cell = ConvLSTM(1, 1).requires_grad_(False)
    nn.init.zeros_(cell.gates.weight)
    enter, forget, leave, candidate = 0.3, -0.2, 0.9, 0.6
    cell.gates.bias.data = torch.tensor([enter, forget, leave, candidate])
    before = torch.full((1, 1, 1, 1), 0.7)

    def sigmoid(x: float) -> float:
        return 1.0 / (1.0 + math.exp(-x))

    hidden, kept = cell(torch.zeros(1, 1, 1, 1), torch.zeros(1, 1, 1, 1), before)
    expected = sigmoid(forget) * 0.7 + sigmoid(enter) * math.tanh(candidate)
    assert float(kept) == pytest.approx(expected, abs=1e-6)
    assert float(hidden) == pytest.approx(sigmoid(leave) * math.tanh(expected), abs=1e-6)


def test_channel_attention_is_its_equation() -> None:
    block = ChannelAttentionBlock(64).requires_grad_(False)
    image = torch.randn(1, 64, 5, 6)
    inner = block.layers(image)
    squeeze, _, excite, _ = block.attention
    pooled = inner.mean((2, 3), keepdim=True)
    weight = torch.sigmoid(excite(F.relu(squeeze(pooled))))
    assert torch.allclose(block(image), inner * weight + image, atol=1e-6)
    assert block.layers[1].__class__ is nn.ReLU


def test_odd_sizes_are_padded_as_published() -> None:
    image = torch.rand(1, 1, 3, 4) + 1.0
    expected = F.interpolate(image, scale_factor=2, mode="bilinear", align_corners=True)
    assert torch.equal(double_size(image, torch.zeros(1, 1, 6, 8)), expected)
    # 1 row and 3 columns are missing: floor(1 / 2) above, floor(3 / 2) to the left
    padded = F.pad(expected, (1, 2, 0, 1))
    assert torch.equal(double_size(image, torch.zeros(1, 1, 7, 11)), padded)


@pytest.mark.parametrize("scale", [2, 4])
@pytest.mark.parametrize("config", [CONFIG, PAPER], ids=["rtsr", "paper"])
def test_any_size_gives_the_target_size(
    make_windows: MakeWindows, config: NSRDConfig, scale: int
) -> None:
    for height, width in ((13, 7), (1, 9)):
        windows = []
        for window in make_windows(NSRD, scale):
            assert window.hr is not None
            lr = tuple(frame.crop(0, 0, (height, width)) for frame in window.lr)
            hr = window.hr.crop(0, 0, (height * scale, width * scale))
            windows.append(replace(window, lr=lr, hr=hr))
        last = replayed(config, windows)[-1]
        assert last.shape == (1, 3, height * scale, width * scale)
        assert torch.isfinite(last).all()


def test_published_warps_shift_what_does_not_move() -> None:
    columns = torch.arange(8.0).view(1, 1, 1, 8).expand(1, 1, 4, 8)
    still = torch.zeros(1, 2, 4, 8)
    # position x is fetched at x (W - 1) / W
    expected = columns * 7 / 8
    assert torch.allclose(warp_output(columns, still), expected, atol=1e-5)
    current = torch.full_like(columns, 100.0)
    far = still.clone()
    far[:, 0, :, 6:] = 3.0
    moved = warp_frame(columns, far, current)
    assert (moved[..., 6:] == 100.0).all()
    assert torch.allclose(moved[..., :6], expected[..., :6], atol=1e-5)


def still(window: FrameWindow) -> FrameWindow:
    """Return the window with past frames that are the current one, nothing moving."""
    frame = window.current
    zero = torch.zeros_like(frame.gbuffer[Buffer.MOTION])
    gbuffer = frame.gbuffer.with_buffers({Buffer.MOTION: zero})
    return replace(window, lr=(replace(frame, gbuffer=gbuffer),) * 3)


def test_what_stands_still_is_fetched_as_it_is(make_windows: MakeWindows) -> None:
    window = still(make_windows(NSRD, 4)[-1])
    inputs = prepare(CONFIG, window)
    for age in (1, 2):
        assert torch.equal(inputs[f"past_{age}"][:, :7], inputs["frame_0"])
        assert not inputs[f"past_{age}"][:, 7:].any()
    assert not inputs["motion_hr"].any()
    assert not inputs["unreliable_hr"].any()


def test_missing_history_is_the_current_frame_unreliable(make_windows: MakeWindows) -> None:
    window = make_windows(NSRD, 4)[-1]
    for count in (1, 2):
        inputs = prepare(CONFIG, replace(window, lr=window.lr[:count]))
        assert torch.equal(inputs["past_2"][:, :7], inputs["frame_0"])
        assert inputs["past_2"][:, 7:].all()
    assert inputs["unreliable_hr"].shape == (1, 1, 64, 96)


def test_forward_vectors_and_their_splat_mark_alike(make_windows: MakeWindows) -> None:
    with_vectors = make_windows(NSRD, 4, optional=True)[-1]
    without = make_windows(NSRD, 4)[-1]
    assert Buffer.FORWARD in with_vectors.lr[1].gbuffer
    assert Buffer.FORWARD not in without.lr[1].gbuffer
    a, b = (prepare(CONFIG, w)["past_1"][:, 7:, 4:, 2:-2] for w in (with_vectors, without))
    assert torch.equal(a, b)
    assert not a.any()


def lit(frame: Frame, gain: float) -> Frame:
    """Return the frame with all of its lighting times a gain."""
    lighting = frame.gbuffer[Buffer.LIGHTING] * gain
    gbuffer = frame.gbuffer.with_buffers({Buffer.LIGHTING: lighting})
    return replace(frame, gbuffer=gbuffer, lighting_scale=frame.lighting_scale * gain)


def test_brightness_and_exposure_change_nothing_but_the_scale(make_windows: MakeWindows) -> None:
    windows = make_windows(NSRD, 4, count=5)
    plain = replayed(CONFIG, windows)
    brighter = [replace(w, lr=tuple(lit(f, 8.0) for f in w.lr)) for w in windows]
    for a, b in zip(plain, replayed(CONFIG, brighter), strict=True):
        assert torch.allclose(a, b, atol=2e-4)

    def exposed(frame: Frame) -> Frame:
        gain = 1.25**frame.number
        camera = replace(frame.camera, pre_exposure=gain)
        return replace(lit(frame, gain), camera=camera)

    changing = [replace(w, lr=tuple(exposed(f) for f in w.lr)) for w in windows]
    for a, b in zip(plain, replayed(CONFIG, changing), strict=True):
        assert torch.allclose(a, b, atol=2e-4)


def test_the_last_output_comes_back_where_its_surfaces_are(make_windows: MakeWindows) -> None:
    windows = make_windows(NSRD, 4)
    network = cast(Any, scrambled(CONFIG, 4))
    _, state = run(network, prepare(CONFIG, windows[0]))
    inputs = prepare(CONFIG, windows[1])
    with torch.inference_mode():
        previous = SURROUNDINGS[Preset.RTSR].fetch_output(state.lighting, inputs)
    # the pattern moves by one LR pixel to the left: 4 HR pixels, not 1
    expected = encode_lighting(state.lighting, inputs["lighting_scale"]).roll(-4, dims=3)
    inner = (..., slice(16, -8), slice(8, -8))
    assert torch.allclose(previous[inner], expected[inner], atol=1e-4)


@pytest.mark.parametrize(
    "config",
    [
        CONFIG,
        PAPER,
        replace(CONFIG, dual_vectors=False),
        replace(CONFIG, feedback=False),
        replace(CONFIG, lstm=False),
        replace(CONFIG, warp_state=False),
    ],
    ids=["rtsr", "paper", "plain mask", "no feedback", "no lstm", "state stays"],
)
def test_presets_and_ablations_run(make_windows: MakeWindows, config: NSRDConfig) -> None:
    windows = make_windows(NSRD, 4)
    found = replayed(config, windows)
    assert all(torch.isfinite(p).all() for p in found)
    alone, _ = run(scrambled(config, 4), prepare(config, windows[-1]))
    carries = config.feedback or config.lstm
    assert torch.equal(found[-1], alone) != carries


@pytest.mark.parametrize("part", ["feedback", "lstm"])
def test_both_memories_matter(make_windows: MakeWindows, part: str) -> None:
    windows = make_windows(NSRD, 4)
    other = replace(CONFIG, **{part: False})
    assert not torch.allclose(replayed(CONFIG, windows)[-1], replayed(other, windows)[-1])


@pytest.mark.parametrize(
    ("base", "name"),
    [(EnlargementBase.GUIDED, "demod-guided"), (EnlargementBase.CUBIC, "demod-bicubic")],
)
def test_a_fresh_network_is_its_base(
    make_windows: MakeWindows, base: EnlargementBase, name: str
) -> None:
    baseline = load_system(name)
    window = make_windows(NSRD, 4, optional=True)[-1]
    with torch.inference_mode():
        network = NSRD.build(replace(CONFIG, base=base), 4).eval()
        ours = NSRD.predict(network, window, None).image
        theirs = baseline.predict(baseline.build(baseline.config(), 4), window, None).image
    assert ours is not None
    assert theirs is not None
    inner = (..., slice(4, -4), slice(4, -4))
    assert torch.allclose(ours[inner], theirs[inner], rtol=1e-5, atol=1e-5)


def test_debug_pictures_say_where_the_last_output_was_not_used(make_windows: MakeWindows) -> None:
    windows = make_windows(NSRD, 4, optional=True)
    network, state = scrambled(CONFIG, 4), None
    shares = []
    for window in windows[:2]:
        with torch.inference_mode():
            prediction = NSRD.predict(network, window, state)
        state = prediction.state
        shares.append(float(prediction.debug["unreliable"].mean()))
        assert prediction.debug["unreliable"].shape[-2:] == (64, 96)
    assert shares[0] == 1.0
    assert 0.0 < shares[1] < 0.5


@pytest.mark.parametrize("mode", list(DemodulationMode))
def test_emission_is_added_where_it_was_taken_out(
    make_windows: MakeWindows, mode: DemodulationMode
) -> None:
    window = make_windows(NSRD, 4, optional=True)[-1]
    assert window.hr is not None
    assert window.hr.gbuffer[Buffer.EMISSION].any()
    inputs = prepare(replace(CONFIG, demodulation=mode), window)
    apart = mode not in (DemodulationMode.SOFTPLUS, DemodulationMode.NONE)
    assert bool(inputs["emission"].any()) == apart


def reference(window: FrameWindow) -> Frame:
    """Return a target-size frame with lighting that differs from the prediction."""
    assert window.hr is not None
    hr = window.hr
    color = hr.gbuffer[Buffer.MATERIAL] * 1.3
    buffers = {
        Buffer.COLOR: color,
        Buffer.LIGHTING: torch.full_like(color, 1.3),
        Buffer.LIGHTING_MASK: torch.ones_like(color[:, :1]),
    }
    return replace(hr, gbuffer=hr.gbuffer.with_buffers(buffers))


def test_the_published_loss_is_its_equation(make_windows: MakeWindows) -> None:
    windows = make_windows(NSRD, 4)
    inputs = prepare(PAPER, windows[-1])
    target = goal(PAPER, windows[-1], reference(windows[-1]))
    predicted = torch.rand_like(target["lighting"])
    previous = torch.rand_like(predicted)
    outputs = {"predicted": predicted, "previous": previous}
    terms = loss(PAPER, inputs, outputs, target)
    reliable = 1.0 - inputs["unreliable_hr"]
    assert set(terms) == {"smooth", "structure", "temporal"}
    assert float(terms["smooth"]) == float(F.smooth_l1_loss(predicted, target["lighting"]))
    similar = ssim(predicted, target["lighting"], SsimConvention.ZERO_PAD)
    assert float(terms["structure"]) == pytest.approx(1.0 - float(similar), abs=1e-6)
    change = F.smooth_l1_loss(reliable * predicted, reliable * previous)
    assert float(terms["temporal"]) == float(change)
    first = loss(PAPER, inputs, {"predicted": predicted}, target)
    assert float(first["temporal"]) == 0.0


@pytest.mark.parametrize("frames", [1, 2])
def test_gradients_reach_back_as_far_as_asked(make_windows: MakeWindows, frames: int) -> None:
    config = replace(CONFIG, gradient_frames=frames)
    network = scrambled(config, 4)
    windows = make_windows(NSRD, 4)
    first = prepare(config, windows[0])
    first["frame_0"].requires_grad_(True)
    _, state = network(first, None)
    outputs, _ = network(prepare(config, windows[1]), state)
    outputs["predicted"].sum().backward()
    assert (first["frame_0"].grad is not None) == (frames == 2)


def test_every_term_of_the_loss_has_a_gradient(make_windows: MakeWindows) -> None:
    weights = NSRDLossWeights(smooth=1.0, structure=1.0, temporal=1.0)
    config = replace(CONFIG, loss=weights)
    network, state = scrambled(config, 4), None
    for window in make_windows(NSRD, 4)[:2]:
        inputs = prepare(config, window)
        outputs, state = network(inputs, state)
        terms = loss(config, inputs, outputs, goal(config, window, reference(window)))
    for name, term in terms.items():
        network.zero_grad()
        term.backward(retain_graph=True)
        weight = cast(Any, network).output.weight
        assert weight.grad.abs().sum() > 0, name
