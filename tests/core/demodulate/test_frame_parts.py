from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from rtsr_cli.core.demodulate import frame_parts
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.derivation import DerivationConfig
from rtsr_cli.core.imaging.row_strips import cut_frame

SIZE = (12, 16)


@pytest.fixture
def frame(analytic_channels: Callable[..., dict[str, Any]], make_camera: Any) -> Frame:
    planes = analytic_channels(3, SIZE)
    layers = {
        Buffer.COLOR: ("R", "G", "B"),
        Buffer.ALBEDO: ("albedo.R", "albedo.G", "albedo.B"),
        Buffer.NORMAL: ("normal.X", "normal.Y", "normal.Z"),
        Buffer.EMISSION: ("emission.R", "emission.G", "emission.B"),
        Buffer.DEPTH: ("depth.Z",),
        Buffer.METALLIC: ("metallic",),
        Buffer.ROUGHNESS: ("roughness",),
    }
    tensors = {
        buffer: torch.from_numpy(np.stack([planes[n].astype(np.float32) for n in names]))[None]
        for buffer, names in layers.items()
    }
    camera: CameraMetadata = make_camera()
    return Frame(number=3, gbuffer=GBuffer(tensors), camera=camera, view=View(display=SIZE))


@pytest.mark.parametrize("full", [False, True])
def test_strips_give_the_bytes_of_the_whole_frame(
    frame: Frame, monkeypatch: pytest.MonkeyPatch, full: bool
) -> None:
    whole = frame_parts.demodulate_frame(frame, DerivationConfig(), full=full)
    monkeypatch.setattr(frame_parts, "STRIP_PIXELS", 5 * SIZE[1])
    assert [top for top, _ in cut_frame(frame, frame_parts.STRIP_PIXELS)] == [0, 5, 10]
    parts = frame_parts.demodulate_frame(frame, DerivationConfig(), full=full)
    assert parts.error == whole.error
    assert parts.undivided == whole.undivided
    for name, plane in whole.channels.items():
        assert np.array_equal(parts.channels[name], plane), name


def test_the_sky_is_the_share_that_is_not_divided(frame: Frame) -> None:
    parts = frame_parts.demodulate_frame(frame, DerivationConfig(), full=False)
    # two of twelve rows are sky
    assert parts.undivided == pytest.approx(2 / 12)
    assert parts.error < 2e-3
    assert set(np.unique(parts.channels["mask"])) == {0.0, 1.0}
