"""What digits leave: halves, halves less a constant, singles, coarse steps."""

from __future__ import annotations

import pytest
import torch

from rtsr_cli.core.captures.measuring.camera_rounding import find_step, measure_rounding

MEANT = torch.linspace(-0.03, 0.031, 997, dtype=torch.float64)


def test_halves_are_off_by_their_digits_and_singles_by_theirs() -> None:
    for stored in (MEANT.half().float(), MEANT.float()):
        off = (stored.double() - MEANT).abs()
        allowed = measure_rounding(stored)
        assert bool((off <= allowed + 1e-12).all())
        assert float(allowed.max()) < 4.0 * float(off.max())


def test_halves_around_a_half_are_off_by_the_steps_there() -> None:
    """As Unreal's velocities: 2 x - 1 of a half float."""
    stored = 2.0 * (0.5 + 0.5 * MEANT).half().float() - 1.0
    off = (stored.double() - MEANT).abs()
    allowed = measure_rounding(stored)
    assert bool((off <= allowed + 1e-12).all())
    assert float(off.max()) > 2e-4
    assert float(allowed.max()) < 3.0 * float(off.max())


def test_few_numbers_have_no_step() -> None:
    """Walls that move alike are no coarse digits."""
    assert find_step(torch.tensor([5.0, 2.5, 0.0]).repeat(50)) == 0.0
    assert find_step(torch.arange(100) * 0.25) == 0.25
    assert find_step(torch.rand(100)) == 0.0


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_what_is_not_finite_is_off_by_nothing(value: float) -> None:
    stored = torch.tensor([value, 1.0, 2.0])
    assert measure_rounding(stored).isfinite().all()
    assert float(measure_rounding(torch.full((3,), value)).max()) == 0.0
