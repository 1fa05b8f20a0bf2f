"""Lighting as networks see, predict and are judged on it; what lighting systems share.

Preset `rtsr`: networks work on e = log(1 + lighting / k), k of the whole frame, their output is
multiplied by the HR material, emission is added, and the sky is enlarged on its own. Preset `paper`
[FuseSR, code]: lighting is radiance / softplus(F) as it is, and everything is multiplied back;
radiance is bounded at 10, of the input and of the reference.

Conventions: HR tensors among inputs, outputs and goal lie on the grid that `alignment` moves, so
that the LR sample is pixel (S//2, S//2) of its block.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import StrEnum

import torch
from torch import Tensor

from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.buffers import Buffer, sky_mask
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.alignment import block_shift, shift_image, shifted_jitter
from rtsr_cli.core.imaging.color import encode_reinhard
from rtsr_cli.core.imaging.demodulation import remodulate
from rtsr_cli.core.imaging.enlarging import enlarge_log_lighting, enlarge_where
from rtsr_cli.core.imaging.guiding import Surfaces, guided_upsample
from rtsr_cli.core.settings import check_numbers
from rtsr_cli.core.shapes import Color, Image, Mask, Plane, Vector3
from rtsr_cli.core.system import Prediction, Tensors, Window

MAX_LIGHTING = 64.0
"""Bound of lighting in a network's input: quotients over dark materials have none."""

MAX_PAPER_RADIANCE = 10.0
"""Bound of the radiance in the preset `paper` [FuseSR, code]."""

LR_BUFFERS = (Buffer.COLOR, Buffer.LIGHTING, Buffer.LIGHTING_MASK, Buffer.SKY)
HR_BUFFERS = (Buffer.MATERIAL, Buffer.SKY)
HR_OPTIONAL = (Buffer.EMISSION,)
GUIDES = (Buffer.NORMAL, Buffer.DEPTH)
REFERENCE_BUFFERS = (Buffer.COLOR, Buffer.LIGHTING, Buffer.LIGHTING_MASK, Buffer.SKY)
"""What this module reads of LR frame, HR frame and captured reference."""


class Base(StrEnum):
    """How lighting is enlarged before a network corrects it."""

    GUIDED = "guided"
    """Along the surfaces of the HR G-buffer."""
    CUBIC = "cubic"


class Preset(StrEnum):
    """What surrounds a network's layers."""

    RTSR = "rtsr"
    PAPER = "paper"


@dataclass(frozen=True, kw_only=True)
class LossWeights:
    """Weights of the loss' terms: mean absolute differences, or squared where named so.

    Attributes:
        log: of log lighting, over divided pixels.
        tonemapped: of the remodulated image after c / (1 + c), sky left out.
        tonemapped_squared: the same squared, which is what PSNR measures; noise in captures moves
            the absolute difference's optimum to the median, this one's to the mean.
        radiance: of the remodulated linear image, bounded as the paper's [FuseSR, code].
    """

    log: float = 0.1
    tonemapped: float = 1.0
    tonemapped_squared: float = 0.0
    radiance: float = 0.0

    def __post_init__(self) -> None:
        """Check the weights.

        Raises:
            ConfigError: one is below 0 or no number, or nothing weighs anything.
        """
        names = [field.name for field in fields(self)]
        check_numbers(self, "network.loss", dict.fromkeys(names, 0.0))
        if not any(getattr(self, name) for name in names):
            raise ConfigError(f"network.loss: one of {', '.join(names)} has to be above 0")


PAPER_LOSS = LossWeights(log=0.0, tonemapped=0.0, radiance=1.0)


def encode_lighting(lighting: Color, scale: Tensor) -> Color:
    """e = log(1 + lighting / k); k broadcasts over a batch."""
    return torch.log1p(lighting.clamp(min=0.0) / scale)


def decode_lighting(encoded: Color, scale: Tensor) -> Color:
    """Lighting = k (exp(e) - 1), never negative."""
    return encoded.clamp(min=0.0).expm1_() * scale


def network_depth(depth_m: Plane, preset: Preset) -> Plane:
    """1 / (1 + depth), 0 on sky; as stored in `paper`."""
    if preset is Preset.PAPER:
        return depth_m
    return (1.0 - sky_mask(depth_m)) / (1.0 + depth_m.clamp(min=0.0))


