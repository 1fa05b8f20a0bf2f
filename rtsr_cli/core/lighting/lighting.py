"""Lighting as networks see, predict and are judged on it; what lighting systems share.

Networks work on e = log(1 + lighting / k), k of the whole frame; their output is added to an
enlargement of the lighting and multiplied by the HR material, emission is added, and the sky is
enlarged on its own. Lighting brighter than any that networks are shown or held against keeps its
enlargement. A system that departs from this says so in `Surroundings` of its own.

Conventions: HR tensors among inputs, outputs and goal lie on the grid that `alignment` moves, so
that the LR sample is pixel (S//2, S//2) of its block.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import StrEnum

import torch
from torch import Tensor

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.buffers import Buffer, sky_mask
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.alignment import block_shift, shift_image, shift_jitter
from rtsr_cli.core.imaging.color import encode_reinhard
from rtsr_cli.core.imaging.demodulation import remodulate
from rtsr_cli.core.imaging.enlargement import enlarge_log_lighting
from rtsr_cli.core.imaging.guided_enlargement import upsample_guided
from rtsr_cli.core.imaging.guided_kernel import GuidedSamples, SurfaceGuides
from rtsr_cli.core.lighting.radiance import add_radiance
from rtsr_cli.core.settings import check_numbers
from rtsr_cli.core.shapes import Color, Image, Mask, Plane, Vector3
from rtsr_cli.core.system import FrameWindow, Prediction, Tensors

MAX_LIGHTING = 64.0
"""Bound of lighting in a network's input: quotients over dark materials have none."""

FADING_SHARE = 0.5
"""Of that bound: from here to there, what a network corrects of lighting fades out."""

GUIDES = (Buffer.NORMAL, Buffer.DEPTH)
"""What tells surfaces apart, where both sizes have it."""

LR_BUFFERS = (Buffer.COLOR, Buffer.LIGHTING, Buffer.LIGHTING_MASK, Buffer.SKY)
LR_OPTIONAL = (Buffer.EMISSION,)
HR_BUFFERS = (Buffer.MATERIAL, Buffer.SKY)
HR_OPTIONAL = (Buffer.EMISSION,)
REFERENCE_BUFFERS = (Buffer.COLOR, Buffer.LIGHTING, Buffer.LIGHTING_MASK, Buffer.SKY)
"""What this module reads of LR frame, HR frame and captured reference."""


class EnlargementBase(StrEnum):
    """How lighting is enlarged before a network corrects it."""

    GUIDED = "guided"
    """Along the surfaces of the HR G-buffer."""
    CUBIC = "cubic"


@dataclass(frozen=True, kw_only=True)
class LossWeights:
    """Weights of the loss' terms: mean absolute differences, or squared where named so.

    Attributes:
        log: of log lighting, over divided pixels.
        tonemapped: of the remodulated image after c / (1 + c), sky left out.
        tonemapped_squared: the same squared, which is what PSNR measures; noise in captures moves
            the absolute difference's optimum to the median, this one's to the mean.
        radiance: of the remodulated linear image, the capture's radiance bounded as the system's
            `Surroundings` say.
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


def encode_lighting(lighting: Color, scale: Tensor) -> Color:
    """e = log(1 + lighting / k); k broadcasts over a batch."""
    return torch.log1p(lighting.clamp(min=0.0) / scale)


def decode_lighting(encoded: Color, scale: Tensor) -> Color:
    """Lighting = k (exp(e) - 1), never negative."""
    return encoded.clamp(min=0.0).expm1_() * scale


def inverse_depth(depth_m: Plane) -> Plane:
    """1 / (1 + depth), 0 on sky."""
    return (1.0 - sky_mask(depth_m)) / (1.0 + depth_m.clamp(min=0.0))


def stored_depth(depth_m: Plane) -> Plane:
    """Depth as it is stored."""
    return depth_m


def network_normal(frame: Frame) -> Vector3:
    """World-space normal, -1..1, 0 on sky."""
    return frame.gbuffer[Buffer.NORMAL]


def lighting_scale_of(frame: Frame) -> Tensor:
    """k of a frame, n 1 1 1."""
    return torch.full((1, 1, 1, 1), frame.lighting_scale, device=frame.gbuffer.device)


def align_image(window: FrameWindow, image: Image) -> Image:
    """Bring an HR image onto the grid where LR samples are pixel S//2 of their block."""
    return shift_image(image, block_shift(window.current.camera.jitter_px, window.scale))


def unalign_image(window: FrameWindow, image: Image) -> Image:
    """Undo `align_image`."""
    x, y = block_shift(window.current.camera.jitter_px, window.scale)
    return shift_image(image, (-x, -y))


