"""Enlargement along surfaces."""

from __future__ import annotations

import math
from itertools import product

import pytest
import torch
import torch.nn.functional as F

from rtsr_cli.core.imaging.guided_enlargement import upsample_emphasised, upsample_guided
from rtsr_cli.core.imaging.guided_kernel import (
    DEPTH_SHARE,
    FACING,
    FALLBACK_WEIGHT,
    LEAST_WEIGHT,
    REACH,
    SLOPE,
    SPREAD,
    GuidedSamples,
    SurfaceGuides,
)
from rtsr_cli.core.shapes import Image

SCALE = 4


def decimated(image: Image, scale: int = SCALE) -> Image:
    return image[..., scale // 2 :: scale, scale // 2 :: scale]


def flat(height: int, width: int, normal: tuple[float, float, float] = (0, 0, 1)) -> SurfaceGuides:
    return SurfaceGuides(
        normal=torch.tensor(normal).view(1, 3, 1, 1).expand(1, 3, height, width),
        depth=torch.full((1, 1, height, width), 3.0),
    )


def enlarged(values: Image, large: SurfaceGuides, scale: int = SCALE, fill: float = 0.0) -> Image:
    small = SurfaceGuides(
        normal=decimated(large.normal, scale), depth=decimated(large.depth, scale)
    )
    fallback = torch.full((1, values.shape[1], *large.depth.shape[-2:]), fill)
    mask = torch.ones_like(values[:, :1])
    return upsample_guided(
        GuidedSamples(
            values=values, mask=mask, small=small, large=large, scale=scale, fallback=fallback
        )
    )


@pytest.mark.parametrize("scale", [2, 3, 4, 8])
def test_what_is_constant_stays(scale: int) -> None:
    large = flat(5 * scale, 7 * scale)
    found = enlarged(torch.full((1, 3, 5, 7), 0.7), large, scale, fill=0.7)
    assert found.shape == (1, 3, 5 * scale, 7 * scale)
    assert torch.allclose(found, torch.full_like(found, 0.7), atol=1e-6)


@pytest.mark.parametrize("kind", ["normal", "depth"])
def test_an_edge_of_surfaces_is_an_edge_of_lighting(kind: str) -> None:
    # the edge lies off the sample grid, between HR columns 13 and 14
    large = flat(24, 32)
    left = torch.arange(32).view(1, 1, 1, 32) < 14
    if kind == "normal":
        other = torch.tensor([1.0, 0.0, 0.0]).view(1, 3, 1, 1)
        large = SurfaceGuides(normal=torch.where(left, large.normal, other), depth=large.depth)
    else:
        large = SurfaceGuides(
            normal=large.normal, depth=torch.where(left, large.depth, 9.0 + 0.0 * large.depth)
        )
    wanted = torch.where(left, 0.2, 1.4).expand(1, 1, 24, 32)
    found = enlarged(decimated(wanted), large)
    assert torch.allclose(found, wanted, atol=2e-3)


def test_a_slope_is_one_surface() -> None:
    # a ramp in depth, lit evenly but for one sample: its light spreads over the ramp
    depth = torch.linspace(2.0, 4.0, 32).view(1, 1, 1, 32).expand(1, 1, 24, 32)
    large = SurfaceGuides(normal=flat(24, 32).normal, depth=depth)
    values = torch.zeros(1, 1, 6, 8)
    values[..., 3, 4] = 1.0
    tilted, level = enlarged(values, large), enlarged(values, flat(24, 32))
    assert torch.allclose(tilted, level, atol=0.02)


def test_samples_that_do_not_count_are_left_out() -> None:
    large = flat(24, 32)
    values = torch.full((1, 1, 6, 8), 0.5)
    values[..., 2, 3] = 100.0
    mask = torch.ones(1, 1, 6, 8)
    mask[..., 2, 3] = 0.0
    small = SurfaceGuides(normal=decimated(large.normal), depth=decimated(large.depth))
    fallback = torch.full((1, 1, 24, 32), 0.5)
    found = upsample_guided(
        GuidedSamples(
            values=values, mask=mask, small=small, large=large, scale=SCALE, fallback=fallback
        )
    )
    assert torch.allclose(found, torch.full_like(found, 0.5), atol=1e-5)


def test_where_no_sample_fits_the_fallback_stands() -> None:
    large = flat(24, 32)
    small = SurfaceGuides(normal=-decimated(large.normal), depth=decimated(large.depth))
    values, mask = torch.zeros(1, 1, 6, 8), torch.ones(1, 1, 6, 8)
    fallback = torch.rand(1, 1, 24, 32)
    found = upsample_guided(
        GuidedSamples(
            values=values, mask=mask, small=small, large=large, scale=SCALE, fallback=fallback
        )
    )
    assert torch.allclose(found, fallback, atol=1e-4)


@pytest.mark.parametrize("zero", ["large", "small", "both"])
def test_where_normals_are_0_depth_alone_tells_surfaces_apart(zero: str) -> None:
    """Bit for bit what one normal everywhere gives, of which the normals' term is 0."""
    torch.manual_seed(2)
    depth = torch.where(torch.rand(1, 1, 24, 32) < 0.5, 2.0, 9.0)
    values, mask = torch.rand(1, 2, 6, 8), (torch.rand(1, 1, 6, 8) < 0.8).float()
    facing, fallback = flat(24, 32).normal, torch.rand(1, 2, 24, 32)

    def run(large: Image, small: Image) -> Image:
        return upsample_guided(
            GuidedSamples(
                values=values,
                mask=mask,
                small=SurfaceGuides(normal=small, depth=decimated(depth)),
                large=SurfaceGuides(normal=large, depth=depth),
                scale=SCALE,
                fallback=fallback,
            )
        )

    torch.manual_seed(3)
    other = F.normalize(torch.randn(1, 3, 24, 32), dim=1)
    nothing = torch.zeros_like(other)
    large = other if zero == "small" else nothing
    small = decimated(other if zero == "large" else nothing)
    assert run(large, small).equal(run(facing, decimated(facing)))


def test_a_few_normals_of_0_change_nothing_elsewhere() -> None:
    torch.manual_seed(4)
    normal = F.normalize(torch.randn(1, 3, 24, 32), dim=1)
    depth = torch.full((1, 1, 24, 32), 3.0)
    values = torch.rand(1, 1, 6, 8)
    spoilt = normal.clone()
    spoilt[..., 4, 5] = 0.0
    right = enlarged(values, SurfaceGuides(normal=normal, depth=depth), fill=0.5)
    found = enlarged(values, SurfaceGuides(normal=spoilt, depth=depth), fill=0.5)
    assert (found != right).nonzero().tolist() == [[0, 0, 4, 5]]


def test_sky_whose_normals_are_0_is_enlarged_as_ever() -> None:
    """No sample is like it: the fallback stands."""
    sky = SurfaceGuides(
        normal=torch.zeros(1, 3, 24, 32), depth=torch.full((1, 1, 24, 32), torch.inf)
    )
    found = enlarged(torch.zeros(1, 1, 6, 8), sky, fill=0.7)
    assert torch.allclose(found, torch.full_like(found, 0.7), atol=1e-4)


def test_weights_are_the_equation() -> None:
    torch.manual_seed(1)
    height, width = 12, 16
    normal = F.normalize(torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1)
                         + 0.2 * torch.randn(1, 3, height, width), dim=1)  # fmt: skip
    depth = 2.0 + 0.1 * torch.rand(1, 1, height, width)
    values = torch.rand(1, 1, 3, 4)
    fallback = torch.rand(1, 1, height, width)
    small = SurfaceGuides(normal=decimated(normal), depth=decimated(depth))
    found = upsample_guided(
        GuidedSamples(
            values=values,
            mask=torch.ones(1, 1, 3, 4),
            small=small,
            large=SurfaceGuides(normal=normal, depth=depth),
            scale=SCALE,
            fallback=fallback,
        )
    )
    y, x = 6, 5
    z = depth[0, 0]
    slopes = (
        min(abs(z[y, x] - z[y, x - 1]), abs(z[y, x] - z[y, x + 1])),
        min(abs(z[y, x] - z[y - 1, x]), abs(z[y, x] - z[y + 1, x])),
    )
    total, weights = FALLBACK_WEIGHT * fallback[0, 0, y, x], FALLBACK_WEIGHT
    block = (y // SCALE, x // SCALE)
    for down, across in product(range(-REACH, REACH + 1), repeat=2):
        row, column = (
            min(max(b + d, 0), side - 1)
            for b, d, side in zip(block, (down, across), (3, 4), strict=True)
        )
        inside = [(p % SCALE - SCALE // 2) / SCALE for p in (y, x)]
        squared = (down - inside[0]) ** 2 + (across - inside[1]) ** 2
        nearest = sum(max(0.0, abs(d) - (0.5 if d < 0 else 0.25)) ** 2 for d in (down, across))
        if math.exp(-nearest / (2 * SPREAD**2)) < LEAST_WEIGHT:
            continue
        facing = float((normal[0, :, y, x] * small.normal[0, :, row, column]).sum())
        allowed = SLOPE * SCALE * float(max(slopes)) * math.sqrt(squared)
        apart = max(0.0, abs(float(z[y, x] - small.depth[0, 0, row, column])) - allowed)
        weight = math.exp(
            -squared / (2 * SPREAD**2) - FACING * (1 - facing)
            - apart / (DEPTH_SHARE * float(z[y, x]))
        )  # fmt: skip
        total = total + weight * values[0, 0, row, column]
        weights += weight
    assert float(found[0, 0, y, x]) == pytest.approx(float(total / weights), rel=1e-4)


def plainly(
    values: Image,
    mask: Image,
    small: SurfaceGuides,
    large: SurfaceGuides,
    scale: int,
    fallback: Image,
) -> Image:
    """Return the equations of `guided_enlargement` on whole images, sample by sample."""
    step = (torch.arange(scale) - scale // 2) / scale
    z = large.depth.clamp(1e-6, 1e6)
    slopes = []
    for dim in (-1, -2):
        difference = z.diff(dim=dim).abs()
        count = difference.shape[dim]
        left = torch.cat([difference.narrow(dim, 0, 1), difference], dim)
        right = torch.cat([difference, difference.narrow(dim, count - 1, 1)], dim)
        slopes.append(torch.minimum(left, right))
    slope = torch.maximum(*slopes)
    height, width = values.shape[-2:]

    def seen(image: Image, down: int, across: int) -> Image:
        rows = torch.arange(height).add(down).clamp(0, height - 1).repeat_interleave(scale)
        columns = torch.arange(width).add(across).clamp(0, width - 1).repeat_interleave(scale)
        return image[..., rows, :][..., columns]

    total, weights = FALLBACK_WEIGHT * fallback, FALLBACK_WEIGHT + 0.0 * z
    for down, across in product(range(-REACH, REACH + 1), repeat=2):
        squared = (down - step).square().view(-1, 1) + (across - step).square()
        if math.exp(-float(squared.min()) / (2 * SPREAD**2)) < LEAST_WEIGHT:
            continue
        squared = squared.repeat(height, width)
        facing = (large.normal * seen(small.normal, down, across)).sum(1, keepdim=True)
        gap = (z - seen(small.depth, down, across).clamp(max=1e6)).abs()
        apart = (gap - SLOPE * scale * slope * squared.sqrt()).clamp(min=0) / (DEPTH_SHARE * z)
        weight = torch.exp(-squared / (2 * SPREAD**2) - FACING * (1 - facing) - apart)
        weight = weight * seen(mask, down, across)
        total = total + weight * seen(values, down, across)
        weights = weights + weight
    return total / weights


@pytest.mark.parametrize("strip_values", [1, 700, 1 << 20])
@pytest.mark.parametrize("scale", [2, 3, 4])
def test_strips_of_any_height_give_the_equations(
    scale: int, strip_values: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rtsr_cli.core.imaging.guided_enlargement.STRIP_VALUES", strip_values)
    torch.manual_seed(scale)
    height, width = 9 * scale, 7 * scale
    toward = torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1)
    sky = torch.rand(2, 1, height, width) > 0.9
    normal = F.normalize(toward + 0.3 * torch.randn(2, 3, height, width), dim=1) * ~sky
    depth = 2.0 + torch.rand(2, 1, height, width).cumsum(-1) * 0.1
    large = SurfaceGuides(normal=normal, depth=torch.where(sky, torch.inf, depth))
    small = SurfaceGuides(normal=decimated(normal, scale), depth=decimated(large.depth, scale))
    values, mask = 3.0 * torch.rand(2, 3, 9, 7), (torch.rand(2, 1, 9, 7) > 0.2).float()
    fallback = torch.rand(2, 3, height, width)
    given = upsample_guided(
        GuidedSamples(
            values=values, mask=mask, small=small, large=large, scale=scale, fallback=fallback
        )
    )
    wanted = plainly(values, mask, small, large, scale, fallback)
    assert torch.allclose(given, wanted, atol=2e-4)


def make_rough_samples(seed: int) -> GuidedSamples:
    torch.manual_seed(seed)
    toward = torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1)
    normal = F.normalize(toward + 0.3 * torch.randn(2, 3, 12, 8), dim=1)
    depth = 2.0 + torch.rand(2, 1, 12, 8).cumsum(-1) * 0.1
    return GuidedSamples(
        values=torch.rand(2, 3, 3, 2),
        mask=(torch.rand(2, 1, 3, 2) > 0.2).float(),
        small=SurfaceGuides(normal=decimated(normal), depth=decimated(depth)),
        large=SurfaceGuides(normal=normal, depth=depth),
        scale=SCALE,
        fallback=torch.rand(2, 3, 12, 8),
    )


def test_factors_of_one_change_nothing() -> None:
    samples = make_rough_samples(1)
    found = upsample_emphasised(samples, torch.ones(2, 3, 12, 8))
    torch.testing.assert_close(found, upsample_guided(samples), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("term", [0, 1, 2])
def test_the_gradient_of_a_factor_is_what_small_changes_give(term: int) -> None:
    samples = make_rough_samples(2)
    factors = torch.full((2, 3, 12, 8), 0.6).requires_grad_()
    found = upsample_emphasised(samples, factors)
    weights = torch.rand_like(found)
    (gradient,) = torch.autograd.grad((found * weights).sum(), factors)
    step = 1e-2
    moved = torch.zeros(2, 3, 12, 8)
    moved[:, term] = step
    ends = [upsample_emphasised(samples, factors.detach() + s * moved) for s in (1.0, -1.0)]
    slope = ((ends[0] - ends[1]) * weights).sum(1) / (2.0 * step)
    torch.testing.assert_close(gradient[:, term], slope, rtol=2e-2, atol=2e-3)


def test_no_emphasis_on_normals_takes_what_faces_away() -> None:
    large = flat(24, 32)
    values = torch.zeros(1, 1, 6, 8)
    values[..., :4] = 1.0
    small = SurfaceGuides(normal=-decimated(large.normal), depth=decimated(large.depth))
    samples = GuidedSamples(
        values=values, mask=torch.ones_like(values), small=small, large=large, scale=SCALE,
        fallback=torch.full((1, 1, 24, 32), 7.0),
    )  # fmt: skip
    factors = torch.ones(1, 3, 24, 32)
    factors[:, 1] = 0.0
    assert float(upsample_guided(samples).min()) > 6.0
    assert float(upsample_emphasised(samples, factors).max()) <= 1.0 + 1e-3


def test_no_weight_is_a_denormal_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """They cost a hundredfold: normals at right angles, depths far apart, factors of 20."""
    seen = []
    exp2 = torch.Tensor.exp2_

    def watch(power: torch.Tensor) -> torch.Tensor:
        seen.append(float(power.min()))
        return exp2(power)

    monkeypatch.setattr(torch.Tensor, "exp2_", watch)
    torch.manual_seed(4)
    samples = make_rough_samples(4)
    samples.small.normal[:, 2, :, 1:] = 0.0
    samples.small.depth[:, :, 1:] *= 5.0
    for factors in (1.0, 20.0):
        seen.clear()
        upsample_emphasised(samples, torch.full((2, 3, 12, 8), factors))
        assert min(seen) > -126.0
    seen.clear()
    upsample_guided(samples)
    assert min(seen) > -126.0
