"""The network: how far each term of the kernel, and history, are to be believed at every pixel.

A trunk of residual blocks sees the samples and what their pixels average to; a small head sees each
pixel and its eight neighbours, and the trunk's features of the sample that the pixel's block
belongs to. Both are the same at every scale: where a pixel lies in its block is among what it sees.

    f = exp(r_1..3)           factors of distance, normal and depth in log w: `guided_kernel`
    c' = min(a c e^r_4' / (...), z c),   b' = sigmoid(logit(b) + r_5')
    r_4' = r_4 - t max(r_4, 0),   r_5' = r_5 - t min(r_5, 0),   the rest of `lighting_history`

Where samples agree on a change (t), history is worth no more, and the change no less, than without
the network, which would keep moving shadows a frame longer. r is 0 before any training: the network
is `demod-temporal` then. It is 0, too, where a pixel filter went over radiance: parting what it
mixed takes away whatever r changes, and training on that lets r grow beyond all bounds. History of
another surface is worth nothing whatever r_4 is.

Change d is enlarged with factors of 1, as in `demod-temporal`: what it adds to history comes back
in the change of frames to come, and wider kernels let that grow. For the same reason worth fades
whatever r_4 is (z): a run forgets how it began. In training, history is what the network itself
made of the frames before; no gradient flows back through it.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import cast

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from rtsr_cli.core.imaging.guided_enlargement import upsample_emphasised
from rtsr_cli.core.imaging.row_strips import fill_in_strips
from rtsr_cli.core.lighting.filtered_lighting import part_filtered
from rtsr_cli.core.lighting.lighting_history import (
    CarriedLighting,
    EnlargedLighting,
    LightingHistory,
    age_worth,
    blend_history,
    carry_history,
    describe_samples,
    enlarge_frame,
    keep_history,
)
from rtsr_cli.core.network.blocks import ResidualBlock, make_conv3
from rtsr_cli.core.network.graphs import is_replaced
from rtsr_cli.core.shapes import Color, Image, Plane
from rtsr_cli.core.system import State, Tensors
from rtsr_cli.models.gather.config import GatherConfig
from rtsr_cli.models.gather.inputs import (
    HR_CHANNELS,
    LR_CHANNELS,
    describe_pixels,
    list_seen,
    see_pixels,
    see_samples,
)

WIDTH = 32
"""Channels of the trunk."""

BLOCKS = 3

HIDDEN = 24
"""Channels of the head."""

MOST_EMPHASIS, MOST_LOGIT = 3.0, 6.0
"""Bounds of r_1..3, and of r_4."""

FRAME_PLANES = tuple(field.name for field in fields(EnlargedLighting))

BLENDED_ROWS = 32
"""Rows that a thread blends at once, so that what it reads and writes stays in its cache."""

LEAST_SHARE = 1e-6

MOST_WORTH = 16.0
"""Samples that history is worth at most."""

MOST_KEPT = 0.95
"""z, share of history's worth that a frame leaves of it at most."""

ALL_ROWS = slice(None)

STRIP_PIXELS = 3 << 14
"""HR pixels that a thread describes, and the head sees, at once: they stay in its cache."""


class Trunk(nn.Module):
    """What the samples say: n 34 h w -> n 24 h w."""

    def __init__(self) -> None:
        """Make the layers."""
        super().__init__()
        self.first = make_conv3(LR_CHANNELS + HR_CHANNELS, WIDTH)
        self.blocks = nn.Sequential(*(ResidualBlock(WIDTH) for _ in range(BLOCKS)))
        self.last = nn.Conv2d(WIDTH, HIDDEN, 1)

    def forward(self, seen: Image) -> Image:
        """Run the layers."""
        features: Image = self.last(F.relu(self.blocks(F.relu(self.first(seen)))))
        return features


