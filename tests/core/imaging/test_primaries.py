from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from rtsr_cli.core.frames.conventions import ColorSpace
from rtsr_cli.core.imaging.primaries import import_colour, rec709_matrix, to_rec709


@pytest.mark.parametrize("space", list(ColorSpace))
def test_white_stays_white_in_every_space(space: ColorSpace) -> None:
    white = torch.ones(1, 3, 1, 2, dtype=torch.float64)
    np.testing.assert_allclose(to_rec709(white, space), 1.0, atol=1e-6)


def test_saturated_green_of_wide_primaries_is_out_of_rec709() -> None:
    # ITU-R BT.2087, Table: linear BT.2020 to BT.709
    np.testing.assert_allclose(
        rec709_matrix(ColorSpace.REC2020)[0], [1.6605, -0.5876, -0.0728], atol=1e-4
    )


def test_acescg_takes_the_matrix_of_the_aces_output_transforms() -> None:
    # AP1 to Rec.709, D60 to D65 by Bradford: the middle row of the OpenColorIO ACES configuration
    color = torch.tensor([0.1, 0.7, 0.4], dtype=torch.float64).view(1, 3, 1, 1)
    expected = -0.13025642 * 0.1 + 1.14080474 * 0.7 - 0.01054832 * 0.4
    assert float(to_rec709(color, ColorSpace("ACEScg"))[0, 1]) == pytest.approx(expected, abs=1e-6)


def test_radiance_in_rec709_is_handed_back_untouched() -> None:
    color = torch.rand(1, 3, 2, 2)
    assert to_rec709(color, None) is color
    assert to_rec709(color, ColorSpace.REC709) is color


ENDING = """
import OpenImageIO
from rtsr_cli.core.frames.conventions import ColorSpace
from rtsr_cli.core.imaging.primaries import rec709_matrix
rec709_matrix(ColorSpace.AP1)
OpenImageIO.ImageSpec(1, 1, 3, "uint8")
print("the last line")
"""


def test_a_process_that_used_colour_science_ends_in_silence() -> None:
    done = subprocess.run(
        [sys.executable, "-c", ENDING], capture_output=True, text=True, check=True
    )
    assert done.stdout == "the last line\n"
    assert not done.stderr


def test_nothing_imports_colour_science_in_another_way() -> None:
    root = Path(__file__).resolve().parents[3]
    direct = re.compile(
        r"^\s*(?:import colour\b|from colour\b)|importorskip\(.colour", re.MULTILINE
    )
    folders = (root / name for name in ("rtsr_cli", "tests", "benchmarks"))
    files = [path for folder in folders for path in folder.rglob("*.py")]
    assert not [p for p in files if direct.search(p.read_text(encoding="utf-8"))]
    assert import_colour().__name__ == "colour"
