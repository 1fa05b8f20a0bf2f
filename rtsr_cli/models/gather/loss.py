"""What `gather` is held against: the picture, after c / (1 + c)."""

from __future__ import annotations

from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.lighting.lighting import LOG_LIGHTING, build_lighting_goal, lighting_loss
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.models.gather.config import GatherConfig


def goal(config: GatherConfig, window: FrameWindow, reference: Frame) -> Tensors:
    """What the capture shows."""
    del config
    return build_lighting_goal(LOG_LIGHTING, window, reference)


def loss(config: GatherConfig, inputs: Tensors, outputs: Tensors, target: Tensors) -> Tensors:
    """Weighted terms of `lighting_loss`."""
    return lighting_loss(LOG_LIGHTING, config.loss, outputs["encoded"], inputs=inputs, goal=target)
