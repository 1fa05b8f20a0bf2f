"""Runs of frames are cut into parts such that no sample is lost and none comes twice."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rtsr_cli.core.training.clip_parts import cut_run
from rtsr_cli.core.training.clip_recording import list_recorded_inputs
from rtsr_cli.models import load_system


@pytest.mark.parametrize("system", ["fusesr-fast", "fusesr", "nsrd"])
@pytest.mark.parametrize("frames", [1, 3, 7, 8, 9, 16, 23])
def test_every_sample_lies_in_one_part_with_its_history(system: str, frames: int) -> None:
    chosen = load_system(system)
    wanted = list_recorded_inputs(chosen, chosen.config(), 4)
    run = range(10, 10 + frames)
    samples = []
    for numbers, targets in cut_run(run, 8, history=wanted.history, unroll=wanted.unroll):
        for first in range(targets, len(numbers) - wanted.unroll + 1):
            held = numbers[max(0, first - wanted.history) : first + wanted.unroll]
            begin = run.index(numbers[first])
            assert tuple(held) == tuple(run[max(0, begin - wanted.history) : begin + wanted.unroll])
            samples.append(numbers[first])
    assert samples == list(run[: max(0, frames - wanted.unroll + 1)])


def test_parts_are_never_too_short_for_a_sample() -> None:
    chosen = load_system("nsrd")
    wanted = replace(list_recorded_inputs(chosen, chosen.config(), 4), unroll=6)
    lengths = [
        len(numbers)
        for numbers, _ in cut_run(range(20), 1, history=wanted.history, unroll=wanted.unroll)
    ]
    assert min(lengths[:-1]) >= wanted.unroll
