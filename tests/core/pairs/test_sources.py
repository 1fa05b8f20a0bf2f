from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.choices import JitterMode, NonfinitePolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.files.pixel_window import PixelWindow
from rtsr_cli.core.frames.buffers import RADIANCE_BUFFERS, Buffer
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.pairs.real_pairs import RealPairs, open_real_pairs
from rtsr_cli.core.pairs.simulated_pairs import open_simulated_pairs
from rtsr_cli.core.pairs.simulation import Simulation
from rtsr_cli.core.pairs.sources import FramePair, PairInputs, name_once

Write = Callable[..., Path]
Open = Callable[..., FrameReader]

LR_BUFFERS = (
    Buffer.COLOR,
    Buffer.DEPTH,
    Buffer.MOTION,
    Buffer.OBJECT_ID,
    Buffer.NORMAL,
    Buffer.LIGHTING,
    Buffer.LIGHTING_MASK,
    Buffer.SKY,
)
HR_BUFFERS = (Buffer.MATERIAL, Buffer.SKY, Buffer.DEPTH, Buffer.NORMAL, Buffer.MOTION)

EVERYTHING = PairInputs(
    lr=LR_BUFFERS, hr=HR_BUFFERS, lr_optional=(Buffer.EMISSION,), hr_optional=(Buffer.EMISSION,)
)


@pytest.fixture
def pair_folders(tmp_path: Path, write_frames: Write, open_folder: Open) -> Callable[..., Any]:
    """Readers of `lr` and `hr`, of the given frames and sizes."""

    def make(
        lr: tuple[int, ...] = (1, 2),
        hr: tuple[int, ...] = (1, 2),
        *,
        lr_size: tuple[int, int] = (6, 8),
        hr_size: tuple[int, int] = (12, 16),
    ) -> tuple[FrameReader, FrameReader]:
        write_frames(tmp_path / "a" / "lr", lr, size=lr_size)
        write_frames(tmp_path / "a" / "hr", hr, size=hr_size)
        return open_folder(tmp_path / "a" / "lr"), open_folder(tmp_path / "a" / "hr")

    return make


def test_the_scale_of_real_pairs_follows_from_the_sizes(pair_folders: Callable[..., Any]) -> None:
    pairs = open_real_pairs(*pair_folders(), None)
    assert pairs.scale == 2
    assert pairs.lr_size == (6, 8)
    windows = pairs.place_output(read_header(pairs.lr.path(1)))
    assert windows.region == PixelWindow(left=0, top=0, width=16, height=12)


@pytest.mark.parametrize("hr_size", [(12, 15), (11, 16), (12, 24), (3, 4)])
def test_high_resolution_that_is_no_multiple_is_refused_with_both_sizes(
    pair_folders: Callable[..., Any], hr_size: tuple[int, int]
) -> None:
    with pytest.raises(FrameFolderError) as caught:
        open_real_pairs(*pair_folders(hr_size=hr_size), None)
    message = str(caught.value)
    assert f"{hr_size[1]} x {hr_size[0]}" in message
    assert "8 x 6" in message
    assert "no whole multiple" in message


def test_high_resolution_that_lacks_frames_is_refused_with_their_numbers(
    pair_folders: Callable[..., Any],
) -> None:
    with pytest.raises(FrameFolderError, match="HR lacks frames 1, 4-5 that LR has"):
        open_real_pairs(*pair_folders(lr=(1, 2, 3, 4, 5), hr=(2, 3)), None)


def test_high_resolution_may_have_more_frames(pair_folders: Callable[..., Any]) -> None:
    assert open_real_pairs(*pair_folders(lr=(2,), hr=(1, 2, 3)), None).reader.numbers == (2,)


def test_a_scale_that_the_sizes_contradict_is_refused(pair_folders: Callable[..., Any]) -> None:
    with pytest.raises(FrameFolderError, match="HR is 2 times the size of LR, not 4 times"):
        open_real_pairs(*pair_folders(), 4)


