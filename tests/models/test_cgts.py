"""`cgts`: sizes, what goes from frame to frame, its weights, goals and losses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import nn

from rtsr_cli.core.choices import Preset
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.auxiliary_buffers import span_colors
from rtsr_cli.core.imaging.pixel_classes import Aliasing, Ghosting
from rtsr_cli.core.imaging.predicted_kernel import (
    FILTERED_WORTH,
    continue_image,
    filter_pixels,
)
from rtsr_cli.core.network.acceleration import accelerate_network
from rtsr_cli.core.network.cost import count_macs, count_parameters, make_uniform_window
from rtsr_cli.core.pairs.simulation import average_samples
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.models import load_system
from rtsr_cli.models.cgts import inputs as cgts_inputs
from rtsr_cli.models.cgts.config import CAUTION, CgtsConfig, CgtsLoss, Stage
from rtsr_cli.models.cgts.inputs import (
    LEAST_FILTERED,
    CgtsState,
    carry_history,
    clip_history,
    filter_moving,
    limit_clipping,
    prepare,
)
from rtsr_cli.models.cgts.loss import (
    ALIASING_ORDER,
    GHOSTING_ORDER,
    classification_loss,
    goal,
    loss,
    number_classes,
)
from rtsr_cli.models.cgts.network import CgtsNetwork, find_hidden

SYSTEM = load_system("cgts")
CONFIG = CgtsConfig()

MakeWindows = Callable[..., list[FrameWindow]]


def build(config: CgtsConfig = CONFIG) -> CgtsNetwork:
    network = SYSTEM.build(config, 2)
    assert isinstance(network, CgtsNetwork)
    return network.eval()


def trained(config: CgtsConfig = CONFIG) -> CgtsNetwork:
    """A network that decides something: the composition's last layer starts at 0."""
    torch.manual_seed(3)
    network = build(config)
    nn.init.normal_(network.composition.weight.weight, std=0.3)
    for module in network.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.uniform_(module.running_mean, -0.2, 0.2)
            nn.init.uniform_(module.running_var, 0.5, 2.0)
    return network


def sharp(network: CgtsNetwork) -> CgtsNetwork:
    """The same, samples where they lie: nothing is filtered."""
    with torch.no_grad():
        network.composition.weight.weight[2:] = 0.0
        network.composition.weight.bias[2] = -1e4
        network.composition.weight.bias[3] = 0.0
    return network


@pytest.fixture
def as_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """What moves is not filtered more than the network says."""
    monkeypatch.setattr(cgts_inputs, "LEAST_FILTERED", 0.0)


def test_networks_have_the_sizes_of_the_design() -> None:
    network = build(CgtsConfig(preset=Preset.PAPER))
    assert count_parameters(network.classifier) == 122_354
    assert count_parameters(network.composition) == 1_025
    detail = 96 * 49 + 2 * (96 * 10 + 96 * 97) + 88 * 97
    assert count_parameters(build().classifier) == 122_354 + 4 * 5 * 32 + 88 * 33 + detail


def test_multiplications_of_an_output_pixel() -> None:
    """2,807 of the classifier, 960 of the composition."""
    macs = count_macs(SYSTEM, CgtsConfig(preset=Preset.PAPER), 2, (64, 96))
    assert macs / (128 * 192) == pytest.approx(2_807 + 960, abs=1)


