"""Past frames as log lighting, in the order that the network takes them: oldest first."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.frame_motion import exposure_ratio
from rtsr_cli.core.lighting.lighting import encode_lighting
from rtsr_cli.core.lighting.past_lighting import take_emission_out
from rtsr_cli.core.shapes import Image, Mask
from rtsr_cli.models.extranet.config import PLACES


def encode_past(frame: Frame, rendered: Frame, scale: Tensor) -> Image:
    """e = log(1 + q / k) of a past frame, at the exposure of the last rendered one.

    Args:
        frame: whose lighting it is, or radiance where nothing is divided.
        rendered: the last rendered frame.
        scale: k of it.
    """
    divided = frame.gbuffer[Buffer.LIGHTING_MASK] > 0.5
    quantity = torch.where(divided, frame.gbuffer[Buffer.LIGHTING], take_emission_out(frame))
    return encode_lighting(quantity * exposure_ratio(rendered, frame), scale)


def make_empty(now: Frame) -> tuple[Image, Mask]:
    """e and mask of a frame that is not there."""
    mask = torch.zeros_like(now.gbuffer[Buffer.DEPTH])
    return mask.expand(-1, 3, -1, -1), mask


def order_history(
    moved: Sequence[tuple[Image, Mask]], now: Frame
) -> tuple[tuple[Image, Mask], ...]:
    """Newest first, as far as there are -> oldest first, all of them."""
    missing = [make_empty(now)] * (len(PLACES) - len(moved))
    return (*missing, *reversed(moved))