def test_without_high_resolution_frames_the_scale_has_to_be_given(
    pair_folders: Callable[..., Any],
) -> None:
    lr, _ = pair_folders()
    with pytest.raises(FrameFolderError, match="--scale"):
        open_real_pairs(lr, None, None)
    pairs = open_real_pairs(lr, None, 3)
    windows = pairs.place_output(read_header(lr.path(1)))
    assert windows.display == PixelWindow(left=0, top=0, width=24, height=18)
    assert pairs.missing(PairInputs(lr=(Buffer.COLOR,), hr=(Buffer.MATERIAL,))) == ("hr frames",)
    assert pairs.load(1, PairInputs(lr=(Buffer.COLOR,))).hr is None


def test_what_a_pair_lacks_is_named_with_its_resolution(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path / "lr", [1], size=(6, 8), only=("R", "G", "B"))
    write_frames(tmp_path / "hr", [1], only=("depth",))
    pairs = open_real_pairs(open_folder(tmp_path / "lr"), open_folder(tmp_path / "hr"), None)
    missing = pairs.missing(PairInputs(lr=(Buffer.COLOR, Buffer.MOTION), hr=(Buffer.NORMAL,)))
    assert missing == ("lr motion", "hr normal")


def test_a_real_pair_holds_the_declared_buffers_and_no_high_resolution_radiance(
    pair_folders: Callable[..., Any],
) -> None:
    pair = open_real_pairs(*pair_folders(), None).load(2, EVERYTHING)
    assert set(pair.lr.gbuffer) == {*LR_BUFFERS, Buffer.EMISSION}
    assert pair.hr is not None
    assert set(pair.hr.gbuffer) == {*HR_BUFFERS, Buffer.EMISSION}
    assert pair.lr.size == (6, 8)
    assert pair.hr.size == (12, 16)
    assert not set(pair.hr.gbuffer) & RADIANCE_BUFFERS