def enlarge_lighting(window: FrameWindow, base: EnlargementBase) -> Color:
    """Enlargement of log lighting, holes filled, on the aligned grid.

    Where a G-buffer has no normals or no depth, the cubic one.
    """
    frame, scale = window.current, window.scale
    encoded = encode_frame(frame)
    mask = frame.gbuffer[Buffer.LIGHTING_MASK]
    cubic = enlarge_cubic(window, encoded)
    sizes = (frame.gbuffer, window.require_hr().gbuffer)
    if base is EnlargementBase.CUBIC or not all(g in held for held in sizes for g in GUIDES):
        return cubic
    small, large = guide_window(window)
    return upsample_guided(
        GuidedSamples(
            values=encoded, mask=mask, small=small, large=large, scale=scale, fallback=cubic
        )
    )


def encode_frame(frame: Frame) -> Color:
    """e of a frame's lighting, by its own k."""
    return encode_lighting(frame.gbuffer[Buffer.LIGHTING], lighting_scale_of(frame))


def enlarge_cubic(window: FrameWindow, encoded: Color) -> Color:
    """Cubic enlargement of the frame's log lighting, holes filled, on the aligned grid."""
    frame, scale = window.current, window.scale
    jitter_px = shift_jitter(frame.camera.jitter_px, scale)
    return enlarge_log_lighting(encoded, frame.gbuffer[Buffer.LIGHTING_MASK], scale, jitter_px)


def guide_window(window: FrameWindow) -> tuple[SurfaceGuides, SurfaceGuides]:
    """What tells surfaces apart at both sizes, the larger one on the aligned grid."""
    small, large = window.current.gbuffer, window.require_hr().gbuffer
    normal, depth = (align_image(window, large[guide]) for guide in GUIDES)
    return (
        SurfaceGuides(normal=small[Buffer.NORMAL], depth=small[Buffer.DEPTH]),
        SurfaceGuides(normal=normal, depth=depth),
    )


def keep_picture(window: FrameWindow, image: Color) -> Color:
    """`Surroundings.finish` of whoever adds nothing to the picture."""
    del window
    return image


def keep_lighting(predicted: Color, scale: Tensor) -> Color:
    """`Surroundings.decode` of whoever predicts lighting itself."""
    del scale
    return predicted


Goal = Callable[[Frame, Tensor], dict[str, Tensor]]
"""(capture, k of the LR frame) -> the lighting that a network is held against."""


def log_goal(reference: Frame, scale: Tensor) -> dict[str, Tensor]:
    """`encoded`: log lighting, bounded; `divided_mask`: where there is any."""
    lighting = reference.gbuffer[Buffer.LIGHTING].clamp(max=MAX_LIGHTING)
    return {
        "encoded": encode_lighting(lighting, scale),
        "divided_mask": reference.gbuffer[Buffer.LIGHTING_MASK],
    }


@dataclass(frozen=True, kw_only=True)
class Surroundings:
    """What surrounds the layers of a network that predicts lighting; by default this project's.

    Attributes:
        show_depth: depth in metres -> as a network sees it.
        decode: (output of a network, k) -> the lighting that it stands for.
        corrects_base: whether the output is added to the enlarged lighting, emission to the
            picture; the layers start as the identity then.
        finish: (window, picture of the surfaces at the target size) -> the whole picture.
        goal: the capture's lighting, as the loss compares with it.
        max_radiance: bound of the capture's radiance in the loss' term of that name.
    """

    show_depth: Callable[[Plane], Plane] = inverse_depth
    decode: Callable[[Color, Tensor], Color] = decode_lighting
    corrects_base: bool = True
    finish: Callable[[FrameWindow, Color], Color] = add_radiance
    goal: Goal = log_goal
    max_radiance: float = math.inf


LOG_LIGHTING = Surroundings()
"""Log lighting, corrected, with emission and sky apart."""


def describe_picture(window: FrameWindow, *, emission_apart: bool = True) -> dict[str, Tensor]:
    """What makes a picture of lighting: `material`, `emission` (HR, aligned), `lighting_scale`.

    Emission is 0 where it was not taken out of the radiance before that was divided
    (`emission_apart`).
    """
    gbuffer = window.require_hr().gbuffer
    material = align_image(window, gbuffer[Buffer.MATERIAL])
    emission = gbuffer.buffers.get(Buffer.EMISSION) if emission_apart else None
    return {
        "material": material,
        "emission": (
            torch.zeros_like(material) if emission is None else align_image(window, emission)
        ),
        "lighting_scale": lighting_scale_of(window.current),
    }


def build_lighting_inputs(
    window: FrameWindow,
    surroundings: Surroundings,
    base: EnlargementBase = EnlargementBase.GUIDED,
    *,
    emission_apart: bool = True,
) -> dict[str, Tensor]:
    """`describe_picture`, and `base` where there is one: what a network corrects.

    Emission is added by whoever corrects such an enlargement of log lighting, and by no one else.
    """
    inputs = describe_picture(window, emission_apart=emission_apart)
    if not surroundings.corrects_base:
        del inputs["emission"]
        return inputs
    return inputs | {"base": enlarge_lighting(window, base)}


