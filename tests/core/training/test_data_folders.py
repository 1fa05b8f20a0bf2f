from __future__ import annotations

import json
from pathlib import Path

import pytest

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.training.config import DataConfig
from rtsr_cli.core.training.data_folders import read_manifest_split, split_shots

NAMES = [f"shot{i:02d}" for i in range(20)]


def test_patterns_decide_where_there_are_any(tmp_path: Path) -> None:
    data = DataConfig(validation=("shot1*",), exclude=("*3",))
    split = split_shots(tmp_path, NAMES, data, hold_out=True)
    assert {n for n, role in split.items() if role == "val"} == {
        f"shot1{i}" for i in range(10) if i != 3
    }
    assert "shot03" not in split
    assert "shot13" not in split


def test_a_manifest_decides_and_leaves_out_what_it_does_not_list(tmp_path: Path) -> None:
    listed = [
        {"scene": "a", "sequence": "x", "split": "train"},
        {"scene": "b", "sequence": "y", "split": "val"},
        {"scene": "b", "sequence": "z", "split": "test"},
    ]
    (tmp_path / "manifest.json").write_text(json.dumps({"sequences": listed}))
    split = split_shots(tmp_path, ["a/x", "b/y", "b/z", "c/w"], DataConfig(), hold_out=True)
    assert split == {"a/x": "train", "b/y": "val", "b/z": "test"}


@pytest.mark.parametrize("content", ["{", '{"sequences": [{"scene": "a"}]}', "[]"])
def test_a_broken_manifest_is_named(tmp_path: Path, content: str) -> None:
    (tmp_path / "manifest.json").write_text(content)
    with pytest.raises(FrameFolderError, match=r"manifest\.json: not a list of sequences"):
        read_manifest_split(tmp_path)


@pytest.mark.parametrize(("count", "held"), [(1, 0), (2, 0), (3, 1), (7, 1), (8, 1), (20, 2)])
def test_whole_shots_are_held_out_where_there_are_enough(
    tmp_path: Path, count: int, held: int
) -> None:
    split = split_shots(tmp_path, NAMES[:count], DataConfig(), hold_out=True)
    assert sum(role == "val" for role in split.values()) == held
    assert len(split) == count


def test_nothing_is_held_out_where_other_data_are_judged_on(tmp_path: Path) -> None:
    split = split_shots(tmp_path, NAMES, DataConfig(), hold_out=False)
    assert set(split.values()) == {"train"}
