"""The state of a training run, as it is read back."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from rtsr_cli.core.errors import CheckpointError
from rtsr_cli.core.training.saved_state import load_state, save_state


def test_a_state_whose_network_holds_no_numbers_is_refused(tmp_path: Path) -> None:
    bad = {"weight": torch.tensor([1.0, float("nan")])}
    save_state(tmp_path, 3, {"network": bad, "optimiser": {}}, {})
    with pytest.raises(CheckpointError, match=r"1 of the 2 values of tensor 'weight' are NaN"):
        load_state(tmp_path)


def test_what_the_optimiser_counts_may_be_anything(tmp_path: Path) -> None:
    parts = {"network": {"w": torch.ones(2)}, "optimiser": {"0.lr": torch.tensor(float("inf"))}}
    save_state(tmp_path, 3, parts, {"note": "x"})
    loaded = load_state(tmp_path)
    assert loaded is not None
    assert loaded[1]["note"] == "x"
