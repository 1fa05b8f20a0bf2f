"""Radiance that no lighting explains: the sky, and surfaces whose material cannot carry it.

    image(p) = enlarged sky(p)                      where p is sky
    image(p) = bicubic(p)                           where p is undivided
    image(p) = lighting(p) material(p) + emission(p)        elsewhere

An HR pixel is undivided where its material is not above epsilon in every channel, or where LR
samples around it gave no lighting though its material is right (theirs is not, or is no number).
It is the very pixel that `bicubic` writes, so that it is never further from the truth than that;
only where a lamp shines, and next to nothing else does, is it the HR emission, with what little
other radiance there is enlarged.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.imaging.alignment import block_shift, shift_image
from rtsr_cli.core.imaging.enlargement import enlarge_masked_radiance, enlarge_radiance
from rtsr_cli.core.imaging.guided_kernel import REACH
from rtsr_cli.core.imaging.mask_groups import keep_groups
from rtsr_cli.core.imaging.resampling import sample_at_lr, upsample_nearest
from rtsr_cli.core.shapes import Color, Mask, Plane
from rtsr_cli.core.system import FrameWindow

SKY_MARGIN_PX = 6
"""LR rows around the sky that its enlargement sees: cubic 2 and jitter 1, highlights 2, and one."""

FAINT = 4.0
"""Material of so many times epsilon carries no radiance where samples beside it are undivided."""

EMISSION_SHARE = 0.5
"""Where emission is less of the enlarged radiance, it is enlarged with the rest of it: surfaces
beside a lamp are bright, though they do not shine."""

LIT_SHARE = 0.1
"""Other light of undivided samples, as a share of emission, up to which that is all there is."""

LOST_REACH = 2 * REACH
"""LR pixels to each side in which a sample without lighting makes an HR pixel undivided."""

BEFORE = 1.1
"""Ratio of depths from which a thing is before another one."""

HALO_PX = LOST_REACH + 4
"""LR pixels that undivided radiance depends on: those samples, their neighbours, HR material around
them, jitter."""


def add_radiance(window: FrameWindow, image: Color) -> Color:
    """Put the sky into the image, and return it, or another with undivided surfaces in it."""
    return add_undivided(window, add_sky(window, image))


def add_sky(window: FrameWindow, image: Color) -> Color:
    """Put the enlarged LR sky into the image where the HR depth says sky, and return it."""
    frame, scale = window.current, window.scale
    hr_sky = window.require_hr().gbuffer[Buffer.SKY] > 0.5
    rows = hr_sky.flatten(0, 1).any(0).any(1).nonzero()
    if not len(rows):
        return image
    first, last = int(rows[0]) // scale, int(rows[-1]) // scale + 1
    top, bottom = max(0, first - SKY_MARGIN_PX), min(frame.size[0], last + SKY_MARGIN_PX)
    color, sky = (frame.gbuffer[b][:, :, top:bottom] for b in (Buffer.COLOR, Buffer.SKY))
    seen = slice((first - top) * scale, (last - top) * scale)
    changed = slice(first * scale, last * scale)
    wanted = hr_sky[:, :, top * scale : bottom * scale]
    enlarged = enlarge_masked_radiance(color, sky, scale, frame.camera.jitter_px, wanted=wanted)
    band = image[:, :, changed]
    band.copy_(torch.where(hr_sky[:, :, changed], enlarged[:, :, seen], band))
    return image


def add_undivided(window: FrameWindow, image: Color) -> Color:
    """Put the enlarged LR radiance where lighting times material cannot be the picture."""
    undivided = window.compute_once(find_undivided)
    if undivided is None:
        return image
    color, (scale, jitter_px) = window.current.gbuffer[Buffer.COLOR], _sampling(window)
    whole = enlarge_radiance(color, scale, jitter_px)
    emission = window.require_hr().gbuffer.buffers.get(Buffer.EMISSION)
    if emission is None:
        return torch.where(undivided, whole, image)
    reflected, added = _part_emission(window, emission)
    shines = (emission > EMISSION_SHARE * whole).any(1, keepdim=True)
    shines = undivided & (shines | _find_lamps(window, reflected, added, emission))
    image = torch.where(undivided, whole, image)
    if not bool(shines.any()):
        return image
    return torch.where(shines, enlarge_radiance(reflected, scale, jitter_px) + emission, image)


def _sampling(window: FrameWindow) -> tuple[int, Jitter]:
    return window.scale, window.current.camera.jitter_px


def find_unexplained(window: FrameWindow) -> Mask | None:
    """True where an HR pixel has no lighting, and that is a fault; None where it is none.

    What `find_undivided` finds, less lamps, whose emission is their radiance, and less what has no
    material at either size and is as dark as that says.
    """
    undivided = window.compute_once(find_undivided)
    if undivided is None:
        return None
    explained = find_explained(window)
    unlit = (window.current.gbuffer[Buffer.LIGHTING_MASK] < 0.5) & ~_is_sky(window)
    known = _spread(explained, REACH) & ~_spread(unlit & ~explained, REACH)
    bare = (window.require_hr().gbuffer[Buffer.MATERIAL] <= MATERIAL_EPSILON).any(1, keepdim=True)
    left = undivided & ~(bare & upsample_nearest(known, window.scale))
    return left if bool(left.any()) else None


def find_explained(window: FrameWindow) -> Mask:
    """True at samples that were not divided, and give no other light than their emission.

        max(radiance - emission, 0) <= max(LIT_SHARE emission, epsilon k)

    of the brightest channels, with the scale k of the frame's lighting: no material reflects less.
    """
    frame = window.current
    emission = window.require_hr().gbuffer.buffers.get(Buffer.EMISSION)
    if emission is None:
        reflected, added = frame.gbuffer[Buffer.COLOR], torch.zeros_like(frame.gbuffer[Buffer.SKY])
    else:
        reflected, added = _part_emission(window, emission)
    other, own = (light.amax(1, keepdim=True) for light in (reflected, added))
    unlit = (frame.gbuffer[Buffer.LIGHTING_MASK] < 0.5) & ~_is_sky(window)
    dark = other <= (LIT_SHARE * own).clamp(min=MATERIAL_EPSILON * frame.lighting_scale)
    return unlit & dark


def _is_sky(window: FrameWindow) -> Mask:
    return window.current.gbuffer[Buffer.SKY] > 0.5


def measure_undivided(window: FrameWindow) -> float:
    """Share of the HR pixels whose radiance is enlarged since nothing was divided there, 0..1.

    Lamps are none of them: their emission is their radiance.
    """
    known = window.hr is not None and Buffer.MATERIAL in window.hr.gbuffer
    if not known or Buffer.LIGHTING_MASK not in window.current.gbuffer:
        return 0.0
    left = window.compute_once(find_unexplained)
    return 0.0 if left is None else float(left.sum()) / left.numel()


def find_undivided(window: FrameWindow) -> Mask | None:
    """True where an HR pixel is no sky and has no lighting; None where all have."""
    gbuffer, frame = window.require_hr().gbuffer, window.current.gbuffer
    material = gbuffer[Buffer.MATERIAL]
    faintest: Plane | None = None
    empty: Mask | None = None
    # one fast pass tells most frames; of NaN it is NaN
    if not float(material.amin()) > MATERIAL_EPSILON:
        faintest = material.amin(1, keepdim=True)
        found = ~(faintest > MATERIAL_EPSILON) & (gbuffer[Buffer.SKY] < 0.5)
        empty = found if bool(found.any()) else None
    unlit = (frame[Buffer.LIGHTING_MASK] < 0.5) & (frame[Buffer.SKY] < 0.5)
    if not bool(unlit.any()):
        return empty
    faintest = material.amin(1, keepdim=True) if faintest is None else faintest
    lost = _find_lost(window, faintest, unlit)
    if empty is None or lost is None:
        return lost if empty is None else empty
    return empty | lost


def _find_lost(window: FrameWindow, faintest: Plane, unlit: Mask) -> Mask | None:
    """True where HR material carries radiance, but samples around gave no lighting.

    A sample counts for that if HR material is right all around it: else it lies on a surface that
    has none at either size, and those beside it have samples of their own. It takes 2 x 2 of them:
    single ones, and rows, lie on what is finer than HR pixels. Beside faint material
    every sample counts: whether it was divided is chance there.
    """
    surface = window.require_hr().gbuffer[Buffer.SKY] < 0.5
    usable = surface & (faintest > MATERIAL_EPSILON)
    wrong = keep_groups(unlit & ~_at_samples(window, _spread(surface & ~usable, 1)))
    faint = usable & (faintest <= FAINT * MATERIAL_EPSILON)
    lost = usable & upsample_nearest(_spread(wrong, LOST_REACH), window.scale)
    lost |= faint & upsample_nearest(_spread(unlit, REACH), window.scale)
    return lost if bool(lost.any()) else None


def _spread(mask: Mask, reach: int) -> Mask:
    """True where any pixel of the square around is."""
    side = 2 * reach + 1
    return F.max_pool2d(mask.float(), side, stride=1, padding=reach) > 0.5


def _at_samples(window: FrameWindow, mask: Mask) -> Mask:
    """HR pixels that LR samples lie in, at the LR size."""
    scale = window.scale
    shift = block_shift(window.current.camera.jitter_px, scale)
    return shift_image(mask, shift)[..., scale // 2 :: scale, scale // 2 :: scale]


def _part_emission(window: FrameWindow, hr_emission: Color) -> tuple[Color, Color]:
    """LR radiance less its emission, and that: what the HR emission would add to it again."""
    buffers = window.current.gbuffer.buffers
    emission = buffers.get(Buffer.EMISSION)
    if emission is None:
        emission = sample_at_lr(hr_emission, *_sampling(window))
    emission = emission.clamp(min=0.0)
    return (buffers[Buffer.COLOR] - emission).clamp_(min=0.0), emission


def _find_lamps(window: FrameWindow, reflected: Color, emission: Color, hr_emission: Color) -> Mask:
    """True where the undivided samples around give next to no other light than emission.

    HR pixels that do not shine are parts of lamps only where no sample around was divided: else
    they may be of the lit surface beside, whose material is lost at HR.
    """
    frame, scale = window.current.gbuffer, window.scale
    surface, divided = frame[Buffer.SKY] < 0.5, frame[Buffer.LIGHTING_MASK] > 0.5
    other, own = (
        F.max_pool2d((light * (surface & ~divided)).amax(1, keepdim=True), 2 * REACH + 1, 1, REACH)
        for light in (reflected, emission)
    )
    lamps = (own > 0.0) & (other <= LIT_SHARE * own)
    shining = (hr_emission > 0.0).any(1, keepdim=True)
    apart = upsample_nearest(_spread(divided & surface, REACH), scale)
    if Buffer.DEPTH in frame and Buffer.DEPTH in window.require_hr().gbuffer:
        apart |= _is_before(window, (emission > 0.0).any(1, keepdim=True) & surface)
    return upsample_nearest(lamps, scale) & (shining | ~apart)


def _is_before(window: FrameWindow, lamps: Mask) -> Mask:
    """True at HR pixels that are nearer than all samples of lamps around."""
    depth = window.current.gbuffer[Buffer.DEPTH].masked_fill(~lamps, torch.inf)
    nearest = -F.max_pool2d(-depth, 2 * REACH + 1, 1, REACH)
    own = window.require_hr().gbuffer[Buffer.DEPTH]
    return own * BEFORE < upsample_nearest(nearest, window.scale)
