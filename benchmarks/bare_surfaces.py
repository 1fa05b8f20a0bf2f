"""Error over surfaces that lose their material, against `bicubic`'s over the same pixels.

    python benchmarks/bare_surfaces.py ../shared/data [SEQUENCE ...] [--scale 4] [--system NAME]

The material of one object at a time (0.5 % to 30 % of the picture) becomes 0 or NaN, or loses its
base colour, at the sizes that a case names, and the frame is upscaled. Squared errors are means
over the pixels that were enlarged as radiance (undivided: at most 1 by construction, but for lamps,
whose emission is known) and over the object's (with slivers that no sample without lighting is
near), linear and after c / (1 + c); printed is the largest ratio to `bicubic`'s of each system,
with where it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import click
import torch

from rtsr_cli.core.choices import JitterMode
from rtsr_cli.core.errors import CheckpointError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.color import encode_reinhard
from rtsr_cli.core.imaging.derivation import DerivationConfig, derive
from rtsr_cli.core.imaging.enlargement import enlarge_radiance
from rtsr_cli.core.lighting.radiance import find_undivided
from rtsr_cli.core.network.load import LoadedNetwork, load_network
from rtsr_cli.core.pairs.dark_material import leave_outshining
from rtsr_cli.core.pairs.material_agreement import leave_contradicting
from rtsr_cli.core.pairs.opening import ReadOptions, open_pairs
from rtsr_cli.core.pairs.simulation import Simulation, decimate_frame
from rtsr_cli.core.pairs.sources import PairSource
from rtsr_cli.core.pairs.window import join_window
from rtsr_cli.core.shapes import Color, Mask
from rtsr_cli.core.system import FrameWindow, State, System
from rtsr_cli.models import load_system

SEQUENCES = (
    "bath/wash",
    "dining/round",
    "greyroom/enter",
    "court/fly",
    "lounge/tour",
    "stairs/climb",
    "atrium/walk",
)
SYSTEMS = (
    "demod-bicubic",
    "demod-guided",
    "demod-temporal",
    "gather",
    "fusesr",
    "fusesr-fast",
    "nsrd",
)
FEWEST, MOST = 0.005, 0.3
TOLERANCE = 1e-3
LEAST_ERROR = 1e-12
HISTORY = 2
ZERO, NAN = 0.0, float("nan")
COLOURLESS = "colourless"
RED = "red"
"""Base colours that are 0: of the material the specular part is left; of metal, green and blue."""

Value = float | str
"""A material, or the name of what base colour and metal become."""

CASES: Mapping[str, Mapping[str, Value]] = {
    "both": {"lr": ZERO, "hr": ZERO},
    "lr": {"lr": ZERO},
    "hr": {"hr": ZERO},
    "NaN": {"lr": NAN, "hr": NAN},
    "NaN at lr": {"lr": NAN},
    "NaN at hr": {"hr": NAN},
    "no colour": {"lr": COLOURLESS, "hr": COLOURLESS},
    "no colour at lr": {"lr": COLOURLESS},
    "no colour at hr": {"hr": COLOURLESS},
    "red metal": {"lr": RED, "hr": RED},
}


Runner = tuple[System, LoadedNetwork]


@dataclass(frozen=True, kw_only=True)
class Found:
    """One ratio to `bicubic`'s squared error, of whom and where."""

    name: str
    ratio: float
    where: str


@dataclass(frozen=True, kw_only=True)
class Stripped:
    """Frames in which an object has no material: what LR frames are made of, and HR frames."""

    number: int
    lr: list[Frame]
    hr: list[Frame]


def read_frames(source: PairSource) -> list[Frame]:
    """Read the first frames, with their material."""
    reader = source.reader
    frames = []
    for number in reader.numbers[: HISTORY + 1]:
        full = reader.read(number, reader.readable)
        known = full.gbuffer.with_buffers({Buffer.MATERIAL: derive_material(full)})
        frames.append(replace(full, gbuffer=known))
    return frames


