from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame, FrameSequence


def refuse(number: int) -> Frame:
    raise AssertionError(f"frame {number} was loaded")


def sequence(*numbers: int, step: int = 1, cuts: frozenset[int] = frozenset()) -> FrameSequence:
    return FrameSequence(numbers=numbers, load_frame=refuse, step=step, cuts=cuts)


def test_an_unbroken_sequence_is_one_run() -> None:
    assert sequence(3, 4, 5).runs() == [(3, 4, 5)]


def test_a_gap_in_the_numbers_splits_the_run() -> None:
    assert sequence(1, 2, 4, 5, 9).runs() == [(1, 2), (4, 5), (9,)]


def test_a_cut_begins_a_new_run_with_the_frame_it_names() -> None:
    assert sequence(1, 2, 3, 4, cuts=frozenset({3})).runs() == [(1, 2), (3, 4)]


def test_numbers_in_tens_are_one_run_where_a_motion_vector_spans_ten() -> None:
    assert sequence(10, 20, 30, 50, step=10).runs() == [(10, 20, 30), (50,)]
    assert sequence(10, 20, step=1).runs() == [(10,), (20,)]


def test_no_frames_are_no_runs() -> None:
    assert sequence().runs() == []


@pytest.mark.parametrize(
    ("number", "history", "window"),
    [
        (5, 0, (5,)),
        (5, 2, (5, 4, 3)),
        (2, 5, (2, 1)),
        (1, 3, (1,)),
        (8, 3, (8, 7)),
    ],
)
def test_a_window_is_newest_first_and_ends_at_the_start_or_a_gap(
    number: int, history: int, window: tuple[int, ...]
) -> None:
    assert sequence(1, 2, 3, 4, 5, 7, 8).window_numbers(number, history) == window


def test_a_window_does_not_reach_over_a_cut() -> None:
    cut = sequence(1, 2, 3, 4, cuts=frozenset({3}))
    assert cut.window_numbers(4, 3) == (4, 3)
    assert cut.window_numbers(3, 3) == (3,)
    assert cut.window_numbers(2, 3) == (2, 1)


def test_a_window_steps_as_far_as_a_motion_vector() -> None:
    assert sequence(10, 15, 20, 30, step=10).window_numbers(30, 2) == (30, 20, 10)


def test_history_is_valid_for_the_next_number_only() -> None:
    frames = sequence(1, 2, 3, cuts=frozenset({3}))
    assert frames.follows(2, 1)
    assert not frames.follows(2, None)
    assert not frames.follows(1, 2)
    assert not frames.follows(3, 2)


@settings(max_examples=60, deadline=None)
@given(
    numbers=st.sets(st.integers(-30, 60), max_size=25),
    cuts=st.frozensets(st.integers(-30, 60), max_size=5),
    step=st.integers(1, 4),
)
def test_runs_hold_every_number_once_and_never_a_reset_inside(
    numbers: set[int], cuts: frozenset[int], step: int
) -> None:
    runs = sequence(*sorted(numbers), step=step, cuts=cuts).runs()
    assert [n for run in runs for n in run] == sorted(numbers)
    for run in runs:
        assert all(b - a == step for a, b in pairwise(run))
        assert not cuts & set(run[1:])


def test_frames_are_loaded_when_they_are_asked_for_and_not_before() -> None:
    asked: list[int] = []

    def load(number: int) -> Frame:
        asked.append(number)
        raise LookupError

    frames = FrameSequence(numbers=(4, 6, 8), load_frame=load)
    assert len(frames) == 3
    chosen = frames.select({8, 6, 99})
    assert chosen.numbers == (6, 8)
    assert asked == []
    with pytest.raises(LookupError):
        chosen[1]
    assert asked == [8]


def test_a_crop_of_a_frame_remembers_where_it_lies(make_frame: Callable[..., Frame]) -> None:
    depth = torch.arange(20.0).view(1, 1, 4, 5)
    frame = make_frame({Buffer.DEPTH: depth}, lighting_scale=3.5)
    part = frame.crop(1, 2, (3, 3)).crop(1, 0, (1, 2))
    assert (part.view.top, part.view.left, part.view.display) == (2, 2, (4, 5))
    assert part.gbuffer[Buffer.DEPTH].flatten().tolist() == [12.0, 13.0]
    assert part.lighting_scale == 3.5
    assert part.number == frame.number
