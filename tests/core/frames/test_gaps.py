from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from rtsr_cli.core.frames.gaps import count_gaps, flatten_gaps, format_gaps, list_gaps

NUMBERS = st.sets(st.integers(-30, 30), max_size=12)


@given(NUMBERS, NUMBERS, st.integers(1, 7))
def test_gaps_are_what_is_known_or_between_in_steps_and_not_there(
    there: set[int], others: set[int], step: int
) -> None:
    known = there | others
    expected = known | set(range(min(known), max(known) + 1, step)) if known else set()
    gaps = list_gaps(there, known, step)
    assert sorted(n for gap in gaps for n in gap) == sorted(expected - there)
    assert count_gaps(gaps) == len(expected - there)
    assert flatten_gaps(gaps) == [n for gap in gaps for n in gap]
    assert len(gaps) <= 2 * len(known) + 2


def test_gaps_are_written_in_short() -> None:
    known = [0, 1, 10**18]
    gaps = list_gaps(known, known, 1)
    assert format_gaps(gaps) == "2-999999999999999999"
    assert flatten_gaps(gaps) == ["2-999999999999999999"]
    assert count_gaps(gaps) == 10**18 - 2
    assert format_gaps(list_gaps([0, 100], [0, 100], 10)) == "10-90x10"
    assert format_gaps(list_gaps([0, 30], [0, 30], 10)) == "10, 20"
    assert format_gaps(list_gaps([-5, 2], [-5, 2], 1)) == "-4..1"
    assert format_gaps(list_gaps([1, 3], [1, 3], 1)) == "2"
