"""docs/export.md holds what upscale computes: rebuilt from it, frames are the same."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rtsr_cli.api import (
    ExportRequest,
    ExtrapolateRequest,
    PredictVrsRequest,
    SynthRequest,
    UpscaleRequest,
    export,
    extrapolate,
    predict_vrs,
    synth,
    upscale,
)
from rtsr_cli.core import choices
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.frames import buffers, storage
from rtsr_cli.core.imaging import (
    auxiliary_buffers,
    camera_motion,
    demodulation,
    enlargement,
    frame_motion,
    guided_kernel,
    predicted_kernel,
    resampling,
    sample_splats,
    splatting,
    surface_history,
    surfaces,
    warping,
)
from rtsr_cli.core.imaging.brdf_lut import load_default_lut
from rtsr_cli.core.lighting import (
    lighting,
    lighting_history,
    past_lighting,
    radiance,
    unseen_lighting,
)
from rtsr_cli.core.network.exported import observe_networks
from rtsr_cli.core.network.graphs import replace_graph
from rtsr_cli.core.network.load import LoadedNetwork
from rtsr_cli.core.system import Tensors
from rtsr_cli.core.vrs.reprojection import SAME_SURFACE
from rtsr_cli.models.cgts import config as cgts_config
from rtsr_cli.models.cgts import inputs as cgts_inputs
from rtsr_cli.models.cgts import network as cgts_network
from rtsr_cli.models.gather import network as gather_network
from rtsr_cli.models.nsrd import inputs as nsrd_inputs
from tests.core.export import rebuilt
from tests.core.export import rebuilt_supersampling as supersampling
from tests.core.export.rebuilt import Side
from tests.core.export.rebuilt_extrapolation import show_past
from tests.core.export.rebuilt_history import gather_frame
from tests.core.export.rebuilt_warps import (
    inside,
    jitter_change,
    nearest,
    rebuild_past,
    reproject,
    surface_motion,
)

SCALE = 4

LEAST_DB = 60.0

CONSTANTS = {
    "SKY_DEPTH": buffers.SKY_DEPTH_M,
    "EPSILON": choices.MATERIAL_EPSILON,
    "MOST_MATERIAL": choices.MOST_MATERIAL,
    "DIELECTRIC_F0": demodulation.DIELECTRIC_F0,
    "LIGHTING_FLOOR": demodulation.LIGHTING_FLOOR,
    "MAX_LIGHTING": lighting.MAX_LIGHTING,
    "FADING_SHARE": lighting.FADING_SHARE,
    "KEYS_A": resampling.KEYS_A,
    "MIN_FILTERED_MASK": resampling.MIN_FILTERED_MASK,
    "SPREAD": guided_kernel.SPREAD,
    "FACING": guided_kernel.FACING,
    "SLOPE": guided_kernel.SLOPE,
    "DEPTH_SHARE": guided_kernel.DEPTH_SHARE,
    "MIN_DEPTH": guided_kernel.MIN_DEPTH,
    "MAX_DEPTH": guided_kernel.MAX_DEPTH,
    "FALLBACK_WEIGHT": guided_kernel.FALLBACK_WEIGHT,
    "LEAST_WEIGHT": guided_kernel.LEAST_WEIGHT,
    "HIGHLIGHT": enlargement.HIGHLIGHT,
    "MOST_RADIANCE": storage.MAX_HALF,
    "SKY_REACH": enlargement.SKY_REACH_PX,
    "LOST_REACH": radiance.LOST_REACH,
    "FAINT": radiance.FAINT,
    "EMISSION_SHARE": radiance.EMISSION_SHARE,
    "LIT_SHARE": radiance.LIT_SHARE,
    "UNRELIABLE_PX": splatting.UNRELIABLE_PX,
    "IN_FRONT": frame_motion.IN_FRONT,
    "ALL_KNOWN": nsrd_inputs.ALL_KNOWN,
    "PLANE_FACING": surfaces.FACING,
    "PLANE_SHARE": surfaces.PLANE_SHARE,
    "MOVING_SHARE": surfaces.MOVING_SHARE,
    "STATIC_PX": camera_motion.STATIC_PX,
    "LEAST_SEEN": past_lighting.LEAST_WEIGHT,
    "LEAST_SEEN_RADIANCE": past_lighting.LEAST_RADIANCE_WEIGHT,
    "FARTHEST_RING": surface_history.REACHES[-1],
    "RING_DECAY": surface_history.RING_DECAY,
    "ENOUGH": surface_history.ENOUGH,
    "UNLIKE": surface_history.UNLIKE,
    "NEAR_SHARE": unseen_lighting.NEAR_SHARE,
    "GRID_PIXELS": unseen_lighting.GRID_PIXELS,
    "COMPARED_WORTH": lighting_history.LEAST_COMPARED_WORTH,
    "KNOWN_SHARE": lighting_history.LEAST_KNOWN_SHARE,
    "LEAST_SQUARE": lighting_history.LEAST_SQUARE,
    "OTHERS": lighting_history.OTHERS,
    "LEAST_WORTH": lighting_history.LEAST_WORTH,
    "MOST_EMPHASIS": gather_network.MOST_EMPHASIS,
    "MOST_LOGIT": gather_network.MOST_LOGIT,
    "GATHER_MOST_KEPT": gather_network.MOST_KEPT,
    "GATHER_MOST_WORTH": gather_network.MOST_WORTH,
    "SAMPLE_SIGMA": cgts_inputs.SAMPLE_SIGMA_PX,
    "SPLAT_A": cgts_inputs.INTERPOLATION_A,
    "BETWEEN_WORTH": cgts_inputs.INTERPOLATED_WORTH,
    "MOST_BETWEEN": sample_splats.MAX_ENCODED,
    "LEAST_HISTORY": cgts_inputs.LEAST_HISTORY,
    "LEAST_FILTERED": cgts_inputs.LEAST_FILTERED,
    "STILL_PX": cgts_inputs.STILL_PX,
    "FRONT_REACH": auxiliary_buffers.FRONT_REACH_PX,
    "SHARP_A": warping.SHARP_A,
    "KERNEL_SIGMA": predicted_kernel.KERNEL_SIGMA_PX,
    "PICTURE_SIGMA": predicted_kernel.PICTURE_SIGMA_PX,
    "FILTERED_WORTH": predicted_kernel.FILTERED_WORTH,
    "DEVIATIONS": cgts_inputs.CLIPPED_DEVIATIONS,
    "RANGE_RATE": auxiliary_buffers.RANGE_RATE,
    "CGTS_MOST_WORTH": cgts_network.MOST_WORTH,
    "CGTS_MOST_LOGIT": cgts_network.MOST_LOGIT,
    "CERTAIN": cgts_inputs.CERTAIN,
    "CAUTION": cgts_config.CAUTION,
    "SEEN_DEPTH": SAME_SURFACE.depth_relative,
    "SEEN_FACING": SAME_SURFACE.normal_cosine,
}


def test_the_constants_of_the_page_are_those_of_the_code() -> None:
    assert rebuilt.C == CONSTANTS


def read_side(path: Path, jitter: tuple[float, float]) -> Side:
    header = read_header(path)
    found = read_channels(path, header.channels)
    camera, ndc = (
        np.array(header.attributes[name], np.float64).reshape(4, 4)
        for name in ("worldToCamera", "worldToNDC")
    )
    return Side(
        buffers={name: plane.astype(np.float64) for name, plane in found.items()},
        world_to_camera=camera,
        world_to_ndc=ndc,
        jitter=jitter,
    )


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An exported fusesr-fast, where the extra is installed."""
    for library in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(library, reason="the extra export is not installed")
    folder = tmp_path_factory.mktemp("model")
    list(export(ExportRequest(source="fusesr-fast", out_folder=folder, scale=SCALE)))
    return folder


