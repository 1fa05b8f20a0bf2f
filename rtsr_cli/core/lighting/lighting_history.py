"""Lighting that is gathered at the target size, frame after frame, along surfaces.

    h(p), c(p)   lighting so far and samples that it is worth, where p's surface was
    d(p) = guided enlargement of e(q) - h(q) over the samples q whose surface was seen before
    t(p) = u clamp(3 |d|^2 / E|e - h|^2 - 2),   E as enlarged: 1 where samples have changed alike
    u(q) = max(c . D, 0) / (|c| max(A, 2 |c|)),   c = e(q) - h(q); D, A sums of c, |c| around q
    c' = a c / (1 + (1 + r t) |d|^2 / s^2)
    h' = h + b max(min(1, fit(p) / v) min(1, m / c'), t) d
    n(p) = fit(p)^f,   how well the best sample fits p
    e'(p) = (c' h' + n g) / (c' + n),   c(p) = c' + n

g is the guided enlargement of the frame's own lighting e = log(1 + lighting / k). A pixel takes
most from the frames whose samples came nearest to it on its own surface; those of this frame tell
how light has changed since. A change on which they agree is the light's: it is believed, and takes
from what history is worth. Of others less is believed, the more samples history is worth: what
one sample differs by from a settled history is its own; and the less, the worse samples fit: what
other surfaces say of it never ends where no sample of its own brings a pixel back. History of
another surface weighs nothing (`warp_along_surfaces`).

Conventions: history lies on the HR frame's own pixels; samples are enlarged, and blended with it,
on the grid that `alignment` moves.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace

import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.alignment import block_shift, shift_image
from rtsr_cli.core.imaging.guided_enlargement import upsample_guided_and_fit
from rtsr_cli.core.imaging.guided_kernel import GuidedSamples, SurfaceGuides
from rtsr_cli.core.imaging.resampling import sum_neighbours, upsample_nearest
from rtsr_cli.core.imaging.surface_history import warp_along_surfaces
from rtsr_cli.core.imaging.surfaces import Surfaces, describe_surfaces, find_moving
from rtsr_cli.core.imaging.warping import upsample_motion
from rtsr_cli.core.lighting.lighting import (
    GUIDES,
    decode_lighting,
    encode_frame,
    encode_lighting,
    enlarge_cubic,
    guide_window,
    lighting_scale_of,
)
from rtsr_cli.core.lighting.past_lighting import find_divided
from rtsr_cli.core.settings import check_numbers
from rtsr_cli.core.shapes import Color, Image, Mask, MotionPx, Plane
from rtsr_cli.core.system import FrameWindow, Tensors

LR_BUFFERS = (*GUIDES, Buffer.MOTION)
HR_BUFFERS = GUIDES
LR_OPTIONAL = (Buffer.REACTIVE,)
HR_OPTIONAL = (Buffer.MOTION, Buffer.OBJECT_ID, Buffer.POSITION)
"""What this module reads beside what `lighting` reads."""

HISTORY_FRAMES = 1
"""Of the window: whose camera tells what moves by itself."""

LEAST_COMPARED_WORTH = 1e-3
"""Samples that history has to be worth to be compared with the frame's."""

LEAST_KNOWN_SHARE = 0.05
"""Share of samples around with a history from which a change is known."""

LEAST_SQUARE = 1e-8
"""Of a change, so that none agrees with none."""

OTHERS = 2.0
"""Samples that have to have changed as one did, so that the change is not its own."""

LEAST_WORTH = 1e-6
"""Where nothing is worth anything, the frame's own enlargement stands."""

SURFACE_PLANES = tuple(field.name for field in fields(Surfaces))


@dataclass(frozen=True, kw_only=True)
class HistoryWeights:
    """Weights of the equations above.

    Attributes:
        age: a, what history is still worth a frame later.
        change: b, share of the change at the samples that is believed.
        change_worth: m, samples that history is worth from which less of the change is believed.
        change_agreed: r, how much more a change counts on which the samples agree.
        change_spread: s, change of log lighting that halves what history is worth.
        change_fit: v, fit of a pixel's best sample from which all of a change is believed: that of
            a sample of its own surface as far away as the nearest one may be.
        fit_power: f.
    """

    age: float = 0.9
    change: float = 0.65
    change_worth: float = 2.0
    change_agreed: float = 3.0
    change_spread: float = 0.5
    change_fit: float = 0.6
    fit_power: float = 4.0

    def __post_init__(self) -> None:
        """Hold `age` and `change` to be shares, the others to be positive.

        Raises:
            ConfigError: one is out of its range.
        """
        least = {
            "age": 0.0,
            "change": 0.0,
            "change_worth": 0.0,
            "change_agreed": 0.0,
            "change_spread": 1e-3,
            "change_fit": 1e-3,
            "fit_power": 0.0,
        }
        check_numbers(self, "network", least, {"age": 1.0, "change": 1.0})


