"""The publication's surroundings, where `rtsr` departs from them.

Colour is enlarged by the cubic kernel, and every pixel of it counts alike, sampled or not; the
composition network sees 14 channels and gives the weight itself.
"""

from __future__ import annotations

import torch

from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.auxiliary_buffers import enlarge_motion
from rtsr_cli.core.imaging.resampling import KEYS_A
from rtsr_cli.core.imaging.sample_splats import (
    encode_samples,
    find_brightest,
    interpolate_samples,
)
from rtsr_cli.core.shapes import Color, Image, Plane
from rtsr_cli.core.system import Tensors
from rtsr_cli.models.cgts.config import CgtsSurroundings


def enlarge_bicubic(frame: Frame, scale: int) -> tuple[Color, Plane]:
    """Un-jittered cubic enlargement."""
    color = encode_samples(frame)
    enlarged = interpolate_samples(
        color, frame.camera.jitter_px, scale, a=KEYS_A, brightest=find_brightest(color)
    )
    return enlarged, torch.ones_like(enlarged[:, :1])


def see_nothing(known: Tensors) -> Image:
    """No channels beside the published ones."""
    return known["history"][:, :0]


def start_from_nothing(worth: Plane, history_worth: Plane) -> Plane:
    """0: the network gives the logit."""
    del history_worth
    return torch.zeros_like(worth)


PUBLISHED = CgtsSurroundings(
    enlarge=enlarge_bicubic,
    move=enlarge_motion,
    signals=0,
    see=see_nothing,
    start=start_from_nothing,
    shown=0,
    show=see_nothing,
    guides=False,
)
