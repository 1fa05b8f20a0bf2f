"""`taau`: what its parts promise, on samples made by hand."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest
import torch

from rtsr_cli.core.imaging.color import decode_reinhard, encode_reinhard
from rtsr_cli.core.imaging.color_neighbourhood import (
    clip_to_neighbourhood,
    from_ycocg,
    measure_neighbourhood,
    to_ycocg,
)
from rtsr_cli.core.imaging.resampling import decimate, halton_offset, sample_jitter
from rtsr_cli.core.imaging.sample_splats import splat_samples
from rtsr_cli.models.taau import (
    LrSamples,
    TaauConfig,
    accumulate,
    change_of_samples,
    find_rejected,
)

SCALE = 2
SIZE = (32, 48)
"""Height and width at the target size."""


def checkers() -> torch.Tensor:
    """Radiance with detail of a few pixels at the target size."""
    y, x = torch.meshgrid(torch.arange(SIZE[0]), torch.arange(SIZE[1]), indexing="ij")
    tone = ((x // 3 + y // 5) % 2).float() * 0.6 + 0.1
    return torch.stack([tone, tone * 0.5, 1.0 - tone])[None]


def samples(
    radiance: torch.Tensor,
    offset: tuple[int, int],
    *,
    motion: tuple[float, float] = (0.0, 0.0),
    object_id: torch.Tensor | None = None,
) -> LrSamples:
    color = decimate(radiance, SCALE, offset)
    plane = torch.ones_like(color[:, :1])
    return LrSamples(
        color_tonemapped=encode_reinhard(color),
        motion_px=torch.tensor(motion).view(1, 2, 1, 1) * torch.cat([plane, plane], dim=1),
        depth_m=5.0 * plane,
        object_id=plane.to(torch.int32) if object_id is None else object_id,
        jitter_px=(sample_jitter(offset[0], SCALE), sample_jitter(offset[1], SCALE)),
    )


def still(radiance: torch.Tensor, frames: int) -> Iterator[torch.Tensor]:
    state = None
    for number in range(1, frames + 1):
        frame = samples(radiance, halton_offset(number, SCALE))
        image, state = accumulate(state, frame, scale=SCALE, config=TaauConfig())
        yield image


def error(image: torch.Tensor, reference: torch.Tensor) -> float:
    difference = encode_reinhard(image) - encode_reinhard(reference)
    return float(difference[..., 4:-4, 4:-4].square().mean())


def test_ycocg_returns_the_colour() -> None:
    color = torch.rand(1, 3, 4, 5, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(from_ycocg(to_ycocg(color)), color)


def test_a_sample_on_a_pixel_centre_weighs_most_there() -> None:
    frame = samples(checkers(), (0, 0))
    color = frame.color_tonemapped
    _, weight = splat_samples(color, frame.jitter_px, SCALE, sigma_px=0.4)
    # samples lie on even pixels; half a pixel further on, exp(-1 / (2 * 0.16)) is left
    inner = weight[0, 0, 8:16, 8:16]
    assert float(inner[0, 0]) == pytest.approx(1.0, abs=0.01)
    assert float(inner[0, 1]) == pytest.approx(2 * math.exp(-1 / 0.32), rel=0.05)


def test_a_still_jittered_sequence_converges_to_the_full_image() -> None:
    reference = checkers()
    errors = [error(image, reference) for image in still(reference, 12)]
    assert errors[-1] < 0.05 * errors[0]


def test_a_change_of_lighting_gets_through_within_three_frames() -> None:
    reference = checkers()
    state = None
    for number in range(1, 13):
        gain = 3.0 if number >= 9 else 1.0
        frame = samples(reference * gain, halton_offset(number, SCALE))
        image, state = accumulate(state, frame, scale=SCALE, config=TaauConfig())
        if number == 11:
            young = list(still(reference * 3.0, 3))[-1]
            assert error(image, reference * 3.0) < 2.0 * error(young, reference * 3.0)


def test_history_follows_a_change_of_pre_exposure() -> None:
    reference = checkers()
    first = samples(reference, (0, 0))
    _, state = accumulate(None, first, scale=SCALE, config=TaauConfig(), pre_exposure=1.0)
    doubled = samples(2.0 * reference, (1, 1))
    image, _ = accumulate(state, doubled, scale=SCALE, config=TaauConfig(), pre_exposure=2.0)
    wrong, _ = accumulate(state, doubled, scale=SCALE, config=TaauConfig(), pre_exposure=1.0)
    assert error(image, 2.0 * reference) < error(wrong, 2.0 * reference)


def test_a_new_object_is_rejected_and_its_surroundings_are_not() -> None:
    before = samples(checkers(), (0, 0))
    ids = torch.ones_like(before.depth_m).to(torch.int32)
    ids[..., 4:12, 6:14] = 2
    now = samples(checkers(), (0, 0), object_id=ids)
    rejected = find_rejected(now, before, 0.05)[0, 0]
    assert (rejected[6:10, 8:12] == 1).all()
    assert (rejected[:2] == 0).all()


def test_residuals_of_one_sign_are_a_change_and_of_both_are_aliasing() -> None:
    valid = torch.ones(1, 1, 6, 6)
    signs = torch.ones(6, 6)
    signs[::2, ::2] = signs[1::2, 1::2] = -1.0
    aliased = (0.2 * signs).expand(1, 3, 6, 6)
    changed = torch.full((1, 3, 6, 6), 0.2)
    config = TaauConfig()
    assert float(change_of_samples(aliased, valid, config)[..., 1:-1, 1:-1].max()) == 0.0
    assert float(change_of_samples(changed, valid, config).min()) == 1.0


def test_clipping_bounds_history_by_the_neighbourhood() -> None:
    colors = torch.full((1, 3, 4, 4), 0.5)
    history = torch.full((1, 3, 8, 8), 0.9)
    around = measure_neighbourhood(colors, SCALE, (0.0, 0.0))
    clipped = clip_to_neighbourhood(history, around, torch.ones(1, 1, 8, 8))
    torch.testing.assert_close(clipped, torch.full((1, 3, 8, 8), 0.5))


def test_the_first_frame_is_finite_and_within_the_samples_range() -> None:
    radiance = checkers() * 1000.0
    image, _ = accumulate(None, samples(radiance, (1, 0)), scale=SCALE, config=TaauConfig())
    assert torch.isfinite(image).all()
    assert float(image.max()) <= float(decode_reinhard(torch.tensor(0.99991)))
