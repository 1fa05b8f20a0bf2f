"""Why pixels have no material, and where they lie: what is said of them."""

from __future__ import annotations

import torch.nn.functional as F

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.lighting.radiance import LOST_REACH, find_explained, find_unexplained
from rtsr_cli.core.pairs.material_causes import UNSAID
from rtsr_cli.core.pairs.sources import FramePair
from rtsr_cli.core.shapes import Mask
from rtsr_cli.core.system import FrameWindow

ZERO_AT_LR = "material is 0 at LR"
ZERO_AT_HR = "material is 0 at HR"

ROWS, COLUMNS = ("upper", "middle", "lower"), ("left", "centre", "right")


def describe_lost(pair: FramePair, window: FrameWindow) -> dict[str, str]:
    """Say why HR pixels of a frame are undivided, and where; empty where none is.

    Args:
        pair: the frame, with what was doubted of it.
        window: what the system saw of it.

    Returns:
        Cause -> place.
    """
    hr, frame = window.hr, window.current.gbuffer
    if hr is None or Buffer.MATERIAL not in hr.gbuffer or Buffer.LIGHTING_MASK not in frame:
        return {}
    undivided = window.compute_once(find_unexplained)
    if undivided is None:
        return {}
    scale, masks = window.scale, dict(pair.doubted)
    unlit = (frame[Buffer.LIGHTING_MASK] < 0.5) & (frame[Buffer.SKY] < 0.5)
    unlit &= ~find_explained(window)
    bare = undivided & (hr.gbuffer[Buffer.MATERIAL] <= MATERIAL_EPSILON).any(1, keepdim=True)
    empty = F.max_pool2d(bare.float(), scale) > 0.5
    if pair.bare is not None:
        empty &= pair.bare.to(empty.device)
    for mask in pair.doubted.values():
        unlit = unlit & ~mask.to(unlit.device)
        side = 2 * LOST_REACH + 1
        empty = empty & (F.max_pool2d(mask.to(empty.device).float(), side, 1, LOST_REACH) < 0.5)
    masks |= {ZERO_AT_LR: unlit, ZERO_AT_HR: empty}
    masks.pop(UNSAID, None)
    places = {cause: describe_place(mask) for cause, mask in masks.items() if bool(mask.any())}
    return {
        cause: f"{place}: {pair.colours[cause]}" if cause in pair.colours else place
        for cause, place in places.items()
    }


def describe_place(mask: Mask) -> str:
    """Name the part of the picture in which LR pixels are marked, and the box around them."""
    height, width = mask.shape[-2:]
    rows, columns = (mask[0, 0].any(axis).nonzero()[:, 0] for axis in (1, 0))
    (top, bottom), (left, right) = ((int(line[0]), int(line[-1])) for line in (rows, columns))
    part = f"{ROWS[_third(top, bottom, height)]} {COLUMNS[_third(left, right, width)]}"
    return f"{part}, x {left}-{right}, y {top}-{bottom} of LR's {width} x {height}"


def _third(first: int, last: int, extent: int) -> int:
    return min(2, 3 * (first + last + 1) // (2 * extent))
