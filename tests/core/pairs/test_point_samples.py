"""Whether radiance was filtered: of a material that changes from pixel to pixel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
import torch
from click.testing import CliRunner

from rtsr_cli.cli import group
from rtsr_cli.core.choices import JitterMode
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.resampling import decimate, decimate_filtered
from rtsr_cli.core.pairs.opening import ReadOptions, open_pairs
from rtsr_cli.core.pairs.point_samples import is_point_sampled, measure_slope
from rtsr_cli.core.pairs.simulation import Simulation
from rtsr_cli.core.pairs.sources import FramePair, PairSource

SCALE = 4


def make_frame(lr_filter: str = "none", *, contrast: float = 1.0, shining: bool = False) -> Frame:
    """Tiles of 3 pixels, each of its own material, under a light that falls off."""
    generator = torch.Generator().manual_seed(4)
    tiles = 0.4 + contrast * (torch.rand(1, 3, 80, 80, generator=generator) - 0.5) * 0.7
    material = tiles.repeat_interleave(3, 2).repeat_interleave(3, 3)
    side = material.shape[3]
    light = torch.linspace(0.2, 3.0, side).view(1, 1, 1, side)
    radiance = material * light
    emission = 5.0 * (torch.rand(1, 3, side, side, generator=generator) > 0.7)
    shown = radiance + emission if shining else radiance
    offset = (1, 1)
    color = (
        decimate(shown, SCALE, offset)
        if lr_filter == "none"
        else decimate_filtered(shown, lr_filter, SCALE, offset)
    )
    buffers = {
        Buffer.COLOR: color,
        Buffer.MATERIAL: decimate(material, SCALE, offset),
        Buffer.SKY: torch.zeros_like(color[:, :1]),
    }
    if shining:
        buffers[Buffer.EMISSION] = decimate(emission, SCALE, offset)
    gbuffer = GBuffer(buffers, "tiles")
    return Frame(
        number=1, gbuffer=gbuffer, camera=CameraMetadata(), view=View(display=gbuffer.size)
    )


def test_of_point_samples_radiance_follows_material() -> None:
    assert measure_slope(make_frame()) == pytest.approx(1.0, abs=0.05)
    assert measure_slope(make_frame(shining=True)) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("lr_filter", ["box", "blackman-harris"])
def test_of_filtered_radiance_it_does_not(lr_filter: str) -> None:
    slope = measure_slope(make_frame(lr_filter))
    assert slope is not None
    assert 0.05 < slope < 0.5


def test_without_contrast_nothing_is_told() -> None:
    assert measure_slope(make_frame("box", contrast=0.1)) is None


@pytest.mark.parametrize(("lr_filter", "sharp"), [("none", True), ("blackman-harris", False)])
def test_frames_are_told_apart(tmp_path: Path, lr_filter: str, sharp: bool) -> None:
    made = CliRunner().invoke(group, ["synth", str(tmp_path), "--size", "192x128", "--frames", "1"])
    assert made.exit_code == 0, made.output
    simulation = Simulation(scale=2, jitter=JitterMode.HALTON, lr_filter=lr_filter)
    [(_, source)] = open_pairs(tmp_path, ReadOptions(), simulation=simulation)
    assert is_point_sampled(source) is sharp


def make_source(frame: Frame, filtered: bool | None = None) -> PairSource:
    """A shot of which the frame is all there is."""
    return cast(
        "PairSource",
        SimpleNamespace(
            filter_width_px=None,
            looks_filtered=filtered,
            missing=lambda inputs: (),
            reader=SimpleNamespace(numbers=(1,)),
            load=lambda number, inputs: FramePair(frame, None),
        ),
    )


def test_without_hr_filters_are_told_from_light_that_differs() -> None:
    filtered = make_frame("blackman-harris")
    assert not is_point_sampled(make_source(filtered))
    light = torch.rand(1, 3, 60, 60, generator=torch.Generator().manual_seed(7))
    other = filtered.gbuffer.with_buffers({Buffer.COLOR: 0.1 + light})
    assert is_point_sampled(make_source(replace(filtered, gbuffer=other)))


def test_what_hr_material_says_comes_first() -> None:
    assert is_point_sampled(make_source(make_frame("blackman-harris"), filtered=False))
    assert not is_point_sampled(make_source(make_frame(), filtered=True))
