"""The system whose weights, or exported files, a run is given."""

from __future__ import annotations

from pathlib import Path

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.errors import CheckpointError
from rtsr_cli.core.network.manifest import read_manifest
from rtsr_cli.core.network.weights import read_weights
from rtsr_cli.core.run.system_inputs import SystemTable
from rtsr_cli.core.wording import join_names


def name_given_system(
    systems: SystemTable, task: SystemTask, *, weights: Path | None, model: Path | None
) -> str | None:
    """Name the system that weights or exported files are of; None where neither is given.

    Args:
        systems: that there are; the preferred ones are of the task.
        task: that the run is for.
        weights: a file of `rtsr train`.
        model: a folder of `rtsr export`, or its manifest.

    Raises:
        CheckpointError: they cannot be read, or are of a system for something else; names it and
            what takes it.
    """
    path = model or weights
    if path is None:
        return None
    name = read_weights(path).system if model is None else read_manifest(path).system
    given = systems.load(name)
    if given.task is not task:
        fitting = join_names([f"'{one}'" for one in systems.preferred if _is_trained(systems, one)])
        raise CheckpointError(
            f"{path}: a network of '{name}', which rtsr {given.task} runs, and rtsr {task} does "
            f"not; give one of {fitting}, or run rtsr {given.task}"
        )
    return name


def _is_trained(systems: SystemTable, name: str) -> bool:
    return systems.load(name).learning is not None
