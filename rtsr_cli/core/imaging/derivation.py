"""Buffers that follow from others: view cosine, sky, material term, lighting.

One table says what each derived buffer is made of; what to read and what is missing both
follow from it, so that `systems`, the loader and the refusals never disagree.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import torch

from rtsr_cli.core.choices import MATERIAL_EPSILON, MOST_MATERIAL, DemodulationMode, LutConvention
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging import demodulation as dm
from rtsr_cli.core.imaging.brdf_lut import load_default_lut
from rtsr_cli.core.imaging.derived_geometry import derive_nov, derive_sky, derive_view_normal
from rtsr_cli.core.imaging.row_strips import cut_frame
from rtsr_cli.core.shapes import Color, Mask

STRIP_PIXELS = 1 << 16
"""Pixels that are derived at a time: a colour of 768 KiB, so that what it is made of stays near."""

CAMERA = "camera"
"""Pseudo-requirement: matrices in the header, in a side-car, or recoverable from buffers."""


@dataclass(frozen=True, kw_only=True)
class DerivationConfig:
    """What divides radiance.

    Attributes:
        mode: divisor.
        lut: convention of the split-sum table.
        epsilon: smallest divisor of masked demodulation.
    """

    mode: DemodulationMode = DemodulationMode.BRDF
    lut: LutConvention = LutConvention.KARIS
    epsilon: float = MATERIAL_EPSILON

    @cached_property
    def has_emission(self) -> bool:
        """Tell whether emission is taken out of the radiance before it is divided."""
        return self.mode not in (DemodulationMode.SOFTPLUS, DemodulationMode.NONE)


Alternatives = tuple[tuple[Buffer | str, ...], ...]

_BRDF_PARTS: tuple[Buffer, ...] = (Buffer.ALBEDO, Buffer.METALLIC, Buffer.ROUGHNESS, Buffer.NOV)

_F0_PARTS: tuple[Buffer, ...] = (Buffer.ALBEDO, Buffer.SPECULAR, Buffer.ROUGHNESS, Buffer.NOV)

_MATERIAL_PARTS: dict[DemodulationMode, Alternatives] = {
    DemodulationMode.BRDF: ((Buffer.MATERIAL,), _BRDF_PARTS, _F0_PARTS),
    DemodulationMode.SOFTPLUS: ((Buffer.MATERIAL,), _BRDF_PARTS, _F0_PARTS),
    DemodulationMode.ALBEDO: ((Buffer.ALBEDO,),),
    DemodulationMode.GLOSSY_ALBEDO: ((Buffer.ALBEDO, Buffer.METALLIC),),
    DemodulationMode.NONE: ((),),
}

_LIGHTING_PARTS: Alternatives = (
    (Buffer.LIGHTING, Buffer.MATERIAL, Buffer.SKY),
    (Buffer.COLOR, Buffer.MATERIAL, Buffer.SKY),
)
"""Lighting that files hold is divided already: no use where nothing is to be divided."""

_OPTIONAL_PARTS: dict[Buffer, tuple[Buffer, ...]] = {
    Buffer.MATERIAL: (Buffer.SPECULAR,),
    Buffer.LIGHTING: (Buffer.EMISSION, Buffer.LIGHTING_MASK),
    Buffer.SKY: (Buffer.DEPTH, Buffer.NORMAL),
}
"""Parts that change the result where they are there, and are not missed where they are not."""


def list_alternatives(buffer: Buffer, config: DerivationConfig) -> Alternatives:
    """Sets of parts that each suffice to make a buffer, best first; empty if it is only stored."""
    parts: dict[Buffer, Alternatives] = {
        Buffer.NOV: (
            (Buffer.NOV,),
            (Buffer.NORMAL, CAMERA),
            (Buffer.NORMAL, Buffer.POSITION, Buffer.DEPTH),
        ),
        Buffer.VIEW_NORMAL: ((Buffer.VIEW_NORMAL,), (Buffer.NORMAL, CAMERA)),
        Buffer.SKY: ((),),
        Buffer.ALBEDO: ((Buffer.ALBEDO,),),
        Buffer.MATERIAL: _MATERIAL_PARTS[config.mode],
        Buffer.LIGHTING: _LIGHTING_PARTS[config.mode is DemodulationMode.NONE :],
        Buffer.LIGHTING_MASK: ((Buffer.LIGHTING,),),
    }
    return parts.get(buffer, ())


@dataclass(frozen=True)
class BufferNeeds:
    """Buffers to read from files, and what is missing for the rest (empty = nothing)."""

    read: frozenset[Buffer]
    missing: tuple[str, ...]


def resolve_needs(
    wanted: Iterable[Buffer],
    stored: Collection[Buffer],
    *,
    has_camera: bool,
    config: DerivationConfig,
) -> BufferNeeds:
    """Resolve wanted buffers down to stored ones.

    Args:
        wanted: buffers a system asks for, stored or derived.
        stored: buffers the files hold.
        has_camera: whether every frame has camera matrices.
        config: what divides radiance.
    """
    return _resolve_needs(tuple(wanted), frozenset(stored), has_camera, config)


@lru_cache(maxsize=1024)
def _resolve_needs(
    wanted: tuple[Buffer, ...],
    stored: frozenset[Buffer],
    has_camera: bool,
    config: DerivationConfig,
) -> BufferNeeds:
    read: set[Buffer] = set()
    missing: list[str] = []
    for buffer in wanted:
        result = _resolve(buffer, stored, has_camera, config)
        read |= result.read
        missing += [m for m in result.missing if m not in missing]
    return BufferNeeds(frozenset(read), tuple(missing))


def _resolve(
    part: Buffer | str, stored: frozenset[Buffer], has_camera: bool, config: DerivationConfig
) -> BufferNeeds:
    if part == CAMERA:
        return BufferNeeds(frozenset(), () if has_camera else (CAMERA,))
    buffer = Buffer(part)
    options = list_alternatives(buffer, config)
    if not options:
        held = buffer in stored
        return BufferNeeds(frozenset({buffer} if held else ()), () if held else (buffer.value,))
    # what a missing buffer could be made of helps a user more than its own name does
    makable = tuple(o for o in options if buffer in stored or buffer not in o) or options
    results = [_resolve_all(buffer, option, stored, has_camera, config) for option in makable]
    return min(results, key=lambda result: len(result.missing))


def _resolve_all(
    buffer: Buffer,
    option: tuple[Buffer | str, ...],
    stored: frozenset[Buffer],
    has_camera: bool,
    config: DerivationConfig,
) -> BufferNeeds:
    optional = _OPTIONAL_PARTS.get(buffer, ())
    if buffer is Buffer.ALBEDO and Buffer.SPECULAR in stored:
        # without metallic, what is stored is the diffuse colour
        optional = (Buffer.SPECULAR, Buffer.METALLIC)
    read = {part for part in optional if part in stored}
    missing: list[str] = []
    for part in option:
        if part == buffer:
            held = buffer in stored
            read |= {buffer} if held else set()
            missing += [] if held else [buffer.value]
            continue
        result = _resolve(part, stored, has_camera, config)
        read |= result.read
        missing += result.missing
    return BufferNeeds(frozenset(read), tuple(missing))


def derive_material(frame: Frame, config: DerivationConfig) -> Color:
    """Return the divisor of a mode; NaN buffers give NaN material, which is never divided by.

    What is above `MOST_MATERIAL` is no share that a surface reflects, and counts as that much.
    Works in strips of rows: every intermediate stays in the cache, and memory at the result's.
    """
    strips = [
        _material_term(strip, config).clamp(max=MOST_MATERIAL)
        for _, strip in cut_frame(frame, STRIP_PIXELS)
    ]
    return strips[0] if len(strips) == 1 else torch.cat(strips, dim=2)


def _material_term(frame: Frame, config: DerivationConfig) -> Color:
    gbuffer = frame.gbuffer
    if config.mode is DemodulationMode.NONE:
        return torch.ones(1, 3, *gbuffer.size, device=gbuffer.device)
    if config.mode is DemodulationMode.ALBEDO:
        named = _name_surfaces(gbuffer, (Buffer.ALBEDO,))
        return dm.floor_material(named.get(Buffer.ALBEDO, gbuffer[Buffer.ALBEDO]))
    if config.mode is DemodulationMode.GLOSSY_ALBEDO:
        f0 = _f0(gbuffer)
        glossy = dm.glossy_albedo(gbuffer[Buffer.ALBEDO], f0, gbuffer[Buffer.METALLIC])
        return dm.floor_material(glossy)
    material = _brdf(frame, config)
    return dm.soften_material(material) if config.mode is DemodulationMode.SOFTPLUS else material


def _f0(gbuffer: GBuffer) -> Color:
    if Buffer.SPECULAR in gbuffer:
        return gbuffer[Buffer.SPECULAR]
    return dm.specular_f0(gbuffer[Buffer.ALBEDO], gbuffer[Buffer.METALLIC])


def _name_surfaces(gbuffer: GBuffer, wanted: Collection[Buffer]) -> dict[Buffer, torch.Tensor]:
    """Base colour and metallic of diffuse colour and F0, unless F0 is wanted as it is stored."""
    held = gbuffer.keys() & {Buffer.ALBEDO, Buffer.SPECULAR, Buffer.METALLIC}
    if held != {Buffer.ALBEDO, Buffer.SPECULAR} or held & set(wanted) != {Buffer.ALBEDO}:
        return {}
    base, metallic = dm.find_base_color(gbuffer[Buffer.ALBEDO], gbuffer[Buffer.SPECULAR])
    return {Buffer.ALBEDO: base, Buffer.METALLIC: metallic}


def _brdf(frame: Frame, config: DerivationConfig) -> Color:
    gbuffer = frame.gbuffer
    if Buffer.MATERIAL in gbuffer:
        return gbuffer[Buffer.MATERIAL]
    if Buffer.SPECULAR not in gbuffer:
        return dm.metallic_material_term(
            gbuffer[Buffer.ALBEDO],
            metallic=gbuffer[Buffer.METALLIC],
            roughness=gbuffer[Buffer.ROUGHNESS],
            nov=derive_nov(frame),
            lut=load_default_lut(config.lut),
        )
    none = torch.zeros_like(gbuffer[Buffer.ROUGHNESS])
    return dm.material_term(
        gbuffer[Buffer.ALBEDO],
        gbuffer[Buffer.SPECULAR],
        metallic=gbuffer.buffers.get(Buffer.METALLIC, none),
        roughness=gbuffer[Buffer.ROUGHNESS],
        nov=derive_nov(frame),
        lut=load_default_lut(config.lut),
    )


def derive_lighting(frame: Frame, config: DerivationConfig) -> dm.Demodulated:
    """Divide a frame's radiance; lighting that the file already holds is taken as it is."""
    sky = derive_sky(frame.gbuffer)
    return divide_radiance(frame.gbuffer, derive_material(frame, config), sky, config)


