from __future__ import annotations

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest

from rtsr_cli import __version__
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import read_header, write_exr
from rtsr_cli.core.files.provenance import (
    STAMP,
    FileDigests,
    describe_provenance,
    digest_config,
    digest_values,
    holds_stamp,
)


def test_a_digest_does_not_depend_on_the_order_of_keys_but_on_that_of_lists() -> None:
    assert digest_values({"a": 1, "b": [1, 2]}) == digest_values({"b": [1, 2], "a": 1})
    assert digest_values([1, 2]) != digest_values([2, 1])
    assert digest_values("a", "b") != digest_values("ab")
    assert digest_values(1.0) != digest_values(1.5)
    assert digest_values(None) != digest_values("")


def test_a_digest_is_32_hexadecimal_digits_and_the_same_in_every_process() -> None:
    assert re.fullmatch("[0-9a-f]{32}", digest_values("x"))
    assert digest_values("x") == hashlib.blake2b(b'["x"]', digest_size=16).hexdigest()


def test_files_of_the_same_bytes_have_one_digest_wherever_they_lie(tmp_path: Path) -> None:
    for name, content in (("a", b"same"), ("b", b"same"), ("c", b"other")):
        (tmp_path / name).write_bytes(content)
    digests = FileDigests()
    a, b, c = (digests.of(tmp_path / name) for name in "abc")
    assert a == b
    assert a != c
    assert digests.of_all([tmp_path / "a", tmp_path / "c"]) != digests.of_all(
        [tmp_path / "c", tmp_path / "a"]
    )


def test_a_file_is_read_once_a_run(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"first")
    digests = FileDigests()
    first = digests.of(path)
    path.write_bytes(b"second")
    assert digests.of(path) == first
    assert FileDigests().of(path) != first


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(FrameFolderError, match=r"none\.exr: cannot be read"):
        FileDigests().of(tmp_path / "none.exr")


def test_the_header_of_an_output_names_its_origin_without_any_folder(tmp_path: Path) -> None:
    known = describe_provenance(
        command="upscale",
        config_hash="c0ffee",
        source=tmp_path / "frame.0007.exr",
        stamp="abc",
        extra={"rtsr:system": "bicubic"},
    )
    write_exr(tmp_path / "out.exr", {"Y": np.zeros((2, 2), np.float16)}, attributes=known)
    attributes = read_header(tmp_path / "out.exr").attributes
    assert attributes["rtsr:sourceFrame"] == "frame.0007.exr"
    assert attributes["rtsr:version"] == __version__
    assert attributes["rtsr:configHash"] == "c0ffee"
    assert attributes["rtsr:system"] == "bicubic"
    assert not any(str(tmp_path) in str(value) for value in attributes.values())
    assert holds_stamp((tmp_path / "out.exr").read_bytes(), "abc")
    assert not holds_stamp((tmp_path / "out.exr").read_bytes(), "ab")


def test_a_file_of_another_program_and_a_damaged_one_have_no_stamp(tmp_path: Path) -> None:
    write_exr(tmp_path / "other.exr", {"Y": np.zeros((2, 2), np.float16)})
    (tmp_path / "damaged.exr").write_bytes(b"half")
    for name in ("other.exr", "damaged.exr"):
        assert not holds_stamp((tmp_path / name).read_bytes(), "")


def test_the_stamp_is_an_attribute_of_rtsr() -> None:
    assert STAMP == "rtsr:stamp"


def test_another_version_makes_other_stamps(monkeypatch: pytest.MonkeyPatch) -> None:
    now = digest_config("upscale", {"scale": 4})
    monkeypatch.setattr("rtsr_cli.core.files.provenance.__version__", "999")
    assert digest_config("upscale", {"scale": 4}) != now
