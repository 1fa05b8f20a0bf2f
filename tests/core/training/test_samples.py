from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from rtsr_cli.core.training.augmentation import (
    NO_AUGMENTATION,
    AlbedoSwap,
    AugmentationConfig,
    PictureTurn,
)
from rtsr_cli.core.training.clips import Clip
from rtsr_cli.core.training.sample_steps import build_steps, build_whole_window, stack_samples
from rtsr_cli.core.training.samples import (
    SampleChoices,
    SampleRegion,
    SampleTask,
    draw_choices,
    draw_region,
)

REGION = SampleRegion(position=3, top=4, left=8, size=(8, 10))


def depth_of(frame: Tensor, task: SampleTask) -> Tensor:
    """Depth among what a network sees of a frame: behind lighting, and NSRD's behind normals."""
    first = 6 if task.system.name == "nsrd" else 3
    return frame[:, first : first + 1]


def test_an_unchanged_sample_holds_the_captures_pixels(clip: Clip, task: SampleTask) -> None:
    step = build_steps(clip, REGION, SampleChoices(), task)[0]
    color = clip.hr["color"][3:4, :, 4:36, 8:48].float()
    assert torch.equal(step.goal["color"], color)
    depth = clip.hr["depth"][3:4, :, 6:36:4, 10:48:4].float()
    sky = (depth >= 65504).float()
    assert torch.allclose(depth_of(step.inputs["frame_0"], task), (1 - sky) / (1 + depth))


def test_a_sample_is_a_function_of_its_draws(clip: Clip, task: SampleTask) -> None:
    def make(seed: int) -> torch.Tensor:
        rng = np.random.default_rng(seed)
        region = draw_region(clip, (8, 8), block=4, unroll=1, rng=rng)
        choices = draw_choices(AugmentationConfig(), rng)
        return build_steps(clip, region, choices, task)[0].goal["color"]

    assert torch.equal(make(5), make(5))
    assert not torch.equal(make(5), make(6))


@pytest.mark.parametrize("mirror_x", [False, True])
@pytest.mark.parametrize("transposed", [False, True])
def test_a_turned_sample_is_the_turned_picture(
    clip: Clip, task: SampleTask, transposed: bool, mirror_x: bool
) -> None:
    turn = PictureTurn(transposed=transposed, mirror_x=mirror_x)
    plain = build_steps(clip, REGION, SampleChoices(), task)[0]
    turned = build_steps(clip, REGION, SampleChoices(turn=turn), task)[0]
    for name in ("color", "encoded", "surface_mask", "divided_mask"):
        assert torch.allclose(turned.goal[name], turn.image(plain.goal[name])), name


def test_k_grows_with_the_light_so_that_the_network_sees_the_same(
    clip: Clip, task: SampleTask
) -> None:
    plain = build_steps(clip, REGION, SampleChoices(), task)[0]
    brighter = build_steps(clip, REGION, SampleChoices(gain=(2.0, 2.0, 2.0)), task)[0]
    assert brighter.inputs["lighting_scale"].item() == pytest.approx(2.0)
    assert torch.allclose(plain.goal["encoded"], brighter.goal["encoded"], atol=1e-5)


def test_history_is_newest_first_and_stands_still_where_there_is_none(clip: Clip) -> None:
    from rtsr_cli.models import load_system

    system = load_system("fusesr")
    task = SampleTask(system=system, config=system.config(), scale=4)
    inputs = build_steps(clip, replace(REGION, position=1), SampleChoices(), task)[0].inputs
    depth = clip.hr["depth"][:, :, 6:36:4, 10:48:4].float()
    expected = torch.where(depth >= 65504, torch.zeros_like(depth), 1 / (1 + depth))
    assert torch.allclose(inputs["frame_1"][:, 3:4], expected[0:1])
    assert torch.allclose(inputs["frame_2"][:, 3:4], expected[1:2])
    assert torch.equal(inputs["motion_2"], torch.zeros_like(inputs["motion_2"]))
    motion = clip.hr["motion"][1:2, :, 6:36:4, 10:48:4].float() / 4
    assert torch.allclose(inputs["motion_1"], motion)
    screen = torch.tensor([2 / 16, 2 / 12]).view(1, 2, 1, 1)
    assert torch.allclose(inputs["motion_ndc_1"], motion * screen)


