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

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.resampling import filter_at_samples
from rtsr_cli.core.shapes import Color, Image
from rtsr_cli.core.system import FrameWindow

MOST_SKY = 0.02
"""Share of the sky within the filter from which radiance is no surface's."""


def match_filter(window: FrameWindow) -> FrameWindow:
    """Return the window with lighting divided by material that was filtered as radiance is.

    The window itself where radiance is point-sampled.
    """
    frame = window.current
    if not frame.filter_width_px:
        return window
    gbuffer, hr = frame.gbuffer, window.require_hr().gbuffer

    def filtered(image: Image) -> Image:
        return filter_at_samples(image, frame.filter_width_px, window.scale, frame.camera.jitter_px)

    surface = 1.0 - hr[Buffer.SKY]
    material, sky = filtered(hr[Buffer.MATERIAL] * surface), filtered(hr[Buffer.SKY])
    radiance: Color = gbuffer[Buffer.COLOR]
    if Buffer.EMISSION in hr:
        radiance = (radiance - filtered(hr[Buffer.EMISSION])).clamp(min=0.0)
    divided = (material > MATERIAL_EPSILON).all(1, keepdim=True) & (sky < MOST_SKY)
    divided &= gbuffer[Buffer.LIGHTING_MASK] > 0.5
    lighting = torch.where(divided, radiance / material.clamp(min=MATERIAL_EPSILON), 0.0)
    matched = gbuffer.with_buffers(
        {Buffer.LIGHTING: lighting, Buffer.LIGHTING_MASK: divided.to(lighting)}
    )
    return replace(window, lr=(replace(frame, gbuffer=matched), *window.lr[1:]))
