"""Radiance that no lighting explains: the sky, and surfaces whose material cannot carry it.

    image(p) = enlarged(p) + emission(p)        where p is sky, or undivided
    image(p) = lighting(p) material(p) + emission(p)        elsewhere

An HR pixel is undivided where its material is not above epsilon in every channel, or where the LR
samples of its surface gave no lighting (their material is not, or is no number). Its radiance, less
the emission that the HR buffer adds, is what `bicubic` makes of it, held within what the LR samples
of its surface span: where the truth lies in there, that is never further from it, and light from
beyond the surface's border does not bleed in.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.imaging.alignment import block_shift, shift_image
from rtsr_cli.core.imaging.enlargement import enlarge_masked_radiance, enlarge_radiance
from rtsr_cli.core.imaging.guided_enlargement import (
    DEPTH_SHARE,
    FACING,
    MAX_DEPTH,
    MIN_DEPTH,
    REACH,
    SPREAD,
)
from rtsr_cli.core.imaging.resampling import sample_at_lr, upsample_nearest
from rtsr_cli.core.shapes import Color, Mask, Plane
from rtsr_cli.core.system import FrameWindow

GUIDES = (Buffer.NORMAL, Buffer.DEPTH)
"""What tells surfaces apart, where both sizes have it."""

SKY_MARGIN_PX = 6
"""LR rows around the sky that its enlargement sees: cubic 2 and jitter 1, highlights 2, and one."""

FAINT = 4.0
"""Material of so many times epsilon carries no radiance where samples beside it are undivided."""

LOST_SHARE = 0.01
"""Share of samples without lighting, by weight, from which a pixel of their surface has none."""

LEAST_WEIGHT = 1e-4
"""Of a sample on another surface, which counts where there is none on the pixel's own."""

SAME_DEPTH = 0.1
"""Samples whose depth differs by more than this share lie on other surfaces."""

EMISSION_SHARE = 0.5
"""Where emission is less of the enlarged radiance, it is enlarged with the rest of it: surfaces
beside a lamp are bright, though they do not shine."""

LIT_SHARE = 0.1
"""Other light of undivided samples, as a share of emission, up to which that is all there is."""

LEAST_SAMPLES = 8
"""Fewer samples of a surface say nothing about what radiance it has."""

SLACK = 1.0
"""Share of what a surface's samples span that its radiance may lie beyond it."""

UNGUIDED_REACH = 2 * REACH
"""LR pixels to each side in which samples tell what has no lighting, where nothing guides."""

HALO_PX = UNGUIDED_REACH + 3
"""LR pixels that undivided radiance depends on: those samples, HR material around them, jitter."""

PIXELS_AT_A_TIME = 1 << 18
"""Whose samples are gathered."""


def add_radiance(window: FrameWindow, image: Color) -> Color:
    """Put in the sky and undivided surfaces; the image itself where there are neither."""
    return add_undivided(window, add_sky(window, image))


def add_sky(window: FrameWindow, image: Color) -> Color:
    """Put the enlarged LR sky where the HR depth says sky; only rows that hold any are touched."""
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
    band = torch.where(hr_sky[:, :, changed], enlarged[:, :, seen], image[:, :, changed])
    return torch.cat([image[:, :, : changed.start], band, image[:, :, changed.stop :]], dim=2)


def add_undivided(window: FrameWindow, image: Color) -> Color:
    """Put the enlarged LR radiance where lighting times material cannot be the picture."""
    undivided = window.compute_once(find_undivided)
    if undivided is None:
        return image
    color, (scale, jitter_px) = window.current.gbuffer[Buffer.COLOR], _sampling(window)
    whole = enlarge_radiance(color, scale, jitter_px)
    emission = window.require_hr().gbuffer.buffers.get(Buffer.EMISSION)
    if emission is None:
        return torch.where(undivided, _hold_in_span(window, undivided, color, whole), image)
    reflected, added = _part_emission(window, emission)
    shines = (emission > EMISSION_SHARE * whole).any(1, keepdim=True)
    shines = undivided & (shines | _find_lamps(window, reflected, added))
    image = torch.where(undivided, _hold_in_span(window, undivided & ~shines, color, whole), image)
    if not bool(shines.any()):
        return image
    enlarged = enlarge_radiance(reflected, scale, jitter_px)
    held = _hold_in_span(window, shines, reflected, enlarged)
    return torch.where(shines, held + emission, image)


