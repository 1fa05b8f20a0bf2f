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

from collections.abc import Iterator

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
from rtsr_cli.core.shapes import Image, Plane, Vector3
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.models.gather.config import GatherConfig

LR_CHANNELS, HR_CHANNELS = 15, 19

ROUGHNESS = 0.5
"""What stands where there is no such buffer."""

FASTEST_PX = 8.0
"""Motion beyond which nothing more is told of it."""

STRIP_ROWS = 8
"""LR rows that a thread describes at once, so that what it reads and writes stays in its cache."""

BUMP_ROWS = 32
"""HR rows that a thread measures the bumps of at once."""

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
    across, down = _find_places(inputs)
    return {
        **{name: inputs[name] for name in ("mask", "depth", "roughness", "material")},
        **{"motion": move_grid(inputs["motion"], inputs), "history": history, "worth": worth},
        **{"own": own, "fit": fit, "change": frame.change, "seen": frame.seen},
        **{"bump": _measure_bumps(inputs["normal"]), "across": across, "down": down},
    }


def see_pixels(images: Tensors) -> Image:
    """The HR channels of `list_seen`, made in strips."""
    fit = images["fit"]
    seen = fit.new_empty(len(fit), HR_CHANNELS, *fit.shape[2:])
    fill_in_strips(lambda strip, _: describe_pixels(strip), images, seen, rows=STRIP_ROWS)
    return seen


def describe_pixels(images: Tensors) -> Image:
    """The HR channels of some rows of `list_seen`, each put where it belongs while it is cached."""
    fit = images["fit"]
    seen = fit.new_empty(len(fit), HR_CHANNELS, *fit.shape[2:])
    for channel, plane in zip(seen.chunk(HR_CHANNELS, dim=1), _list_planes(images), strict=True):
        channel.copy_(plane)
    return seen


def _list_planes(images: Tensors) -> Iterator[Plane]:
    """The HR channels, one behind the other."""
    fit, own, change, worth = (images[name] for name in ("fit", "own", "change", "worth"))
    there = torch.gt(worth, LEAST_SHOWN_WORTH, out=torch.empty_like(worth))
    yield fit
    yield fit.add(1e-3).log_().div_(4.0)
    yield worth.log1p().div_(2.0)
    yield there
    yield _average(change)
    yield _average(change.square()).sqrt_()
    difference = (images["history"] - own).mul_(there)
    yield _average(difference)
    yield difference.abs_().amax(1, keepdim=True)
    yield _average(own)
    yield _average(images["history"]).mul_(there)
    yield images["bump"]
    yield images["roughness"]
    yield _average(images["material"]).add_(1e-2).log_().div_(4.0)
    yield inverse_depth(images["depth"])
    motion = images["motion"]
    speed = motion.abs().amax(1, keepdim=True)
    yield speed.clamp_(max=FASTEST_PX).div_(FASTEST_PX).nan_to_num_()
    fraction = motion.frac().abs_()
    yield (
        fraction.addcmul_(fraction, fraction, value=-1.0)
        .sum(1, keepdim=True)
        .mul_(2.0)
        .nan_to_num_()
    )
    yield images["seen"]
    yield images["across"]
    yield images["down"]


def _average(image: Image) -> Plane:
    """Mean over the channels."""
    return image.sum(1, keepdim=True).div_(image.shape[1])


def _measure_bumps(normal: Vector3) -> Plane:
    """10 (1 - |mean of 3 x 3 normals|)."""
    bumps = torch.empty_like(normal[:, :1])

    def measure(strip: Tensors, inner: slice) -> Plane:
        mean = mean_3x3(strip["normal"])[:, :, inner]
        return _average(mean.square_()).mul_(3.0).sqrt_().sub_(1.0).mul_(-10.0)

    fill_in_strips(measure, {"normal": normal}, bumps, rows=BUMP_ROWS, halo=1)
    return bumps


def _find_places(inputs: Tensors) -> tuple[Plane, Plane]:
    """x and y of pixels minus those of their blocks' samples, LR pixels."""
    depth = inputs["depth"]
    height, width = depth.shape[2:]
    scale = height // inputs["mask"].shape[2]
    inside = (torch.arange(scale).to(depth) - scale // 2) / scale
    x, y = (inside.expand(side // scale, scale).reshape(side) for side in (width, height))
    return x.view(1, 1, 1, width).expand_as(depth), y.view(1, 1, height, 1).expand_as(depth)
