"""Shading ghosting of `rtsr label --kind cgts` against light that is known to change.

    python benchmarks/shading_changes.py --seeds 0 1 2 3 4 5 --frames 2

Scenes of `rtsr synth`, several samples a pixel. Lights and what casts shadows go 24 frames ahead
where the camera goes one, as shadows of these scenes move by less than a pixel a frame. Each frame
is rendered a second time with the lights and shadows of the frame before on the surfaces of this
one, and where the means of a pixel's samples then differ by more than 0.05 in c / (1 + c), its
light changed. Judged
are surfaces that stand still, outside of visibility ghosting and aliasing, which take a pixel's
shading label away; bands of 8 pixels and wider, of which a rim of a pixel is ignored, count for
recall. A label within a pixel of a change is right.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import torch
from torch import Tensor
from torch.nn import functional

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.camera_motion import (
    differs_from_camera,
    find_camera_motion,
)
from rtsr_cli.core.imaging.color import encode_reinhard
from rtsr_cli.core.imaging.pixel_classes import GhostingConfig, PixelClasses, classify_pixels
from rtsr_cli.core.imaging.resampling import box_mean
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.synth.exposure import draw_scene
from rtsr_cli.core.synth.render import GEOMETRY, prepare_shot, render_frame, render_rows
from rtsr_cli.core.synth.scene import Scene

BAND = 8
"""Width of the changes that must be found, pixels."""

LEAST = GhostingConfig().color


def light(scene: Scene, number: int, clock: int, size: Size) -> Tensor:
    """Radiance of a frame's surfaces in the light, and under the shadows, of another frame."""
    shot, other = prepare_shot(scene, number, size), prepare_shot(scene, clock, size)
    lit = replace(shot, lights=other.lights, cover=other.cover)
    return render_rows(lit, range(size[0]), (Buffer.COLOR,))[Buffer.COLOR][None]


def render(scene: Scene, number: int, clock: int, size: Size) -> Frame:
    """Every buffer of a frame, in the light of another."""
    frame = render_frame(scene, number, size, buffers=GEOMETRY)
    lit = {Buffer.COLOR: light(scene, number, clock, size)}
    return replace(frame, gbuffer=frame.gbuffer.with_buffers(lit))


def grow(mask: Tensor, pixels: int = 1) -> Tensor:
    """True within so many pixels of a mask."""
    side = 2 * pixels + 1
    return functional.max_pool2d(mask.float(), side, stride=1, padding=pixels) > 0


def keep_bands(mask: Tensor, width: int = BAND) -> Tensor:
    """What of a mask lies in some block of so many pixels that is full."""
    full = functional.avg_pool2d(mask.double(), width, stride=1) > 1 - 1e-9
    return (
        functional.max_pool2d(functional.pad(full.float(), (width - 1,) * 4), width, stride=1) > 0
    )


def find_change(now: Frame, relit: Tensor, k: int) -> Tensor:
    """True where the mean of a pixel's samples differs by more than T_I in the other light."""
    colors = (now.gbuffer[Buffer.COLOR], relit)
    shown, other = (encode_reinhard(box_mean(color, k)) for color in colors)
    return (shown - other).abs().amax(1, keepdim=True) > LEAST


def find_movers(now: Frame, before: Frame, k: int) -> Tensor:
    """True where a sample of a pixel moves by itself."""
    camera = find_camera_motion(now.gbuffer[Buffer.POSITION], before)
    assert camera is not None
    moves = differs_from_camera(now.gbuffer[Buffer.MOTION], camera)
    # sky has no position
    moves = moves * (now.gbuffer[Buffer.OBJECT_ID] != 0)
    return functional.max_pool2d(moves, k) > 0


def count(classes: PixelClasses, changed: Tensor, movers: Tensor) -> Tensor:
    """Found, and of these right; so, and of these found; of judged pixels."""
    cleared = classes.visibility + classes.geometry + classes.texture > 0
    judged, found = ~movers & ~cleared, classes.shading > 0
    bands = keep_bands(changed)
    sure = bands & ~grow(~changed) & judged
    parts = (found & judged, found & judged & grow(changed), sure, sure & found)
    return torch.tensor([float(part.sum()) for part in parts])


def main() -> None:
    """Print precision and recall of every scene, and of all."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[*range(6)])
    parser.add_argument("--frames", type=int, default=2)
    parser.add_argument("--light-step", type=int, default=24)
    parser.add_argument("--size", default="240x136", help="of the labels")
    parser.add_argument("--samples", type=int, default=2)
    parser.add_argument("--static-camera", action="store_true")
    arguments = parser.parse_args()
    width, height = (int(v) * arguments.samples for v in arguments.size.split("x"))
    k, size, total = arguments.samples, (height, width), torch.zeros(4)
    step = arguments.light_step
    print("seed: pixels labelled, precision; pixels of bands, recall")
    for seed in arguments.seeds:
        scene = draw_scene(seed)
        scene = scene.still() if arguments.static_camera else scene
        part = torch.zeros(4)
        before = render(scene, 1, step, size)
        for number in range(2, arguments.frames + 1):
            now = render(scene, number, number * step, size)
            classes = classify_pixels([now, before], k)
            past_light = light(scene, number, (number - 1) * step, size)
            part += count(classes, find_change(now, past_light, k), find_movers(now, before, k))
            before = now
        total += part
        print(f"{seed}: {describe(part)}", flush=True)
    print(f"all: {describe(total)}")


def describe(part: Tensor) -> str:
    """Say what `count` found."""
    found, right, so, met = part.tolist()
    shares = (f"{a / b:.3f}" if b else "-" for a, b in ((right, found), (met, so)))
    return f"{found:.0f}, {next(shares)}; {so:.0f}, {next(shares)}"


if __name__ == "__main__":
    main()
