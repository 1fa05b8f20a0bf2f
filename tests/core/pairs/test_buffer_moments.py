"""Single buffers of a frame that are another frame's."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest
import torch

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.imaging.resampling import decimate
from rtsr_cli.core.pairs.buffer_moments import BufferMoments, ForeignBuffer, describe_foreign
from rtsr_cli.core.pairs.pair_agreement import list_around

SIZE = (128, 192)
SCALE = 4
Frames = dict[int, GBuffer]


def render(moment: int, movers: int = 40, *, texture: float = 0.0) -> GBuffer:
    """Boxes of one colour each, some of them lamps, below some sky."""
    torch.manual_seed(5)
    rows, columns = torch.meshgrid(*(torch.arange(side) for side in SIZE), indexing="ij")
    ids = torch.zeros(SIZE, dtype=torch.int32)
    for number in range(1, 41):
        top, left = (int(torch.randint(0, side - 24, ())) for side in SIZE)
        shift = 9 * moment if number <= movers else 0
        ids[(rows >= top) & (rows < top + 22) & ((columns - left - shift) % SIZE[1] < 27)] = number
    table = torch.rand(12, 41)
    depth = 20.0 - 0.4 * ids + 0.001 * columns
    depth[:8] = SKY_DEPTH_M
    noise = 1.0 - texture * torch.rand(3, *SIZE)
    albedo = (0.1 + 0.9 * table[:3])[:, ids.long()] * noise
    normal = torch.nn.functional.normalize(table[3:6] - 0.5, dim=0)[:, ids.long()]
    lamp = 5.0 * (table[6:7] > 0.8)[:, ids.long()].float().expand(3, -1, -1)
    light = 0.3 + 0.7 * columns / SIZE[1]
    planes = {
        Buffer.DEPTH: depth[None],
        Buffer.ALBEDO: albedo,
        Buffer.NORMAL: normal,
        Buffer.METALLIC: (table[7:8] > 0.7)[:, ids.long()].float(),
        Buffer.ROUGHNESS: table[8:9][:, ids.long()],
        Buffer.EMISSION: lamp,
        Buffer.COLOR: albedo * light + lamp,
    }
    return GBuffer({buffer: plane[None] for buffer, plane in planes.items()}, "made by a test")


def pair(frames: Mapping[int, GBuffer]) -> tuple[Frames, Frames]:
    """LR samples, at places that change from frame to frame, and HR without radiance."""
    lr = {
        n: GBuffer({b: decimate(t, SCALE, (n % SCALE, 1)) for b, t in frame.items()}, "")
        for n, frame in frames.items()
    }
    return lr, {n: frame.only(frame.keys() - {Buffer.COLOR}) for n, frame in frames.items()}


def exchange(frames: Frames, buffer: Buffer, one: int, other: int) -> Frames:
    held = {one: frames[other][buffer], other: frames[one][buffer]}
    return frames | {n: frames[n].with_buffers({buffer: image}) for n, image in held.items()}


def find(lr: Frames, hr: Frames) -> dict[int, ForeignBuffer | None]:
    moments = BufferMoments(
        lambda n, buffers: lr[n].only(set(buffers)),
        lambda n, buffers: hr[n].only(set(buffers)),
        SCALE,
    )
    return {n: moments.find(n, lr[n], hr[n], list_around(n, lr)) for n in lr}


@pytest.mark.parametrize("size", ["LR", "HR"])
@pytest.mark.parametrize(
    "buffer",
    [Buffer.ALBEDO, Buffer.NORMAL, Buffer.METALLIC, Buffer.ROUGHNESS, Buffer.EMISSION],
)
def test_a_buffer_of_one_size_that_is_exchanged_is_named_in_its_frames_alone(
    buffer: Buffer, size: str
) -> None:
    lr, hr = pair({n: render(n) for n in (1, 2, 3, 4)})
    if size == "LR":
        lr = exchange(lr, buffer, 2, 3)
    else:
        hr = exchange(hr, buffer, 2, 3)
    found = find(lr, hr)
    assert found[1] is found[4] is None
    for number, other in ((2, 3), (3, 2)):
        foreign = found[number]
        assert foreign is not None
        assert (foreign.buffers, foreign.other) == ((buffer,), other)
        assert foreign.size in ("", size)
        said = describe_foreign(foreign, Path("shot/lr"), Path("shot/hr"))
        assert f"frame {number}: {buffer} of " in said
        assert f"in {buffer}" in said


def test_radiance_of_another_frame_is_named() -> None:
    lr, hr = pair({n: render(n) for n in (1, 2, 3, 4)})
    found = find(exchange(lr, Buffer.COLOR, 2, 3), hr)
    assert found[1] is found[4] is None
    for number, other in ((2, 3), (3, 2)):
        foreign = found[number]
        assert foreign is not None
        said = describe_foreign(foreign, Path("shot/lr"), Path("shot/hr"))
        assert f"shot/lr: frame {number}: radiance shows frame {other}" in said


@pytest.mark.parametrize("movers", [0, 3, 40])
@pytest.mark.parametrize("texture", [0.0, 0.6])
def test_right_frames_are_their_own(movers: int, texture: float) -> None:
    """Of cameras that stand still, of movers, and of textures finer than HR pixels."""
    frames = {n: render(n, movers, texture=texture) for n in (1, 2, 3)}
    lr, hr = pair(frames)
    if texture:
        # LR samples lie between the pixels of HR
        lr = {
            n: frame.with_buffers(
                {Buffer.ALBEDO: frame[Buffer.ALBEDO] * (0.4 + 0.6 * torch.rand(*lr[n].size))}
            )
            for n, frame in lr.items()
        }
    assert find(lr, hr) == dict.fromkeys(lr)


def test_what_is_lost_in_one_frame_of_a_still_camera_is_no_other_frames() -> None:
    lr, hr = pair({n: render(0) for n in (1, 2, 3)})
    bare = {Buffer.EMISSION: torch.zeros_like(hr[2][Buffer.EMISSION])}
    assert find(lr, hr | {2: hr[2].with_buffers(bare)}) == dict.fromkeys(lr)