def divide_radiance(
    gbuffer: GBuffer, material: Color, sky: Mask, config: DerivationConfig
) -> dm.Demodulated:
    """Divide by a material term, but where the sky is; a softened one divides there, too."""
    if config.mode is DemodulationMode.SOFTPLUS:
        sky = torch.zeros_like(material[:, :1])
    emission = gbuffer.buffers.get(Buffer.EMISSION) if config.has_emission else None
    if Buffer.LIGHTING in gbuffer:
        valid = (material > config.epsilon).all(1, keepdim=True) & (sky < 0.5)
        if Buffer.LIGHTING_MASK in gbuffer:
            valid &= gbuffer[Buffer.LIGHTING_MASK] > 0.5
        return dm.Demodulated(
            lighting=gbuffer[Buffer.LIGHTING],
            material=torch.where(valid, material, torch.ones_like(material)),
            mask=valid.to(material.dtype),
            emission=emission,
        )
    return dm.demodulate(
        gbuffer[Buffer.COLOR], material, sky=sky, emission=emission, epsilon=config.epsilon
    )


def derive(
    frame: Frame,
    wanted: Collection[Buffer],
    config: DerivationConfig,
    *,
    lighting_scale: float | None = None,
) -> Frame:
    """Add the derived buffers among `wanted`, keep only `wanted`, set the lighting scale.

    Metallic comes with a base colour that was found from diffuse colour and F0.
    `lighting_scale` is that of the whole frame where `frame` is a part of it, else measured.
    """
    added: dict[Buffer, torch.Tensor] = {}
    scale = frame.lighting_scale
    if Buffer.SKY in wanted:
        added[Buffer.SKY] = derive_sky(frame.gbuffer)
    if Buffer.NOV in wanted:
        added[Buffer.NOV] = derive_nov(frame)
    if Buffer.VIEW_NORMAL in wanted:
        added[Buffer.VIEW_NORMAL] = derive_view_normal(frame)
    if Buffer.LIGHTING in wanted or Buffer.LIGHTING_MASK in wanted:
        parts = derive_lighting(frame, config)
        added[Buffer.LIGHTING], added[Buffer.LIGHTING_MASK] = parts.lighting, parts.mask
        if Buffer.MATERIAL in wanted:
            added[Buffer.MATERIAL] = parts.material
        scale = lighting_scale or dm.lighting_scale(parts.lighting, parts.mask)
    elif Buffer.MATERIAL in wanted:
        added[Buffer.MATERIAL] = derive_material(frame, config)
    named = _name_surfaces(frame.gbuffer, wanted)
    gbuffer = frame.gbuffer.with_buffers({**added, **named}).only({*wanted, *named})
    return replace(frame, gbuffer=gbuffer, lighting_scale=scale)