@pytest.mark.parametrize("size", [(16, 16), (34, 50), (2, 6), (30, 48)])
def test_no_pixel_is_lost_whatever_the_size(size: tuple[int, int]) -> None:
    network = CgtsNetwork(CgtsConfig(), 2).eval()
    window = make_uniform_window(SYSTEM, 2, (size[0] // 2, size[1] // 2))
    outputs, _ = network(prepare(network.config, window), None)
    assert outputs["logits"].shape == (1, 6, *size)


def run(network: CgtsNetwork, windows: list[FrameWindow]) -> list[Tensors]:
    state, outputs = None, []
    for window in windows:
        with torch.no_grad():
            given, state = network(prepare(network.config, window), state)
        outputs.append(given)
    return outputs


def test_inference_gives_the_same(make_windows: MakeWindows) -> None:
    windows, network = make_windows(SYSTEM, 2), trained()
    fast = accelerate_network(network)
    assert isinstance(fast, CgtsNetwork)
    fast.strip_pixels = 100
    for plain, accelerated in zip(run(network, windows), run(fast, windows), strict=True):
        for name, tensor in plain.items():
            torch.testing.assert_close(accelerated[name], tensor, rtol=1e-3, atol=1e-4)


@pytest.mark.usefixtures("as_told")
def test_the_first_frame_is_the_frame(make_windows: MakeWindows) -> None:
    window = make_windows(SYSTEM, 2)[0]
    inputs = prepare(CONFIG, window)
    (outputs,) = run(sharp(trained()), [window])
    assert torch.equal(outputs["color"], inputs["color"])
    assert bool((outputs["weight"] == 1.0).all())
    assert bool((outputs["counter"] == 0.0).all())


def test_what_was_learnt_nothing_yet_is_a_running_mean_of_samples(
    make_windows: MakeWindows,
) -> None:
    """sum w c / sum w, as long as history stays where it is."""
    window = make_windows(SYSTEM, 2)[0]
    still = replace(
        window.current,
        gbuffer=window.current.gbuffer.with_buffers(
            {Buffer.MOTION: torch.zeros_like(window.current.gbuffer[Buffer.MOTION])}
        ),
    )
    jitters = [(0.25, 0.25), (-0.25, 0.25), (0.0, -0.25)]
    windows = [
        replace(window, lr=(replace(still, camera=replace(still.camera, jitter_px=j)),))
        for j in jitters
    ]
    inputs = [prepare(CONFIG, w) for w in windows]
    summed = sum(i["color"] * i["worth"] for i in inputs)
    mean = summed / sum(i["worth"] for i in inputs)
    color = run(sharp(build()), windows)[-1]["color"]
    torch.testing.assert_close(color, mean, rtol=1e-4, atol=1e-5)


def test_a_filtered_frame_weighs_the_same_wherever_samples_lie(make_windows: MakeWindows) -> None:
    network = build()
    with torch.no_grad():
        network.composition.weight.bias[2] = 1e4
        inputs = prepare(CONFIG, make_windows(SYSTEM, 2)[0])
        state = make_state(inputs)
        known = replace(state, worth=torch.ones_like(state.worth))
        outputs, kept = network(inputs, known)
    inside = outputs["weight"][outputs["weight"] < 1.0]
    torch.testing.assert_close(
        inside, torch.full_like(inside, FILTERED_WORTH / (1 + FILTERED_WORTH))
    )
    assert float(inputs["worth"].amax() - inputs["worth"].amin()) > 0.5
    assert isinstance(kept, CgtsState)
    inner = kept.worth[..., :-4]
    torch.testing.assert_close(inner, torch.full_like(inner, 1.0 + FILTERED_WORTH))


@pytest.mark.usefixtures("as_told")
def test_what_is_shown_is_filtered_and_what_goes_on_is_not(make_windows: MakeWindows) -> None:
    network = sharp(build())
    inputs = prepare(CONFIG, make_windows(SYSTEM, 2)[0])
    with torch.no_grad():
        network.composition.weight.bias[3] = 1e4
        outputs, kept = network(inputs, None)
    assert isinstance(kept, CgtsState)
    assert torch.equal(kept.color, inputs["color"])
    even = torch.zeros(1, inputs["reach"].shape[1], *inputs["samples"].shape[2:])
    smooth = filter_pixels(continue_image(kept.color), even, 2)
    torch.testing.assert_close(outputs["color"], smooth)


def test_history_is_doubted_before_it_is_likelier_wrong() -> None:
    logits = torch.zeros(1, 6, 1, 2)
    logits[0, 2, 0] = torch.tensor([CAUTION - 0.1, CAUTION + 0.1])
    assert find_hidden(logits)[0, 0, 0].tolist() == [True, False]


def make_state(inputs: Tensors, exposure: float = 1.0) -> CgtsState:
    color = torch.rand(inputs["color"].shape, generator=torch.Generator().manual_seed(5))
    plane = color[:, :1]
    return CgtsState(
        color=color,
        counter=(8 * plane).round(),
        worth=3.0 * plane,
        span=torch.cat([0.5 * color, color], dim=1),
        depth=plane,
        logits=torch.cat([color, -color], dim=1),
        exposure=torch.full((1, 1, 1, 1), exposure),
        linked=0,
    )


def test_history_is_fetched_where_each_pixel_was(make_windows: MakeWindows) -> None:
    """The pattern moves two output pixels to the left a frame, so that it came from the right."""
    inputs = prepare(CONFIG, make_windows(SYSTEM, 2)[0])
    state = make_state(inputs)
    assert bool((inputs["motion"][:, 0] == 2.0).all())
    carried = carry_history(state, inputs, span_colors(inputs["color"]))
    inner = (..., slice(None, -4))
    fetched = {
        "color": carried.color,
        "counter": carried.counter,
        "worth": carried.worth,
        "span": carried.span,
        "logits": carried.logits,
    }
    for name, image in fetched.items():
        expected = getattr(state, name).roll(-2, dims=3)
        torch.testing.assert_close(image[inner], expected[inner])
    assert not bool(carried.inside[..., -2:].any())
    assert torch.equal(carried.color[..., -2:], inputs["color"][..., -2:])
    assert bool((carried.counter[..., -2:] == 0).all())
    assert bool((carried.difference[..., -2:] == 1).all())
    assert bool((carried.logits[..., -2:].argmax(1) == 0).all())


def test_history_is_brought_to_the_frame_s_exposure(make_windows: MakeWindows) -> None:
    inputs = dict(prepare(CONFIG, make_windows(SYSTEM, 2)[0]))
    own, state = span_colors(inputs["color"]), make_state(inputs)
    plain = carry_history(state, inputs, own).color
    brighter = carry_history(state, {**inputs, "exposure": 2.0 * inputs["exposure"]}, own).color
    shown = carry_history(state, inputs, own).inside > 0
    expected = torch.where(shown, 2.0 * plain / (1.0 + plain), plain)
    torch.testing.assert_close(brighter, expected)


@pytest.mark.usefixtures("as_told")
def test_reactive_pixels_take_the_frame(make_windows: MakeWindows) -> None:
    windows = make_windows(SYSTEM, 2, optional=True)
    outputs = run(sharp(trained()), windows)[-1]
    inputs = prepare(CONFIG, windows[-1])
    reactive = inputs["reactive"].expand_as(outputs["color"]) == 1.0
    assert bool(reactive.any())
    assert torch.equal(outputs["color"][reactive], inputs["color"][reactive])


def test_the_published_channels_are_seen_alone(make_windows: MakeWindows) -> None:
    window = make_windows(SYSTEM, 2)[0]
    inputs = prepare(CgtsConfig(preset=Preset.PAPER), window)
    assert bool((inputs["worth"] == 1.0).all())
    outputs = run(build(CgtsConfig(preset=Preset.PAPER)), make_windows(SYSTEM, 2))[-1]
    inside = outputs["weight"] < 1.0
    assert torch.equal(outputs["weight"][inside], torch.full_like(outputs["weight"], 0.5)[inside])


def capture(window: FrameWindow, k: int = 2) -> Frame:
    """Samples of a window's frame as if every LR pixel had held scale x k of the same."""
    frame, scale = window.current, window.scale * k
    buffers = {
        buffer: tensor.repeat_interleave(scale, 2).repeat_interleave(scale, 3)
        * (scale if buffer is Buffer.MOTION else 1)
        for buffer, tensor in frame.gbuffer.only(SYSTEM.lr_inputs).buffers.items()
    }
    gbuffer = GBuffer(buffers, "capture")
    return replace(frame, gbuffer=gbuffer, camera=replace(frame.camera, jitter_px=(0.0, 0.0)))


def make_goal(windows: list[FrameWindow]) -> Tensors:
    captures = tuple(capture(window) for window in reversed(windows))
    reference = average_samples(captures[0], 2)
    return goal(CONFIG, replace(windows[-1], captures=captures), reference)


def test_a_first_frame_is_all_visibility_ghosting(make_windows: MakeWindows) -> None:
    target = make_goal(make_windows(SYSTEM, 2)[:1])
    assert bool((target["ghosting"] == Ghosting.VISIBILITY).all())
    assert torch.equal(target["before"], target["color"])


def test_what_moved_along_does_not_ghost(make_windows: MakeWindows) -> None:
    windows = make_windows(SYSTEM, 2)[:2]
    target = make_goal(windows)
    inner = (..., slice(None), slice(4, -8))
    assert bool((target["ghosting"][inner] == Ghosting.NONE).all())
    # blocks of one value each move by a whole block
    torch.testing.assert_close(target["before"][inner], target["color"][inner])
    assert not bool((target["aliasing"][inner] == Aliasing.TEXTURE).any())


def test_labels_are_the_places_of_the_logits() -> None:
    ghosting = torch.tensor([Ghosting.NONE, Ghosting.VISIBILITY, Ghosting.SHADING]).view(1, 1, 1, 3)
    assert number_classes(ghosting.float(), GHOSTING_ORDER)[0, 0].tolist() == [2, 0, 1]
    aliasing = torch.tensor([Aliasing.NONE, Aliasing.GEOMETRY, Aliasing.TEXTURE]).view(1, 1, 1, 3)
    assert number_classes(aliasing.float(), ALIASING_ORDER)[0, 0].tolist() == [2, 0, 1]


def test_rare_classes_weigh_more_up_to_a_bound() -> None:
    classes = torch.full((1, 10, 100), 2)
    classes[0, 0, :10] = 0
    logits = torch.zeros(1, 3, 10, 100)
    wrong = logits.clone()
    wrong[:, 2] = 2.0
    even = float(classification_loss(logits, classes, 10.0))
    assert even == pytest.approx(torch.log(torch.tensor(3.0)).item())
    # 10 pixels of 1,000 weigh 10 each, 990 weigh 1000 / 2970
    right, lost = (float(torch.log_softmax(wrong[0, :, 0, 0], 0)[c]) for c in (2, 0))
    share = 990 * 1000 / 2970
    expected = -(100 * lost + share * right) / (100 + share)
    assert float(classification_loss(wrong, classes, 10.0)) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("stage", list(Stage))
def test_a_stage_trains_what_it_is_called_by(make_windows: MakeWindows, stage: Stage) -> None:
    config = CgtsConfig(stage=stage)
    windows = make_windows(SYSTEM, 2)[:2]
    network = trained(config)
    network.train()
    state = None
    total = torch.zeros(())
    for i in range(2):
        target = make_goal(windows[: i + 1])
        # something that the picture is not
        target = {**target, "color": 0.5 * target["color"]}
        inputs = prepare(config, windows[i])
        outputs, state = network(inputs, state)
        terms = loss(config, inputs, outputs, target)
        total = total + torch.stack(list(terms.values())).sum()
    total.backward()
    learns = {
        part: any(p.grad is not None and bool(p.grad.any()) for p in module.parameters())
        for part, module in network.named_children()
    }
    assert learns["classifier"] == (stage is not Stage.COMPOSITION)
    assert learns["composition"] == (stage is not Stage.CLASSIFIER)
    assert network.classifier.training == (stage is not Stage.COMPOSITION)


@pytest.mark.parametrize("frames", [1, 2])
def test_gradients_reach_back_as_far_as_asked(make_windows: MakeWindows, frames: int) -> None:
    network = trained(CgtsConfig(gradient_frames=frames))
    inputs = [dict(prepare(CONFIG, window)) for window in make_windows(SYSTEM, 2)[:2]]
    inputs[0]["color"] = inputs[0]["color"].clone().requires_grad_()
    _, state = network(inputs[0], None)
    outputs, _ = network(inputs[1], state)
    outputs["color"].sum().backward()
    assert (inputs[0]["color"].grad is not None) == (frames == 2)


def test_terms_are_those_that_weigh_anything(make_windows: MakeWindows) -> None:
    windows = make_windows(SYSTEM, 2)[:2]
    target = make_goal(windows)
    config = CgtsConfig(loss=CgtsLoss(ghosting=0.0, aliasing=0.0, color=0.0, squared=2.0))
    color = target["color"] + 0.1
    outputs = {"color": color, "accumulated": color, "history": target["before"] + 0.1}
    terms = loss(config, {}, outputs, target)
    assert set(terms) == {"squared", "temporal"}
    assert float(terms["squared"]) == pytest.approx(2.0 * 0.01, rel=1e-4)
    assert float(terms["temporal"]) == pytest.approx(0.0, abs=1e-6)


def test_a_loss_of_nothing_is_refused() -> None:
    with pytest.raises(ConfigError, match="has to be above 0"):
        CgtsLoss(ghosting=0, aliasing=0, color=0, squared=0, temporal=0)
    with pytest.raises(ConfigError, match="gradient_frames"):
        CgtsConfig(gradient_frames=0)


def test_an_ablation_sees_no_classes(make_windows: MakeWindows) -> None:
    windows = make_windows(SYSTEM, 2)
    network = trained(CgtsConfig(classes=False))
    first = run(network, windows)[-1]["weight"]
    with torch.no_grad():
        network.classifier.decoder[-1].bias += torch.tensor([0.0, 0.0, 0.0, 2.0, -1.0, 0.0])
    second = run(network, windows)[-1]["weight"]
    assert torch.equal(first, second)


def test_what_moves_is_filtered_more() -> None:
    share, motion = torch.tensor([0.2, 0.2, 1.0]).view(1, 1, 1, 3), torch.zeros(1, 2, 1, 3)
    motion[0, 1, 0] = torch.tensor([0.0, 20.0, 20.0])
    expected = torch.tensor([0.2, 0.2 + 0.8 * LEAST_FILTERED, 1.0])
    torch.testing.assert_close(filter_moving(share, motion)[0, 0, 0], expected)


def test_history_is_clipped_where_it_moves() -> None:
    share, motion = torch.ones(1, 1, 1, 3), torch.zeros(1, 2, 1, 3)
    motion[0, 0, 0] = torch.tensor([0.0, 0.25, 20.0])
    limited = limit_clipping(share, motion)[0, 0, 0]
    torch.testing.assert_close(limited, torch.tensor([0.0, 0.6321, 1.0]), rtol=0, atol=1e-4)


@pytest.mark.usefixtures("as_told")
def test_untrained_it_is_held_half_way_within_the_colours_around(
    make_windows: MakeWindows,
) -> None:
    """The pattern moves by two pixels a frame; a history of 1 is brighter than all around."""
    inputs = prepare(CONFIG, make_windows(SYSTEM, 2)[0])
    white = replace(make_state(inputs), color=torch.ones_like(inputs["color"]))
    network = sharp(build())
    with torch.no_grad():
        outputs, _ = network(inputs, white)
    clipped = clip_history(torch.ones_like(inputs["color"]), inputs["around"])
    assert float(clipped.amin()) < 0.9
    moving = 1.0 - torch.exp(torch.tensor(-2.0 / 0.25))
    held = torch.lerp(torch.ones_like(clipped), clipped, 0.5 * moving)
    inner = (..., slice(None, -4))
    expected = torch.lerp(held, inputs["color"], outputs["weight"])
    torch.testing.assert_close(outputs["color"][inner], expected[inner], rtol=1e-4, atol=1e-5)


def test_the_published_surroundings_clip_nothing(make_windows: MakeWindows) -> None:
    config = CgtsConfig(preset=Preset.PAPER)
    inputs = prepare(config, make_windows(SYSTEM, 2)[0])
    assert "around" not in inputs
    white = replace(make_state(inputs), color=torch.ones_like(inputs["color"]))
    with torch.no_grad():
        outputs, _ = build(config)(inputs, white)
    inner = (..., slice(None, -4))
    expected = torch.lerp(torch.ones_like(inputs["color"]), inputs["color"], outputs["weight"])
    torch.testing.assert_close(outputs["color"][inner], expected[inner])
