"""Frames whose channels hold a sample each, as a user runs commands on them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from click.testing import CliRunner, Result
from numpy.typing import NDArray

from rtsr_cli.cli import group
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Run = Callable[..., Result]
Planes = Mapping[str, NDArray[np.generic]]

CGTS = ("--kind", "cgts")
GRID = (*CGTS, "--samples-per-pixel", "2")


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of 2 x 2 samples a pixel."""
    out = tmp_path_factory.mktemp("capture") / "shot"
    rendered = ["synth", str(out), "--samples", "2", "--size", "32x24", "--frames", "1-2"]
    result = CliRunner().invoke(group, [*rendered, "--seed", "3"])
    assert result.exit_code == 0, result.output
    return out


def number_channel(name: str, number: int) -> str:
    """`R` is `color.2.R`, `depth.Z` is `depth.2.Z`, `metallic` is `metallic.2`."""
    layer, _, component = name.rpartition(".")
    if not layer and name in "RGB":
        layer = "color"
    return f"{layer}.{number}.{component}" if layer else f"{name}.{number}"


def take_apart(planes: Planes, k: int = 2) -> dict[str, NDArray[np.generic]]:
    """Planes of k x k samples a pixel as channels with a sample each; vectors in pixels."""
    apart = {}
    for name, plane in planes.items():
        for number in range(k * k):
            sample = plane[number // k :: k, number % k :: k]
            if name.startswith(("motion", "forward")):
                sample = sample / k
            apart[number_channel(name, number)] = np.ascontiguousarray(sample)
    return apart


def rearrange(
    capture: Path,
    out: Path,
    change: Callable[[dict[str, NDArray[np.generic]]], Planes] = lambda planes: planes,
) -> Path:
    """Write a capture's frames with a sample a channel."""
    for path in sorted(capture.glob("*.exr")):
        header = read_header(path)
        planes = take_apart(read_channels(path, header.channels))
        write_exr(out / path.name, change(planes), attributes=header.attributes)
    return out


@pytest.fixture(scope="module")
def sampled(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return rearrange(capture, tmp_path_factory.mktemp("sampled") / "shot")


@pytest.fixture(scope="module")
def labelled(sampled: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Labels of the samples on a grid, with pictures."""
    out = tmp_path_factory.mktemp("labels") / "out"
    result = CliRunner().invoke(group, ["label", str(sampled), str(out), *GRID, "--preview"])
    assert result.exit_code == 0, result.output
    assert ", 2 x 2 samples a pixel, geometry by depth beyond a plane's and nor" in result.output
    return out


def read_labels(folder: Path) -> list[dict[str, NDArray[np.generic]]]:
    return [read_channels(p, ("ghosting", "aliasing")) for p in sorted(folder.glob("*.exr"))]


def assert_same_labels(folder: Path, other: Path) -> None:
    pairs = list(zip(read_labels(folder), read_labels(other), strict=True))
    assert len(pairs) == 2
    assert all(first["aliasing"].any() for first, _ in pairs)
    for first, second in pairs:
        for name, plane in first.items():
            assert np.array_equal(plane, second[name])


def test_samples_in_channels_give_the_labels_of_the_capture(
    rtsr: Run, capture: Path, labelled: Path, tmp_path: Path
) -> None:
    result = rtsr("label", capture, tmp_path / "out", *GRID, "--preview")
    assert result.exit_code == 0, result.output
    assert_same_labels(tmp_path / "out", labelled)
    pictures = [sorted(out.glob("*.png")) for out in (tmp_path / "out", labelled)]
    for first, second in zip(*pictures, strict=True):
        assert first.read_bytes() == second.read_bytes()


def test_parts_with_a_sample_each_are_the_same(
    rtsr: Run, sampled: Path, labelled: Path, tmp_path: Path
) -> None:
    for path in sorted(sampled.glob("*.exr")):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        parts: dict[str, dict[str, NDArray[np.generic]]] = {}
        for name in sorted(planes):
            layer, number, component = name.rsplit(".", 2) if name.count(".") > 1 else (name,) * 3
            part = name if layer == name else f"{layer}.{number}"
            parts.setdefault(part, {})[name if layer == name else component] = planes[name]
        # the first part of a file names its channels otherwise than those behind it
        ordered = sorted(parts, key=lambda name: not name.startswith("color"))
        head = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
        cameras = {k: header.attributes[k] for k in ("worldToCamera", "worldToNDC")}
        written = [OpenEXR.Part({**head, **cameras}, parts[name], name) for name in ordered]
        (tmp_path / "in").mkdir(exist_ok=True)
        with OpenEXR.File(written) as file:
            file.write(str(tmp_path / "in" / path.name))
    result = rtsr("label", tmp_path / "in", tmp_path / "out", *GRID)
    assert result.exit_code == 0, result.output
    assert_same_labels(tmp_path / "out", labelled)


def test_samples_are_declared_by_their_names_without_numbers(
    rtsr: Run, sampled: Path, labelled: Path, tmp_path: Path
) -> None:
    def rename(planes: dict[str, NDArray[np.generic]]) -> Planes:
        return {name.replace("color.", "light.full."): plane for name, plane in planes.items()}

    for path in sorted(sampled.glob("*.exr")):
        header = read_header(path)
        planes = rename(read_channels(path, header.channels))
        write_exr(tmp_path / "in" / path.name, planes, attributes=header.attributes)
    (tmp_path / "in" / "capture.toml").write_text('[buffers]\ncolor = "light.full.RGB"\n')
    result = rtsr("label", tmp_path / "in", tmp_path / "out", *GRID)
    assert result.exit_code == 0, result.output
    assert_same_labels(tmp_path / "out", labelled)


def test_samples_may_be_any_number_anywhere_in_the_pixel(
    rtsr: Run, sampled: Path, labelled: Path, tmp_path: Path
) -> None:
    def keep(planes: Planes) -> Planes:
        return {n: p for n, p in planes.items() if ".3." not in n and not n.endswith(".3")}

    for path in sorted(sampled.glob("*.exr")):
        header = read_header(path)
        planes = keep(read_channels(path, header.channels))
        write_exr(tmp_path / "in" / path.name, planes, attributes=header.attributes)
    for source, out, count in ((tmp_path / "in", "three", 3), (sampled, "four", 4)):
        result = rtsr("label", source, tmp_path / out, *CGTS)
        assert result.exit_code == 0, result.output
        assert f", {count} samples a pixel, geometry by" in result.output
    labels = [read_labels(f) for f in (tmp_path / "three", tmp_path / "four", labelled)]
    for three, four, grid in zip(*labels, strict=True):
        # a sample less sees less; of what tells surfaces apart places make little difference
        assert ((three["aliasing"] > 0) <= (four["aliasing"] > 0)).mean() > 0.98
        assert (four["aliasing"] == grid["aliasing"]).mean() > 0.95
        assert np.array_equal(four["ghosting"], grid["ghosting"])


def test_pixels_of_such_frames_are_means_and_first_samples(
    rtsr: Run, capture: Path, sampled: Path, tmp_path: Path
) -> None:
    result = rtsr("upscale", sampled, tmp_path / "out", "--system", "bicubic", "--scale", "2")
    assert result.exit_code == 0, result.output
    told = " ".join(result.output.split())
    assert "4 samples a pixel, of which is read color, " in told
    assert "depth" in told
    means = {}
    for path in sorted(capture.glob("*.exr")):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        means = {n: p.reshape(24, 2, 32, 2).mean((1, 3)) for n, p in planes.items() if n in "RGB"}
        write_exr(tmp_path / "means" / path.name, means, attributes=header.attributes)
    done = rtsr(
        "upscale", tmp_path / "means", tmp_path / "plain", "--system", "bicubic", "--scale", "2"
    )
    assert done.exit_code == 0, done.output
    for path in sorted((tmp_path / "out").glob("*.exr")):
        mine, plain = (read_channels(tmp_path / o / path.name, "RGB") for o in ("out", "plain"))
        for name, plane in mine.items():
            assert np.allclose(plane, plain[name], rtol=2e-3, atol=2e-3)


def test_inspect_says_what_samples_it_found(rtsr: Run, sampled: Path) -> None:
    told = " ".join(rtsr("inspect", sampled).output.split())
    assert "mean of color.0.RGB to color.3.RGB" in told
    assert "first of depth.0.Z to depth.3.Z" in told
    facts = json.loads(rtsr("inspect", sampled, "--json").output)
    facts = facts[0] if isinstance(facts, list) else facts
    assert facts["buffers"]["normal"]["samples"] == 4
    assert not any("color" in names for names in facts["unknown"].values())
    assert not facts["unknown"]


def drop(*gone: str) -> Callable[[Planes], Planes]:
    return lambda planes: {n: p for n, p in planes.items() if not n.startswith(gone)}


def one_sample(layer: str) -> Callable[[Planes], Planes]:
    """Take the numbers of a layer away."""

    def change(planes: Planes) -> Planes:
        kept = {n: p for n, p in planes.items() if not n.startswith(f"{layer}.")}
        plain = {n: p for n, p in planes.items() if n.startswith(f"{layer}.0.")}
        return {**kept, **{n.replace(".0.", "."): p for n, p in plain.items()}}

    return change


@pytest.mark.parametrize(
    ("change", "options", "said"),
    [
        (drop("color.2"), CGTS, "sample 2 of buffer 'color' is missing: channel 'color.0."),
        (drop("normal.1.Y"), CGTS, "sample 1 of buffer 'normal' is missing: channel 'normal.0.Y'"),
        (drop("depth.0"), CGTS, "sample 0 of buffer 'depth' is missing"),
        (drop("depth.2", "depth.3"), CGTS, "different numbers of samples a pixel ("),
        (one_sample("depth"), CGTS, "samples a pixel, but 'depth' only one"),
        (lambda p: p, (*CGTS, "--samples-per-pixel", "3"), "channels hold 4 samples a pixel, not"),
    ],
)
def test_samples_that_do_not_fit_are_refused(
    rtsr: Run,
    capture: Path,
    tmp_path: Path,
    change: Callable[[Planes], Planes],
    options: tuple[str, ...],
    said: str,
) -> None:
    shot = rearrange(capture, tmp_path / "in", change)
    result = rtsr("label", shot, tmp_path / "out", *options)
    assert result.exit_code == 3, result.output
    told = " ".join(result.output.split())
    assert said in told
    assert "Traceback" not in told
    assert not (tmp_path / "out").exists()


def test_what_has_one_value_a_pixel_beside_samples_is_not_compared(
    rtsr: Run, capture: Path, tmp_path: Path
) -> None:
    shot = rearrange(capture, tmp_path / "in", drop("normal.", "geonormal.", "objectid."))
    whole = rearrange(capture, tmp_path / "whole", one_sample("normal"))
    result = rtsr("label", whole, tmp_path / "one", *GRID)
    assert result.exit_code == 0, result.output
    assert "no normals: colour alone tells texture aliasing" in result.output
    assert rtsr("label", shot, tmp_path / "none", *GRID).exit_code == 0
    one, none = (read_labels(tmp_path / out) for out in ("one", "none"))
    assert all(np.array_equal(a["ghosting"], b["ghosting"]) for a, b in zip(one, none, strict=True))


def test_lights_that_are_numbered_are_no_samples_of_a_frame_that_has_its_colour(
    rtsr: Run, sampled: Path, capture: Path, tmp_path: Path
) -> None:
    for path in sorted(capture.glob("*.exr")):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        lights = {f"color.{n}.{c}": planes[c] for n in (1, 4) for c in "RGB"}
        write_exr(tmp_path / "in" / path.name, {**planes, **lights}, attributes=header.attributes)
    out = tmp_path / "out"
    result = rtsr("upscale", tmp_path / "in", out, "--system", "bicubic", "--scale", "2")
    assert result.exit_code == 0, result.output
    plain = rtsr("upscale", capture, tmp_path / "plain", "--system", "bicubic", "--scale", "2")
    assert plain.exit_code == 0, plain.output
    for path in sorted(out.glob("*.exr")):
        mine, other = (read_channels(f / path.name, "RGB") for f in (out, tmp_path / "plain"))
        assert all(np.array_equal(plane, other[name]) for name, plane in mine.items())
    refused = rtsr("label", tmp_path / "in", tmp_path / "labels", *GRID)
    assert refused.exit_code == 3
    assert "sample 0 of buffer 'color' is missing" in " ".join(refused.output.split())
