"""Conformance: what every system has to do, whatever its method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import is_dataclass, replace
from importlib import import_module
from pathlib import Path

import pytest
import torch

import rtsr_cli.models
from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.errors import ConfigError, MissingBufferError
from rtsr_cli.core.frames.buffers import RADIANCE_BUFFERS, Buffer
from rtsr_cli.core.system import FrameWindow, Prediction, System
from rtsr_cli.models import (
    PREFERENCE,
    ROWS,
    list_preferred_names,
    list_system_names,
    list_trainable_names,
    list_upscaler_names,
    load_system,
)

NAMES = list_system_names()

SCALES = (2, 3, 4)

MakeWindows = Callable[..., list[FrameWindow]]


def run(system: System, windows: list[FrameWindow], seed: int = 1) -> list[Prediction]:
    """Predict successive windows as the loop does, with freshly made weights."""
    torch.manual_seed(seed)
    network = system.build(system.config(), windows[0].scale).eval()
    state, predictions = None, []
    for window in windows:
        with torch.inference_mode():
            predictions.append(system.predict(network, window, state))
        state = predictions[-1].state
    return predictions


def upscales(system: System, scale: int) -> bool:
    return system.task is SystemTask.UPSCALE and (not system.scales or scale in system.scales)


def first_scale(system: System) -> int:
    return (system.scales or (2,))[0] if system.task is SystemTask.UPSCALE else 1


@pytest.fixture(params=NAMES)
def system(request: pytest.FixtureRequest) -> System:
    return load_system(request.param)


def test_a_declaration_is_complete(system: System) -> None:
    assert system.name in list_system_names()
    assert system.summary
    assert system.citation
    assert system.lr_inputs
    assert is_dataclass(system.config)
    assert system.config.__dataclass_params__.frozen  # type: ignore[attr-defined]
    assert system.config() == system.config()


def test_upscalers_are_those_whose_task_it_is(system: System) -> None:
    assert (system.name in list_upscaler_names()) == (system.task is SystemTask.UPSCALE)


def test_a_row_says_what_the_declaration_does(system: System) -> None:
    (row,) = [row for row in ROWS if row.name == system.name]
    assert row.task is system.task
    assert row.trainable == (system.learning is not None)
    assert (row.name in list_trainable_names()) == row.trainable
    module = import_module(f"rtsr_cli.models.{row.module}")
    declared = [row.name for row in ROWS if row.module == module.__name__.rpartition(".")[2]]
    assert [declaration.name for declaration in module.SYSTEMS] == declared


def test_a_trained_system_is_a_folder_of_one_shape() -> None:
    folder = Path(rtsr_cli.models.__file__).parent
    trained = {row.module for row in ROWS if row.trainable}
    assert {path.name for path in folder.iterdir() if (path / "__init__.py").is_file()} == trained
    for module in trained:
        names = {path.stem for path in (folder / module).glob("*.py")} - {"published"}
        assert names == {"__init__", "config", "inputs", "network", "loss", "graphs"}, module


@pytest.mark.parametrize("task", list(SystemTask))
def test_no_two_systems_of_a_task_are_preferred_alike(task: SystemTask) -> None:
    ranks = [row.rank for row in ROWS if row.task is task and row.rank is not None]
    assert sorted(ranks) == list(range(1, len(ranks) + 1))
    assert len(list_preferred_names(task)) == len(ranks)
    assert set(list_preferred_names(task)) <= set(list_system_names(task))


def test_no_system_asks_for_radiance_at_the_target_size(system: System) -> None:
    if system.task is SystemTask.UPSCALE:
        assert not {*system.hr_inputs, *system.hr_optional} & RADIANCE_BUFFERS


def test_what_is_required_is_not_declared_optional_as_well(system: System) -> None:
    assert not set(system.lr_inputs) & set(system.lr_optional)
    assert not set(system.hr_inputs) & set(system.hr_optional)


def test_a_recurrent_system_prerolls_before_a_shard(system: System) -> None:
    assert (system.preroll_frames > 0) == system.recurrent


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("optional", [False, True], ids=["required", "with optional"])
def test_declared_inputs_give_a_finite_image_of_the_target_size(
    system: System, make_windows: MakeWindows, scale: int, optional: bool
) -> None:
    if not upscales(system, scale):
        pytest.skip(f"{system.name} does not upscale {scale}x")
    windows = make_windows(system, scale, optional=optional)
    for window, prediction in zip(windows, run(system, windows), strict=True):
        height, width = window.current.size
        assert prediction.image is not None
        assert prediction.image.shape == (1, 3, height * scale, width * scale)
        assert prediction.image.dtype == torch.float32
        assert torch.isfinite(prediction.image).all()
        assert (prediction.image >= 0).all()


def test_the_same_frames_give_the_same_bits(system: System, make_windows: MakeWindows) -> None:
    scale = first_scale(system)
    first, second = (run(system, make_windows(system, scale)) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert a.image is not None or a.tiles is not None
        if a.image is not None and b.image is not None:
            assert torch.equal(a.image, b.image)
        if a.tiles is not None and b.tiles is not None:
            assert torch.equal(a.tiles, b.tiles)


def test_inputs_are_left_as_they_were(system: System, make_windows: MakeWindows) -> None:
    scale = first_scale(system)
    windows, untouched = make_windows(system, scale), make_windows(system, scale)
    run(system, windows)
    for window, copy in zip(windows, untouched, strict=True):
        frames = (*window.lr, *((window.hr,) if window.hr else ()))
        copies = (*copy.lr, *((copy.hr,) if copy.hr else ()))
        for frame, original in zip(frames, copies, strict=True):
            for buffer in frame.gbuffer:
                assert torch.equal(frame.gbuffer[buffer], original.gbuffer[buffer]), buffer


def test_only_a_system_with_history_carries_a_state(
    system: System, make_windows: MakeWindows
) -> None:
    scale = first_scale(system)
    states = [prediction.state for prediction in run(system, make_windows(system, scale))]
    assert system.carries_history or all(state is None for state in states)
    assert not system.recurrent or all(state is not None for state in states)


def test_the_state_of_a_system_that_is_not_recurrent_changes_nothing(
    system: System, make_windows: MakeWindows
) -> None:
    """It may keep what it computed of past frames, which their images give again."""
    if system.recurrent:
        pytest.skip("its state is part of its input")
    windows = make_windows(system, first_scale(system))
    carried, alone = (run(system, part)[-1] for part in (windows, windows[-1:]))
    for one, other in ((carried.image, alone.image), (carried.tiles, alone.tiles)):
        assert (one is None) == (other is None)
        assert one is None or torch.equal(one, other)


def test_a_flat_grey_frame_stays_flat_through_bicubic(make_windows: MakeWindows) -> None:
    system = load_system("bicubic")
    (window,) = make_windows(system, 3, count=1)
    frame = window.current
    flat = frame.gbuffer.with_buffers({Buffer.COLOR: torch.full((1, 3, *frame.size), 0.7)})
    (prediction,) = run(system, [replace(window, lr=(replace(frame, gbuffer=flat),))])
    assert prediction.image is not None
    assert torch.allclose(prediction.image, torch.tensor(0.7), atol=1e-5)


def test_flat_lighting_gives_exact_surfaces_through_demod_bicubic(
    make_windows: MakeWindows,
) -> None:
    system = load_system("demod-bicubic")
    (window,) = make_windows(system, 4, count=1)
    frame, hr = window.current, window.hr
    assert hr is not None
    mask = frame.gbuffer[Buffer.LIGHTING_MASK]
    lighting = 2.5 * mask.expand(1, 3, -1, -1)
    changed = frame.gbuffer.with_buffers({Buffer.LIGHTING: lighting})
    (prediction,) = run(system, [replace(window, lr=(replace(frame, gbuffer=changed),))])
    assert prediction.image is not None
    surface = hr.gbuffer[Buffer.SKY].expand_as(prediction.image) < 0.5
    # rows of the surface whose lighting comes from divided pixels alone
    surface[..., :16, :] = False
    expected = 2.5 * hr.gbuffer[Buffer.MATERIAL]
    assert torch.allclose(prediction.image[surface], expected[surface], rtol=1e-5)
    sky = prediction.image[..., :8, :]
    assert torch.allclose(sky, torch.tensor(0.8), atol=1e-4)


def test_demod_bicubic_without_high_resolution_says_what_it_needs(
    make_windows: MakeWindows,
) -> None:
    system = load_system("demod-bicubic")
    (window,) = make_windows(system, 2, count=1)
    with pytest.raises(MissingBufferError, match="frame 1: demod-bicubic needs HR material"):
        run(system, [replace(window, hr=None)])


def test_an_unknown_system_gets_a_suggestion_and_the_list() -> None:
    with pytest.raises(ConfigError) as caught:
        load_system("bicubik")
    assert "did you mean 'bicubic'?" in str(caught.value)
    assert all(name in str(caught.value) for name in list_system_names())


def test_what_upscale_prefers_are_upscalers_the_network_first() -> None:
    assert set(PREFERENCE) <= set(list_upscaler_names())
    assert PREFERENCE == (
        "gather", "demod-temporal", "fusesr", "fusesr-fast", "demod-guided", "demod-bicubic",
        "cgts", "taau", "bicubic",
    )  # fmt: skip