def show(image: np.ndarray) -> np.ndarray:
    return image / (1.0 + image)


Planes = dict[str, np.ndarray]


def leave(planes: Planes, scale: int) -> None:
    """Frames as they are."""


def put_lamps(planes: Planes, scale: int) -> None:
    """Blocks of black metal, one that shines and one that does not."""
    for top, left, shines in ((20, 30, 5.0), (44, 60, 0.0)):
        block = np.s_[scale * top : scale * (top + 5), scale * left : scale * (left + 7)]
        for name, value in (("metallic", 1.0), ("roughness", 1.0)):
            planes[name][block] = value
        for letter in "RGB":
            planes[f"albedo.{letter}"][block] = 0.0
            planes[f"emission.{letter}"][block] = shines
            if letter in planes:
                planes[letter][block] = shines + 0.02


def change_frame(source: Path, target: Path, scale: int, change: Callable[..., None]) -> None:
    header = read_header(source)
    planes = {n: p.astype(np.float32) for n, p in read_channels(source, header.channels).items()}
    change(planes, scale)
    target.parent.mkdir(parents=True, exist_ok=True)
    write_exr(target, planes, attributes=header.attributes)


@pytest.mark.parametrize(("number", "change"), [(1, leave), (5, put_lamps)])
def test_a_rebuild_from_the_page_gives_the_frames_of_upscale(
    sample_root: Path, model: Path, tmp_path: Path, number: int, change: Callable[..., None]
) -> None:
    import onnxruntime

    shot, name = tmp_path / "shot", f"frame.{number:04d}.exr"
    for side, scale in (("lr", 1), ("hr", SCALE)):
        change_frame(sample_root / side / name, shot / side / name, scale, change)
    shutil.copy(sample_root / "capture.toml", shot)
    request = UpscaleRequest(
        in_folder=shot,
        out_folder=tmp_path / "o",
        system="fusesr-fast",
        precision=choices.Precision.FP32,
    )
    list(upscale(request))
    lr = read_side(shot / "lr" / name, (0.125, 0.125))
    hr = read_side(shot / "hr" / name, (0.0, 0.0))
    lut = load_default_lut(choices.LutConvention.KARIS)[0].double().numpy()
    made = rebuilt.rebuild(lr, hr, lut, SCALE)
    (graph,) = json.loads((model / "manifest.json").read_text("utf-8"))["graphs"]
    session = onnxruntime.InferenceSession(
        str(model / graph["file"]), providers=["CPUExecutionProvider"]
    )
    fed = {put: getattr(made, put)[None].astype(np.float32) for put in ("frame_0", "hr", "base")}
    (predicted,) = session.run(["predicted"], fed)
    image = made.compose(predicted[0].astype(np.float64))
    planes = read_channels(tmp_path / "o" / name, "RGB")
    expected = np.stack([planes[c].astype(np.float64) for c in "RGB"])
    error = float(np.mean((show(image) - show(expected)) ** 2))
    assert -10.0 * np.log10(error) >= LEAST_DB
    # and nowhere far from it: a fault of few pixels hides in a mean
    assert np.abs(show(image) - show(expected)).max() < 1e-2