def network_lighting(frame: Frame, preset: Preset) -> Color:
    """LR lighting of a frame with its own k; 0 where nothing was divided.

    In `paper` that of radiance bounded at 10: min(c, 10) / F = L min(1, 10 / c).
    """
    lighting = frame.gbuffer[Buffer.LIGHTING]
    if preset is Preset.PAPER:
        color = frame.gbuffer[Buffer.COLOR]
        return lighting * (MAX_PAPER_RADIANCE / color).nan_to_num().clamp(0.0, 1.0)
    bounded = lighting.clamp(max=MAX_LIGHTING)
    return encode_lighting(bounded, scale_of(frame)) * frame.gbuffer[Buffer.LIGHTING_MASK]


def network_normal(frame: Frame) -> Vector3:
    """World-space normal, -1..1, 0 on sky."""
    return frame.gbuffer[Buffer.NORMAL]


def scale_of(frame: Frame) -> Tensor:
    """k of a frame, n 1 1 1."""
    return torch.full((1, 1, 1, 1), frame.lighting_scale, device=frame.gbuffer.device)


def aligned(window: Window, image: Image) -> Image:
    """Bring an HR image onto the grid where LR samples are pixel S//2 of their block."""
    return shift_image(image, block_shift(window.current.camera.jitter_px, window.scale))


def unaligned(window: Window, image: Image) -> Image:
    """Undo `aligned`."""
    x, y = block_shift(window.current.camera.jitter_px, window.scale)
    return shift_image(image, (-x, -y))


def enlarged_lighting(window: Window, base: Base) -> Color:
    """Enlargement of log lighting, holes filled, on the aligned grid.

    Where a G-buffer has no normals or no depth, the cubic one.
    """
    frame, scale = window.current, window.scale
    encoded = encode_lighting(frame.gbuffer[Buffer.LIGHTING], scale_of(frame))
    mask = frame.gbuffer[Buffer.LIGHTING_MASK]
    jitter_px = shifted_jitter(frame.camera.jitter_px, scale)
    cubic = enlarge_log_lighting(encoded, mask, scale, jitter_px)
    small, large = frame.gbuffer.buffers, hr_frame(window).gbuffer.buffers
    if base is Base.CUBIC or not all(g in small and g in large for g in GUIDES):
        return cubic
    normal, depth = (aligned(window, large[guide]) for guide in GUIDES)
    return guided_upsample(
        encoded,
        mask,
        Surfaces(normal=small[Buffer.NORMAL], depth=small[Buffer.DEPTH]),
        Surfaces(normal=normal, depth=depth),
        scale=scale,
        fallback=cubic,
    )


def hr_frame(window: Window) -> Frame:
    """Return the HR frame of a system that declares HR inputs."""
    if window.hr is None:
        raise AssertionError("plans check that a system with HR inputs gets an HR frame")
    return window.hr


def lighting_inputs(
    window: Window,
    preset: Preset,
    base: Base = Base.GUIDED,
    *,
    emission_apart: bool = True,
) -> dict[str, Tensor]:
    """`material`, `emission` (HR, aligned), `lighting_scale`, and `base` where there is one.

    `base` is the enlargement of log lighting that a network corrects; `paper` has none. Emission is
    0 where it was not taken out of the radiance before that was divided (`emission_apart`).
    """
    frame, hr = window.current, hr_frame(window)
    material = hr.gbuffer[Buffer.MATERIAL]
    emission = hr.gbuffer.buffers.get(Buffer.EMISSION) if emission_apart else None
    inputs = {
        "material": aligned(window, material),
        "lighting_scale": scale_of(frame),
    }
    if preset is Preset.RTSR:
        inputs["emission"] = (
            torch.zeros_like(material) if emission is None else aligned(window, emission)
        )
        inputs["base"] = enlarged_lighting(window, base)
    return inputs


def predicted_lighting(predicted: Color, inputs: Tensors, preset: Preset) -> Color:
    """Lighting that a network's output stands for."""
    if preset is Preset.PAPER:
        return predicted
    return decode_lighting(predicted, inputs["lighting_scale"])


def relit_material(lighting: Color, inputs: Tensors) -> Color:
    """Radiance = lighting * HR material + emission, sky not treated; `paper` has no emission."""
    return remodulate(lighting, inputs["material"], inputs.get("emission"))


def recomposed(predicted: Color, inputs: Tensors, preset: Preset) -> Color:
    """Radiance of a network's output, sky not treated."""
    return relit_material(predicted_lighting(predicted, inputs, preset), inputs)


