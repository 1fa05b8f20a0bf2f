"""ExtraNet: sizes, inputs, what it starts from, its loss, and how samples are changed."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from rtsr_cli.core.choices import DemodulationMode, Preset
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.imaging.camera_motion import find_camera_motion
from rtsr_cli.core.imaging.derivation import derive
from rtsr_cli.core.imaging.frame_motion import chain_motions
from rtsr_cli.core.imaging.surfaces import find_moving
from rtsr_cli.core.lighting.past_lighting import carry_lighting, shade
from rtsr_cli.core.network.acceleration import accelerate_network
from rtsr_cli.core.network.cost import count_macs, count_parameters
from rtsr_cli.core.synth.exposure import draw_scene
from rtsr_cli.core.synth.render import render_frame
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.core.training.augmentation import PictureTurn, draw_turn
from rtsr_cli.core.training.samples import SampleChoices
from rtsr_cli.models import load_system
from rtsr_cli.models.extranet.config import ExtraNetConfig, ExtraNetLoss, PredictionBase
from rtsr_cli.models.extranet.inputs import find_past_motions, measure_gain, prepare
from rtsr_cli.models.extranet.loss import (
    average_largest,
    change,
    cover_rectangle,
    decode_radiance,
    encode_goal,
    goal,
    loss,
)
from rtsr_cli.models.extranet.network import ExtraNetNetwork

SYSTEM = load_system("extranet")
CONFIG = ExtraNetConfig()

MakeWindows = Callable[..., list[FrameWindow]]


def build(config: ExtraNetConfig = CONFIG) -> ExtraNetNetwork:
    network = SYSTEM.build(config, 1)
    assert isinstance(network, ExtraNetNetwork)
    return network.eval()


def trained(config: ExtraNetConfig = CONFIG) -> ExtraNetNetwork:
    """A network that corrects something: its last layer starts at 0."""
    torch.manual_seed(3)
    network = build(config)
    nn.init.normal_(network.leave.weight, std=0.1)
    return network


def count(*modules: nn.Module) -> int:
    return sum(count_parameters(module) for module in modules)


def test_a_network_has_the_published_size() -> None:
    network = build()
    assert count_parameters(network) == 262_141
    assert count(network.history.frames) == 65_016
    assert count(network.history.join) == 28_545
    assert count(network.enter) == 9_596
    assert count(network.down) == 67_361
    assert count(network.up) == 91_548
    assert count(network.leave) == 75
    statistics = sum(b.numel() for b in network.buffers())
    assert statistics == 1_359


def test_the_published_multiplications() -> None:
    assert count_macs(SYSTEM, CONFIG, 1, (720, 1280)) / 1e9 == pytest.approx(50.1, abs=0.05)


def test_channels_are_those_of_the_publication(make_windows: MakeWindows) -> None:
    inputs = prepare(CONFIG, make_windows(SYSTEM, 1, count=6)[-1])
    assert inputs["current"].shape[1] == 18
    assert inputs["history"].shape[1] == 12
    known = 1.0 - inputs["hole_mask"]
    current, history = inputs["current"], inputs["history"]
    assert torch.equal(current[:, 6:9], current[:, :3] * known)
    assert torch.equal(history[:, 11:], known)
    seen_at_all = torch.stack([known, history[:, 3:4], history[:, 7:8]]).amax(0)
    assert torch.equal(current[:, 9:12], current[:, 3:6] * seen_at_all)


def relight(window: FrameWindow, ages: dict[int, float]) -> FrameWindow:
    """The same window with past frames under brighter light."""
    frames = list(window.lr)
    for age, gain in ages.items():
        held = frames[age].gbuffer
        lights = {b: gain * held[b] for b in (Buffer.LIGHTING, Buffer.COLOR)}
        frames[age] = replace(frames[age], gbuffer=held.with_buffers(lights))
    return FrameWindow(lr=tuple(frames), hr=window.hr, scale=window.scale)


def test_half_precision_is_of_the_layers_alone(make_windows: MakeWindows) -> None:
    window, network = make_windows(SYSTEM, 1, count=6)[-1], trained()
    with torch.inference_mode():
        whole = SYSTEM.predict(network, relight(window, {}), None)
        with torch.autocast("cpu", torch.bfloat16):
            half = SYSTEM.predict(network, relight(window, {}), None)
    for seen in ("hole", "base"):
        assert torch.equal(half.debug[seen], whole.debug[seen])


def test_the_second_picture_is_of_the_frames_before_the_last(make_windows: MakeWindows) -> None:
    window = relight(make_windows(SYSTEM, 1, count=6)[-1], ages={3: 1.5, 5: 2.0})
    inputs = prepare(CONFIG, window)
    second, history = inputs["current"][:, 3:6], inputs["history"]
    third, fifth = (history[:, i : i + 1].expand_as(second) > 0.5 for i in (7, 3))
    assert bool(third.any())
    assert torch.equal(second[third], history[:, 4:7][third])
    older = fifth & ~third
    assert torch.equal(second[older], history[:, :3][older])
    alone = prepare(replace(CONFIG, history=False), window)["current"][:, 3:6]
    assert not torch.equal(alone, second)
    assert torch.equal(alone[~(third | fifth)], second[~(third | fifth)])


def test_what_was_learnt_nothing_yet_is_the_untrained_system(make_windows: MakeWindows) -> None:
    guided = load_system("warp-guided")
    for window in make_windows(SYSTEM, 1, count=6, optional=True):
        made = SYSTEM.predict(build(), window, None).image
        past = carry_lighting(window)
        expected = shade(window, past, past.filled)
        assert made is not None
        assert torch.allclose(made, expected, atol=1e-5)
        same = guided.predict(guided.build(guided.config(), 1), window, None).image
        assert same is not None
        assert torch.equal(expected, same)


@pytest.mark.parametrize("with_camera", [True, False])
def test_older_frames_are_where_the_camera_or_the_vectors_say(*, with_camera: bool) -> None:
    scene = draw_scene(3)
    wanted = {*SYSTEM.lr_inputs, *SYSTEM.unshaded_inputs}
    parts = (Buffer.COLOR, Buffer.ALBEDO, Buffer.METALLIC, Buffer.ROUGHNESS)
    stored = (*parts, Buffer.NORMAL, Buffer.DEPTH, Buffer.MOTION)
    drawn = (render_frame(scene, number, (34, 60), buffers=stored) for number in range(6, 0, -1))
    frames = [derive(frame, wanted, SYSTEM.derivation(CONFIG)) for frame in drawn]
    if not with_camera:
        frames = [replace(frame, camera=CameraMetadata()) for frame in frames]
    window = FrameWindow(lr=tuple(frames))
    past = carry_lighting(window)
    stands = (past.moving < 0.5) & ~past.own.on_sky
    chained = chain_motions(window.lr)
    found = find_past_motions(window, past)
    assert len(found) == 3
    for place, (motion, moving) in zip((1, 3, 5), found, strict=True):
        expected = chained[place - 1]
        camera_px = find_camera_motion(past.own.position, window.lr[place])
        assert (camera_px is not None) == with_camera
        if camera_px is not None and place > 1:
            expected = torch.where(stands & camera_px.isfinite(), camera_px, expected)
        torch.testing.assert_close(motion, expected, rtol=0, atol=1e-4)
        assert torch.equal(moving, find_moving(past.own, motion, window.lr[place]))


def test_frames_that_are_not_there_are_zero(make_windows: MakeWindows) -> None:
    windows = make_windows(SYSTEM, 1, count=6)
    histories = [prepare(CONFIG, window)["history"] for window in windows]
    there = [[bool(h[:, i : i + 4].any()) for i in (0, 4, 8)] for h in histories]
    assert there[0] == there[1] == [False, False, True]
    assert there[2] == there[3] == [False, True, True]
    assert there[4] == there[5] == [True, True, True]


def test_history_is_the_moved_pattern(make_windows: MakeWindows) -> None:
    """The pattern moves a pixel a frame under one light: away from borders all frames agree."""
    inputs = prepare(CONFIG, make_windows(SYSTEM, 1, count=6)[-1])
    history, known = inputs["history"], inputs["history"][:, [3, 7, 11]].amin(1) > 0.5
    assert bool(known[0, 6:, 8:-8].any())
    inner = (slice(None), slice(None), slice(4, None), slice(6, -6))
    mask = known[:, None][inner]
    for part in (slice(0, 3), slice(4, 7)):
        difference = (history[:, part] - history[:, 8:11])[inner] * mask
        assert float(difference.abs().max()) < 0.2


@pytest.mark.parametrize("size", [(16, 24), (17, 21), (8, 9), (1, 1)])
def test_no_pixel_is_lost_whatever_the_size(size: tuple[int, int]) -> None:
    inputs = {"current": torch.rand(1, 18, *size), "history": torch.rand(1, 12, *size)}
    outputs, _ = trained()(inputs)
    assert outputs["predicted"].shape == (1, 3, *size)


def test_the_preset_of_the_paper_warps_and_stretches(make_windows: MakeWindows) -> None:
    """Plain logarithms, no scale; depth from 0 to 1; sky beyond all depth is 0."""
    config = replace(CONFIG, preset=Preset.PAPER)
    window = make_windows(SYSTEM, 1, count=6, optional=True)[-1]
    inputs = prepare(config, window)
    rendered = window.lr[1]
    quantity = torch.where(
        rendered.gbuffer[Buffer.LIGHTING_MASK] > 0.5,
        rendered.gbuffer[Buffer.LIGHTING],
        rendered.gbuffer[Buffer.COLOR] - rendered.gbuffer[Buffer.EMISSION],
    )
    moved = torch.log1p(quantity)[..., 1:]
    assert torch.allclose(inputs["current"][:, :3, :, :-1], moved, atol=1e-5)
    assert float(inputs["current"][:, :3, :, -1].abs().max()) == 0.0
    assert float(inputs["hole_mask"][..., -1].min()) == 1.0
    depth = inputs["current"][:, 15]
    assert float(depth.min()) == 0.0
    assert float(depth.max()) == 1.0
    assert torch.equal(inputs["gain"], measure_gain(window.current, rendered, torch.ones(1)))
    made = SYSTEM.predict(trained(config), window, None).image
    assert made is not None
    assert bool(made.isfinite().all())
    assert SYSTEM.derivation(config).mode is DemodulationMode.ALBEDO


def test_padding_is_that_of_repeated_borders() -> None:
    torch.manual_seed(1)
    inputs = {"current": torch.rand(1, 18, 13, 19), "history": torch.rand(1, 12, 13, 19)}
    padded = {
        name: nn.functional.pad(t, (0, 5, 0, 3), mode="replicate") for name, t in inputs.items()
    }
    network = trained()
    small, large = (network(i)[0]["predicted"] for i in (inputs, padded))
    assert torch.allclose(small, large[..., :13, :19], atol=1e-6)


def test_layers_give_the_same_in_either_memory_format() -> None:
    torch.manual_seed(2)
    inputs = {"current": torch.rand(2, 18, 24, 32), "history": torch.rand(2, 12, 24, 32)}
    network = trained()
    expected = network(inputs)[0]["predicted"]
    fast = accelerate_network(network)
    channels_last = {k: t.contiguous(memory_format=torch.channels_last) for k, t in inputs.items()}
    assert torch.allclose(fast(channels_last)[0]["predicted"], expected, atol=1e-5)


def test_ablations_see_less(make_windows: MakeWindows) -> None:
    window = make_windows(SYSTEM, 1, count=6)[-1]
    inputs = prepare(CONFIG, window)
    blind = replace(CONFIG, history=False)
    network = trained(blind)
    changed = {**inputs, "history": torch.rand_like(inputs["history"])}
    first, second = (network(i)[0]["predicted"] for i in (inputs, changed))
    assert torch.equal(first, second)
    seeing = trained()
    first, second = (seeing(i)[0]["predicted"] for i in (inputs, changed))
    assert not torch.equal(first, second)
    holes = inputs["hole_mask"].expand(1, 3, -1, -1) > 0.5
    assert bool(holes.any())
    plain = prepare(replace(CONFIG, occlusion=False), window)["current"]
    assert float(plain[:, 3:6][holes].abs().max()) == 0.0
    warped = prepare(replace(CONFIG, base=PredictionBase.WARPED), window)["current"]
    assert torch.equal(warped[:, :3], inputs["history"][:, 8:11])


def test_radiance_is_encoded_and_decoded(make_windows: MakeWindows) -> None:
    window = make_windows(SYSTEM, 1, count=6, optional=True)[-1]
    inputs = prepare(CONFIG, window)
    color = inputs["emission"] + torch.rand(1, 3, 16, 24) * 2.0 * inputs["gain"]
    assert torch.allclose(decode_radiance(encode_goal(color, inputs), inputs), color, atol=1e-5)


def sample(make_windows: MakeWindows) -> tuple[Tensors, Tensors]:
    window = make_windows(SYSTEM, 1, count=6, optional=True)[-1]
    truth = torch.rand(1, 3, 16, 24) + 0.1
    current = window.lr[1]
    reference = replace(current, gbuffer=current.gbuffer.with_buffers({Buffer.COLOR: truth}))
    return prepare(CONFIG, window), goal(CONFIG, window, reference)


def test_terms_of_the_loss_are_those_of_the_publication(make_windows: MakeWindows) -> None:
    inputs, target = sample(make_windows)
    predicted = encode_goal(target["color"], inputs).clone()
    predicted[:, :, 5, 7] += 0.5
    inputs = {**inputs, "hole_mask": torch.zeros(1, 1, 16, 24)}
    inputs["hole_mask"][:, :, 5, 7:9] = 1.0
    terms = loss(CONFIG, inputs, {"predicted": predicted}, target)
    assert set(terms) == {"log", "hole", "shading"}
    assert float(terms["log"]) == pytest.approx(0.5 / (16 * 24))
    assert float(terms["hole"]) == pytest.approx(0.25)
    assert float(terms["shading"]) == pytest.approx(0.5 / (16 * 24 // 10))
    none = {**inputs, "hole_mask": torch.zeros(1, 1, 16, 24)}
    assert float(loss(CONFIG, none, {"predicted": predicted}, target)["hole"]) == 0.0


def test_the_largest_tenth_is_taken_image_by_image_and_channel_by_channel() -> None:
    difference = torch.zeros(2, 3, 4, 5)
    difference[0, 1, 0, :2] = torch.tensor([1.0, 3.0])
    assert float(average_largest(difference)) == pytest.approx(2.0 / 6)


def test_tonemapped_terms_measure_the_picture(make_windows: MakeWindows) -> None:
    inputs, target = sample(make_windows)
    config = replace(
        CONFIG,
        loss=ExtraNetLoss(log=0, hole=0, shading=0, tonemapped=1, tonemapped_squared=2),
    )
    black = {"predicted": torch.zeros(1, 3, 16, 24)}
    terms = loss(config, inputs, black, target)
    shown = target["color"] / (1 + target["color"])
    emission = inputs["emission"] / (1 + inputs["emission"])
    assert float(terms["tonemapped"]) == pytest.approx(float((shown - emission).abs().mean()))
    squared = float((shown - emission).square().mean())
    assert float(terms["tonemapped_squared"]) == pytest.approx(2 * squared)


def test_a_loss_of_nothing_is_refused() -> None:
    with pytest.raises(ConfigError, match="has to be above 0"):
        ExtraNetLoss(log=0, hole=0, shading=0)
    with pytest.raises(ConfigError, match=r"network\.loss"):
        ExtraNetLoss(log=-1)


def unchanged(inputs: Tensors, target: Tensors) -> tuple[Tensors, Tensors]:
    """As `change` with a generator that keeps the order of colours and loses nothing."""

    class Keeping:
        def permutation(self, n: int) -> np.ndarray:
            return np.arange(n)

        def random(self) -> float:
            return 1.0

    return change(CONFIG, inputs, target, SampleChoices(), Keeping())


def test_a_sample_that_nothing_happens_to_is_the_frame(make_windows: MakeWindows) -> None:
    inputs, target = sample(make_windows)
    same, aim = unchanged(inputs, target)
    assert all(torch.equal(same[name], tensor) for name, tensor in inputs.items())
    assert torch.equal(aim["color"], target["color"])


@pytest.mark.parametrize("seed", range(8))
def test_changed_samples_have_changed_goals(
    make_windows: MakeWindows, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the base is wrong by, in e, is the same before and after, turned and reordered."""
    monkeypatch.setattr(importlib.import_module(change.__module__), "COVERED", 0.0)
    inputs, target = sample(make_windows)
    rng = np.random.default_rng(seed)
    turn = draw_turn(rng)
    choices = SampleChoices(turn=turn, gain=(2.0, 2.0, 2.0))
    order = np.random.default_rng(seed).permutation(3).tolist()
    changed, aim = change(CONFIG, inputs, target, choices, np.random.default_rng(seed))

    def error(inputs: Tensors, target: Tensors) -> Tensor:
        return encode_goal(target["color"], inputs) - inputs["current"][:, :3]

    expected = turn.image(error(inputs, target))[:, order]
    assert torch.allclose(error(changed, aim), expected, atol=1e-4)
    normal = changed["current"][:, 12:15]
    plain = turn.plane("normal", inputs["current"][:, 12:15])
    assert torch.equal(normal, plain)
    brighter = decode_radiance(changed["current"][:, :3], changed)
    before = decode_radiance(inputs["current"][:, :3], inputs)
    assert torch.allclose(brighter, 2.0 * turn.image(before)[:, order], rtol=1e-4, atol=1e-6)