def _sampling(window: FrameWindow) -> tuple[int, Jitter]:
    return window.scale, window.current.camera.jitter_px


def measure_undivided(window: FrameWindow) -> float:
    """Share of the HR pixels whose radiance is enlarged since nothing was divided there, 0..1."""
    known = window.hr is not None and Buffer.MATERIAL in window.hr.gbuffer
    if not known or Buffer.LIGHTING_MASK not in window.current.gbuffer:
        return 0.0
    undivided = window.compute_once(find_undivided)
    return 0.0 if undivided is None else float(undivided.sum()) / undivided.numel()


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
    """True where HR material carries radiance, but the samples of the surface gave no lighting.

    A sample counts for that if HR material is right all around it: else it lies on a surface that
    has none at either size, and those beside it have samples of their own. Beside faint material
    every sample counts: whether it was divided is chance there.
    """
    surface = window.require_hr().gbuffer[Buffer.SKY] < 0.5
    usable = surface & (faintest > MATERIAL_EPSILON)
    wrong = unlit & ~_at_samples(window, _spread(surface & ~usable, 1))
    faint = usable & (faintest <= FAINT * MATERIAL_EPSILON)
    guided = all(b in window.current.gbuffer for b in GUIDES)
    reach = REACH if guided else UNGUIDED_REACH
    beside = upsample_nearest(_spread(wrong, reach), window.scale)
    candidates = usable & (beside | (upsample_nearest(_spread(unlit, REACH), window.scale) & faint))
    lit = window.current.gbuffer[Buffer.LIGHTING_MASK] > 0.5
    # without guides, whatever is near such samples may lie on their surface
    lost = torch.zeros_like(candidates) if guided else usable & beside
    for pixels in _list_pixels(candidates):
        bad, good = torch.zeros(2, len(pixels.row), device=lost.device)
        always = pixels.pick(faint)[0]
        for sample in _visit_samples(window, pixels):
            weight = sample.weigh()
            bad += weight * (sample.pick(wrong)[0] | (always & sample.pick(unlit)[0]))
            good += weight * sample.pick(lit)[0]
        lost[0, 0, pixels.row, pixels.column] |= bad > LOST_SHARE * (bad + good)
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


def _find_lamps(window: FrameWindow, reflected: Color, emission: Color) -> Mask:
    """True where the undivided samples around give next to no other light than emission."""
    frame = window.current.gbuffer
    unlit = (frame[Buffer.LIGHTING_MASK] < 0.5) & (frame[Buffer.SKY] < 0.5)
    other, own = (
        F.max_pool2d((light * unlit).amax(1, keepdim=True), 2 * REACH + 1, 1, REACH)
        for light in (reflected, emission)
    )
    return upsample_nearest((own > 0.0) & (other <= LIT_SHARE * own), window.scale)


def _hold_in_span(window: FrameWindow, wanted: Mask, samples: Color, enlarged: Color) -> Color:
    """Hold enlarged radiance within what samples of its surface span, with slack."""
    frame = window.current.gbuffer
    lit = frame[Buffer.LIGHTING_MASK] > 0.5
    unlit = ~lit & (frame[Buffer.SKY] < 0.5)
    empty = window.require_hr().gbuffer[Buffer.MATERIAL].amin(1, keepdim=True) <= MATERIAL_EPSILON
    disputed = lit & _at_samples(window, empty)
    held = enlarged.clone()
    for pixels in _list_pixels(wanted):
        shape = (samples.shape[1], len(pixels.row))
        least, most = samples.new_full(shape, math.inf), samples.new_full(shape, -math.inf)
        count = torch.zeros(len(pixels.row), device=held.device)
        for sample in _visit_samples(window, pixels):
            own = sample.is_near_in_depth() & sample.pick(unlit)[0]
            value = sample.pick(samples)
            least = torch.where(own, torch.minimum(least, value), least)
            most = torch.where(own, torch.maximum(most, value), most)
            count += torch.where(sample.pick(disputed)[0], -math.inf, own.float())
        slack = SLACK * (most - least)
        value = pixels.pick(enlarged)
        bounded = torch.minimum(torch.maximum(value, least - slack), most + slack)
        bounded = torch.where(count >= LEAST_SAMPLES, bounded, value)
        held[0, :, pixels.row, pixels.column] = bounded
    return held