def derive_material(frame: Frame) -> Color:
    """The material of a frame that stores what it is made of."""
    return derive(frame, {Buffer.MATERIAL}, DerivationConfig()).gbuffer[Buffer.MATERIAL]


def derive_otherwise(frame: Frame, name: str) -> Color:
    """The same without base colour, or as metal that is red alone."""
    stored = frame.gbuffer.only(frame.gbuffer.keys() - {Buffer.MATERIAL})
    albedo, metallic = stored[Buffer.ALBEDO].clone(), stored[Buffer.METALLIC]
    if name == RED:
        albedo[:, 1:], metallic = 0.0, torch.ones_like(metallic)
    else:
        albedo.zero_()
    changed = stored.with_buffers({Buffer.ALBEDO: albedo, Buffer.METALLIC: metallic})
    return derive_material(replace(frame, gbuffer=changed))


def list_objects(frame: Frame) -> Iterator[int]:
    """Yield the numbers of objects that are neither tiny nor most of the picture."""
    numbers, counts = frame.gbuffer[Buffer.OBJECT_ID].unique(return_counts=True)
    for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
        if number and FEWEST <= count / frame.gbuffer[Buffer.OBJECT_ID].numel() <= MOST:
            yield int(number)


def strip_material(frame: Frame, number: int, value: Value) -> Frame:
    """Give an object a material of one value, or of other base colours."""
    gbuffer = frame.gbuffer
    gone = gbuffer[Buffer.OBJECT_ID] == number
    left = derive_otherwise(frame, value) if isinstance(value, str) else torch.tensor(value)
    material = torch.where(gone, left, gbuffer[Buffer.MATERIAL])
    return replace(frame, gbuffer=gbuffer.with_buffers({Buffer.MATERIAL: material}))


def leave_undividable(lr: Frame, hr: Frame, scale: int) -> tuple[Frame, Frame]:
    """What pairs of real frames go through."""
    lr, hr = leave_contradicting(lr, hr, scale)
    return leave_outshining(lr, hr, scale) if Buffer.LIGHTING in lr.gbuffer else (lr, hr)


def build_windows(
    system: System, config: Any, small: list[Frame], large: list[Frame], scale: int
) -> Iterator[FrameWindow]:
    """Yield the windows of a run over the frames; of systems without a state, the last."""
    derivation = system.derivation(config)

    def keep(frame: Frame, needed: Iterable[Buffer], optional: Iterable[Buffer]) -> Frame:
        known = (b for b in optional if b in frame.gbuffer)
        return derive(frame, {*needed, *known}, derivation)

    divided = (*system.lr_inputs, Buffer.MATERIAL)
    pairs = [
        leave_undividable(
            keep(low, divided, system.lr_optional),
            keep(high, system.hr_inputs, system.hr_optional),
            scale,
        )
        for low, high in zip(small, large, strict=True)
    ]
    lr = [low for low, _ in pairs]
    first = 0 if system.recurrent else len(large) - 1
    for last in range(first, len(large)):
        hr = pairs[last][1]
        seen = reversed(lr[: last + 1])
        yield join_window(seen, hr, scale=scale, history=system.history_frames)


def run_system(
    runner: Runner, small: list[Frame], large: list[Frame], scale: int
) -> tuple[Color, Mask | None]:
    """Return the last frame's picture, and which pixels of it are enlarged radiance."""
    system, loaded = runner
    state: State = None
    image, undivided = None, None
    with torch.inference_mode():
        for window in build_windows(system, loaded.config, small, large, scale):
            prediction = system.predict(loaded.network, window, state)
            state, image = prediction.state, prediction.image
            undivided = find_undivided(window)
    assert image is not None
    return image, undivided


def compare(image: Color, plain: Color, truth: Color, where: Mask) -> float:
    """Return the larger ratio of squared errors, linear and tone-mapped."""
    ratios = [0.0]
    for shown in ((image, plain, truth), tuple(encode_reinhard(i) for i in (image, plain, truth))):
        ours, theirs = (
            float((shown[side] - shown[2]).double().square().mean(1, keepdim=True)[where].mean())
            for side in (0, 1)
        )
        ratios.append(ours / max(theirs, LEAST_ERROR))
    return max(ratios)