def make_pair(folder: Path, scale: int) -> tuple[Path, list[tuple[Side, Side]]]:
    """A pair of sizes of `rtsr synth` whose samples move about, and its frames, (LR, HR)."""
    request = SynthRequest(
        out_folder=folder / "pair",
        size=(128, 192),
        scale=scale,
        jitter=choices.JitterMode.HALTON,
        frames=frozenset({1, 2, 3}),
        seed=3,
    )
    list(synth(request))
    sides = []
    for number in (1, 2, 3):
        x, y = (resampling.radical_inverse(number, b) - 0.5 for b in resampling.HALTON_BASES)
        name = f"frame.{number:04d}.exr"
        lr, hr = (folder / "pair" / side / name for side in ("lr", "hr"))
        sides.append((read_side(lr, (x, y)), read_side(hr, (0.0, 0.0))))
    return folder / "pair", sides


@pytest.fixture(scope="module")
def jittered(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[tuple[Side, Side]]]:
    """Three frames of a pair."""
    return make_pair(tmp_path_factory.mktemp("synth"), SCALE)


def watch_graph(system: str, method: str, shot: Path, out: Path) -> list[dict[str, np.ndarray]]:
    """What goes in and out of a graph, frame by frame."""
    seen: list[dict[str, np.ndarray]] = []

    def watch(loaded: LoadedNetwork) -> None:
        own = getattr(loaded.network, method)

        def call(tensors: Tensors) -> Tensors:
            made: Tensors = own(tensors)
            both = {**tensors, **made}
            seen.append({n: t.detach()[0].double().numpy() for n, t in both.items()})
            return made

        replace_graph(loaded.network, method, call)

    request = UpscaleRequest(
        in_folder=shot, out_folder=out, system=system, precision=choices.Precision.FP32
    )
    with observe_networks(watch):
        list(upscale(request))
    return seen


def forget_forward(planes: Planes, scale: int) -> None:
    """Leave forward vectors out."""
    for letter in "XY":
        planes.pop(f"forward.{letter}", None)