def compose_lighting(
    preset: Preset, window: Window, inputs: Tensors, predicted: Color
) -> Prediction:
    """Multiply by HR material, add emission, put in the sky."""
    lighting = predicted_lighting(predicted.float(), inputs, preset)
    image = unaligned(window, relit_material(lighting, inputs).clamp_(min=0.0))
    if preset is Preset.RTSR:
        image = with_sky(window, image)
    return Prediction(image=image, debug={"lighting": unaligned(window, lighting)})


SKY_MARGIN_PX = 6
"""LR rows around the sky that its enlargement sees: cubic 2 and jitter 1, highlights 2, and one."""


def with_sky(window: Window, image: Color) -> Color:
    """Put the enlarged LR sky where the HR depth says sky; only rows that hold any are touched."""
    frame, scale = window.current, window.scale
    hr_sky = hr_frame(window).gbuffer[Buffer.SKY] > 0.5
    rows = hr_sky.flatten(0, 1).any(0).any(1).nonzero()
    if not len(rows):
        return image
    first, last = int(rows[0]) // scale, int(rows[-1]) // scale + 1
    top, bottom = max(0, first - SKY_MARGIN_PX), min(frame.size[0], last + SKY_MARGIN_PX)
    color, sky = (frame.gbuffer[b][:, :, top:bottom] for b in (Buffer.COLOR, Buffer.SKY))
    seen = slice((first - top) * scale, (last - top) * scale)
    changed = slice(first * scale, last * scale)
    wanted = hr_sky[:, :, top * scale : bottom * scale]
    enlarged = enlarge_where(color, sky, scale, frame.camera.jitter_px, wanted=wanted)
    band = torch.where(hr_sky[:, :, changed], enlarged[:, :, seen], image[:, :, changed])
    return torch.cat([image[:, :, : changed.start], band, image[:, :, changed.stop :]], dim=2)


def lighting_goal(preset: Preset, window: Window, reference: Frame) -> dict[str, Tensor]:
    """What a network is held against: the capture's lighting and radiance, on the aligned grid.

    Keys: `color`, `surface_mask` (1 = no sky), and in `rtsr` `encoded`, `divided_mask`.
    """
    gbuffer = reference.gbuffer
    color = gbuffer[Buffer.COLOR]
    goal = {"color": aligned(window, color), "surface_mask": 1.0 - gbuffer[Buffer.SKY]}
    if preset is Preset.RTSR:
        lighting = gbuffer[Buffer.LIGHTING].clamp(max=MAX_LIGHTING)
        encoded = encode_lighting(lighting, scale_of(window.current))
        goal["encoded"] = aligned(window, encoded)
        goal["divided_mask"] = aligned(window, gbuffer[Buffer.LIGHTING_MASK])
    goal["surface_mask"] = aligned(window, goal["surface_mask"])
    return goal


def masked_mean(values: Image, mask: Mask) -> Tensor:
    """Mean over pixels of mask 1 and all channels, 0 where there are none; then over the batch.

    Samples count alike, so that parts of a batch, on several processes, make the mean of all.
    """
    weight = mask.sum(dim=(1, 2, 3)) * values.shape[1]
    return ((values * mask).sum(dim=(1, 2, 3)) / weight.clamp(min=1.0)).mean()


def lighting_loss(
    weights: LossWeights, predicted: Color, *, inputs: Tensors, goal: Tensors, preset: Preset
) -> dict[str, Tensor]:
    """Terms of `LossWeights` that weigh anything."""
    predicted = predicted.float()
    terms: dict[str, Tensor] = {}
    if weights.log and "encoded" in goal:
        difference = (predicted - goal["encoded"]).abs()
        terms["log"] = weights.log * masked_mean(difference, goal["divided_mask"])
    image = recomposed(predicted, inputs, preset)
    if weights.tonemapped or weights.tonemapped_squared:
        difference = (encode_reinhard(image) - encode_reinhard(goal["color"])).abs()
        if weights.tonemapped:
            terms["tonemapped"] = weights.tonemapped * masked_mean(difference, goal["surface_mask"])
        if weights.tonemapped_squared:
            squared = masked_mean(difference.square(), goal["surface_mask"])
            terms["tonemapped_squared"] = weights.tonemapped_squared * squared
    if weights.radiance:
        bounded = goal["color"].clamp(max=MAX_PAPER_RADIANCE)
        terms["radiance"] = weights.radiance * (image - bounded).abs().mean()
    return terms
