"""Packing crops into one file, for a machine that has no EXR library or little disk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from torch import Tensor

from rtsr_cli.core.training.clips import Clip, write_clips
from rtsr_cli.core.training.config import TrainingConfig
from rtsr_cli.core.training.sampler import SampleDrawer
from rtsr_cli.core.training.samples import (
    SampleRegion,
    SampleTask,
    choose_block,
    cover_frame,
    draw_region,
)
from rtsr_cli.core.training.validation import choose_validation_frames

MARGIN = 4
"""A packed crop is larger than a sample by a share of 1 / MARGIN, so that samples can shift."""


def pack_crops(
    path: Path, clips: Sequence[Clip], task: SampleTask, config: TrainingConfig, *, crops: int
) -> int:
    """Write `crops` random crops, and whole frames for validation; return the number of clips.

    Args:
        path: of the file.
        clips: to cut from.
        task: system, config, scale.
        config: crop side, seed, frames of a validation.
        crops: to write.

    Raises:
        RtsrError: there is nothing to train on, or the file cannot be written.
    """
    sampler = SampleDrawer(clips, task, config)
    history = task.system.history_frames
    side = config.crop + config.crop // MARGIN
    packed = []
    for index in range(crops):
        rng = np.random.default_rng([config.seed, index, 1])
        clip = sampler.draw(rng)
        block, unroll = choose_block(clip, task), task.learning.unroll
        region = draw_region(clip, (side, side), block=block, unroll=unroll, rng=rng)
        if task.learning.whole is not None:
            region = cover_frame(clip, region.position, block)
        packed.append(cut_clip(clip, region, block, history, unroll))
    for clip, position in choose_validation_frames(clips, config.validation_frames):
        whole = cover_frame(clip, position, choose_block(clip, task))
        before = position if task.system.recurrent else history
        packed.append(cut_clip(clip, whole, choose_block(clip, task), before, 1))
    about = {
        "system": task.system.name,
        "scale": task.scale,
        "samples_per_pixel": task.samples_per_pixel,
        "crop": config.crop,
    }
    write_clips(path, packed, about)
    return len(packed)


def cut_clip(clip: Clip, region: SampleRegion, block: int, history: int, unroll: int) -> Clip:
    """Cut a region, `block` HR pixels per LR pixel, and the frames that a sample there needs."""
    facts = clip.facts
    first = max(0, region.position - history)
    last = min(region.position + unroll, len(facts.numbers))
    height, width = region.size
    hr = _cut_planes(
        clip.hr, (first, last), (region.top, region.left), (height * block, width * block)
    )
    lr = {}
    if facts.lr_scale:
        corner = (region.top // block, region.left // block)
        lr = _cut_planes(clip.lr, (first, last), corner, (height, width))
    return Clip(
        replace(
            facts,
            numbers=facts.numbers[first:last],
            targets=region.position - first,
            top=facts.top + region.top,
            left=facts.left + region.left,
            jitters_px=facts.jitters_px[first:last],
            lighting_scales=facts.lighting_scales[first:last],
            pre_exposures=facts.pre_exposures[first:last],
            cameras=facts.cameras[first:last],
        ),
        hr,
        lr,
    )


def _cut_planes(
    planes: Mapping[str, Tensor],
    frames: tuple[int, int],
    corner: tuple[int, int],
    size: tuple[int, int],
) -> dict[str, Tensor]:
    rows = slice(corner[0], corner[0] + size[0])
    columns = slice(corner[1], corner[1] + size[1])
    return {name: plane[slice(*frames), :, rows, columns].clone() for name, plane in planes.items()}
