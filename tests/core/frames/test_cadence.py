"""Which frames are rendered, and how far the others look back."""

from __future__ import annotations

import pytest

from rtsr_cli.core.errors import RequestError
from rtsr_cli.core.frames.cadence import Cadence, measure_reach


@pytest.mark.parametrize(
    ("every", "numbers", "step", "rendered"),
    [
        (2, range(1, 8), 1, {1, 3, 5, 7}),
        (3, range(1, 8), 1, {1, 4, 7}),
        (2, range(10, 60, 10), 10, {10, 30, 50}),
        # frame 4 is missing: 5 stays the fifth time step
        (2, (1, 2, 3, 5, 6, 7), 1, {1, 3, 5, 7}),
    ],
)
def test_frames_are_counted_by_number(
    every: int, numbers: range, step: int, rendered: set[int]
) -> None:
    assert Cadence(every=every).list_rendered(tuple(numbers), step) == rendered


def test_rendered_frames_can_be_named() -> None:
    cadence = Cadence(rendered=frozenset({1, 2, 9}))
    assert cadence.list_rendered((1, 2, 3, 4), 1) == {1, 2}


def test_where_every_frame_is_rendered_there_is_nothing_to_predict() -> None:
    with pytest.raises(RequestError, match="none left to predict"):
        Cadence(every=1)


@pytest.mark.parametrize(
    ("numbers", "rendered", "reach"),
    [
        ((1, 2, 3, 4), {1, 3}, 1),
        ((1, 2, 3, 4, 5), {1}, 4),
        ((1, 2, 3, 4, 5), {1, 4}, 2),
        ((1, 2), {1, 2}, 0),
    ],
)
def test_a_predicted_frame_looks_back_to_the_last_rendered_one(
    numbers: tuple[int, ...], rendered: set[int], reach: int
) -> None:
    assert measure_reach(numbers, frozenset(rendered)) == reach


@pytest.mark.parametrize(
    ("numbers", "rendered", "reach"),
    [
        (range(1, 9), {1, 3, 5, 7}, 5),
        (range(1, 9), {1, 4, 7}, 7),
        (range(1, 5), {1, 3}, 3),
        (range(1, 5), {3}, 1),
    ],
)
def test_three_past_frames_lie_farther_back(numbers: range, rendered: set[int], reach: int) -> None:
    assert measure_reach(numbers, frozenset(rendered), past_frames=3) == reach
