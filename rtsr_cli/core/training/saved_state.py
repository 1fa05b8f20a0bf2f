"""The state of a training run on disk: everything that the next step depends on, exactly.

`RUN/state/state.json` names the tensors' file beside it; it is renamed into place after that file,
so that a run killed at any moment goes on from a state that is whole.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor, nn

from rtsr_cli.core.documents import DocumentError, check_regular, read_json
from rtsr_cli.core.errors import CheckpointError
from rtsr_cli.core.files.atomic_write import remove_leftovers, write_text_atomically
from rtsr_cli.core.files.ownership import may_be_replaced
from rtsr_cli.core.files.tensor_file import write_tensors
from rtsr_cli.core.files.tensor_values import check_finite
from rtsr_cli.core.marks import MARKED

STATE_FILE = "state.json"

TENSOR_FILES = "step-*.safetensors"
"""Beside it: one, and while a state is written two."""

FORMAT = "rtsr-state-1"

NETWORKS = frozenset({"network", "average"})
"""Parts whose numbers the next step takes as they are: none of them may be NaN or Inf."""

MOST_STEPS = 10**12
"""More is no state of ours."""


def save_state(
    folder: Path,
    step: int,
    parts: Mapping[str, Mapping[str, Tensor]],
    facts: Mapping[str, Any],
) -> None:
    """Write a state and drop the one before.

    Args:
        folder: RUN/state.
        step: steps done.
        parts: named groups of tensors (network, ema, optimiser, ...).
        facts: plain values.

    Raises:
        OutputError: it cannot be written; the state before stays.
    """
    remove_leftovers(folder)
    tensors = {
        f"{part}/{name}": tensor.detach().cpu().clone().contiguous()
        for part, named in parts.items()
        for name, tensor in named.items()
    }
    path = folder / f"step-{step:09d}.safetensors"
    write_tensors(path, tensors, {"format": FORMAT})
    text = json.dumps({**MARKED, "step": step, "tensors": path.name, **facts}, indent=1)
    write_text_atomically(folder / STATE_FILE, text)
    for old in folder.glob(TENSOR_FILES):
        if old != path and may_be_replaced(old):
            with suppress(OSError):
                old.unlink()


def read_saved_step(folder: Path) -> int:
    """Steps that a state on disk has done, 0 if there is none that can be read."""
    try:
        return _read_facts(folder / STATE_FILE)["step"]  # type: ignore[no-any-return]
    except DocumentError:
        return 0


def load_state(folder: Path) -> tuple[dict[str, dict[str, Tensor]], dict[str, Any]] | None:
    """Return the parts and facts of a state, None if there is none.

    Raises:
        CheckpointError: there is one, and it cannot be read, or its network holds NaN or Inf.
    """
    path = folder / STATE_FILE
    if not path.exists():
        return None
    try:
        facts = _read_facts(path)
        check_regular(folder / facts["tensors"])
        tensors = load_file(folder / facts["tensors"])
    except (OSError, ValueError, SafetensorError) as error:
        raise CheckpointError(
            f"{path}: cannot be read ({error}); start again in another folder, or with "
            "--init from best.safetensors"
        ) from error
    parts: dict[str, dict[str, Tensor]] = {}
    for key, tensor in tensors.items():
        part, _, name = key.partition("/")
        parts.setdefault(part, {})[name] = tensor
    for part in sorted(NETWORKS & parts.keys()):
        check_finite(folder / facts["tensors"], parts[part])
    return parts, facts


def _read_facts(path: Path) -> dict[str, Any]:
    """Read what a state says of itself.

    Raises:
        DocumentError: it cannot be read, or is none.
    """
    facts = read_json(path)
    if not isinstance(facts, dict):
        raise DocumentError("is no table")
    step, tensors, best = (facts.get(name) for name in ("step", "tensors", "best"))
    number = best is None or isinstance(best, int | float)
    if type(step) is not int or not 0 <= step <= MOST_STEPS or not number:
        raise DocumentError("its step or best score is no number")
    if not isinstance(tensors, str) or Path(tensors).name != tensors:
        raise DocumentError("it names no file beside it")
    return facts


def list_optimiser_tensors(optimiser: torch.optim.Optimizer) -> dict[str, Tensor]:
    """Moments and counters of every parameter, by its position."""
    return {
        f"{index}.{name}": torch.as_tensor(value)
        for index, values in optimiser.state_dict()["state"].items()
        for name, value in values.items()
    }


def restore_optimiser(optimiser: torch.optim.Optimizer, tensors: Mapping[str, Tensor]) -> None:
    """Undo `list_optimiser_tensors`."""
    state: dict[int, dict[str, Tensor]] = {}
    for key, tensor in tensors.items():
        index, _, name = key.partition(".")
        state.setdefault(int(index), {})[name] = tensor
    known = optimiser.state_dict()
    optimiser.load_state_dict({**known, "state": state})


def copy_weights(network: nn.Module) -> dict[str, Tensor]:
    """Copy what a moving average starts from."""
    return {name: tensor.detach().clone() for name, tensor in network.state_dict().items()}


def update_average(average: Mapping[str, Tensor], network: nn.Module, decay: float) -> None:
    """Move the average: a <- decay a + (1 - decay) w; counters are copied."""
    for name, tensor in network.state_dict().items():
        if tensor.is_floating_point():
            average[name].lerp_(tensor.detach(), 1.0 - decay)
        else:
            average[name].copy_(tensor)


def take_average(
    stored: Mapping[str, Tensor], own: Mapping[str, Tensor], device: torch.device
) -> dict[str, Tensor]:
    """Return a moving average that was saved.

    Raises:
        ValueError: it is of other tensors than the one that it replaces.
    """
    average = {name: tensor.to(device) for name, tensor in stored.items()}
    if {k: v.shape for k, v in average.items()} != {k: v.shape for k, v in own.items()}:
        raise ValueError("the moving average is of other tensors")
    return average
