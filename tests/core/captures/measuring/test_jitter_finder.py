"""Whether samples rest: what does not move shows it."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.jitter_finder import do_samples_rest
from rtsr_cli.core.frames.buffers import Buffer

SIZE = (48, 64)


def frames(offset_px: int = 0, moving: float = 0.0) -> dict[int, dict[Buffer, Tensor]]:
    """Two pictures of a texture, the second one sampled elsewhere; a part of it may move."""
    torch.manual_seed(3)
    texture = torch.rand(1, 3, *SIZE)
    motion = torch.zeros(1, 2, *SIZE)
    motion[..., : round(moving * SIZE[1])] = 1.0
    moved = torch.where((motion != 0).any(1, keepdim=True), texture.flip(-1), texture)
    return {
        1: {Buffer.ALBEDO: texture, Buffer.MOTION: motion},
        2: {Buffer.ALBEDO: moved.roll(offset_px, -1), Buffer.MOTION: motion},
    }


def test_things_at_rest_tell_whether_samples_are() -> None:
    assert do_samples_rest(frames(), 1, 0.0)
    assert do_samples_rest(frames(moving=0.4), 1, 0.0)
    assert not do_samples_rest(frames(offset_px=1), 1, 0.0)


def test_shadows_may_move_where_another_picture_rests() -> None:
    shot = frames()
    for number, light in ((1, 1.0), (2, 0.5)):
        shot[number][Buffer.COLOR] = light * shot[number][Buffer.ALBEDO]
    assert do_samples_rest(shot, 1, 0.0)
    assert not do_samples_rest(shot, 1, 0.5)


@pytest.mark.parametrize("moving", [1.0, 0.95])
def test_where_little_rests_nothing_is_known(moving: float) -> None:
    assert not do_samples_rest(frames(moving=moving), 1, 0.0)


def test_pictures_without_detail_tell_nothing() -> None:
    shot = frames()
    for frame in shot.values():
        frame[Buffer.ALBEDO] = torch.full_like(frame[Buffer.ALBEDO], 0.5)
    assert not do_samples_rest(shot, 1, 0.0)
