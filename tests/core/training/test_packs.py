from __future__ import annotations

from pathlib import Path

import pytest
import torch

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.training.clips import read_clips
from rtsr_cli.core.training.config import TrainingConfig
from rtsr_cli.core.training.packs import cut_clip, pack_crops
from rtsr_cli.core.training.sample_steps import build_steps
from rtsr_cli.core.training.sampler import SampleDrawer
from rtsr_cli.core.training.samples import SampleChoices, SampleRegion, SampleTask
from rtsr_cli.models import load_system
from tests.core.training.conftest import make_clip


def test_a_cut_clip_gives_the_same_samples(task: SampleTask) -> None:
    clip = make_clip()
    packed = cut_clip(clip, SampleRegion(position=3, top=8, left=4, size=(8, 10)), 4, 2, 1)
    whole = build_steps(
        clip, SampleRegion(position=3, top=12, left=8, size=(4, 4)), SampleChoices(), task
    )
    inner = SampleRegion(position=packed.facts.targets, top=4, left=4, size=(4, 4))
    again = build_steps(packed, inner, SampleChoices(), task)
    for name, tensor in whole[0].inputs.items():
        assert torch.equal(tensor, again[0].inputs[name]), name
    assert packed.facts.numbers == (2, 3, 4)
    assert (packed.facts.top, packed.facts.left) == (8, 4)


def test_a_pack_trains_and_validates_alone(tmp_path: Path, task: SampleTask) -> None:
    clips = [make_clip(), make_clip(name="v/w", validation=True)]
    config = TrainingConfig(crop=4, validation_frames=2)
    path = tmp_path / "p.rtsr-clips"
    assert pack_crops(path, clips, task, config, crops=5) == 7
    found, about = read_clips(path)
    assert about["system"] == task.system.name
    assert [c.facts.validation for c in found] == [False] * 5 + [True] * 2
    assert all(c.size == (20, 20) for c in found[:5])
    sample = SampleDrawer(found, task, config).make(0)
    assert sample.steps[0].goal["color"].shape[-2:] == (16, 16)


def test_clips_too_short_for_a_sample_are_left_out_or_refused() -> None:
    system = load_system("nsrd")
    task = SampleTask(system=system, config=system.config(), scale=4)
    config = TrainingConfig(crop=4)
    short, long = make_clip(frames=3, name="a/short"), make_clip(frames=4, name="a/long")
    sampler = SampleDrawer([short, long], task, config)
    assert {sampler.make(i).clip.facts.name for i in range(8)} == {"a/long"}
    with pytest.raises(FrameFolderError, match="4 successive frames"):
        SampleDrawer([short], task, config)
