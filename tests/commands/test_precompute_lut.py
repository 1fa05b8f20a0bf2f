"""`rtsr precompute-lut`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from rtsr_cli.core.imaging.brdf_lut import LutConvention, integrate_lut
from rtsr_cli.core.io.exr import read_channels, read_header

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


def test_a_preview_is_written_on_request(rtsr: Run, tmp_path: Path) -> None:
    rtsr("precompute-lut", tmp_path / "lut.exr", "--size", 16, "--preview")
    assert (tmp_path / "lut.png").read_bytes().startswith(b"\x89PNG")


def test_an_existing_file_is_kept_unless_overwritten(rtsr: Run, tmp_path: Path) -> None:
    out = tmp_path / "lut.exr"
    out.write_bytes(b"mine")
    refused = rtsr("precompute-lut", out, "--size", 16)
    assert refused.exit_code == 3
    assert "--overwrite" in refused.output
    assert out.read_bytes() == b"mine"
    assert rtsr("precompute-lut", out, "--size", 16, "--overwrite").exit_code == 0


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
