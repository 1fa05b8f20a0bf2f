from __future__ import annotations

from pathlib import Path

import torch

from rtsr_cli.core.learning.clips import read_clips
from rtsr_cli.core.learning.config import TrainingConfig
from rtsr_cli.core.learning.crops import Choices, Region, Task, sample_steps
from rtsr_cli.core.learning.packing import cut, pack
from rtsr_cli.core.learning.sampling import Sampler
from tests.core.learning.conftest import make_clip


def test_a_cut_clip_gives_the_same_samples(task: Task) -> None:
    clip = make_clip()
    packed = cut(clip, Region(position=3, top=8, left=4, size=(8, 10)), 4, 2, 1)
    whole = sample_steps(clip, Region(position=3, top=12, left=8, size=(4, 4)), Choices(), task)
    inner = Region(position=packed.facts.targets, top=4, left=4, size=(4, 4))
    again = sample_steps(packed, inner, Choices(), task)
    for name, tensor in whole[0].inputs.items():
        assert torch.equal(tensor, again[0].inputs[name]), name
    assert packed.facts.numbers == (2, 3, 4)
    assert (packed.facts.top, packed.facts.left) == (8, 4)


def test_a_pack_trains_and_validates_alone(tmp_path: Path, task: Task) -> None:
    clips = [make_clip(), make_clip(name="v/w", validation=True)]
    config = TrainingConfig(crop=4, validation_frames=2)
    path = tmp_path / "p.rtsr-clips"
    assert pack(path, clips, task, config, crops=5) == 7
    found, about = read_clips(path)
    assert about["system"] == task.system.name
    assert [c.facts.validation for c in found] == [False] * 5 + [True] * 2
    assert all(c.size == (20, 20) for c in found[:5])
    sample = Sampler(found, task, config).make(0)
    assert sample.steps[0].goal["color"].shape[-2:] == (16, 16)
