"""What NSRD's network is held against."""

from __future__ import annotations

import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.choices import SsimConvention
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.lighting.lighting import build_lighting_goal, lighting_loss
from rtsr_cli.core.metrics.ssim import ssim
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.models.nsrd.config import NSRDConfig
from rtsr_cli.models.nsrd.inputs import surroundings_of


def goal(config: NSRDConfig, window: FrameWindow, reference: Frame) -> Tensors:
    """What the capture's lighting is, as the preset expresses it."""
    return build_lighting_goal(surroundings_of(config), window, reference)


def loss(config: NSRDConfig, inputs: Tensors, outputs: Tensors, target: Tensors) -> Tensors:
    """Weighted terms of `NSRDLossWeights` that weigh anything.

    smooth L1(p, g) + (1 - SSIM(p, g)) + smooth L1(m p', m p)         [NSRD, code]

    p' is the prediction before, moved, and m where it is reliable and, where the goal says so, was
    divided; the first frame of a clip has none, and its first term is not taken twice.
    """
    surroundings, predicted = surroundings_of(config), outputs["predicted"].float()
    weights = surroundings.loss or config.loss
    terms: dict[str, Tensor] = {}
    if weights.log or weights.tonemapped or weights.tonemapped_squared or weights.radiance:
        terms |= lighting_loss(surroundings, weights, predicted, inputs=inputs, goal=target)
    wanted = target[surroundings.compared]
    if weights.smooth:
        terms["smooth"] = weights.smooth * F.smooth_l1_loss(predicted, wanted)
    if weights.structure:
        similar = ssim(predicted, wanted, SsimConvention.ZERO_PAD).mean()
        terms["structure"] = weights.structure * (1.0 - similar)
    if weights.temporal:
        previous = outputs.get("previous", predicted)
        reliable = 1.0 - inputs["unreliable_hr"]
        if "divided_mask" in target:
            reliable = reliable * target["divided_mask"]
        change = F.smooth_l1_loss(reliable * predicted, reliable * previous)
        terms["temporal"] = weights.temporal * change
    return terms
