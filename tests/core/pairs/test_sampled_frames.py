"""Samples as frames of their own, and the capture that they make."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from rtsr_cli.core.frames.buffers import VECTOR_BUFFERS, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.sample_ranges import join_samples, split_samples
from rtsr_cli.core.pairs.sampled_frames import join_frames


def draw_capture(k: int) -> Frame:
    """4 x 6 pixels of k x k samples of random numbers, the part at (k, 2 k) of a picture."""
    source = torch.Generator().manual_seed(1)
    height, width = 4 * k, 6 * k
    buffers = {
        Buffer.COLOR: torch.rand(1, 3, height, width, generator=source),
        Buffer.DEPTH: torch.rand(1, 1, height, width, generator=source),
        Buffer.MOTION: k * torch.randint(-9, 9, (1, 2, height, width), generator=source).float(),
        Buffer.OBJECT_ID: torch.randint(0, 9, (1, 1, height, width), generator=source).int(),
    }
    return Frame(
        number=3,
        gbuffer=GBuffer(buffers, "drawn"),
        camera=CameraMetadata(),
        view=View(display=(8 * k, 8 * k), top=k, left=2 * k),
    )


def take_sample(capture: Frame, k: int, number: int) -> Frame:
    """Sample `number` of each pixel, as a frame of the pixels' size."""
    buffers = {
        b: image[..., number // k :: k, number % k :: k] / (k if b in VECTOR_BUFFERS else 1)
        if image.is_floating_point()
        else image[..., number // k :: k, number % k :: k]
        for b, image in capture.gbuffer.items()
    }
    return replace(
        capture, gbuffer=GBuffer(buffers, "drawn"), view=View(display=(8, 8), top=1, left=2)
    )


@pytest.mark.parametrize("k", [2, 3])
def test_samples_row_by_row_make_the_capture_that_they_are_of(k: int) -> None:
    capture = draw_capture(k)
    joined = join_frames([take_sample(capture, k, number) for number in range(k * k)])
    assert joined.view == capture.view
    for buffer, image in capture.gbuffer.items():
        assert joined.gbuffer[buffer].dtype == image.dtype
        assert torch.equal(joined.gbuffer[buffer], image)
    assert torch.equal(
        join_samples(split_samples(capture.gbuffer[Buffer.COLOR], k), k),
        capture.gbuffer[Buffer.COLOR],
    )


def test_the_first_of_five_samples_fills_the_block() -> None:
    capture = draw_capture(3)
    joined = join_frames([take_sample(capture, 3, number) for number in range(5)])
    split = split_samples(joined.gbuffer[Buffer.DEPTH], 3)
    whole = split_samples(capture.gbuffer[Buffer.DEPTH], 3)
    assert torch.equal(split[:, :, :5], whole[:, :, :5])
    assert torch.equal(split[:, :, 5:], whole[:, :, :1].expand(-1, -1, 4, -1, -1))
