"""Weights of a run: those it starts from, and those it writes, with where they come from."""

from __future__ import annotations

import subprocess
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

import rtsr_cli
from rtsr_cli.core.cards.card import place_card, write_card
from rtsr_cli.core.cards.origin import UNDECLARED
from rtsr_cli.core.errors import CheckpointError
from rtsr_cli.core.files.atomic_write import write_text_atomically
from rtsr_cli.core.network.weights import fill_network, read_weights, save_weights
from rtsr_cli.core.system import System
from rtsr_cli.core.training.clips import Clip
from rtsr_cli.core.training.config import TrainingConfig
from rtsr_cli.core.training.samples import SampleTask
from rtsr_cli.core.wording import say_count

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

    def __init__(
        self, folder: Path, system: System, settings: Mapping[str, Any], clips: Sequence[Clip]
    ) -> None:
        """Remember what all files of a run say.

        Args:
            folder: RUN.
            system: that is trained.
            settings: as config.toml holds them.
            clips: that are trained and judged on.
        """
        self._folder, self._system, self._settings = folder, system, settings
        trained, judged = (
            [clip for clip in clips if clip.facts.validation is validation]
            for validation in (False, True)
        )
        names = sorted({clip.facts.name for clip in trained})
        self._about = {
            "trained_on": names if len(names) <= MAX_NAMED else say_count(len(names), "shot"),
            "data": {
                "training": describe_data(trained),
                "validation": describe_data(judged),
                "held_out": not {clip.facts.name for clip in judged}.intersection(names),
            },
            "training": settings["training"],
            "rtsr": rtsr_cli.__version__,
            "revision": git_revision(),
        }

    def write(
        self, name: str, tensors: Mapping[str, Tensor], step: int, scores: Mapping[str, float]
    ) -> None:
        """Write RUN/<name>, and its card beside it.

        Raises:
            OutputError: one cannot be written.
        """
        about = {**self._about, "step": step, "validation": dict(scores)}
        path = self._folder / name
        save_weights(
            path,
            tensors,
            system=self._settings["system"],
            scale=self._settings["training"]["scale"],
            config=self._settings["network"],
            about=about,
        )
        write_text_atomically(place_card(path), write_card(self._system, [read_weights(path)]))


def describe_data(clips: Sequence[Clip]) -> dict[str, Any]:
    """What weights say of clips: how many shots and frames, under which licences, and which."""
    licences = {clip.facts.name: clip.facts.licence or UNDECLARED for clip in clips}
    frames = {(c.facts.name, c.facts.numbers[i]) for c in clips for i in c.target_positions}
    counts = Counter(name for name, _ in frames)
    described: dict[str, Any] = {
        "shots": len(licences),
        "frames": len(frames),
        "licences": dict(sorted(Counter(licences.values()).items())),
    }
    if len(licences) <= MAX_NAMED:
        described["listed"] = [
            {"name": name, "frames": counts[name], "licence": licences[name]}
            for name in sorted(licences)
        ]
    return described


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