@pytest.mark.parametrize("forward", [True, False])
def test_past_frames_of_nsrd_are_those_of_the_page(
    jittered: tuple[Path, list[tuple[Side, Side]]], tmp_path: Path, forward: bool
) -> None:
    """Masks of dual vectors, motion between samples that move, the last output, the state."""
    shot, sides = jittered
    if not forward:
        for path in shot.rglob("*.exr"):
            change_frame(path, tmp_path / "shot" / path.relative_to(shot), 1, forget_forward)
        shutil.copy(shot / "capture.toml", tmp_path / "shot")
        shot = tmp_path / "shot"
        sides = [(replace(lr, buffers=dict(lr.buffers)), hr) for lr, hr in sides]
        for lr, _ in sides:
            forget_forward(lr.buffers, 1)
    _, before, now = watch_graph("nsrd", "reconstruct", shot, tmp_path / "o")
    lut = load_default_lut(choices.LutConvention.KARIS)[0].double().numpy()
    made = rebuild_past(
        (sides[2][0], sides[1][0], sides[0][0]),
        sides[2][1],
        lut,
        SCALE,
        predicted=before["predicted"],
        hidden=before["hidden_next"],
    )
    for name, image in vars(made).items():
        # rounding decides of a pixel whether its vectors agree
        far = np.abs(image - now[name]).max(0) > 1e-3
        assert far.mean() < 1e-3, name
    assert 0.01 < now["past_2"][7].mean() < 0.9
    assert np.abs(now["last"]).max() > 0.1


def test_history_of_gather_is_carried_and_blended_as_the_page_says(
    jittered: tuple[Path, list[tuple[Side, Side]]], tmp_path: Path
) -> None:
    """Channels that the graph is shown of history that two frames left, and what is written."""
    shot, sides = jittered
    seen = watch_graph("gather", "correct", shot, tmp_path / "o")
    lut = load_default_lut(choices.LutConvention.KARIS)[0].double().numpy()
    before, history = None, None
    for pair, tensors in zip(sides, seen, strict=True):
        made = gather_frame(pair, before, history, lut, r=tensors["corrections"], scale=SCALE)
        samples, pixels = tensors["samples"], tensors["pixels"]
        pairs = (
            (made.change, samples[8:11]),
            (made.seen, samples[11]),
            (made.worth_before, np.expm1(2.0 * pixels[2])),
        )
        for found, expected in pairs:
            assert (np.abs(found - expected) > 2e-3).mean() < 2e-3
        before, history = pair, made.history
    assert seen[2]["samples"][11].mean() > 0.5
    assert history is not None
    lr, hr = sides[2]
    picture = history.lighting * rebuilt.material(hr, lut) + hr.color("emission")
    planes = read_channels(tmp_path / "o" / "frame.0003.exr", "RGB")
    expected = np.stack([planes[c].astype(np.float64) for c in "RGB"])
    lit = ~hr.sky & (rebuilt.material(hr, lut).min(0) > 0.01)
    # beside borders, pictures are moved back, not light
    lit[:4], lit[-4:], lit[:, :4], lit[:, -4:] = False, False, False, False
    apart = np.abs(show(picture) - show(expected)).max(0)
    assert lit.mean() > 0.5
    assert (apart[lit] > 2e-3).mean() < 5e-3
    assert lr.depth.shape[0] * SCALE == hr.depth.shape[0]


def test_past_lighting_of_extranet_is_carried_and_filled_as_the_page_says(
    sample_root: Path, tmp_path: Path
) -> None:
    seen: list[np.ndarray] = []

    def watch(loaded: LoadedNetwork) -> None:
        own = loaded.network.correct

        def call(tensors: Tensors) -> Tensors:
            seen.append(tensors["current"][0].double().numpy())
            made: Tensors = own(tensors)
            return made

        replace_graph(loaded.network, "correct", call)

    request = ExtrapolateRequest(
        in_folder=sample_root / "lr",
        out_folder=tmp_path / "o",
        system="extranet",
        frames=frozenset({4}),
        precision=choices.Precision.FP32,
    )
    with observe_networks(watch):
        list(extrapolate(request))
    before, now = (
        read_side(sample_root / "lr" / f"frame.{n:04d}.exr", (0.125, 0.125)) for n in (3, 4)
    )
    lut = load_default_lut(choices.LutConvention.KARIS)[0].double().numpy()
    base, holes = show_past(now, before, lut)
    (current,) = seen
    found = current[:, : holes.shape[0], : holes.shape[1]]
    assert holes.mean() > 0.05
    assert (np.abs(base - found[:3]).max(0) > 1e-3).mean() < 1e-3
    masked = np.where(holes, 0, base)
    assert (np.abs(masked - found[6:9]).max(0) > 1e-3).mean() < 1e-3


