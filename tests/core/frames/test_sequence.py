from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame, FrameSequence


def sequence(*numbers: int, step: int = 1, cuts: frozenset[int] = frozenset()) -> FrameSequence:
    return FrameSequence(numbers=numbers, step=step, cuts=cuts)


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


def test_what_is_known_of_a_frame_is_found_once_and_not_kept_by_another() -> None:
    gbuffer = GBuffer({Buffer.DEPTH: torch.ones(1, 1, 2, 3)}, "test")
    frame = Frame(number=1, gbuffer=gbuffer, camera=CameraMetadata(), view=View(display=(2, 3)))
    asked: list[int] = []

    def measure(of: Frame) -> int:
        asked.append(of.number)
        return 10 * of.number

    assert [frame.compute_once(measure) for _ in range(3)] == [10, 10, 10]
    assert replace(frame, number=2).compute_once(measure) == 20
    assert asked == [1, 2]
    assert frame == replace(frame)
