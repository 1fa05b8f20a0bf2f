"""Lighting of LR radiance that a pixel filter went over, and the lighting behind it.

    E(q) = (c(q) - G[emission](q)) / G[material](q)

G is the filter, applied to the HR G-buffer around sample q: radiance is the filter's mean of
lighting times material, so that this quotient is a mean of lighting, weighted by material. Divided
by the material of the one sample instead, it would hold every texture and silhouette nearby.

What the filter mixed, iterations part again [back-projection, Irani and Peleg 1991]:

    L <- L + guided enlargement of e(E) - e(G[L material] / G[material]),   in log lighting

Conventions: those of `lighting.lighting`; G is a Gaussian of the frame's `filter_width_px`: of
filters of one deviation the shape hardly matters.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.alignment import shift_jitter
from rtsr_cli.core.imaging.filtered_gbuffer import carry_radiance, filter_gbuffer
from rtsr_cli.core.imaging.guided_enlargement import upsample_guided
from rtsr_cli.core.imaging.resampling import filter_at_samples
from rtsr_cli.core.lighting.lighting import align_image, decode_lighting, encode_lighting
from rtsr_cli.core.lighting.lighting_history import describe_samples
from rtsr_cli.core.shapes import Color
from rtsr_cli.core.system import FrameWindow, Tensors

MOST_SKY = 0.02
"""Share of the sky within the filter from which radiance is no surface's."""

ITERATIONS = 4
"""Of the equation above."""


def match_filter(window: FrameWindow) -> FrameWindow:
    """Return the window with lighting divided by material that was filtered as radiance is.

    The window itself where radiance is point-sampled.
    """
    frame = window.current
    if not frame.filter_width_px:
        return window
    gbuffer, hr = frame.gbuffer, window.require_hr().gbuffer
    seen = filter_gbuffer(hr, frame.filter_width_px, window.scale, frame.camera.jitter_px)
    material, sky = seen[Buffer.MATERIAL], seen[Buffer.SKY]
    radiance: Color = gbuffer[Buffer.COLOR]
    emission = seen.get(Buffer.EMISSION, gbuffer.buffers.get(Buffer.EMISSION))
    if emission is not None:
        radiance = (radiance - emission).clamp(min=0.0)
    divided = (material > MATERIAL_EPSILON).all(1, keepdim=True) & (sky < MOST_SKY)
    divided &= gbuffer[Buffer.LIGHTING_MASK] > 0.5
    lighting = torch.where(divided, radiance / material.clamp(min=MATERIAL_EPSILON), 0.0)
    matched = gbuffer.with_buffers(
        {Buffer.LIGHTING: lighting, Buffer.LIGHTING_MASK: divided.to(lighting)}
    )
    return replace(window, lr=(replace(frame, gbuffer=matched), *window.lr[1:]))


def describe_filter(window: FrameWindow) -> dict[str, Tensor]:
    """What parting reads: `filter_width` (n 1 1 1), `place` (n 2 1 1), `surface_material` (HR).

    Place is that of the LR samples on the moved grid, minus LR pixel centres.
    """
    frame, hr = window.current, window.require_hr().gbuffer
    surface = carry_radiance(hr)
    place = surface.new_tensor(shift_jitter(frame.camera.jitter_px, window.scale))
    return {
        "filter_width": surface.new_full((1, 1, 1, 1), frame.filter_width_px),
        "place": place.view(1, 2, 1, 1),
        "surface_material": align_image(window, surface),
    }


def part_filtered(inputs: Tensors, encoded: Color) -> Color:
    """Part what the filter mixed; frames of a batch that none went over stay as they are.

    Args:
        inputs: `describe_filter` and `describe_window`.
        encoded: log lighting, n 3 S*h S*w.
    """
    widths = inputs["filter_width"].flatten().tolist()
    if not any(widths):
        return encoded
    parted = [
        _part_one({name: image[i, None] for name, image in inputs.items()}, encoded[i, None], width)
        for i, width in enumerate(widths)
    ]
    return torch.cat(parted)


def _part_one(inputs: Tensors, encoded: Color, width: float) -> Color:
    """Iterate on one frame."""
    if not width:
        return encoded
    material, k = inputs["surface_material"], inputs["lighting_scale"]
    scale = material.shape[2] // inputs["mask"].shape[2]
    x, y = inputs["place"].flatten().tolist()
    weight = filter_at_samples(material, width, scale, (x, y)).clamp(min=MATERIAL_EPSILON)
    for _ in range(ITERATIONS):
        light = filter_at_samples(decode_lighting(encoded, k) * material, width, scale, (x, y))
        missed = inputs["encoded"] - encode_lighting(light / weight, k)
        samples = describe_samples(inputs, missed)
        nothing = torch.zeros_like(encoded)
        encoded = (encoded + upsample_guided(replace(samples, fallback=nothing))).clamp(min=0.0)
    return encoded