def test_filtered_radiance_is_that_of_the_whole_frame(clip: Clip, task: SampleTask) -> None:
    """A crop's filter sees around the crop: as when all of the frame is filtered."""
    choices = SampleChoices(lr_filter="blackman-harris")
    window, _ = build_whole_window(clip, 3, task, "blackman-harris")
    region = SampleRegion(position=3, top=16, left=16, size=(4, 5))
    whole = task.learning.prepare(task.config, window)["frame_0"]
    part = build_steps(clip, region, choices, task)[0].inputs["frame_0"]
    assert torch.allclose(part, whole[..., 4:8, 4:9], atol=1e-5)
    plain = build_steps(clip, region, SampleChoices(), task)[0].inputs["frame_0"]
    assert not torch.allclose(part, plain, atol=1e-2)


def test_crops_lie_inside_and_reach_every_phase(clip: Clip) -> None:
    regions = [
        draw_region(clip, (8, 8), block=4, unroll=1, rng=np.random.default_rng(i))
        for i in range(400)
    ]
    assert all(0 <= r.top <= 48 - 32 and 0 <= r.left <= 64 - 32 for r in regions)
    assert {(r.top % 4, r.left % 4) for r in regions} == {
        (y, x) for y in range(4) for x in range(4)
    }
    assert {r.position for r in regions} == {0, 1, 2, 3}


def test_crops_larger_than_the_frame_shrink_to_it(clip: Clip) -> None:
    region = draw_region(clip, (99, 99), block=4, unroll=1, rng=np.random.default_rng(0))
    assert region.size == (12, 16)
    assert (region.top, region.left) == (0, 0)


def test_real_lr_frames_are_cropped_with_their_jitter(clip: Clip, task: SampleTask) -> None:
    jitter = (0.375, -0.125)
    lr = {name: plane[:, :, 1::4, 3::4] for name, plane in clip.hr.items()}
    lr["motion"] = lr["motion"] / 4
    facts = replace(clip.facts, lr_scale=4, jitters_px=(jitter,) * 4)
    real = Clip(facts, clip.hr, lr)
    step = build_steps(
        real, SampleRegion(position=3, top=4, left=8, size=(8, 9)), SampleChoices(), task
    )[0]
    depth = clip.hr["depth"][3:4, :, 5:36:4, 11:44:4].float()
    sky = (depth >= 65504).float()
    assert torch.allclose(depth_of(step.inputs["frame_0"], task), (1 - sky) / (1 + depth))
    # sample (3, 1) of a block comes to lie at (2, 2): the goal moves by (1, -1)
    color = clip.hr["color"][3:4, :, 4:36, 8:44].float()
    assert torch.equal(step.goal["color"][..., 1:, :-1], color[..., :-1, 1:])


def test_materials_of_real_pairs_are_swapped_at_both_sizes_or_at_none(
    clip: Clip, task: SampleTask
) -> None:
    names = ("albedo", "material", "color", "depth", "normal", "motion", "emission")
    lr = {name: clip.hr[name][:, :, 2::4, 2::4] for name in names}
    real = Clip(replace(clip.facts, lr_scale=4, jitters_px=((0.125, 0.125),) * 4), clip.hr, lr)
    region = SampleRegion(position=3, top=4, left=8, size=(8, 9))
    swap = SampleChoices(swap=AlbedoSwap(permutation=(1, 2, 0), gain=(0.5, 1.0, 0.7)))
    plain = build_steps(real, region, SampleChoices(), task)[0]
    changed = build_steps(real, region, swap, task)[0]
    assert torch.equal(plain.goal["color"], changed.goal["color"])
    assert torch.equal(plain.inputs["frame_0"], changed.inputs["frame_0"])


def test_a_batch_is_its_samples(clip: Clip, task: SampleTask) -> None:
    samples = [
        build_steps(clip, replace(REGION, left=left), SampleChoices(), task) for left in (0, 8)
    ]
    batch = stack_samples(samples)
    assert len(batch) == 1
    for name, tensor in batch[0].inputs.items():
        assert torch.equal(tensor[1:], samples[1][0].inputs[name]), name


def test_no_augmentation_leaves_samples_as_captured() -> None:
    choices = [draw_choices(NO_AUGMENTATION, np.random.default_rng(i)) for i in range(20)]
    assert all(c == SampleChoices() for c in choices)
    assert math.isclose(choices[0].mean_gain, 1.0)
