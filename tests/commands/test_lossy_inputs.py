"""`rtsr inspect` names numbers that lossy compression alters, and leaves pictures alone."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from click.testing import Result
from numpy.typing import NDArray

Run = Callable[..., Result]


def write_frames(folder: Path, compressions: dict[int, str], kind: type[Any] = np.float16) -> Path:
    """Frames of colour, vectors, normals, depth, ids and a Cryptomatte layer."""
    names = [
        "R", "G", "B", "motion.X", "motion.Y", "normal.X", "normal.Y", "normal.Z", "depth.Z",
        "CryptoObject00.R", "CryptoObject00.A",
    ]  # fmt: skip
    folder.mkdir()
    for number, compression in compressions.items():
        random = np.random.default_rng(number)
        planes: dict[str, NDArray[Any]] = {
            n: random.uniform(0.1, 1.0, (32, 48)).astype(kind) for n in names
        }
        planes["objectid"] = np.ones((32, 48), np.uint32)
        header = {
            "compression": getattr(OpenEXR, f"{compression}_COMPRESSION"),
            "type": OpenEXR.scanlineimage,
        }
        OpenEXR.File(header, planes).write(str(folder / f"f.{number:04d}.exr"))
    return folder


@pytest.mark.parametrize("compression", ["DWAA", "DWAB"])
def test_numbers_under_dwa_are_named_with_what_is_altered(
    rtsr: Run, tmp_path: Path, compression: str
) -> None:
    folder = write_frames(tmp_path / "in", {1: compression, 2: "ZIP"})
    lossy = json.loads(rtsr("inspect", folder, "--json").stdout)["lossy"]
    assert lossy == {
        "normal": {
            "compression": [compression], "altered": ["normal.Y"],
            "spared": ["normal.X", "normal.Z"], "frames": [1],
        },
        "motion": {
            "compression": [compression], "altered": ["motion.Y"], "spared": ["motion.X"],
            "frames": [1],
        },
        "depth": {
            "compression": [compression], "altered": [], "spared": ["depth.Z"], "frames": [1],
        },
        "ids": {
            "compression": [compression], "altered": ["CryptoObject00.R"],
            "spared": ["CryptoObject00.A"], "frames": [1],
        },
    }  # fmt: skip
    said = rtsr("inspect", folder).output
    assert f"'motion' is stored with {compression}, a lossy compression, in frame 1: " in said


@pytest.mark.parametrize(
    ("compression", "kind", "altered"),
    [
        ("B44", np.float16, True),
        ("B44A", np.float16, True),
        ("PXR24", np.float32, True),
        ("PXR24", np.float16, False),
        ("B44", np.float32, False),
        ("PIZ", np.float32, False),
    ],
)
def test_numbers_are_named_where_their_type_is_altered(
    rtsr: Run, tmp_path: Path, compression: str, kind: type[Any], altered: bool
) -> None:
    folder = write_frames(tmp_path / "in", {1: compression, 2: compression}, kind)
    lossy = json.loads(rtsr("inspect", folder, "--json").stdout)["lossy"]
    named = ["normal", "motion", "depth", "ids"] if altered else []
    assert set(lossy) == set(named)
    assert all(not buffer["spared"] for buffer in lossy.values())
    assert ("lossy" in rtsr("inspect", folder).output) == altered
