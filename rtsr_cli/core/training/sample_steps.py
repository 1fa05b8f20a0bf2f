"""Training samples: from crops of a clip to what a network sees and is held against.

Sample `i` of a run is a function of the run's seed and `i` alone, whatever thread makes it, so that
a run that was cut off goes on with exactly the samples it would have seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from rtsr_cli.core.choices import JitterMode
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.pairs.window import join_window
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.core.training.clips import Clip
from rtsr_cli.core.training.config import SampleJitter
from rtsr_cli.core.training.crop_frames import (
    Cut,
    cut_hr,
    make_capture,
    make_hr_frame,
    make_lr_frame,
    make_reference,
    plan_cut,
)
from rtsr_cli.core.training.samples import (
    SampleChoices,
    SampleRegion,
    SampleTask,
    choose_block,
    cover_frame,
)


@dataclass(frozen=True)
class SampleStep:
    """One frame of a sample: what the network gets, and what it is held against."""

    inputs: Tensors
    goal: Tensors


def build_steps(
    clip: Clip,
    region: SampleRegion,
    choices: SampleChoices,
    task: SampleTask,
    goals: Sequence[Tensors] | None = None,
) -> list[SampleStep]:
    """Make the steps of a sample: `unroll` successive targets, each with its history.

    What came before the first target is unknown to all of them but as its history. `goals` are
    those of the same sample, if it was made before.
    """
    learning, config = task.learning, task.config
    cut = plan_cut(clip, region, choices, task)
    last = min(region.position + learning.unroll, len(clip.facts.numbers))
    positions = range(region.position, last)
    frames = _make_lr_frames(cut, positions, task)
    captures: tuple[Frame, ...] = ()
    steps = []
    for i, position in enumerate(positions):
        planes = cut_hr(cut, position, goal=goals is None)
        window = _make_window(cut, planes, position, frames, task)
        if goals is None:
            if learning.samples:
                captures = (make_capture(cut, planes, position), *captures[:1])
            seen = replace(window, captures=captures)
            goal = learning.goal(config, seen, make_reference(cut, planes, position))
        else:
            goal = goals[i]
        steps.append(SampleStep(learning.prepare(config, window), goal))
    return steps


def build_whole_window(
    clip: Clip, position: int, task: SampleTask, lr_filter: str = "none"
) -> tuple[FrameWindow, Frame]:
    """Window and reference of a whole frame as captured: the window is the one `upscale` sees.

    LR frames are simulated as training simulates them, but jittered by their numbers, as `upscale
    --jitter halton` does, where training's jitter is anything but `none`.
    """
    jitter = JitterMode.NONE if task.jitter is SampleJitter.NONE else JitterMode.HALTON
    region = cover_frame(clip, position, choose_block(clip, task))
    cut = plan_cut(clip, region, SampleChoices(lr_filter=lr_filter, jitter=jitter), task)
    planes = cut_hr(cut, position, goal=True)
    frames = _make_lr_frames(cut, range(position, position + 1), task)
    return _make_window(cut, planes, position, frames, task), make_reference(cut, planes, position)


def _make_lr_frames(cut: Cut, positions: range, task: SampleTask) -> dict[int, Frame]:
    """LR frames by position, each made once: of the targets, and those before them."""
    first = max(0, positions.start - task.system.history_frames)
    return {position: make_lr_frame(cut, position) for position in range(first, positions.stop)}


def _make_window(
    cut: Cut, planes: Tensors, position: int, frames: Mapping[int, Frame], task: SampleTask
) -> FrameWindow:
    """Window of a target; a clip is one unbroken run."""
    newest_first = (frames[p] for p in range(position, -1, -1) if p in frames)
    hr = make_hr_frame(cut, planes, position)
    return join_window(newest_first, hr, scale=task.scale, history=task.system.history_frames)


def stack_samples(samples: Sequence[Sequence[SampleStep]]) -> list[SampleStep]:
    """Make a batch: step by step, tensor by tensor."""
    length = min(len(steps) for steps in samples)
    return [
        SampleStep(
            _stack_tensors([steps[i].inputs for steps in samples]),
            _stack_tensors([steps[i].goal for steps in samples]),
        )
        for i in range(length)
    ]


def _stack_tensors(parts: Sequence[Tensors]) -> dict[str, Tensor]:
    return {name: torch.cat([part[name] for part in parts]) for name in parts[0]}


def move_step(
    step: SampleStep, device: torch.device, memory_format: torch.memory_format
) -> SampleStep:
    """Bring a step to the device that trains."""
    return replace(
        step,
        inputs=_move_tensors(step.inputs, device, memory_format),
        goal=_move_tensors(step.goal, device),
    )


def _move_tensors(
    tensors: Tensors,
    device: torch.device,
    memory_format: torch.memory_format = torch.preserve_format,
) -> dict[str, Tensor]:
    return {
        name: tensor.to(device, non_blocking=True, memory_format=memory_format)
        for name, tensor in tensors.items()
    }
