"""Surfaces far too bright for their material: it is not what their light was multiplied by.

    sample q outshines  <=>  in a channel  m(q) <= TINY  and  L(q) > OUTSHINES k
                        or m(q) is what a base colour of 0 leaves  and  L(q) > OUTSHINES k

with the material m, the lighting L = (radiance - emission) / max(m, epsilon), and k the middle of
the frame's lighting (`demodulation.lighting_scale`). A gold sphere whose base colour is 0 is one:
its divisor is 0, or the remainder of a specular term, which changes a hundredfold over a few
pixels, while its radiance does not.

Groups of such samples carry no lighting, nor do dark ones around them: all are left undivided, and
dark HR pixels around have no material either, so that radiance is enlarged there. Dark is what is
so in all channels, or as good as 0 in one: a wall of a saturated colour keeps its lighting. So does
metal of one, whose edges shine in all: samples that hang together with a group go with it while

    in a channel c  m_c(q) <= DARK  and  L_c(q) > BESIDE k  and  L_c(q) > COLOURED L_d(q)

in another one, d: light that is bright in all channels alike falls on surfaces beside lamps. No
group begins with those: lamps that dark glossy surfaces mirror look the same. What else has no base
colour goes with a group of those that have none, however bright it is.

Thin things hold no groups. Where enough samples without a base colour outshine it, all that has
none is asked for by vote: it is lost where most such samples at its depth around are too bright.
Where HR has the colour that LR lost, such samples and HR pixels of their surface go together.
"""

from __future__ import annotations

from itertools import product

import torch
import torch.nn.functional as F

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.demodulation import lighting_scale
from rtsr_cli.core.imaging.guided_kernel import REACH as KERNEL_REACH
from rtsr_cli.core.imaging.mask_groups import spread_mask
from rtsr_cli.core.imaging.resampling import upsample_nearest
from rtsr_cli.core.pairs.held_samples import HeldSamples, is_colourless
from rtsr_cli.core.pairs.material_removal import leave_bare, leave_undivided
from rtsr_cli.core.pairs.straying_groups import count_least
from rtsr_cli.core.pairs.surface_reach import APART, mark_surfaces
from rtsr_cli.core.shapes import Mask

TOO_BRIGHT = (
    "radiance is far too bright for its material (base colour or metal missing, or a black "
    "surface that mirrors lights, which is right so?)"
)
"""What is said of those surfaces."""

TINY = 4.0 * MATERIAL_EPSILON
"""Divisors up to here are doubted: every renderer's dielectrics have more, but for glossy edges."""

OUTSHINES = 8.0
"""Lighting of so many times the middle of the frame's is none that falls on all surfaces."""

BESIDE = 4.0
"""The same, of samples that hang together with ones that outshine their material for sure."""

COLOURED = 2.0
"""How many times more lighting one channel has than another where the material of the one is lost;
of lamps on surfaces that are grey, or nearly so, both are alike."""

STEP, MOST_STEPS = 2, 32
"""LR pixels to each side in which samples hang together, and how often that is followed."""

FAINT = 4.0 * TINY
"""In a channel, of HR pixels beside a group: of walls of a saturated colour each has more."""

DARK = 0.25
"""Material up to here in all channels is of the same surface, seen at another angle."""

GLARES = 4.0 * OUTSHINES
"""Lighting of single samples that is left out; highlights on dark surfaces have less."""

GROUP_REACH, LEAST_GROUP = 2, 0.2
"""A share of the 5 x 5 samples around: single highlights on dark surfaces are no group."""

LOST_REACH = 2 * KERNEL_REACH
"""LR pixels to each side of a sample in which dark surfaces are doubted with it."""


