"""Judging a network on whole frames of sequences that it is not trained on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import nn

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.color import encode_reinhard, encode_srgb
from rtsr_cli.core.imaging.resampling import upsample_nearest
from rtsr_cli.core.metrics.fidelity import psnr
from rtsr_cli.core.metrics.flip import ldr_flip
from rtsr_cli.core.metrics.ssim import ssim
from rtsr_cli.core.shapes import Color, Image
from rtsr_cli.core.system import (
    IMAGE_PROTOCOL,
    FrameJudge,
    FrameWindow,
    Prediction,
    State,
    System,
)
from rtsr_cli.core.training.clips import Clip
from rtsr_cli.core.training.sample_steps import build_whole_window
from rtsr_cli.core.training.samples import SampleTask

BORDER_PX = 16
"""Border that is not judged."""

OUTPUT = "output"
"""Panel of the prediction."""


@dataclass(frozen=True)
class JudgedSample:
    """One frame: its clip and position, its scores, and pictures of what was predicted."""

    clip: Clip
    position: int
    scores: Mapping[str, float]
    panels: Mapping[str, Color]


def choose_validation_frames(clips: Sequence[Clip], count: int) -> list[tuple[Clip, int]]:
    """Up to `count` frames, spread over the validation clips; later ones first have history."""
    frames = [
        (clip, position)
        for clip in clips
        if clip.facts.validation
        for position in clip.target_positions
    ]
    if len(frames) <= count:
        return frames
    return [frames[(2 * i + 1) * len(frames) // (2 * count)] for i in range(count)]


def score_image(
    config: Any, window: FrameWindow, prediction: Prediction, reference: Frame
) -> dict[str, float]:
    """PSNR after c / (1 + c), SSIM and FLIP after sRGB on top, border left out."""
    del config, window
    image, truth_color = _require_image(prediction), reference.gbuffer[Buffer.COLOR]
    tested, truth = (encode_reinhard(cut_border(i)) for i in (image, truth_color))
    shown, wanted = encode_srgb(tested), encode_srgb(truth)
    return {
        "psnr": float(psnr(tested, truth)),
        "ssim": float(ssim(shown, wanted)),
        "flip": float(ldr_flip(shown, wanted).mean()),
    }


def draw_image_panels(
    config: Any, window: FrameWindow, prediction: Prediction, reference: Frame
) -> dict[str, Color]:
    """LR, output and reference."""
    del config
    lr = upsample_nearest(window.current.gbuffer[Buffer.COLOR].cpu(), window.scale)
    color = reference.gbuffer[Buffer.COLOR]
    return {"LR": lr, OUTPUT: _require_image(prediction), "reference": color}


def _require_image(prediction: Prediction) -> Color:
    if prediction.image is None:
        raise AssertionError("a system without pictures declares its judge")
    return prediction.image.float().cpu()


IMAGE_JUDGE = FrameJudge(
    names=("psnr", "ssim", "flip"),
    scores=score_image,
    panels=draw_image_panels,
    protocol=IMAGE_PROTOCOL,
)


def choose_judge(task: SampleTask) -> FrameJudge:
    """What judges a task's frames."""
    return task.learning.judge or IMAGE_JUDGE


def cut_border(image: Image) -> Image:
    """Cut the border off where there is an inside."""
    if min(image.shape[-2:]) <= 4 * BORDER_PX:
        return image
    return image[..., BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX]


def judge_network(
    system: System, network: nn.Module, task: SampleTask, frames: Sequence[tuple[Clip, int]]
) -> Iterator[JudgedSample]:
    """Predict frames and score them; a recurrent system replays from its clip's start, once.

    LR frames are simulated as in training, with `halton` jitter where that has any.
    """
    device = next(iter(network.parameters()), torch.empty(0)).device
    judge = choose_judge(task)
    last: tuple[Clip, int] | None = None
    state: State = None
    for clip, position in frames:
        first = 0 if system.recurrent else position
        if system.recurrent and last is not None and last[0] is clip and last[1] < position:
            first = last[1] + 1
        else:
            state = None
        with torch.inference_mode():
            for p in range(first, position + 1):
                window, reference = build_whole_window(clip, p, task)
                window = _move_window(window, device)
                prediction = system.predict(network, window, state)
                state = prediction.state
        last = clip, position
        told = (task.config, window, prediction, reference)
        yield JudgedSample(clip, position, judge.scores(*told), judge.panels(*told))


def _move_window(window: FrameWindow, device: torch.device) -> FrameWindow:
    return FrameWindow(
        lr=tuple(frame.to(device) for frame in window.lr),
        hr=window.hr and window.hr.to(device),
        scale=window.scale,
    )


def average_scores(samples: Sequence[JudgedSample]) -> dict[str, float]:
    """Mean over the frames of each sequence, then over sequences."""
    sequences: dict[str, list[Mapping[str, float]]] = {}
    for frame in samples:
        sequences.setdefault(frame.clip.facts.name, []).append(frame.scores)
    means = [
        {name: sum(s[name] for s in frames) / len(frames) for name in frames[0]}
        for frames in sequences.values()
    ]
    return {name: sum(m[name] for m in means) / len(means) for name in means[0]} if means else {}


def draw_panels(frame: JudgedSample, baseline: JudgedSample | None, side: int) -> dict[str, Color]:
    """Pictures of the crop around the frame's centre, a baseline's output before its own."""
    shown = dict(frame.panels)
    if baseline is not None:
        before = next(iter(shown))
        shown = {before: shown.pop(before), "baseline": baseline.panels[OUTPUT], **shown}
    return {name: _cut_centre(image, side) for name, image in shown.items()}


def _cut_centre(image: Image, side: int) -> Image:
    height, width = image.shape[-2:]
    top, left = max(0, (height - side) // 2), max(0, (width - side) // 2)
    return image[..., top : top + side, left : left + side]
