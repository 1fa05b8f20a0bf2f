from __future__ import annotations

from dataclasses import dataclass, replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.derivation import derive
from rtsr_cli.core.network.tiling import (
    MAX_UNTILED_PIXELS,
    TILE_PX,
    choose_tile_side,
    cut_tiles,
    predict_in_tiles,
)
from rtsr_cli.core.system import FrameWindow, Prediction, System, build_baseline
from rtsr_cli.models import load_system

SIZES = st.tuples(st.integers(1, 23), st.integers(1, 23))


@settings(max_examples=60, deadline=None)
@given(size=SIZES, tile=st.integers(1, 9), halo=st.integers(0, 5))
def test_tiles_cover_every_pixel_once_and_their_halo_ends_at_the_border(
    size: tuple[int, int], tile: int, halo: int
) -> None:
    covered = torch.zeros(size)
    for part in cut_tiles(size, tile, halo):
        bottom, right = part.top + part.size[0], part.left + part.size[1]
        covered[part.top : bottom, part.left : right] += 1
        assert part.outer_top == max(0, part.top - halo)
        assert part.outer_left == max(0, part.left - halo)
        assert part.outer_top + part.outer_size[0] == min(size[0], bottom + halo)
        assert part.outer_left + part.outer_size[1] == min(size[1], right + halo)
    assert (covered == 1).all()


def make_window(
    size: tuple[int, int], scale: int, jitter_px: tuple[float, float], system: System, seed: int
) -> FrameWindow:
    """Random frames of a system's inputs, a third of the pixels sky, some undivided."""
    generator = torch.Generator().manual_seed(seed)

    def frame(height: int, width: int, wanted: tuple[Buffer, ...], **camera: object) -> Frame:
        def image(channels: int) -> torch.Tensor:
            return torch.rand(1, channels, height, width, generator=generator)

        material = image(3)
        material[(image(1) < 0.2).expand_as(material)] = 0.0
        depth = torch.where(image(1) < 0.3, torch.tensor(SKY_DEPTH_M), 1.0 + image(1))
        stored = {
            Buffer.COLOR: 5 * image(3),
            Buffer.MATERIAL: material,
            Buffer.DEPTH: depth,
            Buffer.EMISSION: 0.1 * image(3),
        }
        whole = Frame(
            number=1,
            gbuffer=GBuffer(stored),
            camera=CameraMetadata(**camera),  # type: ignore[arg-type]
            view=View(display=(height, width)),
        )
        return derive(whole, wanted, system.derivation(system.config()))

    lr = frame(*size, system.lr_inputs, jitter_px=jitter_px)
    hr = frame(size[0] * scale, size[1] * scale, (*system.hr_inputs, *system.hr_optional))
    return FrameWindow(lr=(lr,), hr=hr if system.hr_inputs else None, scale=scale)


@pytest.mark.parametrize("name", ["bicubic", "demod-bicubic"])
@settings(max_examples=40, deadline=None)
@given(
    size=st.tuples(st.integers(1, 15), st.integers(1, 15)),
    scale=st.integers(1, 4),
    tile=st.integers(3, 9),
    jitter_px=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
    seed=st.integers(0, 1000),
)
def test_a_tiled_baseline_equals_the_whole(
    name: str,
    size: tuple[int, int],
    scale: int,
    tile: int,
    jitter_px: tuple[float, float],
    seed: int,
) -> None:
    system = load_system(name)
    window = make_window(size, scale, jitter_px, system, seed)
    network = system.build(system.config(), scale)
    whole = predict_in_tiles(system, network, window, None, None).image
    tiled = predict_in_tiles(system, network, window, None, tile).image
    assert whole is not None
    assert tiled is not None
    assert tiled.shape == (1, 3, size[0] * scale, size[1] * scale)
    assert torch.allclose(tiled, whole, rtol=1e-6, atol=1e-6)


@dataclass(frozen=True, kw_only=True)
class NoConfig:
    """Nothing to set."""


def mean_of_window(network: object, window: FrameWindow, state: object) -> Prediction:
    color = window.current.gbuffer[Buffer.COLOR]
    return Prediction(image=color.mean(dim=(2, 3), keepdim=True).expand_as(color))


GLOBAL = System(
    name="global",
    summary="mean of the frame",
    citation="-",
    lr_inputs=(Buffer.COLOR,),
    halo_px=None,
    config=NoConfig,
    build=build_baseline,
    predict=mean_of_window,
)


def test_a_system_that_sees_the_whole_frame_is_never_tiled() -> None:
    window = make_window((9, 9), 1, (0.0, 0.0), GLOBAL, 1)
    network = GLOBAL.build(NoConfig(), 1)
    whole = GLOBAL.predict(network, window, None).image
    tiled = predict_in_tiles(GLOBAL, network, window, None, 4).image
    assert whole is not None
    assert tiled is not None
    assert torch.equal(whole, tiled)
    assert choose_tile_side(GLOBAL, (4000, 4000), 4, 64) is None


def test_frames_are_tiled_by_their_output_size_unless_the_user_says_otherwise() -> None:
    bicubic = load_system("bicubic")
    assert choose_tile_side(bicubic, (1080, 1920), 1, None) is None
    assert choose_tile_side(bicubic, (1081, 1920), 1, None) == TILE_PX
    assert choose_tile_side(bicubic, (270, 480), 4, None) is None
    assert choose_tile_side(bicubic, (540, 960), 4, None) == TILE_PX
    assert choose_tile_side(bicubic, (4000, 4000), 4, 0) is None
    assert choose_tile_side(bicubic, (8, 8), 2, 3) == 3
    assert MAX_UNTILED_PIXELS == 1080 * 1920


def test_a_recurrent_system_is_never_tiled() -> None:
    recurrent = replace(load_system("bicubic"), recurrent=True)
    assert choose_tile_side(recurrent, (4000, 4000), 4, 64) is None


def test_a_system_without_an_image_is_run_on_the_whole_frame() -> None:
    sizes: list[tuple[int, int]] = []

    def count(network: object, window: FrameWindow, state: object) -> Prediction:
        sizes.append(window.current.size)
        return Prediction(tiles=torch.zeros(1, 1, 2, 2))

    system = replace(GLOBAL, halo_px=1, predict=count)
    window = make_window((8, 8), 1, (0.0, 0.0), system, 1)
    assert predict_in_tiles(system, system.build(NoConfig(), 1), window, None, 4).tiles is not None
    assert sizes[-1] == (8, 8)
