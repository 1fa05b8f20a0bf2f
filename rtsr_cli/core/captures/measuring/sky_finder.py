"""Finding which stored depth is the sky's: far, infinite, NaN, 0, negative, or the far plane's.

One rule holds for a whole sequence. Far and infinite depths are sky in any case. A value that no
surface has (0, below, or NaN) is the sky's where it fills regions and nothing contradicts that, or
where normals, object ids or coverage of 0 say so; a largest value that many pixels share is where
they do. Impossible values that are scattered, or lie on surfaces, are said and taken for what they
are. Where the sky has the same value, such pixels are read as sky, and said all the same: those
that stand alone, as no region's do, and that another buffer shows to be surface.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer
from rtsr_cli.core.frames.conventions import (
    SKY_MARKERS,
    Conventions,
    DepthConvention,
    DepthKind,
    SkyRule,
    is_sky_depth,
)
from rtsr_cli.core.shapes import Mask, Plane

Stored = Mapping[Buffer, Tensor]
"""Buffers of a frame as its files hold them."""

SKY_BUFFERS = (Buffer.DEPTH, Buffer.NORMAL, Buffer.OBJECT_ID, Buffer.ALPHA)

FULL = 0.6
"""Mean share of the 3x3 pixels around that belong to it too: a region, no scattered pixels."""

LONE = 0.4
"""The same of a pixel that stands alone, at most: three of nine. A region's corners are four."""

AGREES = 0.9
"""Share of pixels that have to be marked."""

LEAST_PIXELS = 16
"""Fewer decide nothing."""

LEAST_SHARE = 0.002
"""Of pixels that share the largest depth, so that it may be the far plane's."""

BEYOND = 2.0
"""The far plane is so many times as far as the farthest surface where nothing marks it."""

NEAR = 1.2
"""Surfaces may lie beyond a sky in other frames that is at most so many times as far as theirs."""

LARGE_SHARE = 0.02
"""Of pixels that share the largest depth and that nothing marks, from which they are said."""

EVERYTHING = 0.95
"""A value of so many pixels is a pass that is not there, or depth of another sign."""

DIGITS = 3
"""Significant digits of a depth that somebody chose to clear to."""

MOST_COUNTED = 65536
"""Values among which the most common one is looked for."""

DOUBTFUL = 0.01
"""Share of impossible values from which they are said."""

LEAST_PACKED = -0.01
"""Parts of stored normals up to which none is packed: rounding makes none so far below 0."""


@dataclass(frozen=True, kw_only=True)
class ClearedDepth:
    """One depth of many pixels without material, in the midst of others: the sky's, it seems.

    Attributes:
        value: as stored.
        share: of the pixels that have it.
        beyond: share of the pixels that lie farther.
        normal: what is stored as their normals and as nearly no others'; None if no such is.
    """

    value: float
    share: float
    beyond: float
    normal: tuple[float, ...] | None


@dataclass(frozen=True, kw_only=True)
class SkyFinding:
    """What is sky in the frames that were looked at.

    Attributes:
        share: of the pixels.
        rule: what it was found by, for the user.
        sky: what depth is to be read with, None where that is as presumed.
        impossible: share of pixels whose depth is 0, negative or no number, and no sky.
        strewn: share of pixels that are taken for sky by their depth, and are surfaces by all else.
        lost: share of pixels whose depth is -inf, which is read as sky, and that do not look like
            it.
        unmarked: share and depth of pixels that look like the far plane's, though nothing else says
            so; None if there are none.
        cleared: what looks like the sky's depth among the surfaces', though nothing marks it.
    """

    share: float
    rule: str
    sky: float | SkyRule | None = None
    impossible: float = 0.0
    strewn: float = 0.0
    lost: float = 0.0
    unmarked: tuple[float, float] | None = None
    cleared: ClearedDepth | None = None

    @property
    def is_nothing(self) -> bool:
        """Tell whether these frames show no sky, and nothing that may be one."""
        return not (self.share or self.impossible or self.cleared)


