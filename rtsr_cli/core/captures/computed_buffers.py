"""Buffers from the channels that they are made of."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.captures.bound_channels import BoundBuffer, BoundChannel
from rtsr_cli.core.files.exr import Plane

_Place = tuple[str, str]
"""A file sequence and a channel of it."""


def compute_buffer(
    bound: BoundBuffer, planes: Mapping[_Place, Plane], size: tuple[int, int]
) -> Tensor:
    """Return one buffer as 1 x c x h x w; whole numbers stay whole (32 bits).

    Args:
        bound: what it is made of.
        planes: the channels, by stream and name.
        size: (height, width).
    """
    stored = [planes[c.stream, c.channel] for c in bound]
    if len(stored) == 1 and not bound.is_computed and stored[0].dtype == np.uint32:
        return torch.from_numpy(stored[0].view(np.int32))[None, None]
    image = torch.empty(1, len(bound.components), *size)
    for values, component in zip(image[0], bound.components, strict=True):
        if component.is_one_channel:
            _scale_into(values, component.terms[0], planes)
            continue
        values.fill_(component.constant)
        for term in component.terms:
            values += _scale_into(torch.empty(size), term, planes)
    return image


def _scale_into(values: Tensor, channel: BoundChannel, planes: Mapping[_Place, Plane]) -> Tensor:
    """(stored - offset) * factor."""
    plane = planes[channel.stream, channel.channel]
    wide = plane.astype(np.int64) if plane.dtype == np.uint32 else plane
    values.copy_(torch.from_numpy(wide))
    return values if channel.is_plain else values.sub_(channel.offset).mul_(channel.factor)
