"""A synthetic clip in memory: every buffer, a few frames, sky on top."""

from __future__ import annotations

import pytest
import torch

from rtsr_cli.core.training.clips import MATERIAL_GAIN, Clip, ClipFacts
from rtsr_cli.core.training.samples import SampleTask
from rtsr_cli.models import load_system

SIZE = (48, 64)


@pytest.fixture(autouse=True, scope="session")
def _one_thread() -> None:
    torch.set_num_threads(1)


def planes(frames: int, size: tuple[int, int] = SIZE) -> dict[str, torch.Tensor]:
    height, width = size
    rng = torch.Generator().manual_seed(7)

    def random(channels: int, low: float, high: float) -> torch.Tensor:
        return (low + (high - low) * torch.rand(frames, channels, *size, generator=rng)).half()

    albedo = random(3, 0.2, 0.8)
    gain = random(1, 0.5, 1.0)
    depth = random(1, 1.0, 9.0)
    depth[:, :, : height // 8] = 65504.0
    normal = torch.nn.functional.normalize(torch.randn(frames, 3, *size, generator=rng)).half()
    emission = torch.zeros(frames, 3, *size).half()
    emission[:, :, height // 2, width // 2] = 0.5
    return {
        "albedo": albedo,
        "material": (albedo * gain + 0.02).half(),
        MATERIAL_GAIN: gain,
        "color": random(3, 0.0, 2.0) + emission,
        "emission": emission,
        "depth": depth,
        "normal": normal,
        "motion": random(2, -4.0, 4.0),
    }


def make_clip(
    *, frames: int = 4, name: str = "a/b", validation: bool = False, group: int = 0
) -> Clip:
    return Clip(
        ClipFacts(
            name=name,
            numbers=tuple(range(1, frames + 1)),
            display=SIZE,
            lighting_scales=(1.0,) * frames,
            validation=validation,
            group=group,
        ),
        planes(frames),
    )


@pytest.fixture
def clip() -> Clip:
    return make_clip()


@pytest.fixture(params=["fusesr", "fusesr-fast", "nsrd"])
def task(request: pytest.FixtureRequest) -> SampleTask:
    system = load_system(request.param)
    return SampleTask(system=system, config=system.config(), scale=4)
