"""`gather`: what it starts from, what it weighs, what it does without."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import nn

from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.lighting.lighting_history import CarriedLighting, EnlargedLighting, enlarge_frame
from rtsr_cli.core.system import FrameWindow, Prediction, Tensors
from rtsr_cli.models import load_system
from rtsr_cli.models.gather.config import GatherConfig
from rtsr_cli.models.gather.inputs import (
    HR_CHANNELS,
    LR_CHANNELS,
    describe_pixels,
    list_seen,
    see_pixels,
    see_samples,
)
from rtsr_cli.models.gather.network import GatherNetwork

SYSTEM = load_system("gather")

PARAMETERS = 70_957
"""Of the default network."""

MakeWindows = Callable[..., list[FrameWindow]]


def build(config: GatherConfig | None = None, *, moved: float = 0.0) -> GatherNetwork:
    torch.manual_seed(3)
    network = GatherNetwork(config or GatherConfig(), 4).eval()
    nn.init.normal_(network.head.last.weight, std=moved)
    return network


def run(network: nn.Module, windows: list[FrameWindow], name: str = "gather") -> list[Prediction]:
    system, state, made = load_system(name), None, []
    for window in windows:
        with torch.no_grad():
            made.append(system.predict(network, window, state))
        state = made[-1].state
    return made


def image_of(prediction: Prediction) -> torch.Tensor:
    assert prediction.image is not None
    return prediction.image


def test_parameters() -> None:
    assert sum(p.numel() for p in build().parameters()) == PARAMETERS


@pytest.mark.parametrize("scale", [2, 3, 4])
@pytest.mark.parametrize("optional", [False, True])
def test_untrained_it_is_demod_temporal(
    make_windows: MakeWindows, scale: int, optional: bool
) -> None:
    windows = make_windows(SYSTEM, scale, optional=optional)
    baseline = load_system("demod-temporal")
    known = run(baseline.build(baseline.config(), scale), windows, "demod-temporal")
    for ours, theirs in zip(run(build(), windows), known, strict=True):
        torch.testing.assert_close(image_of(ours), image_of(theirs), rtol=1e-4, atol=1e-5)


def test_of_filtered_radiance_nothing_is_corrected(make_windows: MakeWindows) -> None:
    shot = make_windows(SYSTEM, 4, optional=True)
    filtered = [replace(w, lr=tuple(replace(f, filter_width_px=0.4) for f in w.lr)) for w in shot]
    ours, theirs = (run(build(moved=m), filtered)[-1] for m in (0.3, 0.0))
    torch.testing.assert_close(image_of(ours), image_of(theirs), rtol=1e-4, atol=1e-5)


def blend(agreement: float, worth_logit: float, share_logit: float) -> torch.Tensor:
    """e' and c of pixels whose light has changed, history being worth 4 samples."""
    plane = torch.ones(1, 1, 4, 4)
    given = torch.zeros(1, 5, 4, 4)
    given[:, 3], given[:, 4] = worth_logit, share_logit
    images = {
        **{"encoded": 0.3 * plane.expand(1, 3, 4, 4), "change": -0.4 * plane.expand(1, 3, 4, 4)},
        **{"fit": 0.2 * plane, "seen": plane, "agreement": agreement * plane, "given": given},
        **{"history": 0.8 * plane.expand(1, 3, 4, 4), "worth": 4.0 * plane},
    }
    return build()._blend(images)


@pytest.mark.parametrize("corrections", [(2.0, 0.0), (0.0, -3.0)])
def test_where_samples_agree_on_a_change_history_is_given_no_belief(
    corrections: tuple[float, float],
) -> None:
    assert torch.equal(blend(1.0, *corrections), blend(1.0, 0.0, 0.0))
    assert not torch.allclose(blend(0.0, *corrections), blend(0.0, 0.0, 0.0), atol=1e-3)


@pytest.mark.parametrize("corrections", [(-2.0, 0.0), (0.0, 3.0)])
def test_where_samples_agree_on_a_change_belief_may_be_taken(
    corrections: tuple[float, float],
) -> None:
    assert not torch.allclose(blend(1.0, *corrections), blend(1.0, 0.0, 0.0), atol=1e-3)


def test_channels_are_those_of_the_table(make_windows: MakeWindows) -> None:
    window = make_windows(SYSTEM, 4, optional=True)[0]
    learning = SYSTEM.learning
    assert learning is not None
    inputs = learning.prepare(GatherConfig(), window)
    frame = enlarge_frame(inputs, None)
    assert see_samples(inputs, None).shape == (1, LR_CHANNELS, 16, 24)
    assert see_pixels(list_seen(inputs, None, frame)).shape == (1, HR_CHANNELS, 64, 96)


