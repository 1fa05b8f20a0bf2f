"""Files of named tensors, in the safetensors format, written a tensor at a time.

The library's own writer leaves files of other names behind when it is killed, and says why a disk
refused a file in words only. Source of the layout: [safetensors, "Format"]: the header's size in
8 bytes, the header as JSON padded with spaces, the tensors' bytes in the header's order.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.files.atomic_write import write_atomically

METADATA = "__metadata__"
"""Key of the header that is no tensor: texts by name."""

DTYPES: Mapping[torch.dtype, str] = {
    torch.int64: "I64",
    torch.float64: "F64",
    torch.float32: "F32",
    torch.int32: "I32",
    torch.bfloat16: "BF16",
    torch.float16: "F16",
    torch.int16: "I16",
    torch.int8: "I8",
    torch.uint8: "U8",
    torch.bool: "BOOL",
}
"""Names of types, in the order in which the library lays tensors out."""

ALIGNMENT = 8

SIZE_BYTES = 8
MAX_HEADER_BYTES = 100_000_000
"""As much as the library reads."""


def write_tensors(path: Path, tensors: Mapping[str, Tensor], metadata: Mapping[str, str]) -> None:
    """Write tensors of the CPU, whole or not at all; the bytes are those of the library.

    Raises:
        OutputError: the file cannot be written.
    """
    for name, tensor in tensors.items():
        if tensor.dtype not in DTYPES:
            raise OutputError(f"{path}: {name}: tensors of {tensor.dtype} cannot be written")
    order = list(DTYPES)
    names = sorted(tensors, key=lambda name: (order.index(tensors[name].dtype), name))
    header = _encode_header({name: tensors[name] for name in names}, metadata)

    def write(part: Path) -> None:
        with part.open("wb") as file:
            file.write(header)
            for name in names:
                _write_bytes(file, tensors[name])

    write_atomically(path, write)


def _encode_header(tensors: Mapping[str, Tensor], metadata: Mapping[str, str]) -> bytes:
    entries: dict[str, Any] = {METADATA: dict(metadata)}
    start = 0
    for name, tensor in tensors.items():
        end = start + tensor.nbytes
        entries[name] = {
            "dtype": DTYPES[tensor.dtype],
            "shape": list(tensor.shape),
            "data_offsets": [start, end],
        }
        start = end
    text = json.dumps(entries, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % ALIGNMENT)
    return len(text).to_bytes(SIZE_BYTES, "little") + text


def _write_bytes(file: BinaryIO, tensor: Tensor) -> None:
    plane: NDArray[np.uint8] = tensor.contiguous().reshape(-1).view(torch.uint8).numpy()
    file.write(plane.data)


def read_metadata(path: Path) -> Mapping[str, Any] | None:
    """Return the texts of a file of tensors, None where it is none."""
    try:
        known = _read_header(path)[0].get(METADATA, {})
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    return known if isinstance(known, dict) else None


def is_whole_tensor_file(path: Path) -> bool:
    """Tell whether a file of tensors reaches to the end that its header tells."""
    try:
        header, start = _read_header(path)
        ends = [entry["data_offsets"][1] for name, entry in header.items() if name != METADATA]
        return path.stat().st_size == start + max(ends, default=0)
    except (OSError, ValueError, RecursionError, LookupError, TypeError):
        return False


def _read_header(path: Path) -> tuple[dict[str, Any], int]:
    """The header, and where the tensors' bytes begin.

    Raises:
        OSError: the file cannot be read.
        ValueError, TypeError: it is none of tensors.
    """
    with path.open("rb") as file:
        size = int.from_bytes(file.read(SIZE_BYTES), "little")
        if not 0 < size <= MAX_HEADER_BYTES:
            raise ValueError("a header of no size, or too large")
        header = json.loads(file.read(size))
    if not isinstance(header, dict):
        raise TypeError("the header is no object")
    return header, SIZE_BYTES + size
