"""The width of a pixel filter, found from radiance and the HR material."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.resampling import (
    decimate,
    decimate_filtered,
    filter_at_samples,
    measure_filter_width,
    sample_jitter,
)
from rtsr_cli.core.pairs import pixel_filter
from rtsr_cli.core.pairs.point_samples import FILTERED_SLOPE, measure_slope
from rtsr_cli.core.pairs.sources import FramePair

SCALE = 4
OFFSET = (1, 2)


def make_pair(
    lr_filter: str = "none", *, contrast: float = 1.0, shining: bool = False
) -> FramePair:
    """Tiles of 3 pixels, each of its own material, under a light that falls off; sky on top."""
    generator = torch.Generator().manual_seed(4)
    tiles = 0.4 + contrast * (torch.rand(1, 3, 80, 80, generator=generator) - 0.5) * 0.7
    material = tiles.repeat_interleave(3, 2).repeat_interleave(3, 3)
    side = material.shape[3]
    sky = torch.zeros(1, 1, side, side)
    sky[:, :, :40] = 1.0
    light = torch.linspace(0.2, 3.0, side).view(1, 1, 1, side)
    emission = torch.zeros_like(material)
    if shining:
        emission = 5.0 * (torch.rand(1, 3, side, side, generator=generator) > 0.7).float()
    radiance = (material * light + emission) * (1.0 - sky) + 3.0 * sky
    color = (
        decimate(radiance, SCALE, OFFSET)
        if lr_filter == "none"
        else decimate_filtered(radiance, lr_filter, SCALE, OFFSET)
    )
    hr = {Buffer.MATERIAL: material, Buffer.SKY: sky}
    if shining:
        hr[Buffer.EMISSION] = emission
    lr = {buffer: decimate(image, SCALE, OFFSET) for buffer, image in hr.items()}
    jitter_px = (sample_jitter(OFFSET[0], SCALE), sample_jitter(OFFSET[1], SCALE))

    def frame(buffers: dict[Buffer, torch.Tensor], jitter: tuple[float, float]) -> Frame:
        gbuffer = GBuffer(buffers, "tiles")
        camera = CameraMetadata(jitter_px=jitter)
        return Frame(number=1, gbuffer=gbuffer, camera=camera, view=View(display=gbuffer.size))

    return FramePair(frame({**lr, Buffer.COLOR: color}, jitter_px), frame(hr, (0.0, 0.0)))


def measure_width(pair: FramePair) -> float | None:
    found = pixel_filter.measure_filter(pair, SCALE)
    return None if found is None else found.width_px


def is_filtered(pair: FramePair) -> bool | None:
    found = pixel_filter.measure_filter(pair, SCALE)
    return None if found is None else found.filtered


@pytest.mark.parametrize("shining", [False, True])
@pytest.mark.parametrize("lr_filter", ["box", "blackman-harris"])
def test_the_width_is_that_of_the_filter(lr_filter: str, shining: bool) -> None:
    found = measure_width(make_pair(lr_filter, shining=shining))
    assert found == pytest.approx(measure_filter_width(lr_filter, SCALE), abs=0.08)


def test_point_samples_have_none() -> None:
    assert measure_width(make_pair()) == 0.0


def test_without_contrast_or_hr_nothing_is_told() -> None:
    flat, alone = make_pair("box", contrast=0.05), make_pair("box")
    assert pixel_filter.measure_filter(flat, SCALE) is None
    assert pixel_filter.measure_filter(FramePair(alone.lr, None), SCALE) is None


def test_radiance_that_follows_no_material_tells_no_width() -> None:
    pair = make_pair()
    noise = torch.rand(1, 3, 60, 60, generator=torch.Generator().manual_seed(2))
    color = pair.lr.gbuffer.with_buffers({Buffer.COLOR: 0.1 + noise})
    strange = FramePair(replace(pair.lr, gbuffer=color), pair.hr)
    assert measure_width(strange) is None


def test_the_first_frame_that_tells_decides() -> None:
    pairs = {1: make_pair("box", contrast=0.05), 5: make_pair("box"), 9: make_pair()}
    found = pixel_filter.measure_first(pairs.__getitem__, [1, 3, 5, 7, 9], SCALE)
    assert found == pixel_filter.measure_filter(pairs[5], SCALE)


def test_a_frame_that_tells_a_width_comes_before_one_that_tells_of_a_filter() -> None:
    pairs = {1: filter_wide_tiles(0.85), 2: make_pair("box")}
    found = pixel_filter.measure_first(pairs.__getitem__, [1, 2], SCALE)
    assert found == pixel_filter.measure_filter(pairs[2], SCALE)


@pytest.mark.parametrize(
    ("filters", "declared", "doubted"),
    [
        (("blackman-harris", "blackman-harris"), 0.0, True),
        (("none", "none"), 0.5, True),
        # narrow filters look like point samples
        (("none", "none"), 0.25, False),
        # one frame that fits is enough
        (("none", "blackman-harris"), 0.4, False),
        (("none", "none"), 0.0, False),
    ],
)
def test_a_declared_width_is_doubted_where_no_frame_has_it(
    filters: tuple[str, str], declared: float, doubted: bool
) -> None:
    pairs = dict(enumerate(map(make_pair, filters)))
    found = pixel_filter.find_other_width(pairs.__getitem__, [0, 1], SCALE, declared)
    assert (found is not None) == doubted


def test_a_frame_that_cannot_be_read_is_left_to_whoever_reads_it_next() -> None:
    def fail(number: int) -> FramePair:
        raise FrameFolderError(f"frame {number} is gone")

    assert pixel_filter.measure_first(fail, [1, 2, 3], SCALE) is None


def spoil_material(pair: FramePair, share: float) -> FramePair:
    """Other tiles in the right part of both sizes: what a pass of another frame holds."""
    generator = torch.Generator().manual_seed(9)
    assert pair.hr is not None
    side = pair.hr.gbuffer.size[1]
    tiles = 0.05 + 0.75 * torch.rand(1, 3, side // 3, side // 3, generator=generator)
    wrong = tiles.repeat_interleave(3, 2).repeat_interleave(3, 3)

    def spoil(frame: Frame, other: torch.Tensor) -> Frame:
        material = frame.gbuffer[Buffer.MATERIAL].clone()
        kept = int(material.shape[3] * (1.0 - share))
        material[..., kept:] = other[..., kept:]
        return replace(frame, gbuffer=frame.gbuffer.with_buffers({Buffer.MATERIAL: material}))

    return FramePair(spoil(pair.lr, decimate(wrong, SCALE, OFFSET)), spoil(pair.hr, wrong))


@pytest.mark.parametrize("share", [0.8, 1.0])
def test_material_that_is_wrong_is_no_filter(share: float) -> None:
    pair = spoil_material(make_pair(), share)
    slope = measure_slope(pair.lr)
    assert slope is not None
    assert slope < FILTERED_SLOPE
    assert not measure_width(pair)
    assert is_filtered(pair) is False


@pytest.mark.parametrize("lr_filter", ["box", "blackman-harris"])
def test_a_filter_is_measured_beside_material_that_is_wrong(lr_filter: str) -> None:
    pair = spoil_material(make_pair(lr_filter), 0.4)
    found = measure_width(pair)
    assert found == pytest.approx(measure_filter_width(lr_filter, SCALE), abs=0.08)
    assert is_filtered(pair)


def filter_wide_tiles(width: float) -> FramePair:
    """Tiles of 9 pixels, filtered by a Gaussian."""
    pair = make_pair()
    assert pair.hr is not None
    small = pair.hr.gbuffer[Buffer.MATERIAL][..., :80, :80]
    material = small.repeat_interleave(3, 2).repeat_interleave(3, 3)
    color = filter_at_samples(material, width, SCALE, pair.lr.camera.jitter_px)
    light = torch.linspace(0.2, 3.0, color.shape[3])
    placed = decimate(material, SCALE, OFFSET)
    lr = pair.lr.gbuffer.with_buffers({Buffer.MATERIAL: placed, Buffer.COLOR: color * light})
    hr = pair.hr.gbuffer.with_buffers({Buffer.MATERIAL: material})
    return FramePair(replace(pair.lr, gbuffer=lr), replace(pair.hr, gbuffer=hr))


@pytest.mark.parametrize("width", [0.55, 0.6, 0.65])
def test_wide_gaussians_are_measured(width: float) -> None:
    found = measure_width(filter_wide_tiles(width))
    assert found == pytest.approx(width, abs=0.1)


def test_a_filter_wider_than_those_tried_is_found_to_be_there() -> None:
    wide = filter_wide_tiles(0.85)
    found = pixel_filter.measure_first(lambda number: wide, [1, 2], SCALE)
    assert found == pixel_filter.FilterFinding(None, filtered=True)