def test_strips_of_the_head_are_the_whole(
    make_windows: MakeWindows, monkeypatch: pytest.MonkeyPatch
) -> None:
    windows = make_windows(SYSTEM, 4, optional=True)
    whole = run(build(moved=0.3), windows)
    monkeypatch.setattr("rtsr_cli.models.gather.network.STRIP_PIXELS", 1)
    for ours, theirs in zip(run(build(moved=0.3), windows), whole, strict=True):
        torch.testing.assert_close(image_of(ours), image_of(theirs), rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("scale", [2, 4])
def test_corrections_of_strips_are_those_of_the_graph(
    scale: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pixels that are described strip by strip, their rows' neighbours included."""
    monkeypatch.setattr("rtsr_cli.models.gather.network.STRIP_PIXELS", 1)
    torch.manual_seed(5)
    one, three, two = (torch.rand(1, c, 6 * scale, 5 * scale) for c in (1, 3, 2))
    inputs = {
        **{"mask": torch.ones(1, 1, 6, 5), "depth": 1.0 + one, "roughness": one, "motion": two},
        **{"normal": nn.functional.normalize(three - 0.5, dim=1), "material": three},
        "shift": torch.zeros(1, 2, 1, 1),
    }
    frame = EnlargedLighting(
        encoded=three, fit=one, change=three - 0.5, seen=one, agreement=torch.zeros_like(one)
    )
    images = list_seen(inputs, CarriedLighting(encoded=three.flip(2), worth=one), frame)
    samples, network = torch.rand(1, LR_CHANNELS, 6, 5), build(moved=0.3)
    # what a block's mean takes from beyond a strip is a small part of what is seen
    with torch.no_grad():
        network.trunk.first.weight.mul_(5.0)
        whole = network.correct({"samples": samples, "pixels": see_pixels(images)})["corrections"]
        strips = network._correct_in_strips(samples, images)
    torch.testing.assert_close(strips, whole, rtol=1e-4, atol=1e-4)


def test_whatever_it_learned_another_surface_weighs_nothing(make_windows: MakeWindows) -> None:
    """History of surfaces that are not there any more, believed as far as it can be."""
    windows = make_windows(SYSTEM, 4, count=2, optional=True)
    network = build()
    network.head.last.bias.data[3] = 100.0
    hr = windows[1].require_hr()
    renamed = hr.gbuffer.with_buffers({Buffer.OBJECT_ID: hr.gbuffer[Buffer.OBJECT_ID] + 1000})
    other = replace(windows[1], hr=replace(hr, gbuffer=renamed))
    followed, alone = run(network, [windows[0], other])[1], run(network, [other])[0]
    torch.testing.assert_close(image_of(followed), image_of(alone), rtol=1e-4, atol=1e-5)
    changed = run(network, windows)[1]
    assert float((image_of(changed) - image_of(alone)).abs().max()) > 1e-3


def stack(parts: list[Tensors]) -> dict[str, torch.Tensor]:
    return {name: torch.cat([part[name] for part in parts]) for name in parts[0]}


def test_a_batch_is_its_samples(make_windows: MakeWindows) -> None:
    learning, network = SYSTEM.learning, build(moved=0.3)
    assert learning is not None
    shot = make_windows(SYSTEM, 4, optional=True)
    filtered = [replace(w, lr=tuple(replace(f, filter_width_px=0.4) for f in w.lr)) for w in shot]
    steps = [[learning.prepare(GatherConfig(), w) for w in ws] for ws in (shot, filtered)]
    states = [None, None, None]
    for parts in zip(*steps, strict=True):
        with torch.no_grad():
            both, states[2] = network(stack(list(parts)), states[2])
            for i, part in enumerate(parts):
                one, states[i] = network(part, states[i])
                torch.testing.assert_close(
                    both["encoded"][i, None], one["encoded"], rtol=1e-3, atol=1e-4
                )


def test_a_step_of_training_lessens_the_loss(make_windows: MakeWindows) -> None:
    learning, network = SYSTEM.learning, build(moved=0.1).train()
    assert learning is not None
    config, state, windows = GatherConfig(), None, make_windows(SYSTEM, 4, optional=True)
    optimiser = torch.optim.Adam(network.parameters(), 1e-3)
    losses = []
    for _ in range(8):
        state, total = None, torch.zeros(())
        for window in windows:
            inputs = learning.prepare(config, window)
            outputs, state = network(inputs, state)
            ones = torch.ones_like(inputs["kind"])
            target = {"color": 0.5 * inputs["material"], "surface_mask": ones}
            total = total + sum(learning.loss(config, inputs, outputs, target).values())
        optimiser.zero_grad()
        total.backward()
        optimiser.step()
        losses.append(float(total.detach()))
    assert losses[-1] < losses[0]


TERMS = {"kernel": slice(0, 3), "history": slice(3, 5), "residual": slice(5, 8)}
"""Outputs of the head that each setting takes in."""


@pytest.mark.parametrize("term", TERMS)
def test_an_ablated_term_is_not_heard(make_windows: MakeWindows, term: str) -> None:
    """What its outputs are changes pixels with the setting, and none without."""
    windows = make_windows(SYSTEM, 4, optional=True)
    settings = {"kernel": True, "history": True, "residual": True}

    def show(config: GatherConfig, told: float) -> torch.Tensor:
        network = build(config)
        bias = network.head.last.bias.data
        bias[TERMS[term].start : min(TERMS[term].stop, len(bias))] = told
        return image_of(run(network, windows)[-1])

    with_it, without = GatherConfig(**settings), GatherConfig(**{**settings, term: False})
    assert float((show(with_it, 0.5) - show(with_it, 0.0)).abs().max()) > 1e-3
    torch.testing.assert_close(show(without, 0.5), show(with_it, 0.0), rtol=1e-4, atol=1e-5)


def test_weights_out_of_range_are_refused() -> None:
    with pytest.raises(ConfigError, match="age"):
        GatherConfig(age=1.5)


def test_pixels_are_described_as_the_table_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each channel of one pixel, by hand."""
    rows, columns, scale = 4, 6, 2

    def fill(*values: float) -> torch.Tensor:
        return torch.tensor(values).view(1, -1, 1, 1).repeat(1, 1, rows, columns)

    inputs = {
        "mask": torch.ones(1, 1, rows // scale, columns // scale),
        **{"normal": fill(0.0, 0.0, 1.0), "depth": fill(4.0), "roughness": fill(0.35)},
        **{"material": fill(0.1, 0.2, 0.3), "motion": fill(-2.25, 1.5)},
        "shift": torch.zeros(1, 2, 1, 1),
    }
    # the row below, and the column beside, are turned: bumps of three rows and three columns
    inputs["normal"][:, :, 2:, 3:] = fill(0.6, 0.0, 0.8)[:, :, 2:, 3:]
    carried = CarriedLighting(encoded=fill(0.5, 0.2, 0.8), worth=fill(3.0))
    frame = EnlargedLighting(
        encoded=fill(0.3, 0.6, 0.9),
        fit=fill(0.4),
        change=fill(0.3, -0.6, 0.0),
        seen=fill(0.7),
        agreement=fill(0.0),
    )
    monkeypatch.setattr("rtsr_cli.models.gather.inputs.BUMP_ROWS", 1)
    images = list_seen(inputs, carried, frame)
    expected = {
        **{0: 0.4, 1: math.log(0.401) / 4, 2: math.log(4.0) / 2, 3: 1.0},
        **{4: -0.1, 5: math.sqrt((0.09 + 0.36) / 3), 6: -0.1, 7: 0.4, 8: 0.6, 9: 0.5},
        **{11: 0.35, 12: math.log(0.21) / 4, 13: 0.2, 14: 2.25 / 8},
        **{15: 2 * (0.75 * 0.25 + 0.25), 16: 0.7},
    }
    seen = describe_pixels(images)
    for channel, value in expected.items():
        torch.testing.assert_close(seen[0, channel], torch.full((rows, columns), value))
    # so many of the nine normals around a pixel are turned by 37 degrees
    for (row, column), turned in {(0, 0): 0, (1, 2): 1, (1, 4): 3, (2, 2): 2, (2, 4): 6}.items():
        size = math.hypot(0.6 * turned, 9 - 0.2 * turned) / 9
        assert float(seen[0, 10, row, column]) == pytest.approx(10 * (1 - size), abs=1e-5)
    assert seen[0, 17, 0].tolist() == [-0.5, 0.0] * 3
    assert seen[0, 18, :, 0].tolist() == [-0.5, 0.0] * 2
    unknown = describe_pixels(images | {"worth": fill(0.0)})
    assert not unknown[0, [2, 3, 6, 7, 9]].any()
