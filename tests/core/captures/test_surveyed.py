"""Values of surveyed frames, and of others when they are asked for."""

from __future__ import annotations

import pytest

from rtsr_cli.core.captures.surveyed import SurveyedValues, list_needed
from rtsr_cli.core.frames.selection import Selection


def test_others_are_made_once_and_only_when_asked_for() -> None:
    made = []

    def make(number: int) -> str:
        made.append(number)
        return str(number)

    values = SurveyedValues({1: "1", 2: "2"}, (3, 4), make)
    assert dict(values) == {1: "1", 2: "2"}
    assert made == []
    assert (values[4], values.get(4), values[1]) == ("4", "4", "1")
    assert made == [4]
    assert values.get(5, "none") == "none"
    with pytest.raises(KeyError):
        values[5]


@pytest.mark.parametrize(
    ("frames", "step", "needed"),
    [(None, 1, range(1, 9)), ({2}, 1, [1, 2, 3]), ({2, 4}, 2, range(1, 7)), ({99}, 1, range(1, 9))],
)
def test_what_is_needed_ends_a_step_after_the_last_selected_frame(
    frames: set[int] | None, step: int, needed: list[int]
) -> None:
    selection = Selection(frames=None if frames is None else frozenset(frames))
    assert list(list_needed(range(1, 9), selection, step)) == list(needed)