def find_sky(frames: Sequence[Stored], conventions: Conventions) -> SkyFinding:
    """Find what is sky.

    Args:
        frames: of one size, with `SKY_BUFFERS` as far as they are there.
        conventions: presumed, with the rule that is declared if one is.
    """
    convention, marker = conventions.depth, conventions.normal.sky
    if marker is not None and Buffer.NORMAL in frames[0]:
        marked = [_mark_by_normal(f, marker) for f in frames]
        zero = [_is_zero(f[Buffer.NORMAL]) & m for f, m in zip(frames, marked, strict=True)]
        also = " or 0" if _share(zero) else ""
        return SkyFinding(share=_share(marked), rule=f"normals of {marker}{also}")
    if Buffer.DEPTH not in frames[0]:
        zero = [_is_zero(f[Buffer.NORMAL]) for f in frames if Buffer.NORMAL in f]
        return SkyFinding(share=_share(zero), rule="normals of 0, as there is no depth")
    depths = [frame[Buffer.DEPTH].float() for frame in frames]
    return _add_lost(_find_by_depth(frames, depths, convention), frames, depths, convention)


def _find_by_depth(
    frames: Sequence[Stored], depths: Sequence[Plane], convention: DepthConvention
) -> SkyFinding:
    known = _find_by_rule(frames, depths, convention)
    if convention.sky is not None or convention.kind is DepthKind.DEVICE:
        return known
    found = _measure_sky(frames, depths, convention)
    # depth that is 0 or no number is said first, and is no sky among surfaces
    if not known.impossible and (found is None or _is_near(found, depths)):
        within = _find_within(frames, depths, convention)
        if within is not None and (found is None or within.sky is not None):
            return within
    return found or _add_far_plane(known, depths, convention)


def _add_lost(
    found: SkyFinding,
    frames: Sequence[Stored],
    depths: Sequence[Plane],
    convention: DepthConvention,
) -> SkyFinding:
    """Add how much of the sky is -inf, and how much of that does not look like sky.

    Rays that miss may leave -inf as they leave inf; so does a logarithm or quotient of 0.
    """
    masks = [torch.isneginf(d) for d in depths]
    share = _share(masks)
    if not share or convention.sky is SkyRule.NONE or convention.kind is DepthKind.DEVICE:
        return found
    strewn = _find_strewn(masks, frames)
    rest = [m & ~s for m, s in zip(masks, strewn, strict=True)]
    is_sky = bool(_share(rest)) and _is_marked(rest, frames, region_suffices=True)
    lost = _share(strewn) if is_sky else share
    return replace(found, rule=f"{found.rule}; -inf in {share:.1%}", lost=lost)


def _measure_sky(
    frames: Sequence[Stored], depths: Sequence[Plane], convention: DepthConvention
) -> SkyFinding | None:
    """Find the value that is sky's, of those that no surface has and of the largest."""
    beyond = [~(d > 0) & ~torch.isinf(d) for d in depths]
    for where, value, suffices in (
        (beyond, _most_common(beyond, depths), True),
        (*_find_farthest(depths, convention), False),
    ):
        if value is None:
            continue
        chosen = _select(depths, value)
        if _share(chosen) < AGREES * _share(where) or _share(chosen) > EVERYTHING:
            continue
        cleared = not suffices and _is_far_plane(chosen, depths) and _are_cleared(chosen, frames)
        if cleared or _is_marked(chosen, frames, region_suffices=suffices):
            again = DepthConvention(kind=convention.kind, unit_m=convention.unit_m, sky=value)
            found = _find_by_rule(frames, depths, again)
            strewn = _share(_find_strewn(chosen, frames)) if suffices else 0.0
            return replace(
                found,
                rule=f"{found.rule}, measured",
                sky=value,
                strewn=strewn,
            )
    return None


def _find_within(
    frames: Sequence[Stored], depths: Sequence[Plane], convention: DepthConvention
) -> SkyFinding | None:
    """Find a sky whose depth is one among the surfaces', by what else it has.

    What marks it is the rule where marked pixels and pixels of the depth are the same ones.
    """
    surfaces = [(d > 0) & ~is_sky_depth(d, convention) for d in depths]
    for rule, buffer in SKY_MARKERS.items():
        if buffer not in frames[0] or (rule is SkyRule.NORMAL and _look_packed(frames, surfaces)):
            continue
        marked = [_is_zero(f[buffer]) & s for f, s in zip(frames, surfaces, strict=True)]
        value = _find_shared_depth(marked, depths)
        if value is None or _share(marked) > EVERYTHING:
            continue
        chosen = _select(depths, value)
        if not _are_same(chosen, marked) or not _lack_all_else(chosen, frames, rule):
            continue
        by_mark = DepthConvention(kind=convention.kind, unit_m=convention.unit_m, sky=rule)
        found = _find_by_rule(frames, depths, by_mark)
        text = f"{found.rule}, all of them at a depth of {value:g} as stored, measured"
        return replace(found, rule=text, sky=rule)
    cleared = _find_cleared(frames, depths, surfaces)
    if cleared is None:
        return None
    return replace(_find_by_rule(frames, depths, convention), cleared=cleared)