@dataclass(frozen=True, kw_only=True)
class _Pixels:
    """Some HR pixels.

    Attributes:
        row, column: of each.
    """

    row: Tensor
    column: Tensor

    def pick(self, image: Tensor) -> Tensor:
        """Values of an image there, c x pixels."""
        return image[0, :, self.row, self.column]


@dataclass(frozen=True, kw_only=True)
class _Sample(_Pixels):
    """One LR sample beside each of some HR pixels.

    Attributes:
        squared: of the distance, small pixels.
        normals: of pixel and sample, 3 x pixels each; None where there are none.
        depths: the same, pixels each.
    """

    squared: Tensor
    normals: tuple[Tensor, Tensor] | None
    depths: tuple[Tensor, Tensor] | None

    def weigh(self) -> Tensor:
        """Nearness times likeness of the surfaces, as `guided_enlargement` has it."""
        apart = torch.zeros_like(self.squared)
        if self.normals is not None:
            apart = FACING * (1.0 - (self.normals[0] * self.normals[1]).sum(0))
        if self.depths is not None:
            apart = apart + self._compare_depths() / DEPTH_SHARE
        nearness = (self.squared / (-2.0 * SPREAD**2)).exp()
        return nearness * ((-apart).exp() + LEAST_WEIGHT)

    def is_near_in_depth(self) -> Tensor:
        """Tell where the sample may lie on the pixel's surface."""
        if self.depths is None:
            return torch.ones_like(self.squared, dtype=torch.bool)
        return self._compare_depths() <= SAME_DEPTH

    def _compare_depths(self) -> Tensor:
        assert self.depths is not None
        own, other = self.depths
        return (own - other).abs() / torch.minimum(own, other)


def _list_pixels(mask: Mask) -> Iterator[_Pixels]:
    """Pixels of a mask, so many at a time that their samples fit into memory."""
    _, _, rows, columns = mask.nonzero(as_tuple=True)
    for first in range(0, len(rows), PIXELS_AT_A_TIME):
        some = slice(first, first + PIXELS_AT_A_TIME)
        yield _Pixels(row=rows[some], column=columns[some])


def _visit_samples(window: FrameWindow, pixels: _Pixels) -> Iterator[_Sample]:
    """Visit the samples around, borders replicated."""
    small, large = window.current.gbuffer.buffers, window.require_hr().gbuffer.buffers
    (height, width), scale = window.current.size, window.scale
    jitter_x, jitter_y = window.current.camera.jitter_px
    y, x = ((at + 0.5) / scale for at in (pixels.row, pixels.column))
    guides = {b: pixels.pick(large[b]) for b in GUIDES if b in small and b in large}
    for down, across in product(range(-REACH, REACH + 1), repeat=2):
        row = (pixels.row // scale + down).clamp_(0, height - 1)
        column = (pixels.column // scale + across).clamp_(0, width - 1)
        squared = (y - row - 0.5 - jitter_y).square() + (x - column - 0.5 - jitter_x).square()
        there = _Pixels(row=row, column=column)
        pairs = {b: (own, there.pick(small[b])) for b, own in guides.items()}
        depths = pairs.get(Buffer.DEPTH)
        if depths is not None:
            near, far = (z[0].clamp(MIN_DEPTH, MAX_DEPTH) for z in depths)
            depths = near, far
        yield _Sample(
            row=row,
            column=column,
            squared=squared,
            normals=pairs.get(Buffer.NORMAL),
            depths=depths,
        )
