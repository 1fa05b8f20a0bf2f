"""What the network sees of a frame and of its history.

LR, 15 channels:
  lighting 3, mask 1       e of the samples, 0 where nothing was divided
  normal 3, depth 1        of the samples; depth as 1 / (1 + z)
  change 3, seen 1         e less history where the sample's surface was seen before
  largest change 1, detail 1, block 1    detail: e less its mean of 3 x 3 samples; 1 / S
HR, 19 channels, on the moved grid:
  fit 1, its logarithm 1, history's worth 1, whether there is any 1
  change 2, difference 2   enlarged, mean and root of the mean square; history less the frame's own
                           lighting, mean and largest
  lighting 2               the frame's own and history's, means
  bump 1, roughness 1, material 1, depth 1
  speed 1, blur 1          of the motion: largest component; sum of f (1 - f), f its fraction
  seen 1, place 2          place: of the pixel minus the sample's, LR pixels
"""

from __future__ import annotations

import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.resampling import mean_3x3
from rtsr_cli.core.imaging.row_strips import fill_in_strips
from rtsr_cli.core.lighting.filtered_lighting import describe_filter, match_filter
from rtsr_cli.core.lighting.lighting import align_image, describe_picture, inverse_depth
from rtsr_cli.core.lighting.lighting_history import (
    CarriedLighting,
    EnlargedLighting,
    describe_window,
    move_grid,
    sample_change,
)
from rtsr_cli.core.shapes import Image
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.models.gather.config import GatherConfig

LR_CHANNELS, HR_CHANNELS = 15, 19

ROUGHNESS = 0.5
"""What stands where there is no such buffer."""

FASTEST_PX = 8.0
"""Motion beyond which nothing more is told of it."""

STRIP_ROWS = 8
"""LR rows that a thread describes at once, so that what it reads and writes stays in its cache."""

LEAST_SHOWN_WORTH = 1e-4
"""Samples that history has to be worth for the network to see it."""


def prepare(config: GatherConfig, window: FrameWindow) -> Tensors:
    """What gathering reads, what makes a picture of lighting, and roughness."""
    del config
    hr = window.require_hr().gbuffer
    roughness = hr.buffers.get(Buffer.ROUGHNESS)
    if roughness is None:
        roughness = torch.full_like(hr[Buffer.DEPTH], ROUGHNESS)
    inputs = describe_window(match_filter(window)) | describe_picture(window)
    inputs |= describe_filter(window)
    return inputs | {"roughness": align_image(window, roughness)}


def see_samples(inputs: Tensors, carried: CarriedLighting | None) -> Image:
    """The LR channels."""
    mask, encoded = inputs["mask"], inputs["encoded"]
    change, seen = torch.zeros_like(encoded), torch.zeros_like(mask)
    if carried is not None:
        change, seen = sample_change(inputs, carried)
    mean = encoded.mean(1, keepdim=True)
    block = inputs["mask"].shape[2] / inputs["depth"].shape[2]
    return torch.cat(
        [
            encoded * mask,
            mask,
            inputs["small_normal"],
            inverse_depth(inputs["small_depth"]),
            change,
            seen,
            change.abs().amax(1, keepdim=True),
            mean - mean_3x3(mean),
            torch.full_like(mask, block),
        ],
        dim=1,
    )


def list_seen(
    inputs: Tensors, carried: CarriedLighting | None, frame: EnlargedLighting
) -> dict[str, Tensor]:
    """What the HR channels are made of, by name, on the moved grid; `mask` has LR's size."""
    own, fit = frame.encoded, frame.fit
    history, worth = own, torch.zeros_like(fit)
    if carried is not None:
        history, worth = carried.encoded, carried.worth
    return {
        **{name: inputs[name] for name in ("mask", "normal", "depth", "roughness", "material")},
        **{"motion": move_grid(inputs["motion"], inputs), "history": history, "worth": worth},
        **{"own": own, "fit": fit, "change": frame.change, "seen": frame.seen},
    }


def see_pixels(images: Tensors) -> Image:
    """The HR channels of `list_seen`, made in strips."""
    fit = images["fit"]
    seen = fit.new_empty(len(fit), HR_CHANNELS, *fit.shape[2:])
    fill_in_strips(describe_pixels, images, seen, rows=STRIP_ROWS, halo=1)
    return seen


def describe_pixels(images: Tensors) -> Image:
    """The HR channels of some rows of `list_seen`."""
    fit, own, change, worth = (images[name] for name in ("fit", "own", "change", "worth"))
    there = (worth > LEAST_SHOWN_WORTH).to(worth)
    difference = (images["history"] - own) * there
    motion = images["motion"]
    fraction = motion - motion.floor()
    speed = motion.abs().amax(1, keepdim=True).clamp(max=FASTEST_PX) / FASTEST_PX
    blur = 2.0 * (fraction * (1.0 - fraction)).sum(1, keepdim=True)
    bump = 1.0 - mean_3x3(images["normal"]).square().sum(1, keepdim=True).sqrt()
    return torch.cat(
        [
            fit,
            (fit + 1e-3).log() / 4.0,
            worth.log1p() / 2.0,
            there,
            change.mean(1, keepdim=True),
            change.square().mean(1, keepdim=True).sqrt(),
            difference.mean(1, keepdim=True),
            difference.abs().amax(1, keepdim=True),
            own.mean(1, keepdim=True),
            (images["history"] * there).mean(1, keepdim=True),
            10.0 * bump,
            images["roughness"],
            (images["material"].mean(1, keepdim=True) + 1e-2).log() / 4.0,
            inverse_depth(images["depth"]),
            speed.nan_to_num(),
            blur.nan_to_num(),
            images["seen"],
            _find_places(images),
        ],
        dim=1,
    )


def _find_places(images: Tensors) -> Image:
    """(x, y) of each pixel minus that of its block's sample, LR pixels."""
    depth = images["depth"]
    count, _, height, width = depth.shape
    scale = height // images["mask"].shape[2]
    inside = (torch.arange(scale).to(depth) - scale // 2) / scale
    x = inside.repeat(width // scale).view(1, 1, 1, width).expand(count, 1, height, width)
    y = inside.repeat(height // scale).view(1, 1, height, 1).expand(count, 1, height, width)
    return torch.cat([x, y], dim=1)
