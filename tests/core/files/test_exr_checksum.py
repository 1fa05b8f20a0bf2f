from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.files.exr_checksum import BLANK, CHECKSUM, FIELD, is_unchanged, seal

PLANES = {c: np.random.default_rng(1).random((20, 30)).astype(np.float16) for c in "RGB"}


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("sealed") / "a.exr"
    write_exr(path, PLANES, attributes={"owner": "me"})
    return path.read_bytes()


def test_what_is_written_is_sealed_and_read_as_before(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    path.write_bytes(content)
    assert is_unchanged(content)
    assert dict(read_header(path).attributes)["owner"] == "me"
    assert CHECKSUM not in read_header(path).attributes
    np.testing.assert_array_equal(read_channels(path, "R")["R"], PLANES["R"])


@given(place=st.integers(min_value=0), bit=st.integers(0, 7))
def test_any_bit_that_flips_is_found(content: bytes, place: int, bit: int) -> None:
    damaged = bytearray(content)
    damaged[place % len(content)] ^= 1 << bit
    # damage to the attribute's own name leaves a file without a checksum
    assert not is_unchanged(bytes(damaged))


@given(size=st.integers(min_value=0))
def test_any_cut_is_found(content: bytes, size: int) -> None:
    assert not is_unchanged(content[: size % len(content)])


def test_the_checksum_is_that_of_the_file_with_zeros_in_its_place(content: bytes) -> None:
    found = FIELD.search(content)
    assert found is not None
    blank = bytearray(content)
    blank[found.start(1) : found.end(1)] = BLANK.encode()
    seal(memoryview(blank))
    assert bytes(blank) == content


def test_a_file_of_another_program_has_none(content: bytes) -> None:
    assert is_unchanged(content.replace(CHECKSUM.encode(), b"x" * len(CHECKSUM))) is None
    assert is_unchanged(b"") is None


def test_the_checksum_of_an_input_is_not_handed_on(tmp_path: Path) -> None:
    write_exr(tmp_path / "b.exr", PLANES, attributes={CHECKSUM: "12345678"})
    assert is_unchanged((tmp_path / "b.exr").read_bytes())
