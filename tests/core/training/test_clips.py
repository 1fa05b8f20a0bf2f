from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.training.clips import Clip, hold_frame, read_clips, write_clips


def test_clips_are_read_back_as_they_were_written(tmp_path: Path, clip: Clip) -> None:
    facts = replace(clip.facts, jitters_px=((0.25, -0.5),) * 4, targets=2, name="x/y", group=3)
    planes = {name: plane.clone() for name, plane in clip.hr.items()}
    other = Clip(facts, planes, {"color": torch.rand(4, 3, 12, 16).half()})
    path = tmp_path / "two.rtsr-clips"
    write_clips(path, [clip, other], {"scale": 4})
    found, about = read_clips(path)
    assert about == {"scale": 4}
    assert [c.facts for c in found] == [clip.facts, facts]
    for before, after in zip([clip, other], found, strict=True):
        assert before.hr.keys() == after.hr.keys()
        assert all(torch.equal(before.hr[n], after.hr[n]) for n in before.hr)
    assert torch.equal(found[1].lr["color"], other.lr["color"])
    assert found[1].target_positions == range(2, 4)


def test_another_file_is_no_file_of_clips(tmp_path: Path) -> None:
    path = tmp_path / "weights.safetensors"
    save_file({"a": torch.zeros(1)}, path)
    with pytest.raises(FrameFolderError, match="no packed clips"):
        read_clips(path)


def test_a_damaged_file_is_named(tmp_path: Path, clip: Clip) -> None:
    path = tmp_path / "cut.rtsr-clips"
    write_clips(path, [clip], {})
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(FrameFolderError, match=r"cut\.rtsr-clips: cannot be read"):
        read_clips(path)


def test_a_held_frame_is_shown_at_all_moments_and_nothing_moves(clip: Clip) -> None:
    scales = tuple(float(i + 1) for i in range(len(clip.facts.numbers)))
    moving = {**clip.hr, "motion": torch.ones_like(clip.hr["motion"])}
    held = hold_frame(Clip(replace(clip.facts, lighting_scales=scales), moving), 1)
    assert held.facts.numbers == clip.facts.numbers
    assert held.facts.lighting_scales == (2.0,) * len(scales)
    assert not held.hr["motion"].any()
    for name in clip.hr.keys() - {"motion"}:
        assert held.hr[name].shape == clip.hr[name].shape
        assert all(torch.equal(frame, clip.hr[name][1]) for frame in held.hr[name])
