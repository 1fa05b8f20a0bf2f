"""`rtsr precompute-lut`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO
import pytest
from click.testing import Result

from rtsr_cli import __version__
from rtsr_cli.core.choices import LutConvention
from rtsr_cli.core.files.exr import read_channels, read_header
from rtsr_cli.core.imaging.brdf_lut import integrate_lut

Run = Callable[..., Result]


@pytest.mark.parametrize("convention", list(LutConvention))
def test_the_file_holds_the_table_as_two_float_channels(
    rtsr: Run, tmp_path: Path, convention: LutConvention
) -> None:
    out = tmp_path / "lut.exr"
    result = rtsr("precompute-lut", out, "--size", 16, "--samples", 64, "--convention", convention)
    assert result.exit_code == 0, result.output
    planes = read_channels(out, "AB")
    table = integrate_lut(16, 64, convention)[0].numpy()
    for name, expected in zip("AB", table, strict=True):
        assert planes[name].dtype == np.float32
        np.testing.assert_array_equal(planes[name], expected)
    assert read_header(out).attributes["rtsr:lutConvention"] == convention.value


def test_columns_are_the_view_cosine_and_rows_the_roughness(rtsr: Run, tmp_path: Path) -> None:
    out = tmp_path / "lut.exr"
    rtsr("precompute-lut", out, "--size", 32)
    scale = read_channels(out, "A")["A"]
    # smooth (first row): reflectance grows with the cosine as 1 - Fc does; rough: less throughout
    assert scale[0, 0] < scale[0, 16] < scale[0, 31]
    assert scale[0, 31] > 0.99
    assert scale[31, 31] < 0.9


def test_the_header_says_how_the_table_was_made(rtsr: Run, tmp_path: Path) -> None:
    out = tmp_path / "lut.exr"
    rtsr("precompute-lut", out, "--size", 8, "--samples", 32, "--convention", "seed")
    attributes = read_header(out).attributes
    assert attributes["rtsr:version"] == __version__
    assert attributes["rtsr:lutConvention"] == "seed"
    assert attributes["rtsr:lutSamples"] == 32
    assert attributes["software"] == f"rtsr {__version__}"


def test_nothing_but_the_file_is_left_behind(rtsr: Run, tmp_path: Path) -> None:
    rtsr("precompute-lut", tmp_path / "lut.exr", "--size", 8)
    assert [path.name for path in tmp_path.iterdir()] == ["lut.exr"]


def test_the_preview_shows_a_in_red_and_b_in_green(rtsr: Run, tmp_path: Path) -> None:
    rtsr("precompute-lut", tmp_path / "lut.exr", "--size", 32, "--preview")
    picture = OpenImageIO.ImageBuf(str(tmp_path / "lut.png")).get_pixels(OpenImageIO.UINT8)
    scale, bias = integrate_lut(32)[0].numpy()
    assert picture.shape == (32, 32, 3)
    np.testing.assert_allclose(picture[..., 0], scale * 255, atol=0.51)
    np.testing.assert_allclose(picture[..., 1], bias * 255, atol=0.51)
    assert not picture[..., 2].any()


@pytest.mark.parametrize("existing", ["lut.exr", "lut.png"])
def test_an_existing_file_is_kept_unless_overwritten(
    rtsr: Run, tmp_path: Path, existing: str
) -> None:
    (tmp_path / existing).write_bytes(b"mine")
    arguments = ("precompute-lut", tmp_path / "lut.exr", "--size", 16, "--preview")
    refused = rtsr(*arguments)
    assert refused.exit_code == 3
    assert "--overwrite" in refused.output
    assert existing in refused.output
    assert [path.name for path in tmp_path.iterdir()] == [existing]
    assert (tmp_path / existing).read_bytes() == b"mine"
    assert rtsr(*arguments, "--overwrite").exit_code == 0
    assert (tmp_path / existing).read_bytes() != b"mine"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("lut.png",), "must end in .exr"),
        (("lut.exr", "--size", "1"), "not in the range"),
        (("lut.exr", "--samples", "3"), "not in the range"),
        (("lut.exr", "--convention", "kari"), "'karis'"),
    ],
)
def test_wrong_values_are_usage_errors(rtsr: Run, arguments: tuple[str, ...], message: str) -> None:
    result = rtsr("precompute-lut", *arguments)
    assert result.exit_code == 2
    assert message in result.output


def test_a_folder_that_does_not_exist_is_named(rtsr: Run, tmp_path: Path) -> None:
    result = rtsr("precompute-lut", tmp_path / "no" / "lut.exr")
    assert result.exit_code == 3
    assert f"{tmp_path}/no" in result.output
