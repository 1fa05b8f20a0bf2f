from __future__ import annotations

from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save

from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.files.tensor_file import (
    DTYPES,
    is_whole_tensor_file,
    read_metadata,
    write_tensors,
)


def tensors() -> dict[str, torch.Tensor]:
    known = {f"{i}/é": torch.arange(i % 3 + 2).to(kind) for i, kind in enumerate(DTYPES)}
    turned = torch.arange(12.0).reshape(3, 4).T
    return {**known, "scalar": torch.tensor(7), "none": torch.zeros(0, 3), "turned": turned}


@pytest.mark.parametrize("metadata", [{"rtsr": 'x "é" \\ \n'}, {"format": "rtsr-state-1"}])
def test_the_bytes_are_those_of_the_library(tmp_path: Path, metadata: dict[str, str]) -> None:
    path = tmp_path / "a.safetensors"
    write_tensors(path, tensors(), metadata)
    plain = {name: tensor.contiguous() for name, tensor in tensors().items()}
    assert path.read_bytes() == save(plain, metadata)
    assert read_metadata(path) == metadata
    loaded = load_file(path)
    assert all(torch.equal(loaded[name], tensor) for name, tensor in tensors().items())
    assert list(tmp_path.iterdir()) == [path]


def test_a_type_that_the_format_lacks_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"a: .*complex64"):
        write_tensors(tmp_path / "f", {"a": torch.zeros(2, dtype=torch.complex64)}, {})


@pytest.mark.parametrize(
    "content",
    [b"", b"12", b"\xff" * 20, (3).to_bytes(8, "little") + b"[1]", b'\x02\0\0\0\0\0\0\0{"'],
)
def test_what_is_no_file_of_tensors_has_no_metadata(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "f").write_bytes(content)
    assert read_metadata(tmp_path / "f") is None
    assert read_metadata(tmp_path / "none") is None
    assert not is_whole_tensor_file(tmp_path / "f")


def test_a_file_that_was_cut_or_grew_is_not_whole(tmp_path: Path) -> None:
    path = tmp_path / "f"
    write_tensors(path, tensors(), {})
    content = path.read_bytes()
    assert is_whole_tensor_file(path)
    for other in (content[:-1], content[: len(content) // 2], content[:20], content + b"x"):
        path.write_bytes(other)
        assert not is_whole_tensor_file(path)
