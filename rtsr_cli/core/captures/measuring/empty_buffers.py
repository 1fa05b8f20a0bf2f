"""Finding buffers that say nothing of surfaces, or what no surface is.

A pass that was not rendered is 0, one value, or the pass of another frame; one of another unit
leaves the range of what it stands for. What divides radiance, or tells surfaces apart, is then
wrong wherever it is read, though every value is a number.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from rtsr_cli.core.captures.bound_channels import Binding
from rtsr_cli.core.captures.measuring.geometry_finder import ThinnedFrame
from rtsr_cli.core.captures.measuring.normal_finder import ONE_VALUE, SAME, measure_likeness
from rtsr_cli.core.captures.measuring.sky_finder import DOUBTFUL, Stored, mark_sky
from rtsr_cli.core.frames.buffers import CONSTANTS, Buffer
from rtsr_cli.core.frames.camera import CameraMetadata, is_orthographic
from rtsr_cli.core.frames.conventions import Conventions, DepthKind
from rtsr_cli.core.frames.selection import format_ranges
from rtsr_cli.core.shapes import Mask, Plane

NEVER_ZERO: Mapping[Buffer, tuple[float, str]] = {
    Buffer.NORMAL: (DOUBTFUL, "there surfaces are told apart by depth alone, and face the camera"),
    Buffer.ALBEDO: (0.99, "what divides radiance lacks it there"),
    Buffer.MATERIAL: (0.99, "nothing can be divided there"),
    Buffer.ROUGHNESS: (0.99, "every surface is then a perfect mirror"),
    Buffer.NOV: (0.99, "every surface is then seen edge on"),
    Buffer.POSITION: (0.99, "all points are then one"),
}
"""Share of the surfaces on which a buffer may be 0, and what it leads to; few pixels may be."""

SHARES = (Buffer.ROUGHNESS, Buffer.METALLIC, Buffer.NOV)
"""Buffers of 0..1."""

OUTSIDE = 0.02
"""How far rounding may lead out of 0..1."""

COLOURS = (Buffer.ALBEDO, Buffer.SPECULAR, Buffer.MATERIAL)
"""Buffers that reflect a share of the light each; highlights in them may be brighter."""

MOST_SURFACES = 0.5
"""Share of the surfaces with any colour that are too bright where all of a pass was multiplied."""

EIGHT_BITS, SIXTEEN_BITS = 255, 65535
"""Largest values of what is stored in so many bits and was not divided by them."""

USED_BITS = 0.1
"""Share of these that the largest value of a pass reaches, at least."""

UNIT = (0.9, 1.1)
"""Lengths of normals, up to what filters and rounding leave."""

OFF_PLANE = 0.25
"""How much depth differs, as a share of it, from that of one plane where there are several."""

SEVERAL_PLANES = 0.1
"""Share of the surfaces that are off one plane where there are several."""

LEAST_SURFACE = 64
"""Fewer pixels of surfaces tell nothing."""


@dataclass(frozen=True, kw_only=True)
class BufferFault:
    """What is wrong with a buffer in some frames.

    Attributes:
        buffer: which one.
        frames: where it was seen.
        text: for the user: what is seen, what it leads to, and the remedy.
    """

    buffer: Buffer
    frames: tuple[int, ...]
    text: str


@dataclass(frozen=True, kw_only=True)
class _Seen:
    """One thing that is wrong, in one frame: its wording is that of all frames but for the share.

    Attributes:
        buffer: which one.
        what: said before the share; empty where every pixel is meant.
        then: said behind the frames, from its comma or colon on.
        share: of the surfaces, None where every pixel is meant.
        extent: least and largest value there, where that tells something.
        line: what declares all frames otherwise, with its condition; empty where nothing may.
    """

    buffer: Buffer
    what: str
    then: str
    share: float | None = None
    extent: tuple[float, float] | None = None
    line: str = ""


def find_faults(
    frames: Mapping[int, Stored],
    conventions: Conventions,
    cameras: Mapping[int, CameraMetadata],
    step: int,
    binding: Binding,
) -> tuple[BufferFault, ...]:
    """Find what is wrong with the buffers of some frames.

    Args:
        frames: buffers as stored, by frame number, without those that are declared constants.
        conventions: of them, with the rule of the sky.
        cameras: of the frames.
        step: numbers from one frame to the next.
        binding: what they are made of, for lines that declare it.
    """
    seen: dict[tuple[Buffer, str, str], dict[int, _Seen]] = {}
    for number, stored in frames.items():
        before = number - step
        known = None if before not in frames else (frames[before], cameras[before])
        for one in _look_at_frame(stored, conventions, cameras[number], known, binding):
            seen.setdefault((one.buffer, one.what, one.then), {})[number] = one
    found = []
    for (buffer, what, then), shown in seen.items():
        # a line holds for all frames: where some are right, it would spoil those
        line = next(iter(shown.values())).line if len(shown) == len(frames) else ""
        text = _describe(buffer, what, f"{then}{line}", shown)
        found.append(BufferFault(buffer=buffer, frames=tuple(shown), text=text))
    return tuple(found)


def _describe(buffer: Buffer, what: str, then: str, seen: Mapping[int, _Seen]) -> str:
    frames = f"frame{'s' if len(seen) > 1 else ''} {format_ranges(seen)}"
    shares = [one.share for one in seen.values() if one.share is not None]
    if not shares:
        return f"'{buffer}' {what} of {frames}{then}"
    mean = sum(shares) / len(shares)
    extents = [one.extent for one in seen.values() if one.extent is not None]
    if extents:
        lows, highs = zip(*extents, strict=True)
        what = f"{what} ({min(lows):.3g} to {max(highs):.3g})"
    return f"'{buffer}' {what} on {mean:.1%} of the surfaces of {frames}{then}"


def _look_at_frame(
    stored: Stored,
    conventions: Conventions,
    camera: CameraMetadata,
    before: tuple[Stored, CameraMetadata] | None,
    binding: Binding,
) -> Iterator[_Seen]:
    if before is not None and Buffer.MOTION in stored:
        yield from _look_at_motion(stored, before[0], conventions, camera, before[1])
    size = next(iter(stored.values()))
    thinning = ThinnedFrame.of(size)
    thinned: dict[Buffer, Tensor] = {
        b: thinning.image(t) for b, t in stored.items() if b != Buffer.MOTION
    }
    sky = mark_sky(thinned, conventions)
    if sky is None:
        return
    tells = Buffer.DEPTH in thinned and bool(thinned[Buffer.DEPTH].any())
    no_normals = Buffer.NORMAL in stored and not stored[Buffer.NORMAL].any()
    if no_normals and not tells and bool(sky.all()):
        yield _Seen(
            buffer=Buffer.NORMAL,
            what="is 0 in every pixel",
            then=": all of it is taken for sky; render the normal pass, or depth, which tells sky",
        )
    # where depth is none, as where files have no pixels, the rule of the sky tells
    surface = ~sky & (thinned[Buffer.DEPTH] > 0) if Buffer.DEPTH in thinned else ~sky
    if int(surface.sum()) < LEAST_SURFACE:
        return
    yield from _look_for_zeros(thinned, surface, conventions)
    yield from _look_at_ranges(thinned, surface, binding)
    yield from _look_at_geometry(thinned, surface, conventions, binding)


def _look_for_zeros(stored: Stored, surface: Mask, conventions: Conventions) -> Iterator[_Seen]:
    for buffer, (most, consequence) in NEVER_ZERO.items():
        if buffer not in stored:
            continue
        share = _share((stored[buffer] == 0).all(1, keepdim=True), surface)
        if buffer is Buffer.NORMAL and conventions.normal.packed:
            middle = (stored[buffer] - 0.5).abs().amax(1, keepdim=True) < SAME
            share += _share(middle, surface)
        if share > most:
            then = f": {consequence}; render that pass again, or leave it out"
            yield _Seen(buffer=buffer, what="is 0", then=then, share=share)


def _look_at_ranges(stored: Stored, surface: Mask, binding: Binding) -> Iterator[_Seen]:
    for buffer in SHARES:
        if buffer not in stored:
            continue
        values = stored[buffer]
        share = _share((values < -OUTSIDE) | (values > 1.0 + OUTSIDE), surface)
        if share > DOUBTFUL:
            yield _Seen(
                buffer=buffer,
                what="is outside of 0..1",
                then=": it is clamped there; render it again as 0..1",
                share=share,
                extent=_measure_extent(values[surface]),
                line=_suggest_range(buffer, values[surface], binding),
            )
    for buffer in COLOURS:
        if buffer not in stored:
            continue
        colour = stored[buffer]
        known = surface & (colour != 0).any(1, keepdim=True)
        share = _share((colour > CONSTANTS[buffer][1]).any(1, keepdim=True), known)
        if int(known.sum()) >= LEAST_SURFACE and share > MOST_SURFACES:
            values = colour[0][:, known[0, 0]]
            yield _Seen(
                buffer=buffer,
                what="is above 1",
                then=", which no surface reflects: lighting is radiance divided by it; render it "
                "again as 0..1, linear",
                share=share,
                extent=_measure_extent(values),
                line=_suggest_range(buffer, values, binding),
            )


def _measure_extent(values: Tensor) -> tuple[float, float]:
    finite = values[torch.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.numel() else (0.0, 0.0)


def _suggest_range(buffer: Buffer, values: Tensor, binding: Binding) -> str:
    """The line that divides values beyond 0..1, if they may be those of bits; else empty."""
    low, high = _measure_extent(values)
    most = EIGHT_BITS if high <= EIGHT_BITS else SIXTEEN_BITS
    if low < -OUTSIDE or not USED_BITS * most <= high <= most:
        return ""
    line = _declare(buffer, binding, 1.0 / most)
    return f", or, if it is stored as 0..{most}, declare that ({line})"


def _declare(buffer: Buffer, binding: Binding, factor: float, added: float = 0.0) -> str:
    """The line that declares a buffer to be `factor` times what it is bound to, and a constant."""
    several = len({channel.stream for bound in binding.values() for channel in bound}) > 1
    # so many digits are exact enough, and can be read
    bound = binding[buffer].multiplied(float(f"{factor:.6g}"), added)
    return f'capture.toml: [buffers] {buffer} = "{bound.describe(streams=several)}"'


def _look_at_geometry(
    stored: Stored, surface: Mask, conventions: Conventions, binding: Binding
) -> Iterator[_Seen]:
    """Passes of one value, and normals of other lengths."""
    depth, normal = stored.get(Buffer.DEPTH), stored.get(Buffer.NORMAL)
    known = None if normal is None else surface & (normal != 0).any(1, keepdim=True)
    if normal is None or known is None or int(known.sum()) < LEAST_SURFACE:
        return
    vectors = normal[0][:, known[0, 0]]
    alike = measure_likeness(vectors)
    if alike > ONE_VALUE and depth is not None and _has_several_planes(depth, known, conventions):
        yield _Seen(
            buffer=Buffer.NORMAL,
            what="is one vector",
            then=": depth has several surfaces there, which are not told apart; render the normal "
            "pass, or leave it out",
            share=alike,
        )
        return
    if depth is not None and alike < ONE_VALUE:
        values = depth[known]
        same = float((values == values.median()).float().mean())
        if same > ONE_VALUE:
            yield _Seen(
                buffer=Buffer.DEPTH,
                what="is one value",
                then=": surfaces there face several ways; render the depth pass, or leave it out",
                share=same,
            )
    yield from _look_at_lengths(vectors, binding)


def _look_at_lengths(vectors: Tensor, binding: Binding) -> Iterator[_Seen]:
    """Say of normals, plain or packed, that half of them are of no length that normals have."""
    lengths = [v.square().sum(0).sqrt() for v in (vectors, 2.0 * vectors - 1.0)]
    wrong = [float(((n < UNIT[0]) | (n > UNIT[1])).float().mean()) for n in lengths]
    if min(wrong) > 0.5:
        line = _declare_range(vectors, lengths[0], binding)
        # rounded, as it is much the same in all frames, which are said together
        length = float(f"{float(lengths[0].median()):.2g}")
        yield _Seen(
            buffer=Buffer.NORMAL,
            what=f"has a length of {length:g}, not 1,",
            then=": only its direction is used",
            share=wrong[0],
            line=f"; declare its range ({line})" if line else "",
        )


def _declare_range(vectors: Tensor, lengths: Tensor, binding: Binding) -> str:
    """The line that makes normals unit vectors: 8 bits, or all of one length; else empty."""
    if float(vectors.min()) >= 0.0 and 1.0 < float(vectors.max()) <= EIGHT_BITS:
        return _declare(Buffer.NORMAL, binding, 2.0 / EIGHT_BITS, -1.0)
    length = float(lengths.median())
    like = (lengths > UNIT[0] * length) & (lengths < UNIT[1] * length)
    if float(like.float().mean()) < 1.0 - DOUBTFUL:
        return ""
    return _declare(Buffer.NORMAL, binding, float(f"{1.0 / length:.3g}"))


def _has_several_planes(depth: Plane, known: Mask, conventions: Conventions) -> bool:
    """Tell whether depth is not that of one plane, which is affine in the pixel or its inverse is.

    1 / z = a + b x + c y   (perspective),   z = a + b x + c y   (orthographic, device)
    """
    rows, columns = known[0, 0].nonzero(as_tuple=True)
    stored = depth[0, 0][rows, columns].double()
    usable = torch.isfinite(stored) & (stored > 0)
    if int(usable.sum()) < LEAST_SURFACE:
        return False
    values, x, y = (t[usable].double() for t in (stored, columns, rows))
    design = torch.stack([torch.ones_like(x), x, y], dim=1)
    candidates = [values]
    if conventions.depth.kind is not DepthKind.DEVICE:
        candidates.append(1.0 / values)
    for target in candidates:
        plane = design @ torch.linalg.lstsq(design, target.unsqueeze(1)).solution
        off = (target - plane[:, 0]).abs() > OFF_PLANE * target
        if float(off.double().mean()) < SEVERAL_PLANES:
            return False
    return True


def _look_at_motion(
    stored: Stored,
    before: Stored,
    conventions: Conventions,
    camera: CameraMetadata,
    camera_before: CameraMetadata,
) -> Iterator[_Seen]:
    """Vectors that cannot be those of a camera that moves."""
    pose, previous = camera.world_to_camera, camera_before.world_to_camera
    if pose is None or previous is None or pose.equal(previous):
        return
    motion = stored[Buffer.MOTION] - conventions.motion.zero
    then = ", though the camera moves: the motion pass is missing; render it, or leave it out"
    if not motion.any():
        yield _Seen(buffer=Buffer.MOTION, what="is zero in every pixel", then=then)
        return
    projection = camera.projection
    flat = projection is not None and is_orthographic(projection)
    low, high = motion.flatten(2).aminmax(dim=2)
    depth = stored.get(Buffer.DEPTH)
    if not flat and bool((low == high).all()) and depth is not None and bool(depth.diff().any()):
        yield _Seen(buffer=Buffer.MOTION, what="is one vector in every pixel", then=then)
    known = before.get(Buffer.MOTION), before.get(Buffer.DEPTH)
    if depth is None or known[0] is None or known[1] is None or known[1].equal(depth):
        return
    if bool((low != high).any()) and known[0].equal(stored[Buffer.MOTION]):
        then = ", though depth is another: the pass of one frame several times; render it again"
        yield _Seen(
            buffer=Buffer.MOTION, what="is that of the frame before in every pixel", then=then
        )


def _share(marked: Mask, surface: Mask) -> float:
    return float(marked[surface].float().mean())
