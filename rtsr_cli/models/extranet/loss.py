"""What ExtraNet is held against, how samples are changed, and how frames are judged.

    L = L1 + w_hole L_hole + w_shading L_shading        on e          [ExtraNet, Section 3.4]

L_hole is the mean over holes; L_shading that of the largest tenth of the differences, an image and
channel. In place of these, or beside them, differences of radiance after c / (1 + c).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.color import encode_reinhard, encode_srgb
from rtsr_cli.core.lighting.lighting import batch_masked_mean
from rtsr_cli.core.lighting.past_lighting import carry_lighting, shade
from rtsr_cli.core.metrics.fidelity import psnr
from rtsr_cli.core.metrics.flip import ldr_flip
from rtsr_cli.core.shapes import Color, Image, Mask
from rtsr_cli.core.system import FrameWindow, Prediction, Tensors
from rtsr_cli.models.extranet.config import ExtraNetConfig
from rtsr_cli.models.extranet.inputs import (
    HISTORY_PARTS,
    LAST_MASK,
    NORMAL,
    OLDER_MASKS,
    PICTURES,
)

MAX_ENCODED = 8.0
"""Bound of e in the loss: quotients over dark materials have none."""

LEAST_GAIN = 1e-6

SHADING_SHARE = 10
"""One of so many pixels is among those of the shading loss."""

LOST = (0.15, 0.07)
"""Share of the samples without t-5, and without t-3 either, as at a start or after a cut."""

COVERED = 0.15
"""Share of the samples with a rectangle that the last rendered frame does not show."""

RECTANGLE = (0.1, 0.4)
"""Least and largest side of such a rectangle, as a share of the crop's."""


def goal(config: ExtraNetConfig, window: FrameWindow, reference: Frame) -> Tensors:
    """`color`: radiance as it was rendered."""
    del config, window
    return {"color": reference.gbuffer[Buffer.COLOR]}


def encode_goal(color: Color, inputs: Tensors) -> Image:
    """e of rendered radiance, bounded.

    e = log(1 + (radiance - emission) / gain)
    """
    quantity = (color - inputs["emission"]).clamp(min=0.0)
    return torch.log1p(quantity / inputs["gain"].clamp(min=LEAST_GAIN)).clamp(max=MAX_ENCODED)


def decode_radiance(encoded: Image, inputs: Tensors) -> Color:
    """Radiance of e."""
    return encoded.clamp(0.0, MAX_ENCODED).expm1() * inputs["gain"] + inputs["emission"]


def loss(config: ExtraNetConfig, inputs: Tensors, outputs: Tensors, target: Tensors) -> Tensors:
    """Terms of `ExtraNetLoss` that weigh anything."""
    weights, color = config.loss, target["color"]
    predicted = outputs["predicted"].float()
    difference = (predicted - encode_goal(color, inputs)).abs()
    shown = encode_reinhard(decode_radiance(predicted, inputs)) - encode_reinhard(color)
    terms: dict[str, Callable[[], Tensor]] = {
        "log": difference.mean,
        "hole": lambda: batch_masked_mean(difference, inputs["hole_mask"]),
        "shading": lambda: average_largest(difference),
        "tonemapped": lambda: shown.abs().mean(),
        "tonemapped_squared": lambda: shown.square().mean(),
    }
    weighted = {name: float(getattr(weights, name)) for name in terms}
    return {name: weight * terms[name]() for name, weight in weighted.items() if weight}


