"""The two networks: classes of every pixel, and the weight of the frame against its history.

Guo et al., "Classifier Guided Temporal Supersampling for Real-time Rendering", Computer Graphics
Forum 41(7), 2022, supplement, section 1. The classifier works on half the output's size, over four
scales; the composition pixel by pixel.

Conventions: those of `inputs`, whose `CgtsState` is all that goes from frame to frame.
"""

from __future__ import annotations

import copy
from typing import cast

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from rtsr_cli.core.imaging.auxiliary_buffers import (
    count_frames,
    merge_range,
    span_colors,
)
from rtsr_cli.core.imaging.predicted_kernel import (
    FILTERED_WORTH,
    TAPS,
    continue_image,
    filter_pixels,
    filter_samples,
)
from rtsr_cli.core.imaging.row_strips import cut_pixels
from rtsr_cli.core.network.blocks import continue_borders
from rtsr_cli.core.shapes import Color, Image, Plane
from rtsr_cli.core.system import State, Tensors
from rtsr_cli.models.cgts.config import CAUTION, CLASSES, CgtsConfig, Stage
from rtsr_cli.models.cgts.inputs import (
    SURROUNDINGS,
    CarriedHistory,
    CgtsState,
    carry_history,
    clip_history,
    filter_moving,
    limit_clipping,
)

CLASSIFIED_CHANNELS = 20
"""Colour 3, depth 1, motion 2, counter 1, range 6, depth difference 1, logits 6."""

COMPOSED_CHANNELS = 14
"""Logits 6, counter 1, depth difference 1, colour 3, history 3."""

WIDTHS = (32, 64, 128, 256)
"""Filters of the four scales."""

DECODED = 32
"""Channels of the decoder: 16 + 8 + 4 + 4 come in."""

DETAIL = 96
"""Width of what tells kernels beside the decoder."""

HIDDEN = 64
"""Width of the composition network."""

DIVISOR = 16
"""Sizes that the classifier takes are multiples of it: a half, then three halvings."""

CORRECTIONS = 4
"""What both networks add to, a pixel: logits of the frame's weight, of clipping and of filtering,
and how far the picture is filtered."""

KERNELS = 2
"""Of a pixel: one of the frame's samples, one of the picture's pixels."""

MOST_FRAMES = 16.0
"""Frames that the counter is shown to the networks up to."""

MOTION_UNIT_PX, MOST_MOTION = 16.0, 4.0
"""What a motion of 1 is for the classifier, and the largest one."""

MOST_LOGIT = 10.0
"""Bound of the logits that go on to the next frame."""

MOST_WORTH = 1e3
"""Samples that history is worth at most."""

STRIP_PIXELS = 1 << 14
"""Pixels of a strip in which weights are computed: what 64 channels of them take stays cached."""


def make_scale(channels_in: int, channels: int) -> nn.Sequential:
    """1x1, batch norm, ReLU, depthwise 3x3, 1x1, batch norm, ReLU."""
    return nn.Sequential(
        nn.Conv2d(channels_in, channels, 1),
        nn.BatchNorm2d(channels),
        nn.ReLU(inplace=True),
        nn.Conv2d(channels, channels, 3, padding=1, groups=channels),
        nn.Conv2d(channels, channels, 1),
        nn.BatchNorm2d(channels),
        nn.ReLU(inplace=True),
    )


def make_decoder() -> nn.Sequential:
    """Three 1x1 with batch norm and ReLU, one without ReLU."""
    layers: list[nn.Module] = []
    for _ in range(3):
        layers += [nn.Conv2d(DECODED, DECODED, 1), nn.BatchNorm2d(DECODED), nn.ReLU(inplace=True)]
    return nn.Sequential(*layers, nn.Conv2d(DECODED, 2 * CLASSES, 1), nn.BatchNorm2d(2 * CLASSES))


