"""What classifier guided supersampling is held against.

    L = w_g CE(ghosting) + w_a CE(aliasing)
      + w_c mean(p sqrt(|o - r|^2 + e^2)) + w_s mean(|o - r|^2) + w_t mean(q |(a - a') - (r - r')|)

o is the output and r the reference, the mean of all samples of a pixel, both c / (1 + c); a is what
is accumulated, a' and r' are of the frame before along the motion, p weighs pixels by their class,
q is 1 where nothing ghosts. The publication's losses are not known; these are ours.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.color import encode_reinhard
from rtsr_cli.core.imaging.frame_motion import exposure_ratio
from rtsr_cli.core.imaging.pixel_classes import Aliasing, Ghosting, classify_pixels
from rtsr_cli.core.imaging.resampling import box_mean
from rtsr_cli.core.imaging.warping import backward_warp
from rtsr_cli.core.lighting.lighting import batch_masked_mean
from rtsr_cli.core.shapes import Image, Plane
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.models.cgts.config import CLASSES, LEANING, CgtsConfig, CgtsLoss, Stage
from rtsr_cli.models.cgts.inputs import find_motion

GHOSTING_ORDER = (Ghosting.VISIBILITY, Ghosting.SHADING, Ghosting.NONE)
ALIASING_ORDER = (Aliasing.GEOMETRY, Aliasing.TEXTURE, Aliasing.NONE)
"""Order of the logits, and numbers of the labels."""

SOFTNESS = 1e-3
"""e of the loss."""


def goal(config: CgtsConfig, window: FrameWindow, reference: Frame) -> Tensors:
    """`color`, and `before` of the frame before along the motion; `ghosting`, `aliasing` classes.

    Where the frame before is unknown all is visibility ghosting, and `before` is the frame.
    """
    captures = window.captures
    k = captures[0].size[0] // reference.size[0]
    classes = classify_pixels(captures, k, config.labels)
    color = before = encode_reinhard(reference.gbuffer[Buffer.COLOR])
    if len(captures) > 1:
        radiance = box_mean(captures[1].gbuffer[Buffer.COLOR], k)
        ratio = exposure_ratio(captures[0], captures[1])
        before, _ = backward_warp(encode_reinhard(radiance * ratio), find_motion(config, window))
    return {
        "color": color,
        "before": before,
        "ghosting": classes.ghosting,
        "aliasing": classes.aliasing,
    }


def loss(config: CgtsConfig, inputs: Tensors, outputs: Tensors, target: Tensors) -> Tensors:
    """Terms of `CgtsLoss` that weigh anything in the stage."""
    del inputs
    weights, terms = config.loss, dict[str, Tensor]()
    kinds = {
        "ghosting": (slice(None, CLASSES), GHOSTING_ORDER),
        "aliasing": (slice(CLASSES, None), ALIASING_ORDER),
    }
    for name, (own, order) in kinds.items():
        weight = float(getattr(weights, name))
        if weight and config.stage is not Stage.COMPOSITION:
            logits, classes = outputs["logits"][:, own], number_classes(target[name], order)
            leaning = logits.new_tensor(LEANING[name]).view(1, -1, 1, 1)
            terms[name] = weight * classification_loss(logits + leaning, classes, weights.rarest)
    if config.stage is not Stage.CLASSIFIER:
        terms |= composition_loss(weights, outputs, target)
    return terms


def number_classes(labels: Plane, order: tuple[int, ...]) -> Tensor:
    """Places in the logits of the labels' numbers, n h w."""
    places = torch.empty(len(order), dtype=torch.long, device=labels.device)
    for place, number in enumerate(order):
        places[number] = place
    return places[labels[:, 0].long()]


def classification_loss(logits: Image, classes: Tensor, rarest: float) -> Tensor:
    """Cross-entropy; a class weighs by the inverse of its share in the batch, up to a bound."""
    counts = torch.bincount(classes.flatten(), minlength=CLASSES).clamp(min=1)
    weight = (classes.numel() / (CLASSES * counts)).clamp(max=rarest)
    return F.cross_entropy(logits, classes, weight=weight.to(logits.dtype))


def composition_loss(weights: CgtsLoss, outputs: Tensors, target: Tensors) -> dict[str, Tensor]:
    """Terms of the picture."""
    output, ghosting = outputs["color"].float(), target["ghosting"]
    difference = output - target["color"]
    terms: dict[str, Tensor] = {}
    if weights.color:
        pixels = torch.ones_like(ghosting)
        pixels = torch.where(ghosting == Ghosting.VISIBILITY, weights.visibility, pixels)
        pixels = torch.where(ghosting == Ghosting.SHADING, weights.shading, pixels)
        distance = (difference.square().sum(1, keepdim=True) + SOFTNESS**2).sqrt()
        terms["color"] = weights.color * (distance * pixels).sum() / pixels.sum()
    if weights.squared:
        terms["squared"] = weights.squared * difference.square().mean()
    if weights.temporal:
        kept = (ghosting == Ghosting.NONE).to(output)
        accumulated = outputs["accumulated"].float()
        change = (accumulated - outputs["history"]) - (target["color"] - target["before"])
        terms["temporal"] = weights.temporal * batch_masked_mean(change.abs(), kept)
    return terms
