"""The table of chunks against the file's size, over every way of laying pixels out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import COMPRESSIONS, read_header, write_exr
from rtsr_cli.core.files.exr_chunks import ends_too_early

ROWS = 40
CHUNKS = {"none": 40, "zips": 40, "zip": 3, "piz": 2, "dwaa": 2}
"""40 rows in chunks of 1, 1, 16, 32 and 32."""


@pytest.fixture
def plane() -> np.ndarray:
    return np.random.default_rng(1).normal(size=(ROWS, 24)).astype(np.float32)


@pytest.mark.parametrize("compression", sorted(COMPRESSIONS))
def test_a_whole_file_reaches_its_last_chunk_and_a_cut_one_does_not(
    tmp_path: Path, plane: np.ndarray, compression: str
) -> None:
    path = tmp_path / "a.exr"
    attributes = {"comments": "x" * 700, "worldToCamera": np.eye(4, dtype=np.float32)}
    write_exr(path, {"R": plane}, attributes=attributes, compression=compression)
    content = path.read_bytes()
    assert not ends_too_early(path, CHUNKS[compression])
    # the last chunk holds a third of the rows at most
    for size in (len(content) // 2, len(content) // 3):
        path.write_bytes(content[:size])
        assert ends_too_early(path, CHUNKS[compression])


def test_a_table_that_is_cut_itself_shows(tmp_path: Path, plane: np.ndarray) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, {"R": plane}, compression="none")
    content = path.read_bytes()
    path.write_bytes(content[: len(content) - ROWS * (24 * 4 + 8) - 8])
    assert ends_too_early(path, ROWS)
    with pytest.raises(FrameFolderError, match="ends too early"):
        read_header(path)


def test_headers_of_several_parts_are_skipped(tmp_path: Path, plane: np.ndarray) -> None:
    path = tmp_path / "a.exr"
    OpenEXR.File([OpenEXR.Part({}, {"R": plane}, n) for n in ("a", "b")]).write(str(path))
    assert read_header(path).channels == {"R", "b.R"}
    path.write_bytes(path.read_bytes()[:-3000])
    with pytest.raises(FrameFolderError, match="ends too early"):
        read_header(path)