def _find_cleared(
    frames: Sequence[Stored], depths: Sequence[Plane], surfaces: Sequence[Mask]
) -> ClearedDepth | None:
    """Find a round depth of many pixels that have no material, one normal and one id."""
    if Buffer.ALBEDO not in frames[0]:
        return None
    bare = [_is_zero(f[Buffer.ALBEDO]) & s for f, s in zip(frames, surfaces, strict=True)]
    value = _find_shared_depth(bare, depths)
    if value is None or value != float(torch.tensor(float(f"{value:.{DIGITS}g}"))):
        return None
    chosen = _select(depths, value)
    one = [b for b in (Buffer.NORMAL, Buffer.OBJECT_ID) if b in frames[0]]
    if (
        not LARGE_SHARE <= _share(chosen) <= EVERYTHING
        or _share_within(chosen, bare) < AGREES
        or not all(_are_alike([f[b] for f in frames], chosen) for b in one)
    ):
        return None
    beyond = [(d > value) & s for d, s in zip(depths, surfaces, strict=True)]
    normals = [f[Buffer.NORMAL] for f in frames if Buffer.NORMAL in f]
    marker = _find_marker(normals, chosen, surfaces) if normals else None
    share = _share(chosen)
    return ClearedDepth(value=value, share=share, beyond=_share(beyond), normal=marker)


def _find_marker(
    normals: Sequence[Tensor], masks: Sequence[Mask], surfaces: Sequence[Mask]
) -> tuple[float, ...] | None:
    """The normal of the pixels of a mask, if hardly any other pixel has it."""
    usual = _find_usual(normals, masks)
    alike = [
        s & n.float().sub(usual).abs().lt(1e-3).all(1, keepdim=True)
        for n, s in zip(normals, surfaces, strict=True)
    ]
    return tuple(usual.flatten().tolist()) if _share_within(alike, masks) >= AGREES else None


