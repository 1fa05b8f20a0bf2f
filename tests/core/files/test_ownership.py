from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.files.ownership import is_own, is_own_tensors, list_foreign
from rtsr_cli.core.files.png import write_png
from rtsr_cli.core.files.tensor_file import write_tensors
from rtsr_cli.core.marks import MARK, MARKED, TOML_MARK_LINE

PIXELS = np.zeros((2, 2, 3), np.uint8)
PAGE = f'<!doctype html>\n<head><meta name="{MARK}" content="1"></head>'


def write_text(text: str) -> Callable[[Path], object]:
    return lambda path: path.write_text(text, encoding="utf-8")


OWN: dict[str, Callable[[Path], object]] = {
    ".exr": lambda path: write_exr(path, {"Y": np.zeros((2, 2), np.float16)}, attributes=MARKED),
    ".png": lambda path: write_png(path, PIXELS),
    ".json": write_text(json.dumps(MARKED)),
    ".html": write_text(PAGE),
    ".toml": write_text(TOML_MARK_LINE + "a = 1\n"),
    ".safetensors": lambda path: write_tensors(path, {"a": torch.zeros(2)}, {"rtsr": "{}"}),
}


@pytest.mark.parametrize("suffix", OWN)
def test_what_rtsr_wrote_is_told_from_what_it_did_not(tmp_path: Path, suffix: str) -> None:
    own = tmp_path / f"own{suffix}"
    OWN[suffix](own)
    assert is_own(own)
    assert not is_own(tmp_path / "none")
    for content in (b"", b"mine", MARK.encode(), own.read_bytes().replace(b"rtsr", b"mine")):
        other = tmp_path / f"other{suffix}"
        other.write_bytes(content)
        assert not is_own(other)
    assert list_foreign([own, other, tmp_path / "none.png"]) == [other]


def test_pictures_and_frames_that_others_wrote_are_foreign(tmp_path: Path) -> None:
    write_exr(tmp_path / "a.exr", {"Y": np.zeros((2, 2), np.float16)})
    content = OWN[".png"](tmp_path / "a.png") or (tmp_path / "a.png").read_bytes()
    assert isinstance(content, bytes)
    (tmp_path / "b.png").write_bytes(content.replace(MARK.encode(), b"other:marks."))
    assert list_foreign(tmp_path / name for name in ("a.exr", "a.png", "b.png")) == [
        tmp_path / "a.exr",
        tmp_path / "b.png",
    ]


def test_a_link_that_leads_nowhere_a_folder_and_a_pipe_are_in_the_way(tmp_path: Path) -> None:
    link, folder, pipe = (tmp_path / f"{name}.png" for name in ("link", "folder", "pipe"))
    link.symlink_to(tmp_path / "nowhere")
    folder.mkdir()
    os.mkfifo(pipe)
    assert list_foreign([link, folder, pipe]) == [link, folder, pipe]
    assert not is_own_tensors(pipe)


def test_a_file_that_was_cut_is_still_own(tmp_path: Path) -> None:
    for suffix in (".exr", ".png"):
        path = tmp_path / f"a{suffix}"
        OWN[suffix](path)
        path.write_bytes(path.read_bytes()[:-20])
        assert is_own(path)


@pytest.mark.parametrize("suffix", OWN)
def test_the_mark_stands_in_the_first_bytes(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    OWN[suffix](path)
    content = path.read_bytes()
    path.write_bytes(content[:80])
    assert is_own(path)


def test_the_mark_of_a_large_header_is_its_first_attribute(tmp_path: Path) -> None:
    path, plane = tmp_path / "a.exr", {"Y": np.arange(6, dtype=np.float16).reshape(2, 3)}
    known = {"aaa": "x" * 100_000, **MARKED, "rtsr:stamp": "s" * 32, "zzz": "z"}
    write_exr(path, plane, attributes=known)
    head = b"v/1\x01\x02\0\0\0rtsr:version\0string\0"
    assert path.read_bytes().startswith(head)
    assert path.read_bytes().index(b"rtsr:stamp") < 80
    held = read_header(path).attributes
    assert {name: held[name] for name in known} == known
    np.testing.assert_array_equal(read_channels(path, "Y")["Y"], plane["Y"])


def test_links_are_not_replaced_and_empty_files_are(tmp_path: Path) -> None:
    own, link, empty = (tmp_path / f"{name}.json" for name in ("own", "link", "empty"))
    OWN[".json"](own)
    link.symlink_to(own)
    empty.touch()
    assert list_foreign([own, link, empty]) == [link]


def test_a_document_that_was_cut_is_still_rtsrs(tmp_path: Path) -> None:
    path = tmp_path / "summary.json"
    text = json.dumps({**MARKED, "total": {"frames": 3}}, indent=1)
    for length in range(len(text) // 2, len(text)):
        path.write_text(text[:length], encoding="utf-8")
        assert is_own(path)
    path.write_text('{"other": 1, "rtsr:version"', encoding="utf-8")
    assert not is_own(path)
