"""What `train` sees of a frame is what `upscale` sees of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.choices import JitterMode, NonfinitePolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame, FrameSequence
from rtsr_cli.core.frames.storage import round_to_half
from rtsr_cli.core.pairs.opening import ReadOptions, open_pairs
from rtsr_cli.core.pairs.simulated_pairs import open_simulated_pairs
from rtsr_cli.core.pairs.simulation import Simulation
from rtsr_cli.core.pairs.sources import PairSource
from rtsr_cli.core.run.frame_pairs import PairReading
from rtsr_cli.core.run.sliding_window import SlidingWindow
from rtsr_cli.core.run.system_inputs import resolve_system_inputs, resolve_unshaded_inputs
from rtsr_cli.core.system import FrameWindow
from rtsr_cli.core.training.augmentation import PictureTurn
from rtsr_cli.core.training.clip_recording import (
    CapturedShot,
    list_recorded_inputs,
    record_clips_of,
)
from rtsr_cli.core.training.clips import Clip, read_clips
from rtsr_cli.core.training.config import SampleJitter, TrainingConfig
from rtsr_cli.core.training.crop_frames import cut_hr, make_lr_frame, make_reference, plan_cut
from rtsr_cli.core.training.packs import pack_crops
from rtsr_cli.core.training.sample_steps import build_steps, build_whole_window
from rtsr_cli.core.training.sampler import SampleDrawer
from rtsr_cli.core.training.samples import (
    SampleChoices,
    SampleRegion,
    SampleTask,
    cover_frame,
    draw_jitter,
    leave_out_starts,
    make_task,
)
from rtsr_cli.core.training.whole_frames import PreparedFrames
from rtsr_cli.models import list_trainable_names, load_system

Planes = Mapping[str, NDArray[Any]]

SIZE = (48, 64)
"""Divisible by every block of 4 x output pixels of 2 x 2 samples."""

NUMBERS = (3, 4, 5, 6)

CAPTURE = """
layout = "rtsr"
[motion]
unit = "pixels"
direction = "previous-minus-current"
y_axis = "down"
jittered = false
"""

UPSCALERS = [n for n in list_trainable_names() if not load_system(n).rendered_every]
EXTRAPOLATORS = [n for n in list_trainable_names() if load_system(n).rendered_every]

JITTERS = [SampleJitter.NONE, SampleJitter.HALTON]


def planes(number: int, size: tuple[int, int], *, halves: bool) -> dict[str, NDArray[Any]]:
    """Random buffers with sky on top, stored as floats; of `halves`, values that halves hold.

    Normals are brought to unit length when they are read, so that those of halves lie on axes.
    """
    random = np.random.default_rng([7, number])
    sky = np.arange(size[0])[:, None] < size[0] // 6
    made: dict[str, NDArray[Any]] = {}

    def add(names: tuple[str, ...], low: float, high: float, on_sky: float = 0.0) -> None:
        for name in names:
            made[name] = np.where(sky, on_sky, random.uniform(low, high, size))

    add(("R", "G", "B"), 0.05, 3.0, on_sky=0.75)
    add(("albedo.R", "albedo.G", "albedo.B"), 0.1, 0.9)
    add(("emission.R",), -1.0, 0.04)
    made["emission.R"] = made["emission.R"].clip(min=0.0)
    made["emission.G"] = made["emission.B"] = 0.0 * made["R"]
    add(("depth.Z",), 2.0, 3.0, on_sky=65504.0)
    add(("motion.X", "motion.Y"), -3.0, 3.0)
    add(("roughness", "nov"), 0.2, 0.9)
    add(("metallic",), 0.0, 1.0)
    vectors = random.normal(size=(3, *size)) + np.array([0, 0, 2.0])[:, None, None]
    if halves:
        axes = random.integers(0, 3, size)
        vectors = (np.arange(3)[:, None, None] == axes) * random.choice([-1.0, 1.0], size)
        add(("material.R", "material.G", "material.B"), 0.0, 0.9)
    vectors = np.where(sky, 0.0, vectors / np.linalg.norm(vectors, axis=0))
    made |= {f"normal.{c}": plane for c, plane in zip("XYZ", vectors, strict=True)}
    kind = np.float16 if halves else np.float32
    stored: dict[str, NDArray[Any]] = {
        k: p.astype(kind).astype(np.float32) for k, p in made.items()
    }
    stored["objectid"] = (random.integers(1, 9, size) * ~sky).astype(np.uint32)
    return stored


def write_capture(folder: Path, *, halves: bool = True, lit: bool = True) -> Path:
    """Four frames; the camera stands at the origin. With `lit` something emits."""
    projection = np.diag([1.2, 1.6, -1.0, 0.0]).astype(np.float32)
    projection[2, 3], projection[3, 2] = -1.0, -0.05
    camera = {"worldToCamera": np.eye(4, dtype=np.float32), "worldToNDC": projection}
    for number in NUMBERS:
        stored = planes(number, SIZE, halves=halves)
        if not lit:
            stored = {k: 0 * p if k.startswith("emission") else p for k, p in stored.items()}
        write_exr(folder / f"frame.{number:04d}.exr", stored, attributes=camera)
    (folder / "capture.toml").write_text(CAPTURE)
    return folder


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_capture(tmp_path_factory.mktemp("halves"))


@pytest.fixture(scope="module")
def floats(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_capture(tmp_path_factory.mktemp("floats"), halves=False)


def task_of(name: str, **settings: Any) -> SampleTask:
    system = load_system(name)
    scale = min(system.scales)
    return make_task(system, system.config(), TrainingConfig(scale=scale, **settings))


@cache
def reader_of(folder: Path) -> FrameReader:
    """A capture as `upscale` opens it; the measurements of that are the same for all."""
    ((_, source),) = open_pairs(folder, ReadOptions(), simulation=Simulation(scale=1))
    return source.reader


def source_of(folder: Path, simulation: Simulation) -> PairSource:
    return open_simulated_pairs(reader_of(folder), simulation)


def simulation_of(task: SampleTask, **changed: Any) -> Simulation:
    jittered = task.jitter is not SampleJitter.NONE
    plain = Simulation(
        scale=task.scale,
        samples_per_pixel=task.samples_per_pixel,
        jitter=JitterMode.HALTON if jittered else JitterMode.NONE,
    )
    return replace(plain, **changed)


def upscaled(source: PairSource, task: SampleTask) -> Iterator[FrameWindow]:
    """Windows of every frame as `upscale` makes them."""
    reader = source.reader
    inputs = resolve_system_inputs(task.system, NonfinitePolicy.ERROR, task.config)
    sequence = FrameSequence(numbers=reader.numbers, step=reader.step, cuts=reader.resets)
    window = SlidingWindow(sequence, history_frames=task.system.history_frames, scale=source.scale)
    for number in reader.numbers:
        yield window.slide(source.load(number, inputs))


def recorded(source: PairSource, task: SampleTask, folder: Path) -> Clip:
    """The one clip of a shot, as `train` records and reads it."""
    lines = record_clips_of(
        CapturedShot(source),
        list_recorded_inputs(task.system, task.config, task.scale),
        cache=folder,
        policy=NonfinitePolicy.ERROR,
    )
    while True:
        try:
            next(lines)
        except StopIteration as end:
            (path,) = end.value
            break
    (clip,), _ = read_clips(path)
    return clip


def frames_of(window: FrameWindow) -> list[tuple[str, Frame]]:
    lr = [(f"lr {age}", frame) for age, frame in enumerate(window.lr)]
    return lr if window.hr is None else [*lr, ("hr", window.hr)]


def compare(
    ours: FrameWindow, theirs: FrameWindow, equal: Callable[[torch.Tensor, torch.Tensor], bool]
) -> None:
    assert ours.scale == theirs.scale
    assert [name for name, _ in frames_of(ours)] == [name for name, _ in frames_of(theirs)]
    for (name, one), (_, other) in zip(frames_of(ours), frames_of(theirs), strict=True):
        assert one.number == other.number
        assert one.view == other.view, name
        assert one.camera.jitter_px == other.camera.jitter_px, name
        assert one.camera.pre_exposure == other.camera.pre_exposure
        assert set(one.gbuffer) == set(other.gbuffer), name
        for buffer, tensor in one.gbuffer.items():
            assert tensor.dtype == other.gbuffer[buffer].dtype, (name, buffer)
            assert equal(tensor, other.gbuffer[buffer]), (name, buffer)
        scales = torch.tensor([one.lighting_scale, other.lighting_scale], dtype=torch.float64)
        assert equal(*scales), (name, "lighting scale", scales)


def within_halves(one: torch.Tensor, other: torch.Tensor) -> bool:
    """As near as stored halves allow; a quotient has the rounding of both its terms."""
    return torch.allclose(one.float(), other.float(), rtol=2**-9, atol=2**-10)


@pytest.mark.parametrize("samples", [1, 2])
@pytest.mark.parametrize("jitter", JITTERS)
@pytest.mark.parametrize("name", UPSCALERS)
def test_training_sees_the_windows_that_upscaling_sees(
    capture: Path, tmp_path: Path, name: str, jitter: SampleJitter, samples: int
) -> None:
    task = task_of(name, jitter=jitter, samples_per_pixel=samples)
    source = source_of(capture, simulation_of(task))
    clip = recorded(source, task, tmp_path)
    windows = list(upscaled(source, task))
    assert len(windows) == len(NUMBERS)
    for position, theirs in enumerate(windows):
        ours, _ = build_whole_window(clip, position, task)
        compare(ours, theirs, torch.equal)
        # a sample that nothing happens to is that window, too
        choices = SampleChoices(jitter=simulation_of(task).jitter)
        block = task.scale * samples
        step = build_steps(clip, cover_frame(clip, position, block), choices, task)[0]
        expected = task.learning.prepare(task.config, theirs)
        assert all(torch.equal(step.inputs[key], tensor) for key, tensor in expected.items())


def extrapolated(source: PairSource, task: SampleTask, target: int) -> FrameWindow:
    """Window of a frame as `extrapolate` makes it, where the frame before it is rendered."""
    numbers = source.reader.numbers
    inputs = resolve_system_inputs(task.system, NonfinitePolicy.ERROR, task.config)
    unshaded = resolve_unshaded_inputs(task.system, NonfinitePolicy.ERROR, task.config)
    every = task.system.rendered_every
    predicted = [n for n in numbers if (target - 1 - n) % every]
    reading = PairReading(source=source, inputs=inputs, unshaded=dict.fromkeys(predicted, unshaded))
    sequence = FrameSequence(numbers=numbers, step=source.reader.step, cuts=source.reader.resets)
    window = SlidingWindow(sequence, history_frames=task.system.history_frames, scale=1)
    seen = (window.slide(source.load(n, reading.inputs_of(n))) for n in numbers)
    return next(w for w in seen if w.current.number == target)


@pytest.mark.parametrize("name", EXTRAPOLATORS)
def test_training_sees_the_windows_that_extrapolation_sees(
    capture: Path, tmp_path: Path, name: str
) -> None:
    task = task_of(name)
    source = source_of(capture, simulation_of(task))
    (clip,) = leave_out_starts([recorded(source, task, tmp_path)], task)
    assert list(clip.target_positions) == [1, 2, 3]
    prepared = PreparedFrames(task)
    for position in clip.target_positions:
        theirs = extrapolated(source, task, NUMBERS[position])
        ours, reference = build_whole_window(clip, position, task)
        compare(ours, theirs, torch.equal)
        assert all(Buffer.COLOR not in frame.gbuffer for frame in ours.lr[::2])
        for one, other in zip(ours.lr, theirs.lr, strict=True):
            assert one.camera.has_matrices
            assert torch.equal(one.camera.world_to_ndc, other.camera.world_to_ndc)
        expected = task.learning.prepare(task.config, theirs)
        seen = prepared.prepare(clip, position).inputs
        assert all(torch.equal(seen[k], round_to_half(t)) for k, t in expected.items())
        assert Buffer.COLOR in reference.gbuffer


@pytest.mark.parametrize("samples", [1, 2])
@pytest.mark.parametrize("jitter", JITTERS)
@pytest.mark.parametrize("name", ["fusesr", "rt-percept"])
def test_frames_of_floats_are_seen_within_the_rounding_of_halves(
    floats: Path, tmp_path: Path, name: str, jitter: SampleJitter, samples: int
) -> None:
    task = task_of(name, jitter=jitter, samples_per_pixel=samples)
    source = source_of(floats, simulation_of(task))
    clip = recorded(source, task, tmp_path)
    for position, theirs in enumerate(upscaled(source, task)):
        compare(build_whole_window(clip, position, task)[0], theirs, within_halves)


@pytest.mark.parametrize("lr_filter", ["box", "blackman-harris"])
def test_filtered_samples_are_those_of_filtered_upscaling(
    capture: Path, tmp_path: Path, lr_filter: str
) -> None:
    task = task_of("fusesr-fast", jitter=SampleJitter.HALTON, samples_per_pixel=2)
    source = source_of(capture, simulation_of(task, lr_filter=lr_filter))
    clip = recorded(source, task, tmp_path)
    for position, theirs in enumerate(upscaled(source, task)):
        compare(build_whole_window(clip, position, task, lr_filter)[0], theirs, torch.equal)


def test_emission_that_is_nowhere_is_seen_as_such(tmp_path: Path) -> None:
    task = task_of("fusesr-fast")
    source = source_of(write_capture(tmp_path / "dark", lit=False), simulation_of(task))
    clip = recorded(source, task, tmp_path)
    assert clip.facts.zeros == ("hr.emission",)
    theirs = next(upscaled(source, task))
    assert Buffer.EMISSION in frames_of(theirs)[-1][1].gbuffer
    compare(build_whole_window(clip, 0, task)[0], theirs, torch.equal)


def test_frames_that_were_rendered_are_seen_as_upscaling_sees_them(tmp_path: Path) -> None:
    """With their own jitter, whatever training's is; but for surfaces too dark for their radiance,
    which upscaling alone leaves undivided."""
    for folder, size in (("lr", (24, 32)), ("hr", SIZE)):
        for number in NUMBERS:
            stored = planes(number, size, halves=True)
            for name in {"material.R", "material.G", "material.B"} & stored.keys():
                stored[name] = np.maximum(stored[name], np.float16(0.1))
            write_exr(tmp_path / "shot" / folder / f"frame.{number:04d}.exr", stored)
    toml = CAPTURE.replace('"rtsr"', '"rtsr"\njitter_px = [0.25, -0.25]')
    (tmp_path / "shot" / "capture.toml").write_text(toml)
    task = task_of("nsrd", jitter=SampleJitter.MIXED, samples_per_pixel=2)
    ((_, source),) = open_pairs(tmp_path / "shot", ReadOptions())
    clip = recorded(source, task, tmp_path / "cache")
    assert clip.facts.lr_scale == task.scale
    for position, theirs in enumerate(upscaled(source, task)):
        assert theirs.current.camera.jitter_px == (0.25, -0.25)
        compare(build_whole_window(clip, position, task)[0], theirs, torch.equal)


def test_a_filter_of_rendered_frames_is_known_in_training(tmp_path: Path) -> None:
    task = task_of("gather")
    small = (SIZE[0] // task.scale, SIZE[1] // task.scale)
    for folder, size in (("lr", small), ("hr", SIZE)):
        for number in NUMBERS:
            stored = planes(number, size, halves=True)
            write_exr(tmp_path / "shot" / folder / f"frame.{number:04d}.exr", stored)
    toml = CAPTURE.replace('"rtsr"', '"rtsr"\nfilter_width_px = 0.3')
    (tmp_path / "shot" / "capture.toml").write_text(toml)
    ((_, source),) = open_pairs(tmp_path / "shot", ReadOptions())
    clip = recorded(source, task, tmp_path / "cache")
    theirs = next(upscaled(source, task))
    ours, _ = build_whole_window(clip, 0, task)
    assert ours.current.filter_width_px == theirs.current.filter_width_px == 0.3


@pytest.mark.parametrize("transposed", [False, True])
@pytest.mark.parametrize("mirror_x", [False, True])
def test_a_turned_sample_is_that_of_the_turned_capture(
    capture: Path, tmp_path: Path, transposed: bool, mirror_x: bool
) -> None:
    turn = PictureTurn(transposed=transposed, mirror_x=mirror_x, mirror_y=True)
    task = task_of("nsrd", jitter=SampleJitter.HALTON, samples_per_pixel=2)
    clip = recorded(source_of(capture, simulation_of(task)), task, tmp_path)
    facts = replace(clip.facts, display=turn.size(clip.facts.display), captured=turn.size(SIZE))
    turned = replace(
        clip,
        facts=facts,
        hr={
            name: torch.cat([turn.plane(name, p[None]) for p in ps]) for name, ps in clip.hr.items()
        },
        scales={},
    )
    choices = SampleChoices(jitter=JitterMode.HALTON, phase=5)
    for position in range(len(NUMBERS)):
        there = plan_cut(clip, cover_frame(clip, position, 4), replace(choices, turn=turn), task)
        here = plan_cut(turned, cover_frame(turned, position, 4), choices, task)
        one, other = make_lr_frame(there, position), make_lr_frame(here, position)
        assert one.camera.jitter_px == other.camera.jitter_px
        assert one.view == other.view
        assert one.lighting_scale == pytest.approx(other.lighting_scale, rel=1e-6)
        for buffer, tensor in one.gbuffer.items():
            assert torch.equal(tensor, other.gbuffer[buffer]), buffer


def test_an_output_pixel_is_held_against_the_mean_of_its_samples(
    capture: Path, tmp_path: Path
) -> None:
    """And its lighting against that over the mean material: so the product is the mean again."""
    task = task_of("fusesr-fast", samples_per_pixel=2)
    clip = recorded(source_of(capture, simulation_of(task)), task, tmp_path)
    region = SampleRegion(position=1, top=5, left=3, size=(8, 10))
    cut = plan_cut(clip, region, SampleChoices(), task)
    color = clip.hr["color"][1:2, :, 5:37, 3:43].float()
    expected = color.unfold(2, 2, 2).unfold(3, 2, 2).mean((-1, -2))
    held = cut_hr(cut, 1, goal=True)
    reference = make_reference(cut, held, 1)
    assert torch.allclose(reference.gbuffer[Buffer.COLOR], expected)
    window, _ = build_whole_window(clip, 1, task)
    whole = make_reference(
        plan_cut(clip, cover_frame(clip, 1, 4), SampleChoices(), task), clip_planes(clip), 1
    )
    assert window.hr is not None
    emission = window.hr.gbuffer[Buffer.EMISSION]
    material = window.hr.gbuffer[Buffer.MATERIAL]
    product = whole.gbuffer[Buffer.LIGHTING] * material + emission
    divided = whole.gbuffer[Buffer.LIGHTING_MASK].expand_as(product) > 0
    difference = (product - whole.gbuffer[Buffer.COLOR]).abs()
    assert float(difference[divided].max()) < 1e-5


def clip_planes(clip: Clip) -> dict[str, torch.Tensor]:
    return {name: plane[1:2].float() for name, plane in clip.hr.items()}


def test_a_pack_of_two_samples_a_pixel_trains_and_validates(capture: Path, tmp_path: Path) -> None:
    config = TrainingConfig(
        scale=2, samples_per_pixel=2, jitter=SampleJitter.MIXED, crop=4, validation_frames=2
    )
    system = load_system("fusesr-fast")
    task = make_task(system, system.config(), config)
    clip = recorded(source_of(capture, simulation_of(task)), task, tmp_path)
    judged = replace(clip, facts=replace(clip.facts, validation=True))
    path = tmp_path / "p.rtsr-clips"
    assert pack_crops(path, [clip, judged], task, config, crops=3) == 5
    packed, about = read_clips(path)
    assert about["samples_per_pixel"] == 2
    assert [c.size for c in packed] == [(20, 20)] * 3 + [SIZE] * 2
    assert [c.is_whole for c in packed] == [False] * 3 + [True] * 2
    sample = SampleDrawer(packed, task, config).make(0)
    assert sample.steps[0].goal["color"].shape[-2:] == (8, 8)
    assert sample.steps[0].inputs["frame_0"].shape[-2:] == (4, 4)


def test_clips_that_lack_what_a_system_reads_are_refused(capture: Path, tmp_path: Path) -> None:
    fast = task_of("fusesr-fast")
    clip = recorded(source_of(capture, simulation_of(fast)), fast, tmp_path)
    task = replace(task_of("fusesr"), scale=2)
    with pytest.raises(FrameFolderError, match=r"hold no motion, which system 'fusesr' reads"):
        build_whole_window(clip, 0, task)


def test_mixed_samples_are_jittered_from_anywhere_or_not_at_all() -> None:
    drawn = [draw_jitter(SampleJitter.MIXED, np.random.default_rng(i)) for i in range(200)]
    phases = {phase for jitter, phase in drawn if jitter is JitterMode.HALTON}
    assert 60 < sum(jitter is JitterMode.NONE for jitter, _ in drawn) < 140
    assert len(phases) > 50
    rng = np.random.default_rng(1)
    assert draw_jitter(SampleJitter.HALTON, rng) == (JitterMode.HALTON, 0)
    assert draw_jitter(SampleJitter.NONE, rng) == (JitterMode.NONE, 0)
    # nothing was drawn for those: samples of runs without jitter stay what they were
    assert rng.random() == np.random.default_rng(1).random()


def test_a_phase_is_added_to_the_frames_numbers() -> None:
    plain = Simulation(scale=4, jitter=JitterMode.HALTON)
    later = replace(plain, phase=9)
    assert [later.offset(n) for n in range(1, 20)] == [plain.offset(n + 9) for n in range(1, 20)]