def test_real_pairs_run_on_high_resolution_frames_that_have_no_radiance_at_all(
    pair_folders: Callable[..., Any], tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    lr, hr = pair_folders()
    with_radiance = open_real_pairs(lr, hr, None).load(1, EVERYTHING)

    def strip(_: int, channels: dict[str, Any]) -> dict[str, Any]:
        return {k: v for k, v in channels.items() if k not in ("R", "G", "B")}

    bare_folder = write_frames(tmp_path / "bare", [1, 2], size=(12, 16), change=strip)
    without = open_real_pairs(lr, open_folder(bare_folder), None).load(1, EVERYTHING)
    assert_same(with_radiance, without)


def test_the_files_of_a_pair_are_those_that_hold_what_is_asked_for(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    write_frames(tmp_path / "lr", [1], size=(6, 8))
    write_frames(tmp_path / "hr", [1], name="beauty.{:04d}.exr", only=("R", "G", "B"))
    write_frames(tmp_path / "hr", [1], name="gbuffer.{:04d}.exr", only=("depth", "normal"))
    pairs = open_real_pairs(open_folder(tmp_path / "lr"), open_folder(tmp_path / "hr"), None)
    asked = PairInputs(lr=(Buffer.COLOR,), hr=(Buffer.NORMAL,))
    assert [p.name for p in pairs.files(1, asked)] == ["frame.0001.exr", "gbuffer.0001.exr"]
    alone = pairs.files(1, PairInputs(lr=(Buffer.COLOR,)))
    assert alone == (tmp_path / "lr" / "frame.0001.exr",)


def assert_same(a: FramePair, b: FramePair) -> None:
    assert a.hr is not None
    assert b.hr is not None
    for mine, other in ((a.lr, b.lr), (a.hr, b.hr)):
        assert set(mine.gbuffer) == set(other.gbuffer)
        for buffer in mine.gbuffer:
            assert torch.equal(mine.gbuffer[buffer], other.gbuffer[buffer]), buffer
    assert a.lr.lighting_scale == b.lr.lighting_scale


@pytest.mark.parametrize("jitter", JitterMode)
@pytest.mark.parametrize("scale", [2, 3, 4])
def test_simulated_frames_are_the_kept_samples_of_every_buffer(
    tmp_path: Path,
    write_frames: Write,
    open_folder: Open,
    analytic_channels: Any,
    scale: int,
    jitter: JitterMode,
) -> None:
    reader = open_folder(write_frames(tmp_path, [1, 2], size=(12, 24)))
    simulation = Simulation(scale=scale, jitter=jitter)
    pair = open_simulated_pairs(reader, simulation).load(2, EVERYTHING)
    # Halton(2, 3) of frame 2 is (1/4, 2/3)
    halton = (int(scale / 4), int(scale * 2 / 3 + 1e-9))
    x, y = halton if jitter is JitterMode.HALTON else (scale // 2, scale // 2)
    channels = analytic_channels(2, (12, 24))
    lr = pair.lr.gbuffer
    kept = (slice(y, None, scale), slice(x, None, scale))
    for i, c in enumerate("RGB"):
        expected = channels[c][kept].astype(np.float32)
        assert np.array_equal(lr[Buffer.COLOR][0, i].numpy(), expected)
    assert np.array_equal(lr[Buffer.DEPTH][0, 0].numpy(), channels["depth.Z"][kept])
    assert np.array_equal(
        lr[Buffer.OBJECT_ID][0, 0].numpy(), channels["objectid"][kept].astype(np.int32)
    )
    for i, c in enumerate("XY"):
        expected = channels[f"motion.{c}"][kept] / scale
        assert np.allclose(lr[Buffer.MOTION][0, i].numpy(), expected, atol=1e-7)
    expected_jitter = ((x + 0.5) / scale - 0.5, (y + 0.5) / scale - 0.5)
    assert pair.lr.camera.jitter_px == pytest.approx(expected_jitter)
    assert pair.hr is not None
    assert pair.hr.camera.jitter_px == (0.0, 0.0)
    assert pair.hr.size == (12, 24)
    assert np.array_equal(pair.hr.gbuffer[Buffer.MOTION][0, 0].numpy(), channels["motion.X"])


def with_noise(folder: Path, target: Path, kept: tuple[slice, slice]) -> None:
    """Copy frames, every radiance value that is not kept replaced by noise (some of it NaN)."""
    rng = np.random.default_rng(9)
    for path in sorted(folder.glob("*.exr")):
        channels = read_channels(path, read_header(path).channels)
        for c in "RGB":
            noise = rng.uniform(0, 60000, channels[c].shape).astype(np.float16)
            noise[rng.uniform(size=noise.shape) < 0.2] = np.nan
            noise[kept] = channels[c][kept]
            channels[c] = noise
        write_exr(target / path.name, channels)


@pytest.mark.parametrize("samples_per_pixel", [1, 2])
def test_radiance_that_is_not_sampled_may_be_noise_and_changes_nothing(
    tmp_path: Path, write_frames: Write, open_folder: Open, samples_per_pixel: int
) -> None:
    write_frames(tmp_path / "clean", [1, 2], size=(12, 24))
    simulation = Simulation(scale=2, samples_per_pixel=samples_per_pixel)
    block = 2 * samples_per_pixel
    sample = slice(block // 2, None, block)
    with_noise(tmp_path / "clean", tmp_path / "noisy", (sample, sample))
    clean, noisy = (
        open_simulated_pairs(open_folder(tmp_path / name), simulation)
        for name in ("clean", "noisy")
    )
    for number in (1, 2):
        assert_same(clean.load(number, EVERYTHING), noisy.load(number, EVERYTHING))


def test_simulated_pairs_give_no_high_resolution_radiance_even_if_it_is_asked_for(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    pairs = open_simulated_pairs(open_folder(write_frames(tmp_path, [1])), Simulation(scale=2))
    asked = PairInputs(
        lr=(Buffer.COLOR,), hr=(Buffer.COLOR, Buffer.DEPTH), hr_optional=(Buffer.ALPHA,)
    )
    pair = pairs.load(1, asked)
    assert pair.hr is not None
    assert set(pair.hr.gbuffer) == {Buffer.DEPTH}


def test_radiance_filters_see_the_other_samples_and_leave_the_gbuffer_alone(
    tmp_path: Path, write_frames: Write, open_folder: Open, analytic_channels: Any
) -> None:
    reader = open_folder(write_frames(tmp_path, [1], size=(12, 24)))
    plain = open_simulated_pairs(reader, Simulation(scale=3)).load(1, EVERYTHING)
    boxed = open_simulated_pairs(reader, Simulation(scale=3, lr_filter="box")).load(1, EVERYTHING)
    red = analytic_channels(1, (12, 24))["R"].astype(np.float32)
    means = red.reshape(4, 3, 8, 3).mean(axis=(1, 3))
    assert np.allclose(boxed.lr.gbuffer[Buffer.COLOR][0, 0].numpy(), means, atol=1e-6)
    assert not torch.equal(boxed.lr.gbuffer[Buffer.COLOR], plain.lr.gbuffer[Buffer.COLOR])
    assert torch.equal(boxed.lr.gbuffer[Buffer.NORMAL], plain.lr.gbuffer[Buffer.NORMAL])


def test_samples_of_a_pixel_become_means_or_the_middle_sample_where_a_mean_misleads(
    tmp_path: Path, write_frames: Write, open_folder: Open, analytic_channels: Any
) -> None:
    reader = open_folder(write_frames(tmp_path, [1], size=(12, 24)))
    pairs = open_simulated_pairs(reader, Simulation(scale=2, samples_per_pixel=3))
    assert pairs.lr_size == (2, 4)
    windows = pairs.place_output(read_header(reader.path(1)))
    assert windows.region == PixelWindow(left=0, top=0, width=8, height=4)
    pair = pairs.load(1, EVERYTHING)
    assert pair.hr is not None
    hr = pair.hr.gbuffer
    channels = analytic_channels(1, (12, 24))

    def block_mean(name: str) -> np.ndarray:
        return channels[name].astype(np.float32).reshape(4, 3, 8, 3).mean(axis=(1, 3))

    assert pair.hr.view.display == (4, 8)
    for i, c in enumerate("RGB"):
        assert np.allclose(
            hr[Buffer.MATERIAL][0, i].numpy(), block_mean(f"material.{c}"), atol=1e-6
        )
    middle = channels["depth.Z"][1::3, 1::3]
    assert np.array_equal(hr[Buffer.DEPTH][0, 0].numpy(), middle)
    motion = channels["motion.Y"][1::3, 1::3] / 3
    assert np.allclose(hr[Buffer.MOTION][0, 1].numpy(), motion, atol=1e-7)
    length = hr[Buffer.NORMAL].norm(dim=1)
    assert torch.allclose(length, (length > 0.5).float(), atol=1e-5)


def test_the_view_cosine_of_a_simulated_frame_is_that_of_its_samples(
    tmp_path: Path,
    write_frames: Write,
    open_folder: Open,
    make_camera: Callable[..., CameraMetadata],
) -> None:
    camera = make_camera()
    assert camera.world_to_camera is not None
    assert camera.world_to_ndc is not None
    attributes = {
        "worldToCamera": camera.world_to_camera.numpy().astype(np.float32),
        "worldToNDC": camera.world_to_ndc.numpy().astype(np.float32),
    }
    reader = open_folder(write_frames(tmp_path, [1], size=(12, 24), attributes=attributes))
    pairs = open_simulated_pairs(reader, Simulation(scale=4, jitter=JitterMode.HALTON))
    pair = pairs.load(1, PairInputs(lr=(Buffer.NOV,), hr=(Buffer.NOV,)))
    assert pair.hr is not None
    # Halton(2, 3) of frame 1 is (1/2, 1/3): sample (2, 1) of four
    samples = pair.hr.gbuffer[Buffer.NOV][..., 1::4, 2::4]
    assert torch.allclose(pair.lr.gbuffer[Buffer.NOV], samples, atol=1e-6)
    assert float(samples.max()) > 0.1


@pytest.mark.parametrize("scale", [5, 7])
def test_a_capture_that_the_block_does_not_divide_is_refused_with_its_size(
    tmp_path: Path, write_frames: Write, open_folder: Open, scale: int
) -> None:
    reader = open_folder(write_frames(tmp_path, [1], size=(12, 16)))
    with pytest.raises(FrameFolderError, match=f"16 x 12 pixels.* by {scale}"):
        open_simulated_pairs(reader, Simulation(scale=scale))


def test_overscan_that_does_not_begin_on_a_block_is_refused(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    window = PixelWindow(left=-1, top=0, width=16, height=12)
    plane = PixelWindow(left=0, top=0, width=14, height=12)
    reader = open_folder(write_frames(tmp_path, [1], data_window=window, display_window=plane))
    with pytest.raises(FrameFolderError, match="cannot be decimated by 2"):
        open_simulated_pairs(reader, Simulation(scale=2))


def test_optional_buffers_come_along_where_they_can_be_had_and_are_not_missed_otherwise(
    pair_folders: Callable[..., Any],
) -> None:
    pairs: RealPairs = open_real_pairs(*pair_folders(), None)
    asked = PairInputs(lr=(Buffer.COLOR,), lr_optional=(Buffer.REACTIVE, Buffer.EMISSION))
    assert pairs.missing(asked) == ()
    assert set(pairs.load(1, asked).lr.gbuffer) == {Buffer.COLOR, Buffer.EMISSION}


def bad_color(_: int, channels: dict[str, Any]) -> dict[str, Any]:
    channels["G"][3, 5] = np.inf
    channels["R"][4, 5] = np.nan
    return channels


def test_non_finite_radiance_is_refused_with_frame_and_count_or_repaired_and_counted(
    tmp_path: Path, write_frames: Write, open_folder: Open
) -> None:
    pairs = open_real_pairs(open_folder(write_frames(tmp_path, [1], change=bad_color)), None, 2)
    with pytest.raises(FrameFolderError, match="frame 1: 2 values of 'color' are NaN or Inf"):
        pairs.load(1, PairInputs(lr=(Buffer.COLOR,)))
    zeroed = pairs.load(1, PairInputs(lr=(Buffer.COLOR,), on_nonfinite=NonfinitePolicy.ZERO))
    assert zeroed.fixed == 2
    assert float(zeroed.lr.gbuffer[Buffer.COLOR][0, 1, 3, 5]) == 0.0
    filled = pairs.load(1, PairInputs(lr=(Buffer.COLOR,), on_nonfinite=NonfinitePolicy.INPAINT))
    color = filled.lr.gbuffer[Buffer.COLOR][0]
    around = [(2, 4), (2, 5), (2, 6), (3, 4), (3, 6), (4, 4), (4, 6)]
    mean = sum(float(color[1, row, column]) for row, column in around) / len(around)
    assert float(color[1, 3, 5]) == pytest.approx(mean, rel=1e-5)


def test_what_a_system_reads_is_resolved_once_a_source(pair_folders: Callable[..., Any]) -> None:
    lr, hr = pair_folders()
    for source in (open_real_pairs(lr, hr, None), open_simulated_pairs(hr, Simulation(scale=2))):
        reads = source.resolve(EVERYTHING)
        source.load(1, EVERYTHING)
        assert source.resolve(EVERYTHING) is reads
        assert source.resolve(PairInputs(lr=(Buffer.COLOR,))).lr.used == (Buffer.COLOR,)


def test_a_camera_that_converts_buffers_is_named_once() -> None:
    missing = (
        "lr camera",
        "lr camera (to convert depth from ray distance)",
        "lr motion",
        "hr camera",
        "lr camera (to convert normal from view-space normals)",
    )
    converts = "to convert depth from ray distance and normal from view-space normals"
    assert name_once(missing) == (f"lr camera ({converts})", "lr motion", "hr camera")
