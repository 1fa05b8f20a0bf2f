"""Weights of a run: those it starts from, and those it writes, with where they come from."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

import rtsr_cli
from rtsr_cli.core.errors import CheckpointError
from rtsr_cli.core.network.weights import fill_network, read_weights, save_weights
from rtsr_cli.core.training.clips import Clip
from rtsr_cli.core.training.config import TrainingConfig
from rtsr_cli.core.training.samples import SampleTask

MAX_NAMED = 40
"""Shots that weights name; more are counted."""


def make_network(task: SampleTask, training: TrainingConfig, init_file: Path | None) -> nn.Module:
    """Return a network with fresh weights by the seed, or with those of a file.

    Raises:
        CheckpointError: they cannot be read, are another system's, or do not fit.
    """
    torch.manual_seed(training.seed)
    network = task.system.build(task.config, task.scale)
    if init_file is None:
        return network
    weights = read_weights(init_file)
    if weights.system != task.system.name:
        raise CheckpointError(
            f"{weights.path}: weights of '{weights.system}', not of '{task.system.name}'; give "
            "others as --init"
        )
    begun = {name: network.get_buffer(name).clone() for name in task.learning.measured}
    fill_network(network, weights)
    for name, value in begun.items():
        network.get_buffer(name).copy_(value)
    return network


class WeightsWriter:
    """Writes weights with everything that says where they come from."""

    def __init__(self, folder: Path, settings: Mapping[str, Any], clips: Sequence[Clip]) -> None:
        """Remember what all files of a run say.

        Args:
            folder: RUN.
            settings: as config.toml holds them.
            clips: that are trained and judged on.
        """
        self._folder, self._settings = folder, settings
        trained = sorted({c.facts.name for c in clips if not c.facts.validation})
        self._about = {
            "trained_on": trained if len(trained) <= MAX_NAMED else f"{len(trained)} shots",
            "training": settings["training"],
            "rtsr": rtsr_cli.__version__,
            "revision": git_revision(),
        }

    def write(
        self, name: str, tensors: Mapping[str, Tensor], step: int, scores: Mapping[str, float]
    ) -> None:
        """Write RUN/<name>.

        Raises:
            OutputError: it cannot be written.
        """
        about = {**self._about, "step": step, "validation": dict(scores)}
        save_weights(
            self._folder / name,
            tensors,
            system=self._settings["system"],
            scale=self._settings["training"]["scale"],
            config=self._settings["network"],
            about=about,
        )


def git_revision() -> str:
    """Revision of the source tree that runs, empty where it is none."""
    root = Path(rtsr_cli.__file__).parents[1]
    if not (root / ".git").exists():
        return ""
    try:
        command = ("git", "-C", str(root), "rev-parse", "HEAD")
        answer = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return answer.stdout.strip()
