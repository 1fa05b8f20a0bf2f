"""What ExtraNet sees: past lighting brought to the predicted frame, and that frame's G-buffer.

    current  18   base e 3, second e 3, each times the mask of where it is of the surface 6,
                  normal 3, 1 / (1 + depth) 1, roughness 1, metallic 1
    history  12   of t-5, t-3, t-1: moved e 3, mask 1; all 0 where there is no such frame

The second picture is what t-3, or else t-5, shows of the surface: next to the base, how light
changed, and in many holes what they hide. Elsewhere it is t-1's, holes filled by occlusion vectors.
e = log(1 + q / k) of `past_lighting`, k that of the last rendered frame for all of them. A frame's
radiance is k (exp(e) - 1) * material + emission = (exp(e) - 1) * gain + emission.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import torch
from torch import Tensor

from rtsr_cli.core.choices import DemodulationMode, Preset
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.camera_motion import differs_from_camera, find_camera_motion
from rtsr_cli.core.imaging.derivation import DerivationConfig
from rtsr_cli.core.imaging.frame_motion import (
    chain_motions_of_pixels,
    exposure_ratio,
    find_occlusion_motion_of_pixels,
    sample_motion,
)
from rtsr_cli.core.imaging.surface_history import warp_with_and_without
from rtsr_cli.core.imaging.surfaces import find_moving
from rtsr_cli.core.imaging.warping import warp_pixels
from rtsr_cli.core.lighting.lighting import (
    inverse_depth,
    lighting_scale_of,
    network_normal,
)
from rtsr_cli.core.lighting.past_lighting import (
    LEAST_WEIGHT,
    PastLighting,
    carry_lighting,
    encode_past,
    find_divided,
    find_rendered,
    pack_surfaces,
)
from rtsr_cli.core.shapes import Color, Image, Mask, MotionPx
from rtsr_cli.core.system import FrameWindow, Tensors
from rtsr_cli.models.extranet.config import (
    PLACES,
    ExtraNetConfig,
    ExtraNetSurroundings,
    PastPictures,
    PredictionBase,
)
from rtsr_cli.models.extranet.published import PUBLISHED

PICTURES = tuple(slice(first, first + 3) for first in (0, 3, 6, 9))
NORMAL = slice(12, 15)
"""Channels of `current`."""

HISTORY_PARTS = tuple(slice(first, first + 3) for first in (0, 4, 8))
"""Channels of `history` that are pictures."""

OLDER_MASKS, LAST_MASK = [3, 7], 11
"""Channels of `history` that say where t-5 and t-3, and t-1, are of the surface."""


def look_back(config: ExtraNetConfig, window: FrameWindow) -> PastPictures:
    """`warp-guided`'s lighting as the base; masks by likeness of surfaces."""
    past = carry_lighting(window)
    moved = move_history(window, past)
    second, known = past.carried.values, 1.0 - past.holes
    second = fill_holes_by_occlusion(window, past) if config.occlusion else second * known
    older = [pair for pair in moved[:0:-1] if pair is not None] if config.history else []
    for image, mask in older:
        second = torch.where(mask > 0.5, image, second)
        known = torch.maximum(known, mask)
    return PastPictures(
        base=past.filled if config.base is PredictionBase.GUIDED else warp_lighting(past),
        second=second,
        holes=past.holes,
        second_known=known,
        moved=moved,
    )


SURROUNDINGS: Mapping[Preset, ExtraNetSurroundings] = {
    Preset.RTSR: ExtraNetSurroundings(
        look_back=look_back,
        scale_of=lighting_scale_of,
        show_depth=inverse_depth,
        demodulation=DemodulationMode.BRDF,
    ),
    Preset.PAPER: PUBLISHED,
}
"""What surrounds the layers, by preset."""


@cache
def derivation(config: ExtraNetConfig) -> DerivationConfig:
    """What divides the radiance of a config."""
    return DerivationConfig(mode=SURROUNDINGS[config.preset].demodulation)


def prepare(config: ExtraNetConfig, window: FrameWindow) -> Tensors:
    """`current`, `history`; `hole_mask` 1, `gain` 3 and `emission` 3, to make radiance of e."""
    surroundings, now = SURROUNDINGS[config.preset], window.current
    past, rendered = surroundings.look_back(config, window), window.lr[find_rendered(window)]
    known = past.base * (1.0 - past.holes), past.second * past.second_known
    surfaces = show_surfaces(now, surroundings)
    return {
        "current": torch.cat([past.base, past.second, *known, surfaces], dim=1),
        "history": stack_history(past),
        "hole_mask": past.holes,
        "gain": measure_gain(now, rendered, surroundings.scale_of(rendered)),
        "emission": take_emission(now),
    }


def stack_history(past: PastPictures) -> Image:
    """Oldest first, e and mask of each; 0 of frames that are not there."""
    empty = torch.zeros_like(past.base), torch.zeros_like(past.holes)
    missing = [empty] * (len(PLACES) - len(past.moved))
    pairs = [*missing, *(pair or empty for pair in reversed(past.moved))]
    return torch.cat([part for pair in pairs for part in pair], dim=1)


