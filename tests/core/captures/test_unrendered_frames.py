"""Binding the buffers of sequences some of whose frames hold no radiance."""

from __future__ import annotations

import pytest

from rtsr_cli.core.captures.bound_channels import Binding, BoundChannel, bind_channels
from rtsr_cli.core.captures.layers import BoundLayers
from rtsr_cli.core.captures.layouts import Layout
from rtsr_cli.core.captures.unrendered_frames import (
    FirstHeaders,
    bind_rendered,
    join_headers,
    list_lacking,
    list_partial_streams,
)
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import ExrHeader
from rtsr_cli.core.files.pixel_window import PixelWindow
from rtsr_cli.core.frames.buffers import Buffer

CHANNELS = {Buffer.COLOR: "R", Buffer.DEPTH: "Z", Buffer.POSITION: "P"}
WINDOW = PixelWindow(left=0, top=0, width=4, height=3)


def header(channels: str) -> ExrHeader:
    return ExrHeader(
        channels=frozenset(channels), data_window=WINDOW, display_window=WINDOW, attributes={}
    )


def bind(first: FirstHeaders) -> BoundLayers:
    """Find the buffers of `CHANNELS`, whose names are one letter."""
    held = {
        buffer: bind_channels(BoundChannel(stream=key, channel=name))
        for buffer, name in CHANNELS.items()
        for key, one in first.items()
        if name in one.channels
    }
    if Buffer.DEPTH not in held:
        raise FrameFolderError("no layout knows these channels")
    return BoundLayers(layout=Layout(name="letters", description="", buffers={}), binding=held)


@pytest.mark.parametrize("frames", [("RZ", "Z", "RZ", "Z"), ("Z", "RZ", "Z", "RZ")])
def test_it_does_not_matter_which_kind_of_frame_comes_first(frames: tuple[str, ...]) -> None:
    found = bind_rendered({"f": {n: header(c) for n, c in enumerate(frames, 1)}}, bind)
    assert set(found.bound.binding) == {Buffer.COLOR, Buffer.DEPTH}
    without = frozenset(n for n, c in enumerate(frames, 1) if "R" not in c)
    assert dict(found.lacking) == {Buffer.COLOR: without}
    assert found.notes == ()


def test_what_one_kind_of_frames_has_alone_is_not_bound() -> None:
    found = bind_rendered({"f": {1: header("RZP"), 2: header("Z"), 3: header("RZP")}}, bind)
    assert set(found.bound.binding) == {Buffer.COLOR, Buffer.DEPTH}
    assert found.lacking[Buffer.POSITION] == frozenset({2})
    assert found.notes == ("buffer 'position' is not read: frame 2 has none",)


def test_what_a_single_frame_lacks_stays_bound_for_it_is_a_fault() -> None:
    frames = {1: header("RZ"), 2: header("Z"), 3: header("R"), 4: header("Z")}
    found = bind_rendered({"f": frames}, bind)
    assert set(found.bound.binding) == {Buffer.COLOR, Buffer.DEPTH}
    assert set(found.lacking) == {Buffer.COLOR}


def test_frames_of_which_none_holds_radiance_are_bound_by_the_first() -> None:
    found = bind_rendered({"f": {1: header("Z"), 2: header("ZP")}}, bind)
    assert set(found.bound.binding) == {Buffer.DEPTH}
    with pytest.raises(FrameFolderError, match="no layout"):
        bind_rendered({"f": {1: header("Q"), 2: header("QP")}}, bind)


def test_a_frame_lacks_what_its_files_lack_or_has_no_file_for() -> None:
    binding: Binding = {
        Buffer.COLOR: bind_channels(BoundChannel(stream="beauty", channel="R")),
        Buffer.DEPTH: bind_channels(BoundChannel(stream="depth", channel="Z")),
    }
    headers = {"beauty": {1: header("R")}, "depth": {1: header("Z"), 2: header("Z")}}
    assert list_lacking(headers, binding) == {Buffer.COLOR: frozenset({2})}
    assert list_partial_streams(binding) == {"beauty"}
    # where nothing but radiance is there, every frame needs it
    assert list_partial_streams({Buffer.COLOR: binding[Buffer.COLOR]}) == frozenset()


def test_joined_headers_hold_the_channels_of_all() -> None:
    assert join_headers([header("Z"), header("RZ"), header("A")]).channels == {"Z", "R", "A"}