def test_what_rt_percept_sees_is_what_the_page_says(sample_root: Path, tmp_path: Path) -> None:
    seen: list[np.ndarray] = []

    def watch(loaded: LoadedNetwork) -> None:
        own = loaded.network.estimate

        def call(tensors: Tensors) -> Tensors:
            seen.append(tensors["seen"][0].double().numpy())
            made: Tensors = own(tensors)
            return made

        replace_graph(loaded.network, "estimate", call)

    request = PredictVrsRequest(
        in_folder=sample_root / "lr",
        out_folder=tmp_path / "o",
        frames=frozenset({3}),
        no_compare=True,
    )
    with observe_networks(watch):
        list(predict_vrs(request))
    before, now = (
        read_side(sample_root / "lr" / f"frame.{n:04d}.exr", (0.125, 0.125)) for n in (2, 3)
    )
    made = reproject(now, before)
    # a pre-roll frame comes first
    found = seen[-1]
    found = found[:, : made.shape[1], : made.shape[2]]
    assert 0.5 < made[1].mean() < 0.99
    assert (np.abs(made - found) > 1e-4).mean() < 1e-3


def test_past_features_of_fusesr_are_warped_as_the_page_says(
    jittered: tuple[Path, list[tuple[Side, Side]]], tmp_path: Path
) -> None:
    shot, sides = jittered
    seen = watch_graph("fusesr", "fuse", shot, tmp_path / "o")
    mains = [tensors["main"] for tensors in seen]
    lr = [pair[0] for pair in sides]
    m1 = surface_motion(lr[2]) + jitter_change(lr[2], lr[1])
    m2 = m1 + nearest(surface_motion(lr[1]) + jitter_change(lr[1], lr[0]), m1)
    size = np.array(lr[2].depth.shape[::-1]).reshape(2, 1, 1)
    for age, motion, past in ((1, m1, 1), (2, m2, 0)):
        d = np.where(lr[past].sky, 0, 1 / (1 + lr[past].depth))
        made = {
            f"past_{age}": np.where(inside(motion), nearest(mains[past], motion), 0),
            f"depth_{age}": nearest(d, motion)[None],
            f"motion_ndc_{age}": motion * 2 / size,
        }
        for name, image in made.items():
            apart = np.abs(image - seen[2][name]).max(0)
            assert (apart > 1e-3).mean() < 1e-3, name


def test_history_of_cgts_is_carried_and_accumulated_as_the_page_says(tmp_path: Path) -> None:
    shot, sides = make_pair(tmp_path, 2)
    classes = watch_graph("cgts", "classify", shot, tmp_path / "o")
    strips = watch_graph("cgts", "weigh", shot, tmp_path / "again")
    height, width = sides[0][1].depth.shape
    count, state = len(strips) // len(sides), None
    for i, ((lr, _), tensors) in enumerate(zip(sides, classes, strict=True)):
        shown = supersampling.show(lr, state, 2)
        seen, logits = (tensors[name][:, :height, :width] for name in ("seen", "logits"))
        guides = tensors["guides"][:, : height // 2, : width // 2]
        parts = strips[i * count : (i + 1) * count]
        known, given = (
            np.concatenate([part[name] for part in parts], axis=1) for name in ("known", "given")
        )
        pairs = (
            (shown.color, seen[:3]),
            (shown.motion / 16, seen[4:6]),
            (shown.counter / 16, seen[6]),
            (np.concatenate([shown.low, shown.high]), seen[7:13]),
            (shown.logits, seen[14:20]),
            (shown.history - shown.color, seen[20:23]),
            (shown.worth, seen[23]),
            (np.log1p(shown.history_worth) / 4, seen[24]),
            (shown.history, known[11:14]),
            (shown.worth, known[14]),
            (np.log1p(shown.history_worth) / 4, known[15]),
            (np.abs(shown.clipped - shown.history).max(0), known[19]),
        )
        for found, expected in pairs:
            assert (np.abs(found - expected) > 1e-3).mean() < 1e-3
        state = supersampling.accumulate(shown, logits, guides, given)
    assert state is not None
    assert state.counter.max() == 2
    planes = read_channels(tmp_path / "o" / "frame.0003.exr", "RGB")
    written = np.stack([planes[c].astype(np.float64) for c in "RGB"])
    assert np.abs(state.shown - show(written)).max() < 1e-3
