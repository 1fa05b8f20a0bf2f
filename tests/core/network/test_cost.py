"""Counting parameters and multiply-accumulates."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import pytest
from torch import Tensor, nn

from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.warping import backward_warp
from rtsr_cli.core.network.cost import count_macs, count_parameters, make_uniform_window
from rtsr_cli.core.system import FrameWindow, State, System, Tensors, TrainingRecipe
from rtsr_cli.models import load_system


class Strided(nn.Module):
    """Every way in which a convolution's cost depends on its settings, and a filtered warp."""

    def __init__(self) -> None:
        super().__init__()
        self.first = nn.Conv2d(3, 8, 3, stride=2, padding=1)
        self.depthwise = nn.Conv2d(8, 8, 5, padding=2, groups=8, bias=False)
        self.wide = nn.Conv2d(8, 2, (1, 3), padding=(0, 1))

    def forward(self, inputs: Tensors, state: State) -> tuple[Tensors, State]:
        color, _ = backward_warp(inputs["color"], inputs["motion"], mode="bilinear")
        once = self.depthwise(self.first(color).relu_())
        return {"out": self.wide(self.depthwise(once))}, state


@dataclass(frozen=True)
class NoConfig:
    """No settings."""


def prepare(config: Any, window: FrameWindow) -> dict[str, Tensor]:
    gbuffer = window.current.gbuffer
    return {"color": gbuffer[Buffer.COLOR], "motion": gbuffer[Buffer.MOTION]}


def unused(*_: Any) -> Any:
    raise AssertionError


SYSTEM = System(
    name="strided",
    summary="made by a test",
    citation="-",
    lr_inputs=(Buffer.COLOR, Buffer.MOTION),
    hr_inputs=(Buffer.MATERIAL,),
    history_frames=2,
    config=NoConfig,
    build=lambda config, scale: Strided(),
    predict=unused,
    learning=TrainingRecipe(prepare=prepare, reference=(), goal=unused, loss=unused),
)


def test_macs_are_output_values_times_the_kernel_of_a_group() -> None:
    # 7 x 9 pixels at stride 2 leave 4 x 5; the depthwise layer runs twice
    expected = 4 * 5 * (8 * 3 * 9 + 2 * 8 * 25 + 2 * 8 * 3)
    assert count_macs(SYSTEM, NoConfig(), 4, (7, 9)) == expected


def test_parameters_include_biases() -> None:
    assert count_parameters(Strided()) == (3 * 9 + 1) * 8 + 8 * 25 + (8 * 3 + 1) * 2


def test_a_window_is_full_and_has_every_declared_buffer() -> None:
    window = make_uniform_window(SYSTEM, 4, (7, 9))
    assert len(window.lr) == 3
    assert set(window.current.gbuffer) == {Buffer.COLOR, Buffer.MOTION}
    assert window.current.gbuffer[Buffer.MOTION].shape == (1, 2, 7, 9)
    assert window.hr is not None
    assert window.hr.gbuffer[Buffer.MATERIAL].shape == (1, 3, 28, 36)
    assert make_uniform_window(replace(SYSTEM, hr_inputs=()), 4, (7, 9)).hr is None


def test_a_baseline_has_nothing_to_count() -> None:
    with pytest.raises(ConfigError, match="'bicubic' has no network"):
        count_macs(load_system("bicubic"), None, 4, (4, 4))