@dataclass(frozen=True, kw_only=True)
class LightingHistory:
    """What one frame leaves to the next, at the target size.

    Attributes:
        lighting: linear, as the frame was exposed.
        worth: samples that it is worth.
        surfaces: that it lies on.
        jitter: n 2 1 1, where its pixels lie, minus pixel centres.
        exposure: n 1 1 1, of the frame.
    """

    lighting: Color
    worth: Plane
    surfaces: Surfaces
    jitter: Tensor
    exposure: Tensor


@dataclass(frozen=True, kw_only=True)
class CarriedLighting:
    """History where each pixel's surface was, on the moved grid.

    Attributes:
        encoded: h, anything where it is worth nothing.
        worth: c.
    """

    encoded: Color
    worth: Plane


@dataclass(frozen=True, kw_only=True)
class EnlargedLighting:
    """What a frame's own samples say at every pixel, on the moved grid.

    Attributes:
        encoded: g.
        fit: how well the best of them fits.
        change: d, 0 where it is not known.
        seen: share of the samples around whose surface was seen before.
        agreement: t, 1 where these have changed alike, 0 where a third of it is their own or the
            block's sample has changed alone.
    """

    encoded: Color
    fit: Plane
    change: Color
    seen: Plane
    agreement: Plane


@dataclass(frozen=True, kw_only=True)
class GatheredLighting:
    """Lighting of a frame, on the moved grid.

    Attributes:
        encoded: e'.
        worth: c.
        history: what goes on to the next frame.
    """

    encoded: Color
    worth: Plane
    history: LightingHistory


def describe_window(window: FrameWindow) -> dict[str, Tensor]:
    """What gathering reads of a window, by name.

    encoded, mask, small_normal, small_depth    LR: e, 1 where it counts, guides
    normal, depth, cubic                        HR, moved: guides, cubic enlargement of e
    facing, position, plane, tolerance, kind    HR: `Surfaces`
    motion, trusted                             HR: of surfaces, px; 1 where history may be used
    jitter, shift                               n 2 1 1, HR pixels: of the HR frame; of the grid
    exposure, lighting_scale                    n 1 1 1: pre-exposure; k
    """
    lr, hr = window.current, window.require_hr()
    encoded = encode_frame(lr)
    small, large = guide_window(window)
    motion = find_surface_motion(window)
    surfaces = describe_surfaces(hr, find_divided(hr))
    before = _find_camera_before(window)
    if before is not None:
        surfaces = surfaces.widen(find_moving(surfaces, motion, before))
    one = torch.ones_like(surfaces.kind[:, :, :1, :1])

    def as_vector(pair: tuple[float, float]) -> Tensor:
        return one.new_tensor(pair).view(1, 2, 1, 1)

    return {
        "encoded": encoded,
        "mask": lr.gbuffer[Buffer.LIGHTING_MASK],
        "small_normal": small.normal,
        "small_depth": small.depth,
        "normal": large.normal,
        "depth": large.depth,
        "cubic": enlarge_cubic(window, encoded),
        **{name: getattr(surfaces, name) for name in SURFACE_PLANES},
        "motion": motion,
        "trusted": _find_trusted(window),
        "jitter": as_vector(hr.camera.jitter_px),
        "shift": as_vector(block_shift(lr.camera.jitter_px, window.scale)),
        "exposure": one * hr.camera.pre_exposure,
        "lighting_scale": lighting_scale_of(lr),
    }


def move_grid(image: Image, inputs: Tensors, *, back: bool = False) -> Image:
    """Bring an HR image onto the moved grid, or back from it."""
    sign = -1 if back else 1
    shifts = [(sign * int(x), sign * int(y)) for x, y in inputs["shift"].flatten(1).tolist()]
    moved = [shift_image(image[i, None], shift) for i, shift in enumerate(shifts)]
    return moved[0] if len(moved) == 1 else torch.cat(moved)


