"""Which channels lossy compression alters: held against what the library does to noise."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import read_channels
from rtsr_cli.core.files.lossy_channels import ChannelCompression, find_lossy_channels

NAMES = (
    "R", "A", "Y", "depth.Z", "motion.X", "motion.Y", "normal.X", "normal.Y", "normal.Z",
    "crypto00.R", "crypto00.A", "ids", "n.r", "n.RY",
)  # fmt: skip
COMPRESSIONS = {
    name: getattr(OpenEXR, f"{name}_COMPRESSION")
    for name in ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")
}


def noise(kind: type[Any]) -> dict[str, NDArray[Any]]:
    random = np.random.default_rng(4)
    if kind is np.uint32:
        return {n: random.integers(0, 1 << 32, (32, 32)).astype(np.uint32) for n in NAMES}
    return {n: random.normal(0.0, 3.0, (32, 32)).astype(kind) for n in NAMES}


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.uint32])
@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_channels_that_the_library_alters_are_named(
    tmp_path: Path, compression: str, kind: type[Any]
) -> None:
    path, planes = tmp_path / "f.exr", noise(kind)
    header = {"compression": COMPRESSIONS[compression], "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {n: p.copy() for n, p in planes.items()}).write(str(path))
    stored = read_channels(path, NAMES)
    altered = {n for n in NAMES if not np.array_equal(stored[n], planes[n])}
    found = find_lossy_channels(path)
    assert {n for n, known in found.items() if known.altered} == altered
    assert {known.compression for known in found.values()} <= {compression}


def test_each_part_is_taken_by_its_own_compression(tmp_path: Path) -> None:
    path, plane = tmp_path / "f.exr", np.ones((8, 8), np.float16)
    parts = [
        OpenEXR.Part(
            {"compression": COMPRESSIONS[compression], "type": OpenEXR.scanlineimage},
            {channel: plane.copy()},
            name,
        )
        for name, channel, compression in (("beauty", "R", "ZIP"), ("normal", "Y", "DWAB"))
    ]
    OpenEXR.File(parts).write(str(path))
    assert find_lossy_channels(path) == {
        "normal.Y": ChannelCompression(compression="DWAB", altered=True)
    }


def test_a_file_that_is_no_exr_has_none(tmp_path: Path) -> None:
    path = tmp_path / "f.exr"
    path.write_bytes(b"not a picture")
    assert find_lossy_channels(path) == {}
