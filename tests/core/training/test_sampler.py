"""Samples: batches of one size, whatever the frames' shapes; what goals see of several frames."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.system import FrameWindow
from rtsr_cli.core.training.augmentation import NO_AUGMENTATION
from rtsr_cli.core.training.clips import Clip
from rtsr_cli.core.training.config import TrainingConfig
from rtsr_cli.core.training.run_settings import resolve_sources
from rtsr_cli.core.training.sample_steps import SampleStep, stack_samples
from rtsr_cli.core.training.sampler import SampleDrawer, choose_crop, describe_crop
from rtsr_cli.core.training.samples import SampleTask, make_task
from rtsr_cli.models import list_trainable_names, load_system

CONFIG = TrainingConfig()


def cut(clip: Clip, height: int, width: int) -> Clip:
    """The top left corner of every frame."""

    def corner(plane: Tensor) -> Tensor:
        return plane[..., :height, :width]

    facts = replace(clip.facts, display=(height, width))
    return Clip(facts, {name: corner(plane) for name, plane in clip.hr.items()})


def lengthen(clip: Clip, frames: int) -> Clip:
    """The same frames over and over, as many as asked."""
    order = [i % len(clip.facts.numbers) for i in range(max(frames, len(clip.facts.numbers)))]
    scales = tuple(clip.facts.lighting_scales[i] for i in order)
    numbers = tuple(range(1, len(order) + 1))
    facts = replace(clip.facts, numbers=numbers, lighting_scales=scales)
    return Clip(facts, {name: plane[order] for name, plane in clip.hr.items()})


@pytest.fixture
def fast() -> SampleTask:
    return make_task(load_system("fusesr-fast"), load_system("fusesr-fast").config(), CONFIG)


@pytest.mark.parametrize("name", list_trainable_names())
def test_the_defaults_of_every_system_take_frames_of_any_shape(clip: Clip, name: str) -> None:
    settings = resolve_sources(load_system(name), [])
    task = make_task(settings.system, settings.network, settings.training)
    half = 0.5 + 0 * clip.hr["depth"]
    seen = {**clip.hr, "view_normal": clip.hr["normal"], "roughness": half, "metallic": half}
    whole = lengthen(replace(clip, hr=seen), task.learning.unroll)
    clips = [whole, cut(whole, 48, 36), cut(whole, 32, 64)]
    drawer = SampleDrawer(clips, task, replace(settings.training, seed=5))
    samples = [drawer.make(i) for i in range(6)]
    assert len({sample.region.size for sample in samples}) == 1
    batch = stack_samples([sample.steps for sample in samples])
    assert all(len(t) == 6 for step in batch for t in (*step.inputs.values(), *step.goal.values()))


def test_goals_see_all_samples_of_a_frame_and_of_the_one_before(clip: Clip) -> None:
    """The first frame of a sample has none before it, whatever the clip holds."""
    settings = resolve_sources(load_system("cgts"), [])
    task = make_task(settings.system, settings.network, settings.training)
    seen: list[tuple[int, ...]] = []

    def goal(config: object, window: FrameWindow, reference: Frame) -> dict[str, Tensor]:
        del config
        height, width = reference.size
        assert all(c.size == (2 * height, 2 * width) for c in window.captures)
        assert window.captures[0].number == window.current.number
        seen.append(tuple(c.number for c in window.captures))
        return {"color": reference.gbuffer[Buffer.COLOR]}

    learning = replace(task.learning, goal=goal)
    task = replace(task, system=replace(task.system, learning=learning))
    clips = [lengthen(clip, learning.unroll)]
    SampleDrawer(clips, task, replace(settings.training, seed=5)).make(0)
    first = seen[0][0]
    later = [(n, n - 1) for n in range(first + 1, first + learning.unroll)]
    assert seen == [(first,), *later]


def test_samples_that_may_be_turned_are_square_and_fit_all_frames(
    clip: Clip, fast: SampleTask
) -> None:
    clips = [clip, cut(clip, 40, 64)]
    assert choose_crop(clips, fast, CONFIG) == (10, 10)
    upright = replace(CONFIG, augmentation=NO_AUGMENTATION)
    assert choose_crop(clips, fast, upright) == (10, 16)
    assert choose_crop(clips, fast, replace(CONFIG, crop=8)) == (8, 8)
    assert choose_crop(clips, fast, replace(CONFIG, batch=1)) == (64, 64)


def test_what_is_only_judged_on_shrinks_no_sample(clip: Clip, fast: SampleTask) -> None:
    small = cut(clip, 16, 16)
    judged = replace(small, facts=replace(small.facts, validation=True))
    assert choose_crop([clip, judged], fast, CONFIG) == (12, 12)


def test_smaller_crops_are_said_in_output_pixels(clip: Clip, fast: SampleTask) -> None:
    assert "crops shrink to 48 x 48 pixels" in describe_crop([clip], fast, CONFIG)
    assert describe_crop([clip], fast, replace(CONFIG, crop=12)) == ""
    alone = describe_crop([clip, cut(clip, 40, 64)], fast, replace(CONFIG, batch=1))
    assert "64 x 40 or 64 x 48 pixels" in alone


def test_some_samples_show_one_frame_with_its_samples_jittered(clip: Clip) -> None:
    """All do at a share of 1; none at 0, and the others are what they are without any."""
    settings = resolve_sources(load_system("cgts"), [])
    task = make_task(settings.system, settings.network, settings.training)
    long = lengthen(clip, task.learning.unroll)

    def draw(share: float) -> list[SampleStep]:
        augmentation = replace(NO_AUGMENTATION, still_share=share)
        config = replace(settings.training, augmentation=augmentation, crop=16, batch=1)
        return SampleDrawer([long], task, config).make(3).steps

    still, moving = draw(1.0), draw(0.0)
    assert all(torch.equal(step.goal["color"], still[0].goal["color"]) for step in still)
    assert not any(bool(step.inputs["motion"].any()) for step in still)
    assert not torch.equal(still[1].inputs["color"], still[0].inputs["color"])
    assert not torch.equal(moving[1].goal["color"], moving[0].goal["color"])
    assert torch.equal(moving[0].goal["color"], still[0].goal["color"])
