"""One scene in every layout that `synth` writes: what is made of it depends on none of them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from numpy.typing import NDArray

from rtsr_cli.cli import group
from rtsr_cli.core.captures.layout_names import LAYOUT_NAMES, PAIR_LAYOUTS
from rtsr_cli.core.captures.presets import LAYOUTS
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.pairs.opening import ReadOptions, open_pairs, open_single_sets

Run = Callable[..., Result]
Array = NDArray[np.float32]

OWN = "rtsr"
OTHERS = [name for name in LAYOUT_NAMES if name not in (OWN, "nsrd")]
"""`nsrd` holds divided lighting, so that its pictures are others'."""
FRAMES = ("--frames", "1-2", "--seed", "5")
SIZE = ("--size", "128x64")
SYSTEMS = ("bicubic", "taau", "demod-guided", "fusesr")
HALF_STEP = 1e-3
"""Of c / (1 + c): two roundings to half of what differs by less than one."""
FEW = 1e-3
"""Share of pixels at which `taau` may take another of two neighbours of the same depth."""


def write_scene(out: Path, layout: str, *options: str) -> Path:
    arguments = ["synth", str(out), *FRAMES, *options, "--layout", layout, "--quiet"]
    result = CliRunner().invoke(group, arguments)
    assert result.exit_code == 0, result.output
    return out


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("own") / "pair"
    return write_scene(out, OWN, *SIZE, "--scale", "4", "--jitter", "halton")


@pytest.fixture(scope="module")
def single(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scene(tmp_path_factory.mktemp("own") / "single", OWN, *SIZE)


def list_channels(held: Collection[Buffer]) -> Iterator[str]:
    """Own names of the buffers that a layout holds; metallic where it holds F0 in its place."""
    named = {*held, Buffer.METALLIC} if Buffer.SPECULAR in held else held
    for buffer in LAYOUTS[OWN].buffers.keys() & named:
        for component in LAYOUTS[OWN].buffers[buffer]:
            yield next(component.terms).place.channel


def hold_no_more(source: Path, target: Path, readers: Collection[FrameReader]) -> Path:
    """The scene in rtsr's own layout, with the buffers that readers of another layout find."""
    held = [reader.stored for reader in readers]
    for path in sorted(source.rglob("*.exr")):
        folder = path.parent.name
        if folder == "reference":
            continue
        header = read_header(path)
        wanted = set(list_channels(held[-1] if folder == "hr" else held[0]))
        cameras = {n: header.attributes[n] for n in ("worldToCamera", "worldToNDC")}
        planes = read_channels(path, wanted & set(header.channels))
        write_exr(target / path.relative_to(source), planes, attributes=cameras)
    (target / "capture.toml").write_bytes((source / "capture.toml").read_bytes())
    return target


def load(folder: Path) -> Array:
    """Pictures of a run after c / (1 + c)."""
    pictures = []
    for path in sorted(folder.rglob("*.exr")):
        planes = read_channels(path, {"R", "G", "B"})
        color = np.stack([planes[c].astype(np.float32) for c in "RGB"])
        pictures.append(color / (1.0 + color))
    return np.stack(pictures)


@pytest.mark.parametrize("layout", OTHERS)
def test_a_scene_is_upscaled_alike_in_every_layout(
    rtsr: Run, pair: Path, tmp_path: Path, layout: str
) -> None:
    other = write_scene(tmp_path / "other", layout, *SIZE, "--scale", "4", "--jitter", "halton")
    [(_, source)] = open_pairs(other, ReadOptions())
    own = hold_no_more(pair, tmp_path / "own", source.readers)
    done = []
    # bf16, which some processors take by default, would show more than what half rounds
    exact = ("--precision", "fp32")
    for system in SYSTEMS:
        results = [
            rtsr("upscale", shot, tmp_path / f"{shot.name}-{system}", "--system", system, *exact)
            for shot in (other, own)
        ]
        assert results[0].exit_code == results[1].exit_code, results[0].output
        if results[0].exit_code:
            continue
        done.append(system)
        ours, theirs = (load(tmp_path / f"{name}-{system}") for name in ("other", "own"))
        apart = np.abs(ours - theirs)
        assert (apart > HALF_STEP).mean() <= (FEW if system == "taau" else 0.0), system
    bare = layout in ("nss", "nuke")
    assert tuple(done) == (("bicubic", "taau") if bare else SYSTEMS)


@pytest.mark.parametrize("layout", [n for n in OTHERS if n not in (*PAIR_LAYOUTS, "nuke")])
def test_a_scene_is_extrapolated_alike_in_every_layout(
    rtsr: Run, single: Path, tmp_path: Path, layout: str
) -> None:
    other = write_scene(tmp_path / "other", layout, *SIZE)
    [(_, source)] = open_single_sets(other, ReadOptions())
    own = hold_no_more(single, tmp_path / "own", source.readers)
    for shot in (other, own):
        run = ("extrapolate", shot, tmp_path / f"{shot.name}-out", "--system", "warp-guided")
        result = rtsr(*run)
        assert result.exit_code == 0, result.output
    ours, theirs = (load(tmp_path / f"{name}-out") for name in ("other", "own"))
    assert np.abs(ours - theirs).max() <= HALF_STEP
