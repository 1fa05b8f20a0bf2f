"""Texts of others: one message each, whatever they hold, before memory or time is taken."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from rtsr_cli.core import documents
from rtsr_cli.core.documents import (
    DocumentError,
    check_regular,
    describe_value,
    parse_json,
    parse_toml,
    read_json,
    read_text,
    read_toml_text,
)
from rtsr_cli.core.limits import MOST_TOML_BYTES


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, "is nested more than 64 levels deep"),
        ("[" * 100 + "]" * 100, "is nested more than 64 levels deep"),
        ('{"a":' * 100_000, "is nested more than 64 levels deep"),
        ("9" * 5000, "is not valid JSON: Exceeds the limit"),
        ("9" * 50, "holds a whole number of too many digits"),
        ("{", "is not valid JSON: Expecting"),
        ("[" + "1," * 4_000_001 + "1]", "holds more than 4000000 values"),
    ],
    ids=["deep", "deep and whole", "tables", "digits", "large", "cut", "many"],
)
def test_hostile_json_is_one_short_message(text: str, message: str) -> None:
    with pytest.raises(DocumentError) as refusal:
        parse_json(text)
    assert str(refusal.value).startswith(message)
    assert len(str(refusal.value)) < 250


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = " + "[" * 100_000, "is nested more than 64 levels deep"),
        (".".join(["a"] * 10_000) + " = 1", "is nested more than 64 levels deep"),
        ("a = " + "9" * 5000, "is not valid TOML: Exceeds the limit"),
        ("a = 0x" + "f" * 5000, "holds a whole number of too many digits"),
        ("a = [1", "is not valid TOML: "),
        ("a = 1\na = 2", "is not valid TOML: "),
    ],
    ids=["deep", "dotted", "digits", "hexadecimal", "cut", "twice"],
)
def test_hostile_toml_is_one_short_message(text: str, message: str) -> None:
    with pytest.raises(DocumentError) as refusal:
        parse_toml(text)
    assert str(refusal.value).startswith(message)
    assert len(str(refusal.value)) < 250


def test_only_regular_files_are_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    started = time.perf_counter()
    for path in (tmp_path / "pipe", tmp_path, Path("/dev/zero"), Path("/dev/null")):
        with pytest.raises(DocumentError, match="is no regular file"):
            read_text(path)
        with pytest.raises(DocumentError, match="is no regular file"):
            check_regular(path)
    for path in (tmp_path / "none", tmp_path / ("x" * 5000), Path("a\0b")):
        with pytest.raises(DocumentError, match="cannot be read"):
            read_text(path)
    assert time.perf_counter() - started < 1.0


def test_a_file_that_is_too_large_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "big.toml"
    path.write_bytes(b"#" * (MOST_TOML_BYTES + 1))
    with pytest.raises(DocumentError, match="is larger than 4 MiB"):
        read_toml_text(path)
    path.write_bytes(b"#" * MOST_TOML_BYTES)
    assert read_toml_text(path) == {}
    monkeypatch.setattr(documents, "MOST_VALUES", 3)
    path.write_text("[1, 2, 3, 4, 5]")
    with pytest.raises(DocumentError, match="holds more than 3 values"):
        read_json(path)


def test_bytes_that_are_no_utf8_are_said_with_their_place(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    path.write_bytes(b'{"a": "\xfc"}')
    with pytest.raises(DocumentError, match="is not valid JSON: byte 7 is no UTF-8"):
        read_json(path)
    path.write_bytes(b"\xef\xbb\xbf[1]")
    assert read_json(path) == [1]


@pytest.mark.parametrize(
    "value",
    [10**6000, "x" * 10**6, [1] * 10**6, {str(i): i for i in range(1000)}, [[["x" * 99]]]],
    ids=["digits", "text", "list", "table", "nested"],
)
def test_any_value_is_described_in_one_short_line(value: object) -> None:
    assert len(describe_value(value)) <= 60
    assert "\n" not in describe_value(value)


def test_small_values_are_described_as_they_are() -> None:
    for value in (1, -2.5, "a", [1, "b"], {"c": [1.0]}, None):
        assert describe_value(value) == repr(value)
    # as TOML and JSON write them
    assert [describe_value(value) for value in (True, False)] == ["true", "false"]
