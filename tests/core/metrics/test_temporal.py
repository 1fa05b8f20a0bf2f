"""Errors along motion: the oracle's integer pan, and what each measure is blind to."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.errors import MetricUnavailableError
from rtsr_cli.core.imaging.warping import inside_frame
from rtsr_cli.core.metrics.fidelity import masked_mean, psnr
from rtsr_cli.core.metrics.lpips import Lpips
from rtsr_cli.core.metrics.temporal import stack_rows, temporal_change_map, warped_error_map

Oracle = Callable[[str], dict[str, Any]]
PAIRS = 5


def frames(recipe: SimpleNamespace, device: torch.device, *, distort: bool) -> Tensor:
    """6 x 1 x h x w, 0..1."""
    array = recipe.luma_sequence(distort=distort)
    return torch.from_numpy(array).float().to(device)[:, None] / 255.0


def pan(size: tuple[int, int], device: torch.device) -> Tensor:
    """Backward motion of 3 pixels in x and 1 in y."""
    return torch.tensor([3.0, 1.0], device=device).view(1, 2, 1, 1).expand(1, 2, *size).contiguous()


def test_warped_error_of_the_oracle(
    recipe: SimpleNamespace, oracle: Oracle, device: torch.device
) -> None:
    expected = oracle("temporal")["warped_error"]
    for distort, name in ((False, "mse_reference"), (True, "l1_test")):
        images = frames(recipe, device, distort=distort)
        motion = pan(images.shape[-2:], device)
        there = inside_frame(motion)
        for t in range(1, PAIRS + 1):
            error = warped_error_map(images[t : t + 1], images[t - 1 : t], motion)
            found = float(masked_mean(error, there))
            assert found == pytest.approx(expected[name][t - 1], abs=1e-7)


def test_squared_warped_error_of_the_oracle(
    recipe: SimpleNamespace, oracle: Oracle, device: torch.device
) -> None:
    images = frames(recipe, device, distort=True)
    motion = pan(images.shape[-2:], device)
    for t, expected in enumerate(oracle("temporal")["warped_error"]["mse_test"], start=1):
        error = warped_error_map(images[t : t + 1], images[t - 1 : t], motion).square()
        assert float(masked_mean(error, inside_frame(motion))) == pytest.approx(expected, abs=1e-8)


def test_a_reference_that_only_moves_leaves_the_error_of_the_test(
    recipe: SimpleNamespace, device: torch.device
) -> None:
    """Where the reference's own warped error is 0, the two measures agree."""
    test, ref = (frames(recipe, device, distort=d) for d in (True, False))
    motion = pan(test.shape[-2:], device)
    there = inside_frame(motion)
    pair = test[1:2], ref[1:2], test[:1], ref[:1]
    change = masked_mean(temporal_change_map(*pair, motion), there)
    raw = masked_mean(warped_error_map(test[1:2], test[:1], motion), there)
    assert float(change) == pytest.approx(float(raw), abs=1e-6)


def test_tpsnr_of_the_oracle(recipe: SimpleNamespace, oracle: Oracle, device: torch.device) -> None:
    test, ref = (frames(recipe, device, distort=d) for d in (True, False))
    for t, expected in enumerate(oracle("temporal")["tPSNR"]["per_pair"], start=1):
        found = psnr(test[t : t + 1] - test[t - 1 : t], ref[t : t + 1] - ref[t - 1 : t])
        assert float(found) == pytest.approx(expected, abs=1e-4)


def test_tlp_of_the_oracle(recipe: SimpleNamespace, oracle: Oracle, device: torch.device) -> None:
    try:
        network = Lpips.load(device=device)
    except MetricUnavailableError as error:
        pytest.skip(str(error))
    expected = oracle("temporal")["tLP"]
    steps = []
    for distort in (False, True):
        images = frames(recipe, device, distort=distort).expand(-1, 3, -1, -1)
        with torch.no_grad():
            layers = list(network.layer_distances(images[1:], images[:-1]))
        steps.append(sum(distance.mean((1, 2, 3)) for distance in layers))
    found = 100.0 * (steps[0] - steps[1]).abs()
    assert found.tolist() == pytest.approx(expected["tLP_x100"], abs=2e-3)


def test_an_epi_stacks_rows_in_time() -> None:
    rows = [torch.full((1, 3, 1, 4), float(t)) for t in range(5)]
    picture = stack_rows(rows)
    assert picture.shape == (1, 3, 5, 4)
    assert picture[0, 0, :, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