def leave_outshining(
    lr: Frame, hr: Frame, scale: int, known: Mask | None = None
) -> tuple[Frame, Frame]:
    """Take material out of both frames where radiance is far too bright for it.

    Args:
        lr: with sky, material, lighting and its mask.
        hr: with material.
        scale: S.
        known: True at samples that are left undivided for another reason.

    Returns:
        The frames: those samples are undivided, and HR's material is 0 around them where it is
        dark; the very frames where there are none.
    """
    bright = _find_bright(lr, known)
    bare = is_colourless(lr.gbuffer) & (lr.gbuffer[Buffer.SKY] < 0.5)
    outshines = _keep_shares(bright)
    thin = int((bare & bright).sum()) >= count_least(bare)
    lr = leave_glaring(lr)
    if outshines is None and not thin:
        return lr, hr
    group = torch.zeros_like(bare) if outshines is None else _follow(outshines, lr)
    asked = lr, bare, bare & (group | bright)
    divided = lr.gbuffer[Buffer.LIGHTING_MASK] > 0.5
    # at edges HR pixels of the thing lie beside samples that see what is behind it
    bare_hr = is_colourless(hr.gbuffer) & (hr.gbuffer[Buffer.SKY] < 0.5)
    lost = bare_hr & upsample_nearest(spread_mask(group, LOST_REACH), scale)
    lost |= _find_missing(hr, bare_hr, *asked)
    doubted = _find_missing(lr, bare, *asked) & divided
    if outshines is not None:
        around, material = spread_mask(outshines, LOST_REACH), hr.gbuffer[Buffer.MATERIAL]
        dark = around & divided & _is_dark(lr.gbuffer[Buffer.MATERIAL])
        further = group & divided & ~dark
        doubted |= dark | further
        lost |= upsample_nearest(around, scale) & _is_dark(material)
        for samples, most in ((group, FAINT), (further, DARK)):
            beside = upsample_nearest(spread_mask(samples, 1), scale)
            lost |= beside & (material.amin(1, keepdim=True) <= most)
    return leave_undivided(lr, doubted), leave_bare(lr, hr, lost, scale)


def leave_colour_lost_at_lr(held: HeldSamples) -> tuple[Frame, Frame, Mask | None]:
    """Take material out of both frames where LR alone lost a base colour, of thin things as well.

    Its samples have none and are too bright for that, and HR pixels of their surface have one. Such
    samples that lie in pixels of what is behind them are held to be of the same material.

    Args:
        held: samples, of LR frames whose radiance was divided.

    Returns:
        The frames, and True at those samples; the very frames and None where there are too few.
    """
    lr, hr = held.lr, held.hr
    bare, bare_hr = held.bare
    gone = bare & (lr.gbuffer[Buffer.SKY] < 0.5)
    least = count_least(gone)
    if int(gone.sum()) < least:
        return lr, hr, None
    bright = gone & _find_bright(lr, None)
    gone = bright & held.place(~bare_hr & (hr.gbuffer[Buffer.SKY] < 0.5))
    if Buffer.DEPTH in lr.gbuffer and Buffer.DEPTH in hr.gbuffer:
        own, other = lr.gbuffer[Buffer.DEPTH], held.place(hr.gbuffer[Buffer.DEPTH])
        gone &= (own - other).abs() <= APART * torch.minimum(own, other)
    if int(gone.sum()) < least:
        return lr, hr, None
    left = leave_undivided(lr, bright)
    of_pixels = held.placed[gone.expand_as(held.placed)].view(3, -1)
    placed = torch.where(gone, held.placed, of_pixels.median(1).values.view(1, 3, 1, 1))
    lost = mark_surfaces(left, hr, placed, bright, held.scale)
    return left, leave_bare(left, hr, lost, held.scale), bright


def find_outshining(lr: Frame, known: Mask | None = None) -> Mask | None:
    """True at LR samples that outshine their material, in groups; None where none do.

    Args:
        lr: with sky, material, lighting and its mask.
        known: True at samples that are left undivided for another reason.
    """
    return _keep_shares(_find_bright(lr, known))


def _find_bright(lr: Frame, known: Mask | None) -> Mask:
    """True at LR samples that outshine their material, single ones as well."""
    gbuffer = lr.gbuffer
    most, lighting = OUTSHINES * lr.lighting_scale, gbuffer[Buffer.LIGHTING]
    divided = gbuffer[Buffer.LIGHTING_MASK] > 0.5
    surface = gbuffer[Buffer.SKY] < 0.5
    lit = divided & _is_doubtful(lr) & (lighting > most)
    # lighting of what was not divided is its radiance
    unlit = ~divided & (lighting > most * MATERIAL_EPSILON)
    colourless = is_colourless(gbuffer)
    if bool(colourless.any()):
        lit |= divided & colourless & (lighting > OUTSHINES * _scale_beside(lr, colourless))
    found = surface & (lit | unlit).any(1, keepdim=True)
    return found if known is None else found & ~known


def _keep_shares(found: Mask) -> Mask | None:
    """Keep those that are `LEAST_GROUP` of the samples around; None where none are."""
    if not bool(found.any()):
        return None
    side = 2 * GROUP_REACH + 1
    share = F.avg_pool2d(found.float(), side, 1, GROUP_REACH, count_include_pad=False)
    found = found & (share > LEAST_GROUP - 1e-6)
    return found if bool(found.any()) else None