def find_surface_motion(window: FrameWindow) -> MotionPx:
    """Motion of the surfaces that HR pixels show, HR pixels; that of the nearest LR sample where
    the HR G-buffer has none.
    """
    hr, lr = window.require_hr(), window.current
    own = hr.gbuffer.buffers.get(Buffer.MOTION)
    if own is not None:
        return own
    motion: MotionPx = upsample_motion(
        lr.gbuffer[Buffer.MOTION], window.scale, mode="nearest", jitter_px=lr.camera.jitter_px
    )
    return motion


def _find_camera_before(window: FrameWindow) -> Frame | None:
    """The frame before, as a camera of the HR frame's size and jitter; None if it is not known."""
    if len(window.lr) <= HISTORY_FRAMES:
        return None
    hr, before = window.require_hr(), window.lr[HISTORY_FRAMES]
    camera = replace(before.camera, jitter_px=hr.camera.jitter_px)
    return replace(before, camera=camera, view=hr.view)


def _find_trusted(window: FrameWindow) -> Plane:
    reactive = window.current.gbuffer.buffers.get(Buffer.REACTIVE)
    if reactive is None:
        return torch.ones_like(window.require_hr().gbuffer[Buffer.SKY])
    return 1.0 - upsample_nearest(reactive.clamp(0.0, 1.0), window.scale)


def describe_samples(inputs: Tensors, values: Image) -> GuidedSamples:
    """What is enlarged along the surfaces of a window; log lighting comes first among `values`."""
    height, small_height = inputs["depth"].shape[2], inputs["mask"].shape[2]
    return GuidedSamples(
        values=values,
        mask=inputs["mask"],
        small=SurfaceGuides(normal=inputs["small_normal"], depth=inputs["small_depth"]),
        large=SurfaceGuides(normal=inputs["normal"], depth=inputs["depth"]),
        scale=height // small_height,
        fallback=inputs["cubic"],
    )


def carry_history(before: LightingHistory, inputs: Tensors) -> CarriedLighting:
    """Bring history to where each pixel's surface was."""
    motion = inputs["motion"] + inputs["jitter"] - before.jitter
    gain = inputs["exposure"] / before.exposure
    encoded = encode_lighting(before.lighting * gain, inputs["lighting_scale"])
    carried = warp_along_surfaces(
        torch.cat([encoded, before.worth], dim=1), motion, own_surfaces(inputs), before.surfaces
    )
    encoded, worth = carried.values.split_with_sizes([3, 1], dim=1)
    known = torch.cat([encoded, worth * carried.weight * inputs["trusted"]], dim=1)
    encoded, worth = move_grid(known, inputs).split_with_sizes([3, 1], dim=1)
    return CarriedLighting(encoded=encoded, worth=worth)


def own_surfaces(inputs: Mapping[str, Tensor]) -> Surfaces:
    """Surfaces of a window."""
    return Surfaces(**{name: inputs[name] for name in SURFACE_PLANES})