def average_largest(difference: Image) -> Tensor:
    """Mean of the largest tenth of an image's and channel's differences, over the batch."""
    pixels = difference.flatten(2)
    count = max(1, pixels.shape[2] // SHADING_SHARE)
    return pixels.topk(count, dim=2, sorted=False).values.mean()


def change(
    config: ExtraNetConfig, inputs: Tensors, target: Tensors, choices: Any, rng: Any
) -> tuple[Tensors, Tensors]:
    """Turn and relight a sample, exchange its colours; hide parts and lose older frames at times.

    e stays what it is under any exposure, as k goes along.
    """
    del config
    turned = {name: choices.turn.image(tensor) for name, tensor in inputs.items()}
    colors = rng.permutation(3).tolist()
    current, history = turned["current"].clone(), turned["history"].clone()
    current[:, NORMAL] = choices.turn.plane(Buffer.NORMAL.value, inputs["current"][:, NORMAL])
    for part in PICTURES:
        current[:, part] = current[:, part][:, colors]
    for part in HISTORY_PARTS:
        history[:, part] = history[:, part][:, colors]
    older, oldest = (rng.random() < share for share in LOST[::-1])
    if older or oldest:
        history[:, : 8 if older else 4] = 0.0
    covered = turned["hole_mask"].clone()
    if rng.random() < COVERED:
        cover_rectangle(current, history, covered, rng)
    exposure = choices.mean_gain
    lights = {name: turned[name][:, colors] * exposure for name in ("gain", "emission")}
    color = choices.turn.image(target["color"])[:, colors] * exposure
    seen = {"current": current, "history": history, "hole_mask": covered}
    return {**turned, **lights, **seen}, {"color": color}


def cover_rectangle(current: Image, history: Image, holes: Mask, rng: Any) -> None:
    """Hide a rectangle of the last rendered frame, in place, as if something had stood before it.

    What came of that frame becomes its mean there, the least that a fill can tell; where older
    frames show the surface they still do.
    """
    frame = holes.shape[-2:]
    sides = [max(1, round(extent * rng.uniform(*RECTANGLE))) for extent in frame]
    starts = [int(rng.integers(0, e - side + 1)) for e, side in zip(frame, sides, strict=True)]
    rows, columns = (slice(a, a + side) for a, side in zip(starts, sides, strict=True))
    now, past, covered = (tensor[..., rows, columns] for tensor in (current, history, holes))
    base, second, known, second_known = (now[:, part] for part in PICTURES)
    unseen = past[:, OLDER_MASKS].amax(dim=1, keepdim=True) < 0.5
    mean = base.mean(dim=(-2, -1), keepdim=True)
    second.copy_(torch.where(unseen, mean, second))
    second_known.copy_(torch.where(unseen, 0.0, second_known))
    for picture in (base, past[:, HISTORY_PARTS[-1]]):
        picture.copy_(mean.expand_as(picture))
    known.zero_()
    past[:, LAST_MASK].zero_()
    covered.fill_(1.0)


def scores(
    config: ExtraNetConfig, window: FrameWindow, prediction: Prediction, reference: Frame
) -> dict[str, float]:
    """PSNR after c / (1 + c) over all pixels, and over holes; FLIP after sRGB on top."""
    del config
    image, color = _require_image(prediction), reference.gbuffer[Buffer.COLOR].cpu()
    tested, truth = encode_reinhard(image), encode_reinhard(color)
    squared = (tested - truth).square().mean(1, keepdim=True)
    del window
    holes = prediction.debug["hole"].cpu()
    error = float((squared * holes).sum() / holes.sum().clamp(min=1.0))
    flip = ldr_flip(encode_srgb(tested), encode_srgb(truth))
    return {
        "psnr": float(psnr(tested, truth)),
        "hole_psnr": float(-10.0 * torch.log10(torch.tensor(error).clamp(min=1e-10))),
        "flip": float(flip.mean()),
    }


def panels(
    config: ExtraNetConfig, window: FrameWindow, prediction: Prediction, reference: Frame
) -> dict[str, Color]:
    """The last rendered frame, what the network corrects, its output, and the truth."""
    del config
    past = carry_lighting(window)
    return {
        "rendered": past.rendered.gbuffer[Buffer.COLOR].cpu(),
        "base": shade(window, past, past.filled).cpu(),
        "output": _require_image(prediction),
        "reference": reference.gbuffer[Buffer.COLOR].cpu(),
    }


def _require_image(prediction: Prediction) -> Color:
    if prediction.image is None:
        raise AssertionError("ExtraNet predicts pictures")
    return prediction.image.float().cpu()
