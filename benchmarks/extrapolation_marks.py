"""Marks beside the systems that extrapolate: what sees less than they do, and what sees more.

`camera-only` takes every pixel for still and moves the last rendered frame by the camera alone, as
asynchronous space warp does. `two-sided` also sees the rendered frame that follows: lighting from
both sides, each pixel from the side that shows its surface. `oracle` knows the truth: of the last
rendered frame warped, of `warp-guided`, and of lighting along occlusion vectors (Zeng et al. 2021)
each pixel takes what is nearest to it, which is all that a choice between these could reach.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor, nn

from rtsr_cli.core.captures.measuring.geometry_finder import (
    project_points,
    sample_positions,
    unproject_depth,
)
from rtsr_cli.core.choices import NonfinitePolicy
from rtsr_cli.core.files.exr import read_header, write_exr
from rtsr_cli.core.files.provenance import PREDICTED
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.cadence import Cadence
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.color import encode_reinhard
from rtsr_cli.core.imaging.frame_motion import find_dual_motion
from rtsr_cli.core.imaging.splatting import forward_motion_by_splat
from rtsr_cli.core.imaging.warping import backward_warp
from rtsr_cli.core.lighting.past_lighting import (
    carry_lighting,
    encode_quantity,
    shade,
)
from rtsr_cli.core.pairs.opening import ReadOptions, open_single_sets
from rtsr_cli.core.run.system_inputs import resolve_system_inputs
from rtsr_cli.core.system import FrameWindow
from rtsr_cli.models import load_system

GUIDED, WARP = "warp-guided", "warp"
RADIANCE = frozenset({Buffer.COLOR, Buffer.LIGHTING, Buffer.LIGHTING_MASK})

Mark = Callable[[Frame, Frame, Frame | None], Tensor]
"""Of the truth (the only one to see its radiance), the frame before it and the one after it."""


def hide_radiance(frame: Frame) -> Frame:
    """The frame as a system sees it that was not rendered."""
    kept = [b for b in frame.gbuffer if b not in RADIANCE]
    return replace(frame, gbuffer=frame.gbuffer.only(kept))


def predict(system: str, window: FrameWindow) -> Tensor:
    """Picture of a shipped system."""
    image = load_system(system).predict(nn.Module(), window, None).image
    assert image is not None
    return image


def turn_motion(frame: Frame, motion_px: Tensor) -> Frame:
    """The same frame with other vectors."""
    gbuffer = frame.gbuffer.with_buffers({Buffer.MOTION: motion_px})
    return replace(frame, gbuffer=gbuffer)


def move_by_camera(truth: Frame, before: Frame, after: Frame | None) -> Tensor:
    """`warp` with the vectors that the camera alone would give."""
    del after
    now = hide_radiance(truth)
    world = unproject_depth(now.gbuffer[Buffer.DEPTH], now.camera, now.view)
    seen = None if world is None else project_points(world, before.camera, now.view)
    if seen is None:
        raise ValueError("frames without camera matrices")
    motion = (seen - sample_positions(now.size)).to(now.gbuffer[Buffer.MOTION])
    return predict(WARP, FrameWindow(lr=(turn_motion(now, motion), before)))


def look_both_ways(truth: Frame, before: Frame, after: Frame | None) -> Tensor:
    """Lighting of both rendered neighbours; without a following one, `warp-guided`."""
    now = hide_radiance(truth)
    past_window = FrameWindow(lr=(now, before))
    if after is None:
        return predict(GUIDED, past_window)
    forward, known = forward_motion_by_splat(
        after.gbuffer[Buffer.MOTION], after.gbuffer[Buffer.DEPTH]
    )
    next_window = FrameWindow(lr=(turn_motion(now, forward), after))
    past, coming = carry_lighting(past_window), carry_lighting(next_window)
    pictures = [
        shade(window, side, side.filled)
        for window, side in ((past_window, past), (next_window, coming))
    ]
    hole_past = past.holes > 0
    hole_next = (coming.holes > 0) | (known == 0)
    mean = (pictures[0] + pictures[1]) / 2
    one_sided = torch.where(hole_past & ~hole_next, pictures[1], pictures[0])
    return torch.where(hole_past ^ hole_next, one_sided, torch.where(hole_past, pictures[0], mean))


def choose_by_truth(truth: Frame, before: Frame, after: Frame | None) -> Tensor:
    """Each pixel as the candidate that is nearest to the truth after c / (1 + c)."""
    del after
    now = hide_radiance(truth)
    window = FrameWindow(lr=(now, before))
    past = carry_lighting(window)
    dual = find_dual_motion(now, before).dual_px
    behind, _ = backward_warp(encode_quantity(before), dual)
    candidates = torch.stack(
        [predict(WARP, window), predict(GUIDED, window), shade(window, past, behind)]
    )
    error = (encode_reinhard(candidates) - encode_reinhard(truth.gbuffer[Buffer.COLOR])).square()
    best = error.sum(2, keepdim=True).argmin(0, keepdim=True)
    return candidates.gather(0, best.expand(1, *candidates.shape[1:]))[0]


MARKS: dict[str, Mark] = {
    "camera-only": move_by_camera,
    "two-sided": look_both_ways,
    "oracle": choose_by_truth,
}
"""Marks by name."""


def draw_marks(folder: Path, out: Path, first: int) -> None:
    """Write the sequences of a tree as each mark has them, from a frame on.

    Rendered frames are as they are, so that change can be judged.
    """
    with torch.inference_mode():
        for name, source in open_single_sets(folder, ReadOptions()):
            wanted = resolve_system_inputs(load_system(GUIDED), NonfinitePolicy.ERROR)
            inputs = replace(wanted, lr=(*wanted.lr, Buffer.MATERIAL))
            reader = source.reader
            rendered = Cadence().list_rendered(reader.numbers, reader.step)
            frames = {n: source.load(n, inputs).lr for n in reader.numbers if n >= first - 1}
            for number in reader.numbers:
                path = reader.path(number)
                if number < first - 1:
                    continue
                for mark in MARKS:
                    target = out / mark / name / path.name
                    if number in rendered:
                        write_picture(target, path, frames[number].gbuffer[Buffer.COLOR])
                        continue
                    near = (frames[number - 1], frames.get(number + 1))
                    image = MARKS[mark](frames[number], *near)
                    write_picture(target, path, image, PREDICTED)


def write_picture(target: Path, source: Path, image: Tensor, *marks: str) -> None:
    """Write radiance as half, with the header of its frame and marks beside."""
    planes = {c: image[0, i].half().numpy() for i, c in enumerate("RGB")}
    attributes = {**read_header(source).attributes, **dict.fromkeys(marks, 1)}
    write_exr(target, planes, attributes=attributes)


def list_predicted(folder: Path, first: int) -> Iterator[Path]:
    """Files of a shot that are stamped as predicted, from a frame on."""
    for path in sorted(folder.glob("*.exr")):
        number = int(path.stem.rpartition(".")[2])
        if number >= first and PREDICTED in read_header(path).attributes:
            yield path
