from __future__ import annotations

import pytest

from rtsr_cli.core.captures.bound_channels import BoundChannel, bind_channels
from rtsr_cli.core.captures.sample_channels import (
    SampleName,
    bind_samples,
    describe_samples,
    number_names,
    split_sample,
    stand_for_pixel,
)
from rtsr_cli.core.frames.buffers import Buffer


@pytest.mark.parametrize(
    ("name", "plain", "number"),
    [
        ("color.0.R", "color.R", 0),
        ("ViewLayer.Depth.12.Z", "ViewLayer.Depth.Z", 12),
        ("metallic.3", "metallic", 3),
    ],
)
def test_the_number_of_a_sample_stands_before_the_component_or_last(
    name: str, plain: str, number: int
) -> None:
    assert split_sample(name) == SampleName(plain, number)


@pytest.mark.parametrize("name", ["R", "depth.Z", "Crypto00.R", "light.007.R", "0.R", "a.0.b.c"])
def test_other_numbers_are_none_of_samples(name: str) -> None:
    assert split_sample(name) is None


def test_one_number_alone_makes_no_samples() -> None:
    assert number_names({"f": ["color.0.R", "color.1.G", "R"]}, ()) == {}


def test_radiance_has_no_layer_unless_it_is_spelled_out() -> None:
    names = {"f": [f"color.{n}.R" for n in range(2)]}
    assert number_names(names, ()) == {"f": {"R": {0: "color.0.R", 1: "color.1.R"}}}
    assert set(number_names(names, ("color.R",))["f"]) == {"color.R"}


def test_colour_is_the_mean_of_its_samples_and_depth_the_first() -> None:
    streams = {"f": [f"{c}.{n}.{s}" for n in range(4) for c, s in (("color", "R"), ("depth", "Z"))]}
    numbered = number_names(streams, ())
    binding = {
        Buffer.COLOR: bind_channels(BoundChannel(stream="f", channel="R", factor=2.0)),
        Buffer.DEPTH: bind_channels(BoundChannel(stream="f", channel="depth.Z")),
    }
    pixels = bind_samples(binding, numbered, {"f": {name: name for name in streams["f"]}})
    color, depth = pixels.binding[Buffer.COLOR], pixels.binding[Buffer.DEPTH]
    assert [(c.channel, c.factor) for c in color] == [(f"color.{n}.R", 0.5) for n in range(4)]
    assert [c.channel for c in depth] == ["depth.0.Z"]
    samples = pixels.samples[Buffer.DEPTH]
    assert [c.channel for one in samples for c in one] == [f"depth.{n}.Z" for n in range(4)]
    assert stand_for_pixel(Buffer.DEPTH, samples) == depth
    told = describe_samples(Buffer.DEPTH, samples, streams=False)
    assert told == "first of depth.0.Z to depth.3.Z"
