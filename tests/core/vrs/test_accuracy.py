"""Sums of prediction errors, put together."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from rtsr_cli.core.vrs.accuracy import (
    average_accuracy,
    join_tallies,
    tallies_from_plain,
    tallies_to_plain,
    tally_errors,
)


def test_parts_put_together_are_the_whole() -> None:
    torch.manual_seed(0)
    wanted = {name: torch.rand(1, 1, 6, 8) for name in ("1x2", "2x1")}
    predicted = {name: w + 0.1 * torch.randn_like(w) for name, w in wanted.items()}
    parts = [
        {n: tally_errors(predicted[n][:, :, rows], wanted[n][:, :, rows]) for n in wanted}
        for rows in (slice(0, 2), slice(2, 6))
    ]
    found = average_accuracy(
        join_tallies(tallies_from_plain(tallies_to_plain(part)) for part in parts)
    )
    scores = []
    for name, w in wanted.items():
        p, y = predicted[name].double().numpy(), w.double().numpy()
        scores.append(1.0 - np.square(p - y).sum() / np.square(y - y.mean()).sum())
    assert found["r2"] == pytest.approx(np.mean(scores))
    gaps = [(predicted[n] - wanted[n]).double() for n in wanted]
    assert found["mae"] == pytest.approx(float(torch.stack(gaps).abs().mean()))
    assert found["under"] == pytest.approx(float((-torch.stack(gaps)).clamp(min=0).mean()))


def test_chosen_tiles_alone_count() -> None:
    wanted = torch.tensor([[[[0.0, 1.0, 5.0]]]])
    predicted = torch.tensor([[[[0.0, 0.5, 9.0]]]])
    found = average_accuracy(
        {"a": tally_errors(predicted, wanted, torch.tensor([[[[1.0, 1.0, 0.0]]]]))}
    )
    assert found == pytest.approx({"r2": 0.5, "mae": 0.25, "under": 0.25})
    assert average_accuracy({"a": tally_errors(predicted, wanted, torch.zeros_like(wanted))}) == {}