def make_detail(guides: int) -> nn.Sequential:
    """1x1, twice (ReLU, depthwise 3x3, 1x1), ReLU, 1x1: of all features of the first scale."""
    layers: list[nn.Module] = [nn.Conv2d(WIDTHS[0] + DECODED - WIDTHS[0] // 2, DETAIL, 1)]
    for _ in range(2):
        layers += [
            nn.ReLU(inplace=True),
            nn.Conv2d(DETAIL, DETAIL, 3, padding=1, groups=DETAIL),
            nn.Conv2d(DETAIL, DETAIL, 1),
        ]
    return nn.Sequential(*layers, nn.ReLU(inplace=True), nn.Conv2d(DETAIL, guides, 1))


class Classifier(nn.Module):
    """n c h w -> logits n 6 h w and guides n g h/2 w/2; 122,354 parameters at 20 and none."""

    def __init__(self, channels: int, guides: int) -> None:
        """Make the layers; that of guides starts at 0."""
        super().__init__()
        halves = [width // 2 for width in WIDTHS[:-1]]
        before = (4 * channels, *halves)
        self.halve: nn.Module = nn.PixelUnshuffle(2)
        self.scales = nn.ModuleList(
            make_scale(c, width) for c, width in zip(before, WIDTHS, strict=True)
        )
        self.decoder = make_decoder()
        self.guide: nn.Conv2d | None = None
        self.detail: nn.Sequential | None = None
        if guides:
            self.guide = nn.Conv2d(DECODED, guides, 1)
            self.detail = make_detail(guides)
            for last in (self.guide, cast(nn.Conv2d, self.detail[-1])):
                nn.init.zeros_(last.weight)
                nn.init.zeros_(cast(Tensor, last.bias))

    def for_inference(self) -> Classifier:
        """Return the same function whose first layer takes 2 x 2 pixels as they lie."""
        merged = copy.deepcopy(self)
        first = cast(nn.Sequential, merged.scales[0])
        layer = cast(nn.Conv2d, first[0])
        blocks = nn.Conv2d(layer.in_channels // 4, layer.out_channels, 2, stride=2)
        # the order in which pixels are unshuffled: channel, row, column
        blocks.weight = nn.Parameter(layer.weight.reshape(blocks.weight.shape))
        blocks.bias = layer.bias
        first[0], merged.halve = blocks, nn.Identity()
        return merged

    def forward(self, seen: Image) -> tuple[Image, Image | None]:
        """Classify; sides are multiples of 16."""
        rest = self.halve(seen)
        parts, fine = [], rest
        for level, scale in enumerate(self.scales):
            features = scale(rest)
            half = features.shape[1] // 2
            if level == 0:
                fine = features
            last = level == len(self.scales) - 1
            own = features if last else features[:, :half]
            parts.append(own if level == 0 else F.pixel_shuffle(own, 1 << level))
            if not last:
                rest = F.max_pool2d(features[:, half:], 2)
        decoded = self.decoder[:-2](torch.cat(parts, dim=1))
        small: Image = self.decoder[-2:](decoded)
        guides = None
        if self.guide is not None and self.detail is not None:
            guides = self.detail(torch.cat([fine, *parts[1:]], dim=1))
            guides = guides.add_(self.guide(decoded)).float()
        logits = F.interpolate(
            small.float(), scale_factor=2.0, mode="bilinear", align_corners=False
        )
        return logits, guides


class Composition(nn.Module):
    """n c h w -> logits, n 1 h w or n 3 h w; 1,025 parameters at 14 channels and one logit.

    The frame's weight, how much history is clipped, and how much of the frame is filtered.
    """

    def __init__(self, channels: int, logits: int) -> None:
        """Make two layers, the last one of zeros."""
        super().__init__()
        self.hidden = nn.Conv2d(channels, HIDDEN, 1)
        self.weight = nn.Conv2d(HIDDEN, logits, 1)
        nn.init.zeros_(self.weight.weight)
        nn.init.zeros_(cast(Tensor, self.weight.bias))

    def forward(self, seen: Image) -> Image:
        """Weigh."""
        logits: Image = self.weight(F.relu_(self.hidden(seen)))
        return logits.float()


class ColumnComposition(nn.Module):
    """The same as products of matrices, a pixel a column; for inference, in strips."""

    def __init__(self, composition: Composition) -> None:
        """Take over the layers."""
        super().__init__()
        layers = (composition.hidden, composition.weight)
        self.weights = nn.ParameterList(layer.weight.flatten(1) for layer in layers)
        self.biases = nn.ParameterList(cast(Tensor, layer.bias).view(-1, 1) for layer in layers)

    def forward(self, seen: Image) -> Image:
        """Weigh."""
        columns = seen.flatten(2)
        (inner, outer), (shift, last) = self.weights, self.biases
        hidden = torch.matmul(inner, columns).add_(shift).relu_()
        logits = torch.matmul(outer, hidden).add_(last)
        return logits.view(seen.shape[0], -1, *seen.shape[2:]).float()


class CgtsNetwork(nn.Module):
    """Both networks and what goes from frame to frame; its state is a `CgtsState`."""

    def __init__(self, config: CgtsConfig, scale: int) -> None:
        """Make the layers."""
        super().__init__()
        self.config, self.strip_pixels = config, 0
        self.surroundings = SURROUNDINGS[config.preset]
        self.scale, guided = scale, self.surroundings.guides
        self.classifier = Classifier(
            CLASSIFIED_CHANNELS + self.surroundings.shown,
            (KERNELS * TAPS + CORRECTIONS) * scale * scale if guided else 0,
        )
        self.composition: nn.Module = Composition(
            COMPOSED_CHANNELS + self.surroundings.signals, CORRECTIONS if guided else 1
        )

    def train(self, mode: bool = True) -> CgtsNetwork:
        """Switch to training; a classifier that is not trained keeps its statistics."""
        super().train(mode)
        if self.config.stage is Stage.COMPOSITION:
            self.classifier.eval()
        return self

    def for_inference(self) -> CgtsNetwork:
        """Return the same function, weights computed strip by strip."""
        fast = copy.deepcopy(self)
        fast.classifier = self.classifier.for_inference()
        fast.composition = ColumnComposition(cast(Composition, self.composition))
        fast.strip_pixels = STRIP_PIXELS
        return fast

    def forward(self, inputs: Tensors, state: State) -> tuple[dict[str, Tensor], State]:
        """Carry history along, classify, weigh, and accumulate."""
        before = cast(CgtsState | None, state)
        span = span_colors(inputs["color"])
        history = carry_history(before, inputs, span)
        told = self._classify(inputs, history)
        logits = told["logits"]
        useless = (find_hidden(logits) | (history.inside == 0)).to(logits.dtype)
        counter = count_frames(history.counter, useless)
        color, weight, worth, share = self._compose(inputs, history, span, told, counter)
        kept = CgtsState(
            color=color,
            counter=counter,
            worth=(worth / weight).detach().clamp(max=MOST_WORTH),
            span=merge_range(span, history.span, useless),
            depth=inputs["depth"],
            logits=logits.detach().clamp(-MOST_LOGIT, MOST_LOGIT),
            exposure=inputs["exposure"],
            linked=1 if before is None else before.linked + 1,
        )
        outputs = {
            "color": color if share is None else self._finish(color, told["guides"], share),
            "accumulated": color,
            "history": history.color,
            "logits": logits,
            "weight": weight,
            "counter": counter,
        }
        return outputs, kept if kept.linked < self.config.gradient_frames else kept.detached()

    def _classify(self, inputs: Tensors, history: CarriedHistory) -> dict[str, Tensor]:
        depth = inputs["depth"]
        motion = (inputs["motion"].nan_to_num() / MOTION_UNIT_PX).clamp(-MOST_MOTION, MOST_MOTION)
        known = {
            "color": inputs["color"],
            "worth": inputs["worth"],
            # its colours are learnt by the picture alone
            "history": history.color.detach(),
            "history_worth": history.worth,
        }
        seen = torch.cat(
            [
                inputs["color"],
                depth / (1.0 + depth),
                motion,
                _show_counter(history.counter),
                history.span,
                history.difference,
                history.logits,
                self.surroundings.show(known),
            ],
            dim=1,
        ).float()
        height, width = seen.shape[2:]
        padded = {"seen": continue_borders(seen, DIVISOR)}
        if self.config.stage is Stage.COMPOSITION:
            with torch.no_grad():
                told = self.classify(padded)
        else:
            told = self.classify(padded)
        sizes = {"logits": (height, width), "guides": (height // 2, width // 2)}
        return {name: t[:, :, : sizes[name][0], : sizes[name][1]] for name, t in told.items()}

    def classify(self, tensors: Tensors) -> dict[str, Tensor]:
        """`seen` -> `logits` of both kinds of classes, and `guides` of the picture: a graph."""
        logits, guides = self.classifier(tensors["seen"])
        return {"logits": logits} if guides is None else {"logits": logits, "guides": guides}

    def weigh(self, tensors: Tensors) -> Tensors:
        """`known` -> `given`, logits of the frame's weight, of clipping and filtering: a graph."""
        return {"given": self.composition(tensors["known"])}

    def _compose(
        self,
        inputs: Tensors,
        history: CarriedHistory,
        span: Image,
        told: Tensors,
        counter: Plane,
    ) -> tuple[Color, Plane, Plane, Plane | None]:
        """Frame and history, weighted, the weight, what the frame is worth, and `_finish`'s share.

        The weight is 1 where there is no history.
        """
        seen = {
            "logits": told["logits"],
            "counter": counter,
            "difference": history.difference,
            "color": inputs["color"],
            "history": history.color,
            "worth": inputs["worth"],
            "history_worth": history.worth,
            "span": span,
            "motion": inputs["motion"],
            "reactive": inputs["reactive"],
            "inside": history.inside,
        }
        small: dict[str, Tensor] = {}
        if self.surroundings.guides:
            seen |= {"around": inputs["around"], "history_span": history.span}
            small = {"samples": continue_image(inputs["samples"]), "guides": told["guides"]}
        if not self.strip_pixels:
            return self._compose_pixels(seen, small, inputs)
        size, parts = (span.shape[2], span.shape[3]), []
        for rows in cut_pixels(size, self.strip_pixels, multiple=self.scale):
            shown = {n: t[:, :, rows.start : rows.stop] for n, t in seen.items()}
            top, bottom = rows.start // self.scale, rows.stop // self.scale
            # samples have a row more to each side
            own = {n: t[:, :, top : bottom + 2 * (n == "samples")] for n, t in small.items()}
            parts.append(self._compose_pixels(shown, own, inputs))
        colors, weights, worths, shares = zip(*parts, strict=True)
        whole = [torch.cat(strips, dim=2) for strips in (colors, weights, worths)]
        finish = torch.cat(shares, dim=2) if self.surroundings.guides else None
        return whole[0], whole[1], whole[2], finish

    def _finish(self, color: Color, guides: Image, share: Plane) -> Color:
        """o + s (f - o), shown of the accumulated o; f is filtered by kernels of its own."""
        taps = TAPS * self.scale * self.scale
        around, logits = continue_image(color), guides[:, (KERNELS - 1) * taps : KERNELS * taps]
        height, width = color.shape[2:]
        parts = []
        pixels = self.strip_pixels or height * width
        for rows in cut_pixels((height, width), pixels, multiple=self.scale):
            own = (..., slice(rows.start, rows.stop), slice(None))
            top, bottom = rows.start // self.scale, rows.stop // self.scale
            filtered = filter_pixels(
                around[:, :, rows.start : rows.stop + 2], logits[:, :, top:bottom], self.scale
            )
            parts.append(torch.lerp(color[own], filtered, share[own].to(color.dtype)))
        return torch.cat(parts, dim=2).clamp_(0.0, 1.0)

    def _compose_pixels(
        self, seen: Tensors, small: Tensors, inputs: Tensors
    ) -> tuple[Color, Plane, Plane, Plane | None]:
        shown = seen["logits"].clamp(-MOST_LOGIT, MOST_LOGIT)
        known = {**seen, "motion": seen["motion"].nan_to_num()}
        history, color, worth = seen["history"], seen["color"], seen["worth"]
        if self.surroundings.guides:
            known["clipped"] = clip_history(history, seen["around"])
        channels = [
            shown if self.config.classes else torch.zeros_like(shown),
            _show_counter(seen["counter"]),
            *(seen[name] for name in ("difference", "color", "history")),
            self.surroundings.see(known),
        ]
        given = self.weigh({"known": torch.cat(channels, dim=1).float()})["given"]
        finish: Plane | None = None
        if self.surroundings.guides:
            taps = TAPS * self.scale * self.scale
            given = given + F.pixel_shuffle(small["guides"][:, KERNELS * taps :], self.scale)
            finish = torch.tanh(given[:, 3:])
            logits = small["guides"][:, :taps] + inputs["reach"]
            filtered = filter_samples(small["samples"], logits, self.scale)
            share = filter_moving(torch.sigmoid(given[:, 2:3]), known["motion"])
            color = torch.lerp(color, filtered, share.to(color.dtype))
            worth = worth + share * (FILTERED_WORTH - worth)
            share = limit_clipping(torch.sigmoid(given[:, 1:2]), known["motion"])
            history = torch.lerp(history, known["clipped"], share.to(history.dtype))
        start = self.surroundings.start(worth, seen["history_worth"])
        weight = torch.sigmoid(given[:, :1] + start)
        weight = torch.where(seen["inside"] > 0, torch.maximum(weight, seen["reactive"]), 1.0)
        return torch.lerp(history, color, weight.to(history.dtype)), weight, worth, finish


def find_hidden(logits: Image) -> Tensor:
    """True where history may show another surface: e^`CAUTION` times less likely is enough.

    A history that begins anew for nothing costs less than one that shows what is no longer there.
    """
    visibility, others = logits[:, :1], logits[:, 1:CLASSES]
    return visibility + CAUTION >= others.amax(1, keepdim=True)


def _show_counter(counter: Plane) -> Plane:
    return counter.clamp(max=MOST_FRAMES) / MOST_FRAMES
