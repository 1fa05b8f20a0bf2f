"""Which frames are judged where some are stamped as predicted."""

from __future__ import annotations

import pytest

from rtsr_cli.core.evaluation.predicted_frames import list_between
from rtsr_cli.core.evaluation.score_summary import summarise_frames
from rtsr_cli.core.files.provenance import PAST, read_past
from rtsr_cli.core.frames.cadence import FULL_PAST, count_past
from rtsr_cli.core.frames.selection import Selection


def facts(psnr: float, past: int | None) -> dict[str, object]:
    own = {} if past is None else {"past": past}
    return {"psnr": psnr, "nonfinite": 0, "counted": True, "regions": {}, **own}


def test_frames_between_judged_ones_go_with_the_part_that_they_follow() -> None:
    there = {"test": set(range(1, 9)), "ref": set(range(1, 9))}
    available, nothing = (2, 4, 6, 8), Selection()
    assert list_between(there, (2, 4), available, nothing) == (1, 3, 5)
    assert list_between(there, (6, 8), available, nothing) == (7,)
    chosen = Selection(frames=frozenset({2, 3, 4}))
    assert list_between(there, (2, 4), available, chosen) == (3,)


def test_history_counts_rendered_frames_since_the_last_cut() -> None:
    runs = [(1, 2, 3, 4, 5, 6, 7, 8, 9, 10), (11, 12)]
    past = count_past(runs, frozenset(range(1, 12, 2)))
    assert [past[n] for n in (2, 4, 6, 8, 12)] == [1, 2, 3, 3, 1]
    assert past[11] == 0
    assert max(past.values()) == FULL_PAST


@pytest.mark.parametrize(
    ("told", "known"),
    [(2, 2), ("3", 3), ("", None), ("two", None), ("9" * 40, None), (-1, None)],
)
def test_a_count_that_is_none_is_none(told: object, known: int | None) -> None:
    assert read_past({PAST: told}) == known
    assert read_past({}) is None


def test_frames_with_full_history_are_averaged_apart() -> None:
    frames = {"2": facts(20.0, 1), "4": facts(22.0, 2), "6": facts(30.0, 3), "8": facts(32.0, 3)}
    history = summarise_frames(frames)["history"]
    assert history["full"]["frames"] == [6, 8]
    assert history["full"]["mean"] == {"psnr": 31.0}
    assert history["less"]["mean"] == {"psnr": 21.0}
    assert "history" not in summarise_frames({"1": facts(20.0, None)})
