"""Weights of networks: safetensors with everything needed to build the network again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from rtsr_cli.core.documents import check_regular, parse_json
from rtsr_cli.core.errors import CheckpointError
from rtsr_cli.core.files.folders import is_folder
from rtsr_cli.core.files.tensor_file import read_metadata, write_tensors
from rtsr_cli.core.files.tensor_values import check_finite

FORMAT = "rtsr-weights-1"

FACTS: Mapping[str, type] = {"system": str, "scale": int, "config": dict, "about": dict}
"""What weights say of themselves."""

KEY = "rtsr"
"""Of the metadata: everything but the tensors, as JSON."""

CHECKSUM = "checksum"
"""Beside the facts: `sum_weights`. Files of older versions have none."""

DIGEST_LETTERS = 32
"""Of the SHA-256, that outputs and stamps hold."""

SUFFIX = ".safetensors"
"""Ends the names of files of weights."""

UNDERESTIMATION = "under"
"""Score of the validation that tells how far errors were underestimated."""

SHIPPED = Path(__file__).parents[2] / "weights"
"""Folder of the weights that come with the package."""


@dataclass(frozen=True, kw_only=True)
class SavedWeights:
    """What a file of weights holds.

    Attributes:
        path: of the file.
        system: name.
        scale: S.
        config: the system's settings as plain values.
        about: training data, step, revision and the like.
        tensors: by parameter name.
    """

    path: Path
    system: str
    scale: int
    config: Mapping[str, Any]
    about: Mapping[str, Any]
    tensors: Mapping[str, Tensor]

    def digest(self) -> str:
        """Hash of the file's bytes, as outputs and stamps name it."""
        return self.sha256()[:DIGEST_LETTERS]

    def sha256(self) -> str:
        """SHA-256 of the file's bytes."""
        return sha256(self.path.read_bytes()).hexdigest()

    @property
    def is_shipped(self) -> bool:
        """Tell whether it is a file of the package."""
        return self.path.resolve().parent == SHIPPED.resolve()


def sum_weights(facts: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> str:
    """SHA-256 of what decides a network: its numbers, system, scale and settings.

    Args:
        facts: `system`, `scale` and `config` of the file, plain.
        tensors: by name.
    """
    deciding = {name: facts[name] for name in ("system", "scale", "config")}
    total = sha256(json.dumps(deciding, sort_keys=True).encode())
    for name in sorted(tensors):
        tensor = tensors[name].detach().cpu().contiguous()
        total.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        total.update(tensor.reshape(-1).view(torch.uint8).numpy().tobytes())
    return total.hexdigest()


def save_weights(
    path: Path,
    tensors: Mapping[str, Tensor],
    *,
    system: str,
    scale: int,
    config: Mapping[str, Any],
    about: Mapping[str, Any],
    half: bool = False,
) -> None:
    """Write weights.

    Raises:
        OutputError: the file cannot be written.
    """
    stored = {
        name: (t.half() if half and t.is_floating_point() else t).detach().cpu().contiguous()
        for name, t in tensors.items()
    }
    facts = {
        "format": FORMAT,
        "system": system,
        "scale": scale,
        "config": dict(config),
        "about": dict(about),
    }
    facts[CHECKSUM] = sum_weights(facts, stored)
    # one key, because the library writes several in any order
    metadata = {KEY: json.dumps(facts)}
    write_tensors(path, stored, metadata)


def read_weights(path: Path) -> SavedWeights:
    """Read weights.

    Raises:
        CheckpointError: the file is not there, damaged, or something else; its numbers are not
            those that it was written with; or a tensor holds NaN or Inf.
    """
    if is_folder(path):
        raise CheckpointError(f"{path}: a folder, no file of weights; give {path}/best{SUFFIX}")
    try:
        check_regular(path)
        with safe_open(path, "pt") as opened:
            facts = parse_json((opened.metadata() or {}).get(KEY, "{}"))
            tensors = {key: opened.get_tensor(key) for key in opened.keys()}  # noqa: SIM118
    except (OSError, ValueError, SafetensorError, TypeError) as error:
        raise CheckpointError(
            f"{path}: cannot be read as weights ({error}); give the whole file of a training "
            f"(RUN/best{SUFFIX}), copied again if it was cut short"
        ) from error
    if not isinstance(facts, dict) or facts.get("format") != FORMAT:
        raise CheckpointError(f"{path}: these are no weights of rtsr; rtsr train makes them")
    wrong = [name for name, kind in FACTS.items() if type(facts.get(name)) is not kind]
    if wrong:
        raise CheckpointError(f"{path}: what it says of itself is damaged ({', '.join(wrong)})")
    _check_sum(path, facts, tensors)
    check_finite(path, tensors)
    return SavedWeights(path=path, tensors=tensors, **{name: facts[name] for name in FACTS})


def _check_sum(path: Path, facts: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> None:
    """Hold what a file holds to what it was written with; those of before checksums are accepted.

    Raises:
        CheckpointError: it is another.
    """
    wanted = facts.get(CHECKSUM)
    if wanted is not None and wanted != sum_weights(facts, tensors):
        raise CheckpointError(
            f"{path}: damaged: its numbers or settings are not those that it was written with "
            "(checksum); copy it again"
        )


def name_shipped(pattern: str, scale: int, config: Any) -> str:
    """File name of the weights that come with the package for a scale and a config."""
    return pattern.format(scale=scale, config=config)


def find_shipped(pattern: str | None, scale: int, config: Any = None) -> Path | None:
    """Return the file of weights that comes with the package, None if none does."""
    path = None if pattern is None else SHIPPED / name_shipped(pattern, scale, config)
    return path if path is not None and path.is_file() else None


def list_shipped(system: str) -> list[Path]:
    """Files of a system's weights that come with the package, by name."""
    return [path for path in sorted(SHIPPED.glob(f"*{SUFFIX}")) if _read_system(path) == system]


def _read_system(path: Path) -> object:
    """The system that weights of the package are of."""
    facts = parse_json((read_metadata(path) or {}).get(KEY, "{}"))
    return facts.get("system") if isinstance(facts, dict) else None


def find_margin(about: Mapping[str, Any]) -> float:
    """What is added to predicted errors where users say nothing: their mean underestimation.

    Args:
        about: what weights say of their training; 0 where it says nothing of that.
    """
    scores = about.get("validation")
    under = scores.get(UNDERESTIMATION) if isinstance(scores, Mapping) else None
    return float(under) if isinstance(under, int | float) else 0.0


def fill_network(network: nn.Module, weights: SavedWeights) -> None:
    """Fill a network.

    Raises:
        CheckpointError: the parameters are not those of the network.
    """
    own = network.state_dict()
    lacking, extra = (
        sorted(own.keys() - weights.tensors.keys()),
        sorted(weights.tensors.keys() - own.keys()),
    )
    differing = [
        f"{name} {tuple(weights.tensors[name].shape)} for {tuple(own[name].shape)}"
        for name in own.keys() & weights.tensors.keys()
        if own[name].shape != weights.tensors[name].shape
    ]
    if lacking or extra or differing:
        raise CheckpointError(
            f"{weights.path}: weights of {weights.system} {weights.scale}x do not fit: "
            f"missing {lacking[:3]}, not known {extra[:3]}, other shapes {differing[:3]}"
        )
    with torch.no_grad():
        network.load_state_dict({k: v.to(own[k].dtype) for k, v in weights.tensors.items()})
