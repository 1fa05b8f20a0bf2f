"""Material of a pair that does not explain its radiance, taken out for every reason in turn."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import reduce

import torch
import torch.nn.functional as F

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.pairs.alike_material import hold_all, leave_alike
from rtsr_cli.core.pairs.colourless_material import leave_colourless
from rtsr_cli.core.pairs.dark_material import (
    TOO_BRIGHT,
    leave_colour_lost_at_lr,
    leave_outshining,
)
from rtsr_cli.core.pairs.excessive_material import EXCESSIVE, leave_excessive
from rtsr_cli.core.pairs.held_samples import HeldSamples, hold_samples
from rtsr_cli.core.pairs.material_agreement import leave_contradicting
from rtsr_cli.core.pairs.material_causes import (
    DARKER_AT_LR,
    DIFFERS,
    describe_difference,
    name_darker,
)
from rtsr_cli.core.pairs.material_removal import find_taken, leave_bare, leave_undivided
from rtsr_cli.core.pairs.surface_factors import leave_scaled
from rtsr_cli.core.pairs.thin_material import LostThings, find_lost_things
from rtsr_cli.core.shapes import Mask


@dataclass(frozen=True)
class DoubtedPair:
    """Both frames, without material that is doubted.

    Attributes:
        lr, hr: the frames.
        doubted: why LR samples were left undivided though their material is above 0 -> which.
        colours: of some of these reasons -> what the material is at both sizes.
        bare: as in `FramePair`.
    """

    lr: Frame
    hr: Frame
    doubted: dict[str, Mask] = field(default_factory=dict)
    colours: dict[str, str] = field(default_factory=dict)
    bare: Mask | None = None

    def leave(self, lr: Frame, hr: Frame, found: dict[str, Mask]) -> DoubtedPair:
        """The frames after a step, and what it found beside what is known."""
        known = self.doubted
        both = {name: known[name] | found[name] for name in known.keys() & found.keys()}
        return replace(self, lr=lr, hr=hr, doubted=known | found | both)

    @property
    def taken(self) -> Mask | None:
        """Samples that are left undivided."""
        return reduce(torch.logical_or, self.doubted.values()) if self.doubted else None


def leave_doubted(lr: Frame, hr: Frame, scale: int, *, divided: bool) -> DoubtedPair:
    """Take material out of both frames where it does not explain radiance.

    Args:
        lr: with sky, and material where it is there, lighting with its mask where it was divided.
        hr: with sky, and material where it is there.
        scale: S.
        divided: whether LR radiance was.
    """
    pair = DoubtedPair(lr, hr)
    if Buffer.MATERIAL not in hr.gbuffer:
        return pair
    things = None
    if Buffer.MATERIAL in lr.gbuffer:
        first = hold_samples(lr, hr, scale)
        things = find_lost_things(first) if divided else None
        pair = _leave_disagreeing(pair, first, divided=divided)
    if divided:
        left, bare = leave_outshining(pair.lr, pair.hr, scale, pair.taken)
        found = {} if left is pair.lr else {TOO_BRIGHT: find_taken(pair.lr, left)}
        pair = pair.leave(left, bare, found)
        left, bare, excessive = leave_excessive(pair.lr, pair.hr, scale)
        pair = pair if excessive is None else pair.leave(left, bare, {EXCESSIVE: excessive})
    if things is not None:
        pair = _leave_things(pair, things, first)
    unsaid = things is not None and not things.sure
    return replace(pair, bare=_find_bare(hr, scale)) if pair.doubted or unsaid else pair


def _find_bare(hr: Frame, scale: int) -> Mask:
    """True at LR samples in whose blocks HR has no material."""
    bare = (hr.gbuffer[Buffer.MATERIAL] <= MATERIAL_EPSILON).any(1, keepdim=True)
    return F.max_pool2d(bare.float(), scale) > 0.5


def _leave_things(pair: DoubtedPair, things: LostThings, first: HeldSamples) -> DoubtedPair:
    """Leave what is lost of thin things."""
    left, found = pair.lr, dict(things.samples)
    divided = left.gbuffer[Buffer.LIGHTING_MASK] > 0.5
    samples = reduce(torch.logical_or, found.values())
    left = leave_undivided(left, samples & divided)
    bare = leave_bare(left, pair.hr, things.pixels, first.scale)
    found = {cause: mask for cause, mask in found.items() if bool(mask.any())}
    return pair.leave(left, bare, found)


def _leave_disagreeing(pair: DoubtedPair, first: HeldSamples, *, divided: bool) -> DoubtedPair:
    """Leave what is one material at LR and another at HR."""
    held, scale = first, first.scale
    left, bare = leave_contradicting(pair.lr, pair.hr, scale, held)
    if left is not pair.lr:
        taken = find_taken(pair.lr, left)
        pair = pair.leave(left, bare, {name_darker(pair.lr, pair.hr, scale, taken): taken})
        held = hold_samples(pair.lr, pair.hr, scale)
    left, bare = leave_scaled(pair.lr, pair.hr, scale, held, lines=held is not first)
    if left is not pair.lr:
        pair = pair.leave(left, bare, {DIFFERS: find_taken(pair.lr, left)})
    if pair.taken is not None:
        left, bare, taken = leave_alike(hold_all(first), pair.lr, pair.hr, pair.taken, scale)
        cause = max(pair.doubted, key=lambda name: int(pair.doubted[name].sum()))
        colours = {
            name: describe_difference(first, mask)
            for name, mask in pair.doubted.items()
            if name == DIFFERS
        }
        pair = replace(pair.leave(left, bare, {cause: taken}), colours=colours)
        held = hold_samples(pair.lr, pair.hr, scale)
    gone = None
    if divided:
        left, bare, gone = leave_colour_lost_at_lr(held)
    if gone is not None:
        pair = pair.leave(left, bare, {DARKER_AT_LR: gone})
        held = hold_samples(pair.lr, pair.hr, scale)
    return pair.leave(*leave_colourless(pair.lr, pair.hr, scale, held))
