"""`taau`: temporal anti-aliasing upsampling, the strong baseline without a network.

The engines' method [Karis 2014; Yang et al. 2020, A Survey of Temporal Antialiasing Techniques]:
jittered LR samples are accumulated at the target size, un-jittered, each output pixel weighting
samples by their distance; history is fetched along dilated motion with Catmull-Rom and clipped to
the neighbourhood's mean and deviation in YCoCg.

What is ours: how much history is trusted. Point samples alias, so that a clip box of nine of them
is a poor judge of a converged history. Where the surface stands still, the box is wide and the
counter unbounded; a t-test of the samples against the history where they lie tells a change of
lighting, and makes the history young there. Where it moves, the box is tight and the history short.

Conventions: LR buffers only (radiance, motion, depth, ids where there are any); state and history
are tone-mapped, c/(1+c); history moves along (x, y) + motion. Departs from engines: no
sharpening, whole frames only (the state has the target's size).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.frames.storage import MAX_HALF
from rtsr_cli.core.frames.vector_length import vector_length
from rtsr_cli.core.imaging.color import decode_reinhard, encode_reinhard
from rtsr_cli.core.imaging.color_neighbourhood import (
    clip_to_neighbourhood,
    from_ycocg,
    measure_neighbourhood,
    to_ycocg,
)
from rtsr_cli.core.imaging.disocclusion import bound_depth, depth_slope
from rtsr_cli.core.imaging.resampling import (
    BILINEAR,
    mean_3x3,
    sample_at_lr,
    upsample,
    upsample_nearest,
)
from rtsr_cli.core.imaging.sample_splats import (
    find_brightest,
    interpolate_samples,
    splat_samples,
)
from rtsr_cli.core.imaging.splatting import forward_splat
from rtsr_cli.core.imaging.warping import backward_warp, dilate_motion, fetch_nearest
from rtsr_cli.core.shapes import Color, IdMap, Image, Mask, MotionPx, Plane
from rtsr_cli.core.system import FrameWindow, Prediction, State, System, build_baseline

NEIGHBOURHOOD = 9
"""Samples in a 3x3 neighbourhood."""

PREROLL_FRAMES = 16
"""Frames that a shard replays: moving history is far shorter, still history has converged."""


@dataclass(frozen=True, kw_only=True)
class TaauConfig:
    """How samples and history weigh against each other; weights count samples.

    Attributes:
        sample_sigma_px: spread of a sample, in output pixels.
        prior_a: slope of the cubic kernel of the spatial estimate (softer than Keys').
        prior_weight: weight of the spatial estimate where there is no history.
        moving_prior_weight: the same where the surface moves.
        still_px: motion (output pixels a frame) at which stillness has fallen to 1/e.
        max_count_still: bound of the sample counter where the surface stands still.
        max_count_moving: the same where it moves.
        clip_moving: half width of the clip box in deviations where history is not trusted.
        clip_still: the same where it is.
        trusted_count: samples after which a still history is trusted in full.
        change_floor: tone-mapped standard error that no test goes below.
        change_low, change_high: t values between which history goes from kept to young.
        depth_tolerance: relative difference of depth that is the same surface.
    """

    sample_sigma_px: float = 0.4
    prior_a: float = -0.3
    prior_weight: float = 0.1
    moving_prior_weight: float = 0.5
    still_px: float = 0.05
    max_count_still: float = 1e3
    max_count_moving: float = 0.5
    clip_moving: float = 1.0
    clip_still: float = 6.0
    trusted_count: float = 1.0
    change_floor: float = 2e-3
    change_low: float = 3.0
    change_high: float = 6.0
    depth_tolerance: float = 0.05


@dataclass(frozen=True, kw_only=True)
class LrSamples:
    """One frame's samples: tone-mapped colour, motion, depth, ids, and where they lie.

    `reactive` is 1 where history is not to be trusted (particles, translucents).
    """

    color_tonemapped: Color
    motion_px: MotionPx
    depth_m: Plane
    object_id: IdMap | None
    jitter_px: Jitter
    reactive: Plane | None = None

    @property
    def brightest(self) -> float:
        """Tone-mapped value that interpolation may reach; samples in float64 are brighter."""
        return find_brightest(self.color_tonemapped)


@dataclass(frozen=True, kw_only=True)
class TaauState:
    """History: tone-mapped colour and sample counter at the target size, and the last samples."""

    color_tonemapped: Color
    count: Plane
    samples: LrSamples
    pre_exposure: float

    def to(self, dtype: torch.dtype) -> TaauState:
        """Return the same history in the precision of the samples that it meets."""
        if self.count.dtype == dtype:
            return self
        samples = replace(self.samples, depth_m=self.samples.depth_m.to(dtype))
        color, count = self.color_tonemapped.to(dtype), self.count.to(dtype)
        return replace(self, color_tonemapped=color, count=count, samples=samples)


def find_rejected(now: LrSamples, before: LrSamples, depth_tolerance: float) -> Mask:
    """1 where the surface of a sample was not seen in the previous frame.

    Either something nearer moved to where it was (forward splat of the depths), or no sample
    around its previous position has its id and depth, nor has any of its neighbours'.
    """
    depth = bound_depth(now.depth_m)
    tolerance = depth_tolerance * depth + depth_slope(depth)
    front, hit = forward_splat(depth, now.motion_px, depth)
    front = torch.where(hit > 0, front, depth.new_full((), torch.inf))
    covered = fetch_nearest(front, now.motion_px) < depth - tolerance
    matched = _match_samples(now, before, depth, tolerance)
    lost = F.max_pool2d(matched.to(depth.dtype), 3, stride=1, padding=1) == 0
    return (covered | lost).to(depth.dtype)


def _match_samples(now: LrSamples, before: LrSamples, depth: Plane, tolerance: Plane) -> Tensor:
    """True where one of 3x3 samples around the previous position has the same depth and id."""
    shift = [a - b for a, b in zip(now.jitter_px, before.jitter_px, strict=True)]
    moved = now.motion_px + torch.tensor(shift).to(now.motion_px).view(1, 2, 1, 1)
    nearest = moved.nan_to_num().round()
    depth_before = bound_depth(before.depth_m)
    matched = torch.zeros_like(depth, dtype=torch.bool)
    for dy in (-1.0, 0.0, 1.0):
        for dx in (-1.0, 0.0, 1.0):
            target = nearest + nearest.new_tensor([dx, dy]).view(1, 2, 1, 1)
            same = (fetch_nearest(depth_before, target) - depth).abs() <= tolerance
            if now.object_id is not None and before.object_id is not None:
                same &= fetch_nearest(before.object_id, target) == now.object_id
            matched |= same
    return matched


def change_of_samples(residual: Image, valid: Mask, config: TaauConfig) -> Mask:
    """0 where samples agree with the history, 1 where their neighbourhood says it has changed.

        t = |mean r| / (sqrt(var r / 9) + floor),   r = sample - history at the sample

    An aliased history leaves residuals of both signs; a change of lighting leaves one.
    """
    share = mean_3x3(valid).clamp(min=1.0 / NEIGHBOURHOOD)
    mean = mean_3x3(residual * valid) / share
    variance = (mean_3x3(residual.square() * valid) / share - mean.square()).clamp(min=0.0)
    error = (variance / NEIGHBOURHOOD).sqrt() + config.change_floor
    t = (mean.abs() / error).amax(dim=1, keepdim=True)
    return ((t - config.change_low) / (config.change_high - config.change_low)).clamp(0.0, 1.0)


def accumulate(
    state: TaauState | None,
    samples: LrSamples,
    *,
    scale: int,
    config: TaauConfig,
    pre_exposure: float = 1.0,
) -> tuple[Color, TaauState]:
    """Add one frame's samples to the history.

    Args:
        state: history, None at a reset.
        samples: the frame.
        scale: output pixels per LR pixel.
        config: weights.
        pre_exposure: factor in the frame's radiance; history is brought to it.

    Returns:
        Linear radiance at the target size, and the new history.
    """
    colors, jitter_px = samples.color_tonemapped, samples.jitter_px
    prior = interpolate_samples(
        colors, jitter_px, scale, a=config.prior_a, brightest=samples.brightest
    )
    summed, weight = splat_samples(colors, jitter_px, scale, sigma_px=config.sample_sigma_px)
    if state is None:
        total = weight + config.prior_weight
        color = (summed + prior * config.prior_weight) / total
    else:
        state = state.to(samples.color_tonemapped.dtype)
        history, count, prior_weight = judge_history(state, samples, scale, config, pre_exposure)
        total = count + weight + prior_weight
        color = (history * count + summed + prior * prior_weight) / total
    kept = TaauState(
        color_tonemapped=color, count=total, samples=samples, pre_exposure=pre_exposure
    )
    most = MAX_HALF if color.dtype == torch.float32 else torch.finfo(torch.float32).max
    return decode_reinhard(color, most).float(), kept


def judge_history(
    state: TaauState, samples: LrSamples, scale: int, config: TaauConfig, pre_exposure: float
) -> tuple[Color, Plane, Plane]:
    """Return warped and clipped history, its count, and the weight of the spatial estimate."""
    jitter_px = samples.jitter_px
    dilated = dilate_motion(samples.motion_px, samples.depth_m)
    motion_px = upsample(dilated, scale, jitter_px, kernel=BILINEAR) * scale
    warped, inside = backward_warp(_adjust_exposure(state, pre_exposure), motion_px, mode="bicubic")
    warped = warped.clamp_(0.0, samples.brightest)
    count = backward_warp(state.count, motion_px)[0] * inside

    rejected = find_rejected(samples, state.samples, config.depth_tolerance)
    if samples.reactive is not None:
        rejected = torch.maximum(rejected, samples.reactive.clamp(0.0, 1.0))
    colors = to_ycocg(samples.color_tonemapped)
    history = to_ycocg(warped)
    valid = (sample_at_lr(count, scale, jitter_px) > 0).to(count.dtype) * (1.0 - rejected)
    residual = colors - sample_at_lr(history, scale, jitter_px)
    changed = change_of_samples(residual, valid, config)
    keep = 1.0 - upsample(changed, scale, jitter_px, kernel=BILINEAR)

    still = torch.exp(-vector_length(motion_px) / config.still_px)
    limit = config.max_count_moving + (config.max_count_still - config.max_count_moving) * still
    count = torch.minimum(count, limit)
    young = count.clamp(max=config.max_count_moving)
    count = torch.lerp(young, count, keep) * (1.0 - upsample_nearest(rejected, scale))

    trust = keep * still * (count / config.trusted_count).clamp(max=1.0)
    deviations = config.clip_moving + (config.clip_still - config.clip_moving) * trust
    around = measure_neighbourhood(colors, scale, jitter_px)
    clipped = clip_to_neighbourhood(history, around, deviations)
    alone = config.prior_weight * (1.0 - count.clamp(max=1.0))
    prior_weight = torch.lerp(torch.full_like(still, config.moving_prior_weight), alone, still)
    return from_ycocg(clipped).clamp_(0.0, samples.brightest), count, prior_weight


def _adjust_exposure(state: TaauState, pre_exposure: float) -> Color:
    """History as it would be had it been rendered with this frame's pre-exposure."""
    if pre_exposure == state.pre_exposure:
        return state.color_tonemapped
    gain = pre_exposure / state.pre_exposure
    return encode_reinhard(decode_reinhard(state.color_tonemapped) * gain)


def predict_taau(network: nn.Module, window: FrameWindow, state: State) -> Prediction:
    """Accumulate the current frame."""
    frame = window.current
    if float(frame.gbuffer[Buffer.COLOR].amax()) > MAX_HALF:
        # c/(1+c) in float32 has too few steps left
        doubled = frame.gbuffer.map(lambda _, t: t.double() if t.is_floating_point() else t)
        frame = replace(frame, gbuffer=doubled)
    buffers = frame.gbuffer.buffers
    samples = LrSamples(
        color_tonemapped=encode_reinhard(frame.gbuffer[Buffer.COLOR]),
        motion_px=frame.gbuffer[Buffer.MOTION],
        depth_m=frame.gbuffer[Buffer.DEPTH],
        object_id=buffers.get(Buffer.OBJECT_ID),
        jitter_px=frame.camera.jitter_px,
        reactive=buffers.get(Buffer.REACTIVE),
    )
    image, kept = accumulate(
        cast(TaauState | None, state),
        samples,
        scale=window.scale,
        config=cast(TaauConfig, network.config),
        pre_exposure=frame.camera.pre_exposure,
    )
    return Prediction(image=image, state=kept, debug={"sample_count": kept.count})


TAAU = System(
    name="taau",
    summary="temporal accumulation with variance clipping (baseline)",
    citation="Karis 2014; Yang et al. 2020; Salvi 2016",
    lr_inputs=(Buffer.COLOR, Buffer.MOTION, Buffer.DEPTH),
    lr_optional=(Buffer.OBJECT_ID, Buffer.REACTIVE),
    recurrent=True,
    preroll_frames=PREROLL_FRAMES,
    halo_px=None,
    config=TaauConfig,
    build=build_baseline,
    predict=predict_taau,
)

SYSTEMS = (TAAU,)
