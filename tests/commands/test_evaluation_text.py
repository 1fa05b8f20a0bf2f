"""The printed table: marks, decimals, what means leave out."""

from __future__ import annotations

import math
from typing import Any

from rtsr_cli.commands.evaluation_text import (
    group_notes,
    list_perfect_frame_lines,
    list_table_lines,
)


def result(**means: list[float | None]) -> dict[str, Any]:
    """Two tests, `a` and `b`, one shot."""
    metrics = {name: {"title": name, "unit": "", "better": "higher"} for name in means}
    tests = {
        test: {"shot": "", "frames": {}, "mean": {n: values[i] for n, values in means.items()}}
        for i, test in enumerate("ab")
    }
    return {"metrics": metrics, "tests": tests}


def cells(found: dict[str, Any]) -> list[list[str]]:
    return [line.split() for line in list_table_lines(found)][1:]


def test_a_column_has_one_number_of_decimals() -> None:
    assert cells(result(psnr=[9.5, 30.0])) == [["a", "9.50"], ["b", "30.00*"]]
    assert cells(result(ssim=[0.5, 0.25])) == [["a", "0.5000*"], ["b", "0.2500"]]
    assert cells(result(psnr=[math.inf, 9.5])) == [["a", "inf*"], ["b", "9.5000"]]


def test_what_is_the_same_for_all_or_no_score_has_no_star() -> None:
    assert cells(result(psnr=[30.0, 30.001])) == [["a", "30.00"], ["b", "30.00"]]
    assert "*" not in str(cells(result(**{"warped-reference": [0.25, 0.5]})))
    assert cells(result(psnr=[30.0, None])) == [["a", "30.00"], ["b", "-"]]


def test_perfect_frames_that_a_mean_leaves_out_are_told() -> None:
    found = result(psnr=[30.0, math.inf])
    values = {"a": (30.0, math.inf, math.inf), "b": (math.inf, math.inf, math.inf)}
    for test, held in values.items():
        frames = {str(i): {"psnr": v, "counted": i > 0} for i, v in enumerate((math.inf, *held))}
        found["tests"][test]["frames"] = frames
    assert list(list_perfect_frame_lines(found)) == [
        "a: the mean of psnr is of 1 of 3 frames; 2 are perfect, their infinite values left out"
    ]


def test_a_note_is_grouped_with_all_tests_that_it_is_of() -> None:
    found = result()
    found["tests"]["a"]["notes"] = ["of both", "of a"]
    found["tests"]["b"]["notes"] = ["of both"]
    assert group_notes(found) == {"of both": ["a", "b"], "of a": ["a"]}