def _find_shared_depth(masks: Sequence[Mask], depths: Sequence[Plane]) -> float | None:
    """The depth that most pixels of the masks have; None where they are too few."""
    values = torch.cat([d[m] for m, d in zip(masks, depths, strict=True)])
    if values.numel() < LEAST_PIXELS or _share(masks) < LEAST_SHARE:
        return None
    few = values[:: -(-values.numel() // MOST_COUNTED)].numpy()
    known, counts = np.unique(few, return_counts=True)
    return float(known[counts.argmax()])


def _are_same(masks: Sequence[Mask], others: Sequence[Mask]) -> bool:
    """Tell whether two sets of pixels hardly differ."""
    if min(_share(masks), _share(others)) < LEAST_SHARE:
        return False
    return min(_share_within(masks, others), _share_within(others, masks)) >= AGREES


def _lack_all_else(masks: Sequence[Mask], frames: Sequence[Stored], rule: SkyRule) -> bool:
    """Tell whether pixels have neither material nor id, and one normal, as far as those are there.

    Ids of 0 alone are no mark: walls that face the camera have one depth, and no id if nobody gave
    them one. Normals of 0 and coverage of 0 no surface has.
    """
    held = [b for b in (Buffer.ALBEDO, Buffer.NORMAL, Buffer.OBJECT_ID) if b in frames[0]]
    zero = {b: [_is_zero(f[b]) for f in frames] for b in held}
    # what is 0 nearly everywhere tells nothing: a pass that is not there
    told = {b: _share_within(masks, z) for b, z in zero.items() if _share(z) <= EVERYTHING}
    if rule is SkyRule.OBJECT_ID and told.get(Buffer.ALBEDO, told.get(Buffer.NORMAL, 0.0)) < AGREES:
        return False
    normal = told.pop(Buffer.NORMAL, 1.0)
    if normal < AGREES and not _are_alike([f[Buffer.NORMAL] for f in frames], masks):
        return False
    return all(share >= AGREES for share in told.values())


def _is_near(found: SkyFinding, depths: Sequence[Plane]) -> bool:
    """Tell whether surfaces lie so near to the bound of the sky that in other frames some may pass.

    Bounds that no surface has are none of these.
    """
    bound = found.sky
    if not isinstance(bound, float) or bound <= 0:
        return False
    nearer = (float(torch.where(d < bound, d, 0.0).nan_to_num().amax()) for d in depths)
    return max(nearer) * NEAR > bound


def _look_packed(frames: Sequence[Stored], surfaces: Sequence[Mask]) -> bool:
    """Tell whether no normal of a surface has a part below 0: a stored 0 is then no vector of 0."""
    below = (
        (f[Buffer.NORMAL] <= LEAST_PACKED).any(1, keepdim=True) & s
        for f, s in zip(frames, surfaces, strict=True)
    )
    return not any(bool(mask.any()) for mask in below)


def _add_far_plane(
    known: SkyFinding, depths: Sequence[Plane], convention: DepthConvention
) -> SkyFinding:
    """Add what looks like the far plane, though nothing else says so."""
    masks, farthest = _find_farthest(depths, convention)
    share = _share(masks)
    if farthest is None or not LARGE_SHARE <= share <= EVERYTHING:
        return known
    return replace(known, unmarked=(share, farthest)) if _is_far_plane(masks, depths) else known


def _find_by_rule(
    frames: Sequence[Stored], depths: Sequence[Plane], convention: DepthConvention
) -> SkyFinding:
    """Take for sky what a convention does."""
    sky = [_mark_by_rule(f, d, convention) for f, d in zip(frames, depths, strict=True)]
    possible = [s | (d > 0) for s, d in zip(sky, depths, strict=True)]
    impossible = 0.0 if convention.kind is DepthKind.DEVICE else 1.0 - _share(possible)
    return SkyFinding(share=_share(sky), rule=describe_rule(convention), impossible=impossible)


def _mark_by_rule(frame: Stored, depth: Plane, convention: DepthConvention) -> Mask:
    sky = is_sky_depth(depth, convention)
    marker = SKY_MARKERS.get(convention.sky) if isinstance(convention.sky, SkyRule) else None
    if marker is None or marker not in frame:
        return sky
    return sky | _is_zero(frame[marker])


def mark_sky(frame: Stored, conventions: Conventions) -> Mask | None:
    """True on what is sky by conventions; None where neither depth nor normals tell."""
    normal, marker = frame.get(Buffer.NORMAL), conventions.normal.sky
    if marker is not None and normal is not None:
        return _mark_by_normal(frame, marker)
    if Buffer.DEPTH in frame:
        return _mark_by_rule(frame, frame[Buffer.DEPTH].float(), conventions.depth)
    return None if normal is None else _is_zero(normal)


NO_SURFACE = (Buffer.OBJECT_ID, Buffer.ALPHA, Buffer.POSITION)
"""Buffers that are 0 where there is no surface, unless they are 0 nearly everywhere."""

VECTORS = (Buffer.NORMAL, Buffer.GEONORMAL)


def leave_out_sky(frame: Stored, conventions: Conventions) -> Stored:
    """Return a frame whose normals are NaN where there is no surface: there they say nothing.

    What a renderer clears them to, (0, 0, 1) say, is a direction like any other.
    """
    normals = {b: frame[b].float() for b in VECTORS if b in frame}
    sky = mark_sky(frame, conventions) if normals else None
    if sky is None:
        return frame
    for marked in (_is_zero(frame[b]) for b in NO_SURFACE if b in frame):
        if _share([marked]) <= EVERYTHING:
            sky = sky | marked
    return {**frame, **{b: n.masked_fill(sky, torch.nan) for b, n in normals.items()}}


def _mark_by_normal(frame: Stored, marker: tuple[float, float, float]) -> Mask:
    """True on normals of a marker; and of 0, as they are read, where those are no surfaces.

    Surfaces whose normals were not rendered have several depths.
    """
    marked, zero = _is_marker(frame[Buffer.NORMAL], marker), _is_zero(frame[Buffer.NORMAL])
    if not bool(zero.any()):
        return marked
    if Buffer.DEPTH not in frame:
        return marked | zero
    depth = frame[Buffer.DEPTH].float()
    known = depth[zero & (depth > 0)]
    alike = not known.numel() or float((known == known.median()).float().mean()) >= AGREES
    return marked | zero if alike else marked


def _is_marker(normal: Tensor, marker: tuple[float, float, float]) -> Mask:
    own = torch.tensor(marker).view(1, 3, 1, 1)
    return normal.sub(own).abs().lt(1e-3).all(1, keepdim=True)


def describe_rule(convention: DepthConvention) -> str:
    """Say what is sky by a convention."""
    rule = convention.sky
    if convention.kind is DepthKind.DEVICE and not isinstance(rule, SkyRule):
        return f"device depth of {0 if convention.reversed else 1}"
    if isinstance(rule, SkyRule):
        return _RULES[rule]
    if rule is None:
        return _RULES[SkyRule.FAR]
    return f"depth of {rule:g} or {'more' if rule > 0 else 'less'}"


_RULES = {
    SkyRule.FAR: f"depth of {SKY_DEPTH_M:g} or more, or infinite",
    SkyRule.NAN: f"depth of NaN, of {SKY_DEPTH_M:g} or more, or infinite",
    SkyRule.NONE: "nothing, as declared",
    SkyRule.NORMAL: "normals of 0",
    SkyRule.OBJECT_ID: "object id 0",
    SkyRule.ALPHA: "alpha 0",
}


def _is_zero(image: Tensor) -> Mask:
    return (image == 0).all(1, keepdim=True)


def _share(masks: Sequence[Mask]) -> float:
    pixels = sum(mask.numel() for mask in masks)
    return sum(int(mask.sum()) for mask in masks) / pixels if pixels else 0.0


def _most_common(masks: Sequence[Mask], depths: Sequence[Plane]) -> float | SkyRule | None:
    """The value that most pixels of the masks share, None where they are too few."""
    values = torch.cat([d[m] for m, d in zip(masks, depths, strict=True)])
    numbers = values[torch.isfinite(values)]
    if values.numel() - numbers.numel() >= max(LEAST_PIXELS, numbers.numel()):
        return SkyRule.NAN
    values = numbers
    # the middle one is the one that more than half of them are
    return float(values.median()) + 0.0 if values.numel() >= LEAST_PIXELS else None


def _select(depths: Sequence[Plane], value: float | SkyRule) -> list[Mask]:
    """Pixels of a stored depth; a rule stands for NaN, which equals nothing."""
    if isinstance(value, SkyRule):
        return [d.isnan() for d in depths]
    return [torch.eq(d, value) for d in depths]


def _find_farthest(
    depths: Sequence[Plane], convention: DepthConvention
) -> tuple[list[Mask], float | None]:
    """Pixels of the largest depth, and it, where many share it and nothing is farther."""
    if any(bool(is_sky_depth(d, convention).any()) for d in depths):
        return [], None
    farthest = max(float(d.nan_to_num().amax()) for d in depths)
    masks = [d == farthest for d in depths]
    pixels = sum(int(m.sum()) for m in masks)
    enough = pixels >= LEAST_PIXELS and _share(masks) >= LEAST_SHARE and farthest > 0
    return masks, farthest if enough else None


def _is_marked(masks: Sequence[Mask], frames: Sequence[Stored], *, region_suffices: bool) -> bool:
    """Tell whether other buffers, or their shape, show that pixels are sky."""
    zero = [[_is_zero(f[b]) for f in frames] for b in SKY_MARKERS.values() if b in frames[0]]
    # what is 0 nearly everywhere marks nothing: a pass that is not there
    marks = [_share_within(masks, marked) for marked in zero if _share(marked) <= EVERYTHING]
    if any(share >= AGREES for share in marks):
        return True
    if not region_suffices or _have_surfaces(masks, frames):
        return False
    around = [_average_around(m) for m in masks]
    values = torch.cat([a[m] for a, m in zip(around, masks, strict=True)])
    return float(values.mean()) >= FULL


def _find_strewn(masks: Sequence[Mask], frames: Sequence[Stored]) -> list[Mask]:
    """Pixels of the sky's value that few pixels around share, and that are surface elsewhere.

    Normals, object ids or coverage tell a surface by what the sky's own are: the usual value of the
    pixels that are in regions. Normals of a surface differ from that; ids and coverage of the sky
    are 0, so that others tell only where the regions' are.
    """
    around = [_average_around(m) for m in masks]
    alone = [m & (a < LONE) for m, a in zip(masks, around, strict=True)]
    regions = [m & (a >= FULL) for m, a in zip(masks, around, strict=True)]
    if _share(regions) == 0.0:
        return [torch.zeros_like(m) for m in masks]
    surface = [torch.zeros_like(m) for m in masks]
    for buffer in (Buffer.NORMAL, Buffer.OBJECT_ID, Buffer.ALPHA):
        if buffer not in frames[0]:
            continue
        images = [f[buffer] for f in frames]
        if not _are_alike(images, regions):
            continue
        usual = _find_usual(images, regions)
        surface = [
            s | (i.float().nan_to_num() - usual).abs().ge(1e-3).any(1, keepdim=True)
            for s, i in zip(surface, images, strict=True)
        ]
    return [a & s for a, s in zip(alone, surface, strict=True)]


def _average_around(mask: Mask) -> Tensor:
    """Share of the 3x3 pixels around each that belong to a mask."""
    return F.avg_pool2d(mask.float(), 3, stride=1, padding=1, count_include_pad=False)


def _are_cleared(masks: Sequence[Mask], frames: Sequence[Stored]) -> bool:
    """Tell whether pixels are one value in normals, and in object ids, as nothing seen is."""
    if Buffer.NORMAL not in frames[0]:
        return False
    normals, others = [f[Buffer.NORMAL] for f in frames], [~m for m in masks]
    if _are_alike(normals, others):
        return False
    held = [b for b in (Buffer.NORMAL, Buffer.OBJECT_ID) if b in frames[0]]
    return all(_are_alike([f[b] for f in frames], masks) for b in held)


def _is_far_plane(masks: Sequence[Mask], depths: Sequence[Plane]) -> bool:
    """Tell whether the largest depth is a round number far beyond all that is seen.

    A wall that faces the camera has one depth as well, but there is something just before it.
    """
    farthest = max(float(d.nan_to_num().amax()) for d in depths)
    nearer = [d[~m & torch.isfinite(d)] for d, m in zip(depths, masks, strict=True)]
    second = max((float(n.amax()) for n in nearer if n.numel()), default=farthest)
    return second * BEYOND <= farthest and farthest == float(f"{farthest:.2g}")


def _are_alike(images: Sequence[Tensor], masks: Sequence[Mask]) -> bool:
    """Tell whether pixels of a mask hold one value."""
    values, usual = _select_values(images, masks), _find_usual(images, masks)[0, :, :, 0]
    return float((values - usual).abs().lt(1e-3).all(0).float().mean()) >= AGREES


def _find_usual(images: Sequence[Tensor], masks: Sequence[Mask]) -> Tensor:
    """The middle value of the pixels of a mask in each channel, 1 x C x 1 x 1."""
    return _select_values(images, masks).median(dim=1).values.view(1, -1, 1, 1)


def _select_values(images: Sequence[Tensor], masks: Sequence[Mask]) -> Tensor:
    """Values of the pixels of a mask, C x pixels; NaN as 0."""
    values = torch.cat([i[0][:, m[0, 0]] for i, m in zip(images, masks, strict=True)], 1)
    return values.float().nan_to_num()


def _share_within(masks: Sequence[Mask], marked: Sequence[Mask]) -> float:
    inside = torch.cat([k[m] for k, m in zip(marked, masks, strict=True)])
    return float(inside.float().mean())


def _have_surfaces(masks: Sequence[Mask], frames: Sequence[Stored]) -> bool:
    """Tell whether normals vary in some pixels, which those of the sky do not."""
    if Buffer.NORMAL not in frames[0]:
        return False
    normals = torch.cat(
        [f[Buffer.NORMAL][0][:, m[0, 0]] for f, m in zip(frames, masks, strict=True)], 1
    ).nan_to_num()
    alike = (normals == normals.median(dim=1, keepdim=True).values).all(0)
    return float(alike.float().mean()) < AGREES