def show_surfaces(frame: Frame, surroundings: ExtraNetSurroundings) -> Image:
    """Normal 3, depth 1, roughness 1, metallic 1."""
    gbuffer = frame.gbuffer
    parts = (
        network_normal(frame),
        surroundings.show_depth(gbuffer[Buffer.DEPTH]),
        gbuffer[Buffer.ROUGHNESS],
        gbuffer[Buffer.METALLIC],
    )
    return torch.cat(parts, dim=1)


def take_emission(frame: Frame) -> Color:
    """Emission of a frame, 0 where it has none."""
    emission = frame.gbuffer.buffers.get(Buffer.EMISSION)
    return torch.zeros_like(frame.gbuffer[Buffer.MATERIAL]) if emission is None else emission


def measure_gain(now: Frame, rendered: Frame, scale: Tensor) -> Color:
    """Radiance less emission over exp(e) - 1: k, at the current exposure, times the material.

    Where nothing is divided there is no material: 1.
    """
    divided = now.compute_once(find_divided)
    material = torch.where(divided > 0.5, now.gbuffer[Buffer.MATERIAL], 1.0)
    return material * scale * exposure_ratio(now, rendered)


def move_history(window: FrameWindow, past: PastLighting) -> tuple[tuple[Image, Mask] | None, ...]:
    """`PastPictures.moved` by likeness of surfaces."""
    rendered, own = past.rendered, past.own
    scale = lighting_scale_of(rendered)
    moved: list[tuple[Image, Mask] | None] = []
    for place, (motion, moving) in zip(PLACES, find_past_motions(window, past), strict=False):
        then = window.lr[place]
        if Buffer.COLOR not in then.gbuffer:
            moved.append(None)
            continue
        if then is rendered:
            carried, image, mask = past.carried, past.plain, 1.0 - past.holes
        else:
            encoded = encode_past(then, rendered, scale)
            packed = then.compute_once(pack_surfaces)
            carried, image = warp_with_and_without(encoded, motion, own.widen(moving), packed)
            mask = (carried.weight >= LEAST_WEIGHT).to(carried.weight)
        moved.append((image * carried.inside, mask))
    return tuple(moved)


def find_past_motions(window: FrameWindow, past: PastLighting) -> list[tuple[MotionPx, Mask]]:
    """Motion from the current samples to those of the frames at `PLACES`, as far as there are.

    What stands still is where the camera says, hidden in between or not; all else where the
    vectors, composed frame after frame, lead. Beside it 1 where that is not the camera's motion.
    """
    frames, own = window.lr[: PLACES[-1] + 1], past.own
    motion = sample_motion(frames[0], frames[1])
    moving = past.moving if past.rendered is frames[1] else find_moving(own, motion, frames[1])
    stands = (moving < 0.5) & ~own.on_sky
    places = [place for place in PLACES[1:] if place < len(frames)]
    by_camera = {place: find_camera_motion(own.position, frames[place]) for place in places}
    seen = stands
    for camera_px in by_camera.values():
        seen = seen & (False if camera_px is None else camera_px.isfinite().all(1, keepdim=True))
    pixels = (~seen).flatten().nonzero()[:, 0]
    chained = chain_motions_of_pixels(frames, pixels)
    found = [(motion, moving)]
    for place, camera_px in by_camera.items():
        if camera_px is None:
            # then `pixels` are all there are
            found.append((chained[place - 1].view_as(motion), torch.ones_like(moving)))
            continue
        own_camera = camera_px[:, :, None].flatten(3)[..., pixels]
        own_stands = stands.flatten()[pixels]
        followed = torch.where(
            own_stands & own_camera.isfinite(), own_camera, chained[place - 1][None, :, None]
        )
        on_sky = own.on_sky.flatten()[pixels]
        apart = differs_from_camera(followed, own_camera).masked_fill(on_sky, 0.0)
        camera_px.flatten(2)[..., pixels] = followed[:, :, 0]
        by_itself = torch.zeros_like(moving)
        by_itself.flatten()[pixels] = apart.flatten()
        found.append((camera_px, by_itself))
    return found


def warp_lighting(past: PastLighting) -> Image:
    """e of the last rendered frame along the vectors, whatever surface it is of; 0 outside."""
    return past.plain * past.carried.inside


def fill_holes_by_occlusion(window: FrameWindow, past: PastLighting) -> Image:
    """Carried e, and in holes what lay beside the surface that hid them   [Zeng et al. 2021]."""
    pixels = (past.holes > 0.5).flatten().nonzero()[:, 0]
    vectors = find_occlusion_motion_of_pixels(window.lr[:2], past.motion_px, pixels)
    filled = past.carried.values.clone()
    filled[0].flatten(1)[:, pixels] = warp_pixels(past.encoded, vectors, pixels)
    return filled