def test_older_frames_are_lost_now_and_then(make_windows: MakeWindows) -> None:
    inputs, target = sample(make_windows)
    choices = SampleChoices(turn=PictureTurn())
    lost = [0, 0]
    for seed in range(200):
        made, _ = change(CONFIG, inputs, target, choices, np.random.default_rng(seed))
        lost[0] += not bool(made["history"][:, :4].any())
        lost[1] += not bool(made["history"][:, 4:8].any())
        assert bool(made["history"][:, 8:].any())
    assert 20 < lost[0] < 65
    assert 4 < lost[1] < 30
    assert math.isfinite(float(made["current"].sum()))


def test_a_rectangle_is_hidden_of_the_last_rendered_frame_alone(make_windows: MakeWindows) -> None:
    inputs, _ = sample(make_windows)
    current, history, holes = (inputs[name].clone() for name in ("current", "history", "hole_mask"))
    cover_rectangle(current, history, holes, np.random.default_rng(3))
    covered = (holes > inputs["hole_mask"])[0, 0]
    rows, columns = (torch.nonzero(covered.any(dim)).flatten() for dim in (1, 0))
    inside = (..., slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    assert 0.1 < len(rows) / covered.shape[0] < 0.41
    assert bool((holes[inside] == 1.0).all())
    before = inputs["current"][inside]
    assert torch.allclose(current[inside][:, :3], before[:, :3].mean((-2, -1), keepdim=True))
    assert not bool(current[inside][:, 6:9].any())
    assert not bool(history[inside][:, 11].any())
    older = (history[inside][:, [3, 7]] > 0.5).any(1, keepdim=True)
    assert bool(older.any())
    assert torch.equal(current[inside][:, 3:6] * older, before[:, 3:6] * older)
    assert not bool((current[inside][:, 9:12] * ~older).any())
    assert torch.equal(history[:, :8], inputs["history"][:, :8])
    outside = torch.ones_like(holes)
    outside[inside] = 0.0
    assert torch.equal(current * outside, inputs["current"] * outside)
    assert torch.equal(history * outside, inputs["history"] * outside)