def sample_change(inputs: Tensors, carried: CarriedLighting) -> tuple[Color, Mask]:
    """e - h at the samples whose surface was seen before, and 1 for these."""
    scale = inputs["depth"].shape[2] // inputs["mask"].shape[2]
    middle = slice(scale // 2, None, scale)
    history, worth = (image[..., middle, middle] for image in (carried.encoded, carried.worth))
    seen = (worth > LEAST_COMPARED_WORTH).to(worth) * inputs["mask"]
    return (inputs["encoded"] - history) * seen, seen


def enlarge_frame(inputs: Tensors, carried: CarriedLighting | None) -> EnlargedLighting:
    """Enlarge log lighting and its change at once, as their weights are one."""
    if carried is None:
        return split_enlarged(*upsample_guided_and_fit(describe_samples(inputs, inputs["encoded"])))
    change, seen = sample_change(inputs, carried)
    values = torch.cat([inputs["encoded"], change, seen, _square(change)], dim=1)
    samples = describe_samples(inputs, values)
    frame = split_enlarged(*upsample_guided_and_fit(samples))
    shared = upsample_nearest(measure_shared_change(change), samples.scale)
    return replace(frame, agreement=frame.agreement * shared)


def measure_shared_change(change: Color) -> Plane:
    """u: how far the eight samples around each have changed as it did, n 1 h w."""
    size = change.square().sum(1, keepdim=True).sqrt()
    others, sizes = sum_neighbours(torch.cat([change, size], dim=1)).split_with_sizes([3, 1], dim=1)
    alike = (change * others).sum(1, keepdim=True).clamp(min=0.0)
    return alike / (size * torch.maximum(sizes, OTHERS * size)).clamp(min=LEAST_SQUARE)


def _square(change: Color) -> Plane:
    """|d|^2: mean over the channels, plane by plane, as a picture of squares is one too many."""
    red, green, blue = change.chunk(3, dim=1)
    return (red * red).addcmul_(green, green).addcmul_(blue, blue).div_(3.0)


def split_enlarged(enlarged: Image, fit: Plane) -> EnlargedLighting:
    """Name the channels of what was enlarged: e, c, seen, |c|^2 with history; t without u."""
    encoded, nothing = enlarged[:, :3], torch.zeros_like(fit)
    if enlarged.shape[1] == 3:
        return EnlargedLighting(
            encoded=encoded,
            fit=fit,
            change=torch.zeros_like(encoded),
            seen=nothing,
            agreement=nothing,
        )
    seen = enlarged[:, 6:7]
    share = seen.clamp(min=LEAST_KNOWN_SHARE)
    known = torch.gt(seen, LEAST_KNOWN_SHARE, out=torch.empty_like(seen))
    change = (enlarged[:, 3:6] / share).mul_(known)
    shared = _square(change).div_((enlarged[:, 7:] / share).clamp_(min=LEAST_SQUARE))
    agreement = shared.mul_(3.0).sub_(2.0).clamp_(0.0, 1.0)
    return EnlargedLighting(encoded=encoded, fit=fit, change=change, seen=seen, agreement=agreement)


def age_worth(worth: Plane, frame: EnlargedLighting, weights: HistoryWeights) -> Plane:
    """c' = a c / (1 + (1 + r t) |d|^2 / s^2)."""
    spread = weights.change_spread**2 / (1.0 + weights.change_agreed * frame.agreement)
    return worth * weights.age / (1.0 + _square(frame.change) / spread)


def blend_history(
    frame: EnlargedLighting,
    carried: CarriedLighting,
    *,
    fresh: Plane,
    share: Plane | float,
    weights: HistoryWeights,
) -> Color:
    """e' = (c' h' + n g) / (c' + n).

    Args:
        frame: g and d.
        carried: h and c'.
        fresh: n.
        share: b.
        weights: of the equations.
    """
    total = (fresh + carried.worth).clamp(min=LEAST_WORTH)
    settled = (carried.worth / max(weights.change_worth, LEAST_WORTH)).clamp(min=1.0)
    fitting = (frame.fit / weights.change_fit).clamp(max=1.0)
    believed = share * torch.maximum(fitting / settled, frame.agreement)
    moved = carried.encoded + believed * frame.change
    return torch.lerp(frame.encoded, moved, carried.worth / total).clamp(min=0.0)


def keep_history(inputs: Tensors, encoded: Color, worth: Plane) -> LightingHistory:
    """What goes on to the next frame."""
    lighting = decode_lighting(encoded, inputs["lighting_scale"])
    return LightingHistory(
        lighting=move_grid(lighting, inputs, back=True),
        worth=move_grid(worth, inputs, back=True),
        surfaces=own_surfaces(inputs),
        jitter=inputs["jitter"],
        exposure=inputs["exposure"],
    )


def gather_lighting(
    inputs: Tensors,
    before: LightingHistory | None,
    weights: HistoryWeights,
    finish: Callable[[Tensors, Color], Color],
) -> GatheredLighting:
    """Gather a frame's samples; without history they are enlarged along surfaces.

    Args:
        inputs: `describe_window`.
        before: history, None at a reset.
        weights: of the equations.
        finish: (inputs, e') -> log lighting that is shown and goes on.
    """
    carried = None if before is None else carry_history(before, inputs)
    frame = enlarge_frame(inputs, carried)
    worth = fresh = frame.fit.pow(weights.fit_power)
    encoded = frame.encoded
    if carried is not None:
        aged = replace(carried, worth=age_worth(carried.worth, frame, weights))
        encoded = blend_history(frame, aged, fresh=fresh, share=weights.change, weights=weights)
        worth = fresh + aged.worth
    encoded = finish(inputs, encoded)
    return GatheredLighting(
        encoded=encoded, worth=worth, history=keep_history(inputs, encoded, worth)
    )
