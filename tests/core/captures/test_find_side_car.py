"""A file of cameras that lies beside the frames, and that nothing declares."""

from __future__ import annotations

from pathlib import Path

from rtsr_cli.core.captures.cameras import find_side_car

MATRIX = " ".join(["1 0 0 0", "0 1 0 0", "0 0 1 0", "0 0 0 1"])


def test_the_file_that_holds_matrices_is_found_by_what_is_in_it(tmp_path: Path) -> None:
    assert find_side_car(tmp_path / "none") == ""
    (tmp_path / "a.csv").write_text("name,price\nlamp,3\n")
    (tmp_path / "b.csv").write_text("frame,jitter_px\n1,0.5 0.5\n")
    (tmp_path / "c.json").write_text('{"objects": [1, 2]}')
    assert find_side_car(tmp_path) == ""
    (tmp_path / "poses.csv").write_text(f"frame,worldToCamera\n1,{MATRIX}\n")
    assert find_side_car(tmp_path) == "poses.csv"