class Head(nn.Module):
    """What a pixel says of it: n 19 S*h S*w and n 24 h w -> n c S*h S*w, 0 at first."""

    def __init__(self, channels: int) -> None:
        """Make the layers, the last one of zeros."""
        super().__init__()
        self.channels = channels
        self.first = make_conv3(HR_CHANNELS, HIDDEN)
        self.second = nn.Conv2d(HIDDEN, HIDDEN, 1)
        self.last = nn.Conv2d(HIDDEN, channels, 1)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(cast(Tensor, self.last.bias))

    def forward(self, pixels: Image, features: Image, rows: slice = ALL_ROWS) -> Image:
        """Run the layers for some rows of the pixels, whose features these are."""
        hidden = self.first(pixels)[:, :, rows]
        # a number, whatever stands for the sizes while a graph is traced
        scale = int(hidden.shape[2] // features.shape[2])
        said = F.interpolate(features, scale_factor=scale, mode="nearest")
        # in place: memory that is asked for anew costs more than the arithmetic
        hidden = hidden.add_(said).relu_()
        hidden = self.second(hidden).add_(hidden).relu_()
        given: Image = self.last(hidden)
        return given


class GatherNetwork(nn.Module):
    """Trunk, head, and what is made of their corrections; its state is a `LightingHistory`.

    Attributes:
        needs_values: where pixels are fetched from depends on values, not on shapes alone.
    """

    needs_values = True

    def __init__(self, config: GatherConfig, scale: int) -> None:
        """Make the layers; they are the same at every scale."""
        super().__init__()
        del scale
        self.config = config
        self.trunk = Trunk()
        self.head = Head(8 if config.residual else 5)

    def forward(self, inputs: Tensors, state: State) -> tuple[dict[str, Tensor], State]:
        """Carry history, correct how much is believed, and gather."""
        encoded, worth = self._gather_frame(inputs, cast(LightingHistory | None, state))
        with torch.autocast(inputs["depth"].device.type, enabled=False):
            encoded = part_filtered(inputs, encoded)
            history = keep_history(inputs, encoded.detach(), worth.detach().clamp(max=MOST_WORTH))
        return {"encoded": encoded, "worth": worth.detach()}, history

    def _gather_frame(self, inputs: Tensors, before: LightingHistory | None) -> tuple[Color, Plane]:
        """e' and c of a frame; what they are made of takes more memory than all that is kept."""
        with torch.no_grad(), torch.autocast(inputs["depth"].device.type, enabled=False):
            carried = None if before is None else carry_history(before, inputs)
            frame = enlarge_frame(inputs, carried)
        sharp = (inputs["filter_width"] == 0).to(inputs["depth"])
        given = self._correct(inputs, carried, frame).float().mul_(sharp)
        with torch.autocast(inputs["depth"].device.type, enabled=False):
            return self._gather(inputs, carried, frame, given)

    def _correct(
        self, inputs: Tensors, carried: CarriedLighting | None, frame: EnlargedLighting
    ) -> Image:
        """r of every pixel."""
        samples, images = see_samples(inputs, carried), list_seen(inputs, carried, frame)
        if self.training or is_replaced(self, "correct"):
            tensors = {"samples": samples, "pixels": see_pixels(images)}
            return self.correct(tensors)["corrections"]
        return self._correct_in_strips(samples, images)

    def _correct_in_strips(self, samples: Image, images: Tensors) -> Image:
        """`correct` of pixels that are described strip by strip: all of them take 76 bytes each."""
        count, _, height, width = samples.shape
        small = samples.new_empty(count, HR_CHANNELS, height, width)
        size = images["fit"].shape[2:]
        rows = max(2, STRIP_PIXELS * height // size.numel())
        fill_in_strips(
            lambda strip, _: average_blocks(describe_pixels(strip), strip["mask"]),
            images,
            small,
            rows=rows,
        )
        seen = {**images, "features": self.trunk(torch.cat([samples, small], dim=1))}
        given = samples.new_empty(count, self.head.channels, *size)
        fill_in_strips(
            lambda strip, inner: self._run_head(describe_pixels(strip), strip["features"], inner),
            seen,
            given,
            rows=rows,
            halo=1,
        )
        return given

    def correct(self, tensors: Tensors) -> Tensors:
        """`samples` 15 h w, `pixels` 19 S*h S*w -> `corrections`, r of every pixel: a graph."""
        samples, pixels = tensors["samples"], tensors["pixels"]
        small = average_blocks(pixels, samples)
        features = self.trunk(torch.cat([samples, small], dim=1))
        return {"corrections": self._run_head(pixels, features)}

    def _run_head(self, pixels: Image, features: Image, rows: slice = ALL_ROWS) -> Image:
        given: Image = self.head(pixels, features, rows)
        return given

    def _gather(
        self,
        inputs: Tensors,
        carried: CarriedLighting | None,
        frame: EnlargedLighting,
        given: Image,
    ) -> tuple[Color, Plane]:
        """e' and c."""
        images = {name: getattr(frame, name) for name in FRAME_PLANES} | {"given": given}
        if self.config.kernel:
            emphasis = given[:, :3].clamp(-MOST_EMPHASIS, MOST_EMPHASIS).exp_()
            samples = describe_samples(inputs, inputs["encoded"])
            images["encoded"] = upsample_emphasised(samples, emphasis)
        if carried is not None:
            images |= {"history": carried.encoded, "worth": carried.worth}
        if self.training:
            blended = self._blend(images)
        else:
            blended = given.new_empty(len(given), 4, *given.shape[2:])
            fill_in_strips(lambda strip, _: self._blend(strip), images, blended, rows=BLENDED_ROWS)
        return blended[:, :3], blended[:, 3:]

    def _blend(self, images: Tensors) -> Image:
        """e' and c of some rows, one behind the other."""
        config, given = self.config, images["given"]
        worth_logit, share_logit = given[:, 3:4], given[:, 4:5]
        frame = EnlargedLighting(**{name: images[name] for name in FRAME_PLANES})
        worth = fresh = frame.fit.pow(config.fit_power)
        encoded = frame.encoded
        if "history" in images:
            aged = age_worth(images["worth"], frame, config)
            share: Tensor | float = config.change
            if config.history:
                agreed = frame.agreement
                worth_logit = torch.lerp(worth_logit, worth_logit.clamp(max=0.0), agreed)
                share_logit = torch.lerp(share_logit, share_logit.clamp(min=0.0), agreed)
                aged = aged * worth_logit.clamp(-MOST_LOGIT, MOST_LOGIT).exp()
                aged = torch.minimum(aged, MOST_KEPT * images["worth"])
                share = torch.sigmoid(share_logit + find_logit(config.change))
            known = CarriedLighting(encoded=images["history"], worth=aged)
            encoded = blend_history(frame, known, fresh=fresh, share=share, weights=config)
            worth = fresh + aged
        if config.residual:
            encoded = (encoded + given[:, 5:]).clamp(min=0.0)
        return torch.cat([encoded, worth], dim=1)


def average_blocks(pixels: Image, small: Image) -> Image:
    """Mean of each pixel of `small`, n . S*h S*w -> n . h w."""
    return F.avg_pool2d(pixels, int(pixels.shape[2] // small.shape[2]))


def find_logit(share: float) -> float:
    """Logit of a share, finite at 0 and 1."""
    return math.log((share + LEAST_SHARE) / (1.0 - share + LEAST_SHARE))