def multiply_material(lighting: Color, inputs: Tensors) -> Color:
    """Radiance = lighting * HR material + emission where there is one, sky not treated."""
    return remodulate(lighting, inputs["material"], inputs.get("emission"))


def recompose_prediction(predicted: Color, inputs: Tensors, surroundings: Surroundings) -> Color:
    """Radiance of a network's output, sky not treated."""
    return multiply_material(surroundings.decode(predicted, inputs["lighting_scale"]), inputs)


def keep_unseen(inputs: Tensors, predicted: Color) -> Color:
    """Leave the enlarged lighting as it is where no network was ever shown any that bright.

        base + w (predicted - base),  w = clamp((M - L) / ((1 - f) M), 0, 1)

    with L the brightest channel of the enlarged lighting, M `MAX_LIGHTING`, f `FADING_SHARE`: a
    network sees M in place of more, and held against M: it would darken what is brighter.

    Args:
        inputs: `base`, log lighting, and `lighting_scale`; without `base` nothing is left.
        predicted: log lighting of a network that corrects `base`.
    """
    base = inputs.get("base")
    if base is None or base is predicted:
        return predicted
    brightest = decode_lighting(base.amax(1, keepdim=True), inputs["lighting_scale"])
    if float(brightest.amax()) <= FADING_SHARE * MAX_LIGHTING:
        return predicted
    believed = (MAX_LIGHTING - brightest) / ((1.0 - FADING_SHARE) * MAX_LIGHTING)
    return torch.lerp(base, predicted, believed.clamp_(0.0, 1.0))


def compose_lighting(
    surroundings: Surroundings, window: FrameWindow, inputs: Tensors, predicted: Color
) -> Prediction:
    """Multiply by HR material, add emission, and finish: put in sky and undivided surfaces."""
    predicted = keep_unseen(inputs, predicted.float())
    lighting = surroundings.decode(predicted, inputs["lighting_scale"])
    image = unalign_image(window, multiply_material(lighting, inputs).clamp_(min=0.0))
    return Prediction(
        image=surroundings.finish(window, image),
        debug={"lighting": unalign_image(window, lighting)},
    )


def build_lighting_goal(
    surroundings: Surroundings, window: FrameWindow, reference: Frame
) -> dict[str, Tensor]:
    """What a network is held against: the capture's radiance and lighting, on the aligned grid.

    Keys: `color`, `surface_mask` (1 = lighting makes the picture: no sky, no
    material of 0), and those of `Surroundings.goal`.
    """
    gbuffer = reference.gbuffer
    material = window.require_hr().gbuffer[Buffer.MATERIAL].amin(1, keepdim=True)
    surface = (1.0 - gbuffer[Buffer.SKY]) * (material > MATERIAL_EPSILON)
    goal = {"color": gbuffer[Buffer.COLOR], "surface_mask": surface}
    goal |= surroundings.goal(reference, lighting_scale_of(window.current))
    return {name: align_image(window, image) for name, image in goal.items()}


def batch_masked_mean(values: Image, mask: Mask) -> Tensor:
    """Mean over pixels of mask 1 and all channels, 0 where there are none; then over the batch.

    Samples count alike, so that parts of a batch, on several processes, make the mean of all.
    """
    weight = mask.sum(dim=(1, 2, 3)) * values.shape[1]
    return ((values * mask).sum(dim=(1, 2, 3)) / weight.clamp(min=1.0)).mean()


def lighting_loss(
    surroundings: Surroundings,
    weights: LossWeights,
    predicted: Color,
    *,
    inputs: Tensors,
    goal: Tensors,
) -> dict[str, Tensor]:
    """Terms of `LossWeights` that weigh anything; that of log lighting where the goal is that."""
    predicted = predicted.float()
    terms: dict[str, Tensor] = {}
    if weights.log and "encoded" in goal:
        difference = (predicted - goal["encoded"]).abs()
        terms["log"] = weights.log * batch_masked_mean(difference, goal["divided_mask"])
    image = recompose_prediction(predicted, inputs, surroundings)
    if weights.tonemapped or weights.tonemapped_squared:
        difference = (encode_reinhard(image) - encode_reinhard(goal["color"])).abs()
        if weights.tonemapped:
            terms["tonemapped"] = weights.tonemapped * batch_masked_mean(
                difference, goal["surface_mask"]
            )
        if weights.tonemapped_squared:
            squared = batch_masked_mean(difference.square(), goal["surface_mask"])
            terms["tonemapped_squared"] = weights.tonemapped_squared * squared
    if weights.radiance:
        bounded = goal["color"].clamp(max=surroundings.max_radiance)
        terms["radiance"] = weights.radiance * (image - bounded).abs().mean()
    return terms