def measure_case(
    runners: Mapping[str, Runner], stripped: Stripped, simulation: Simulation
) -> Iterator[tuple[str, float]]:
    """Yield each system's largest ratio over one object in one case."""
    small = [decimate_frame(f, f.gbuffer.buffers.keys(), simulation) for f in stripped.lr]
    newest = stripped.hr[-1].gbuffer
    truth = newest[Buffer.COLOR]
    last = small[-1]
    plain = enlarge_radiance(last.gbuffer[Buffer.COLOR], simulation.scale, last.camera.jitter_px)
    large = [
        replace(f, gbuffer=f.gbuffer.only(set(f.gbuffer.buffers) - {Buffer.COLOR}))
        for f in stripped.hr
    ]
    for name, runner in runners.items():
        image, undivided = run_system(runner, small, large, simulation.scale)
        own = newest[Buffer.OBJECT_ID] == stripped.number
        yield f"{name} object", compare(image, plain, truth, own)
        if undivided is not None:
            yield f"{name} undivided", compare(image, plain, truth, undivided)


def measure_shot(
    source: PairSource, runners: Mapping[str, Runner], simulation: Simulation, cases: Iterable[str]
) -> Iterator[Found]:
    """Yield every ratio of a shot."""
    frames = read_frames(source)
    for number in list_objects(frames[-1]):
        for case in cases:
            values = CASES[case]
            sides = {
                side: [
                    strip_material(f, number, values[side]) if side in values else f for f in frames
                ]
                for side in ("lr", "hr")
            }
            stripped = Stripped(number=number, **sides)
            for name, ratio in measure_case(runners, stripped, simulation):
                yield Found(name=name, ratio=ratio, where=f"object {number}, {case}")


def load_runners(names: Iterable[str], scale: int) -> dict[str, Runner]:
    """Load the systems that have weights for a scale."""
    runners = {}
    for name in names:
        system = load_system(name)
        try:
            runners[name] = (system, load_network(system, scale, "cpu"))
        except CheckpointError:
            continue
    return runners


@click.command()
@click.argument("data", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("sequences", nargs=-1)
@click.option("--scale", "scales", type=int, multiple=True, default=(2, 4, 8), show_default=True)
@click.option("--system", "names", multiple=True, default=SYSTEMS, show_default=True)
@click.option("--case", "cases", type=click.Choice(list(CASES)), multiple=True, default=CASES)
@click.option("--jitter", type=click.Choice(["none", "halton"]), default="halton")
@click.option("--verbose", is_flag=True, help="Print every ratio above 1.")
def main(*, data: Path, sequences: tuple[str, ...], scales: tuple[int, ...], **other: Any) -> None:
    """Print the largest ratio of each system, sequence and scale."""
    worst: dict[str, Found] = {}
    for scale, sequence in product(scales, sequences or SEQUENCES):
        runners = load_runners(other["names"], scale)
        simulation = Simulation(scale=scale, jitter=JitterMode(other["jitter"]))
        [(_, source)] = open_pairs(data / sequence, ReadOptions(), simulation=simulation)
        found = list(measure_shot(source, runners, simulation, other["cases"]))
        for one in found:
            if other["verbose"] and one.ratio > 1.0 + TOLERANCE:
                print(f"    {one.name} {one.where}: {one.ratio:.4f}")
        for name in sorted({one.name for one in found}):
            own = [one for one in found if one.name == name]
            most = max(own, key=lambda one: one.ratio)
            above = sum(one.ratio > 1.0 + TOLERANCE for one in own)
            line = f"{sequence} {scale}x {name}: {most.ratio:.4f} ({most.where}); {above} of "
            print(f"{line}{len(own)} above", flush=True)
            if name not in worst or most.ratio > worst[name].ratio:
                worst[name] = replace(most, where=f"{sequence} {scale}x, {most.where}")
    for name, most in worst.items():
        print(f"worst of {name}: {most.ratio:.4f} ({most.where})")


if __name__ == "__main__":
    main()
