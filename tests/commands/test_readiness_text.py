"""What is missing, by size; files that are there to be named, and files still to be written."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from rtsr_cli.commands.readiness_text import _gather_sizes
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr


@pytest.mark.parametrize(
    ("missing", "said"),
    [
        (("motion", "metallic"), "motion, metallic"),
        (("lr a", "lr b", "hr a", "hr c"), "lr and hr a; lr b; hr c"),
        (("hr frames",), "hr frames"),
        (("lr motion", "weights for 4x"), "lr motion; weights for 4x"),
    ],
)
def test_what_both_sizes_lack_is_named_once(missing: tuple[str, ...], said: str) -> None:
    assert _gather_sizes(missing) == said


def test_a_file_of_cameras_is_pasted_where_it_lies_and_else_to_be_written(
    rtsr: Any, small_shot: Path, tmp_path: Path
) -> None:
    shot = tmp_path / "shot"
    rows = ["frame,worldToCamera,worldToNDC"]
    for size in ("lr", "hr"):
        for path in sorted((small_shot / size).glob("*.exr")):
            header = read_header(path)
            write_exr(shot / size / path.name, read_channels(path, header.channels))
            matrices = (header.attributes[name] for name in ("worldToCamera", "worldToNDC"))
            cells = [" ".join(str(float(v)) for row in m for v in row) for m in matrices]
            rows.append(",".join([str(int(path.stem.split(".")[-1])), *cells]))
    bare = rtsr("inspect", shot).output
    assert "to write    camera.csv, beside capture.toml: a row a frame" in bare
    assert 'then camera = "camera.csv" at the head of capture.toml' in bare
    assert "to paste    camera" not in bare
    (shot / "my_poses.csv").write_text("\n".join(rows[:5]) + "\n")
    there = rtsr("inspect", shot).output
    assert 'camera = "my_poses.csv"' in there
    assert "to write" not in there
    shutil.rmtree(shot)