def _find_missing(pixels: Frame, where: Mask, lr: Frame, bare: Mask, bright: Mask) -> Mask:
    """True at pixels without base colour where it is missing, by most samples around without one.

    Those at the pixel's depth are asked, as far as it is known; where there are none it is missing
    if it is anywhere.

    Args:
        pixels: a frame of LR's size, or a multiple.
        where: its pixels without a base colour.
        lr: with depth where it is there.
        bare: samples without a base colour.
        bright: those of them that are too bright for that.
    """
    rows, columns = where[0, 0].nonzero().T
    count, votes = (torch.zeros(len(rows), dtype=torch.int32) for _ in range(2))
    height, width = bare.shape[-2:]
    scale = where.shape[-1] // width
    depths = [frame.gbuffer.buffers.get(Buffer.DEPTH) for frame in (pixels, lr)]
    steps = range(-LOST_REACH, LOST_REACH + 1)
    for down, across in product(steps, steps):
        y, x = rows // scale + down, columns // scale + across
        inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
        y, x = y.clamp(0, height - 1), x.clamp(0, width - 1)
        asked = inside & bare[0, 0, y, x]
        if depths[0] is not None and depths[1] is not None:
            own, other = depths[0][0, 0, rows, columns], depths[1][0, 0, y, x]
            asked &= (own - other).abs() <= APART * torch.minimum(own, other)
        count += asked
        votes += asked & bright[0, 0, y, x]
    most = int(bright.sum()) > min(count_least(bare), 0.5 * int(bare.sum()))
    missing = torch.zeros_like(where)
    missing[0, 0, rows, columns] = (2 * votes > count) | ((count == 0) & most)
    return missing


def leave_glaring(lr: Frame) -> Frame:
    """Leave single samples undivided that hardly any material makes as bright as lamps.

    One would light all pixels around; HR pixels keep their material, and take the light of the
    other samples.
    """
    gbuffer = lr.gbuffer
    faint = _is_doubtful(lr) | is_colourless(gbuffer)
    glares = faint & (gbuffer[Buffer.LIGHTING] > GLARES * lr.lighting_scale)
    glares = glares.any(1, keepdim=True) & (gbuffer[Buffer.LIGHTING_MASK] > 0.5)
    return leave_undivided(lr, glares) if bool(glares.any()) else lr


def _is_doubtful(lr: Frame) -> torch.Tensor:
    """Tiny channels that have more light than what is solid of them has; of that they are lit."""
    material, lighting = lr.gbuffer[Buffer.MATERIAL], lr.gbuffer[Buffer.LIGHTING]
    tiny = material <= TINY
    solid = lighting.masked_fill(tiny, 0.0).amax(1, keepdim=True)
    return tiny & (lighting > COLOURED * solid)


def _scale_beside(lr: Frame, colourless: Mask) -> float:
    """The middle of the lighting of all other surfaces; of all where there are none."""
    mask = lr.gbuffer[Buffer.LIGHTING_MASK]
    beside = mask.masked_fill(colourless, 0.0)
    if not bool(beside.any()):
        return lr.lighting_scale
    return lighting_scale(lr.gbuffer[Buffer.LIGHTING], beside)


def _follow(outshines: Mask, lr: Frame) -> Mask:
    """Add what hangs together with samples that outshine their material and is like them."""
    gbuffer = lr.gbuffer
    lighting = gbuffer[Buffer.LIGHTING]
    bright = lighting > BESIDE * lr.lighting_scale
    bright &= lighting > COLOURED * lighting.amin(1, keepdim=True)
    alike = (bright & (gbuffer[Buffer.MATERIAL] <= DARK)).any(1, keepdim=True)
    alike |= is_colourless(gbuffer)
    alike &= (gbuffer[Buffer.LIGHTING_MASK] > 0.5) & (gbuffer[Buffer.SKY] < 0.5)
    found = outshines
    for _ in range(MOST_STEPS):
        before, found = found, found | (alike & spread_mask(found, STEP))
        if torch.equal(before, found):
            break
    return found


def _is_dark(material: torch.Tensor) -> Mask:
    """All channels dark, or one of them as good as 0: a saturated colour alone is not."""
    least, most = material.amin(1, keepdim=True), material.amax(1, keepdim=True)
    return (most <= DARK) | (least <= TINY)
