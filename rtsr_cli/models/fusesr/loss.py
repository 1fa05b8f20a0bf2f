"""What FuseSR's networks are held against."""

from __future__ import annotations

from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.lighting.lighting import build_lighting_goal, lighting_loss
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.models.fusesr.config import FuseSRConfig
from rtsr_cli.models.fusesr.inputs import surroundings_of


def goal(config: FuseSRConfig, window: FrameWindow, reference: Frame) -> Tensors:
    """What the capture's lighting is."""
    return build_lighting_goal(surroundings_of(config), window, reference)


def loss(config: FuseSRConfig, inputs: Tensors, outputs: Tensors, target: Tensors) -> Tensors:
    """Weighted terms of `lighting_loss`."""
    surroundings = surroundings_of(config)
    weights = surroundings.loss or config.loss
    predicted = outputs["predicted"]
    return lighting_loss(surroundings, weights, predicted, inputs=inputs, goal=target)
