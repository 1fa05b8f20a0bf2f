"""Means, intervals and merging of scores."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.evaluation.score_summary import (
    FrameScores,
    group_by_method,
    harmonic_mean,
    merge_results,
    pooled_mean,
    score_interval,
    summarise_frames,
)


def facts(
    number: int, psnr: float | None, *, counted: bool = True, sky: float | None = None
) -> Any:
    return FrameScores(
        number=number,
        scores={"psnr": psnr},
        regions={
            "all": {"share": 1.0, "psnr": psnr},
            "sky": None if sky is None else {"psnr": sky},
        },
        nonfinite=number,
        counted=counted,
    ).facts()


def test_infinite_values_are_left_out_unless_all_are() -> None:
    assert pooled_mean([math.inf, 20.0, 30.0]) == 25.0
    assert pooled_mean([math.inf, math.inf]) == math.inf
    assert pooled_mean([None, None]) is None
    assert pooled_mean([None, 4.0]) == 4.0


def test_an_interval_holds_the_mean_and_narrows_with_more_frames() -> None:
    few, many = ([20.0 + (i * 7) % 5 for i in range(n)] for n in (6, 200))
    low, high = score_interval(few) or (0.0, 0.0)
    assert low < pooled_mean(few) < high  # type: ignore[operator]
    tight = score_interval(many) or [0.0, 0.0]
    assert tight[1] - tight[0] < (high - low) / 2
    assert score_interval([30.0, 31.0]) is None


def test_intervals_of_independent_frames_hold_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(5)
    for count in (3, 4, 5, 6, 8, 12, 16, 24, 32, 60):
        found = [score_interval(list(rng.normal(size=count))) or [1.0, 1.0] for _ in range(2000)]
        share = sum(low <= 0.0 <= high for low, high in found) / len(found)
        # a correlation that chance shows widens them a little, so that they hold it more often
        assert 0.93 <= share <= 0.97, (count, share)


def test_the_interval_of_correlated_frames_is_wider_than_of_shuffled_ones() -> None:
    slow = [20.0 + 5.0 * (i >= 32) for i in range(64)]
    mixed = [20.0 + 5.0 * (i % 2) for i in range(64)]
    wide, narrow = score_interval(slow), score_interval(mixed)
    assert wide is not None
    assert narrow is not None
    assert wide[1] - wide[0] > 1.5 * (narrow[1] - narrow[0])


def test_skipped_frames_are_listed_but_take_no_part_in_means() -> None:
    found = summarise_frames({"1": facts(1, 10.0, counted=False), "2": facts(2, 30.0)})
    assert found["mean"] == {"psnr": 30.0}
    assert list(found["frames"]) == ["1", "2"]
    assert found["nonfinite"] == 3


def test_a_region_that_no_frame_has_is_none_and_one_of_some_frames_their_mean() -> None:
    frames = {"1": facts(1, 10.0), "2": facts(2, 30.0)}
    assert summarise_frames(frames)["regions"]["sky"] is None
    frames["3"] = facts(3, 20.0, sky=44.0)
    assert summarise_frames(frames)["regions"]["sky"] == {"psnr": 44.0}


def test_methods_are_averaged_over_shots_of_any_length() -> None:
    tests = {
        "a/long": {"method": "a", "mean": {"psnr": 20.0}},
        "a/short": {"method": "a", "mean": {"psnr": 40.0}},
    }
    assert group_by_method(tests)["a"]["mean"] == {"psnr": 30.0}
    assert group_by_method(tests)["a"]["shots"] == 2


def part(*numbers: int, border: int = 0) -> dict[str, Any]:
    frames = {str(n): facts(n, 10.0 * n) for n in numbers}
    test = {"method": "a", "shot": "", "notes": [], **summarise_frames(frames)}
    return {"protocol": "rtsr", "options": {"border": border}, "metrics": {}, "tests": {"a": test}}


def test_parts_join_to_what_one_run_gives() -> None:
    joined = merge_results([("1.json", part(3, 4)), ("2.json", part(1, 2))])
    whole = part(1, 2, 3, 4)
    assert joined == whole
    assert list(joined["tests"]["a"]["frames"]) == ["1", "2", "3", "4"]


def test_parts_of_other_rules_or_with_a_frame_twice_are_refused() -> None:
    with pytest.raises(FrameFolderError, match=r"2\.json: was judged with other options"):
        merge_results([("1.json", part(1)), ("2.json", part(2, border=3))])
    with pytest.raises(FrameFolderError, match=r"2\.json: frame 1 of 'a' is in another part"):
        merge_results([("1.json", part(1)), ("2.json", part(1))])


def test_parts_of_other_tests_are_refused() -> None:
    both = part(1)
    both["tests"]["b"] = {**both["tests"]["a"], "method": "b"}
    for parts in ([("1.json", both), ("2.json", part(2))], [("2.json", part(2)), ("1.json", both)]):
        with pytest.raises(FrameFolderError, match=r"2\.json: lacks 'b', which 1\.json has"):
            merge_results(parts)


def shard(index: int, count: int, *numbers: int, frames: str | None = None) -> dict[str, Any]:
    return {**part(*numbers), "shard": {"parts": [index], "of": count, "frames": frames}}


def test_missing_parts_are_noted_until_they_are_there() -> None:
    some = merge_results([("1.json", shard(1, 4, 1)), ("3.json", shard(3, 4, 3))])
    assert some["shard"] == {"parts": [1, 3], "of": 4, "frames": None}
    (note,) = some["tests"]["a"]["notes"]
    assert "parts missing: 2, 4 of 4" in note
    rest = [("2.json", shard(2, 4, 2)), ("4.json", shard(4, 4, 4))]
    assert merge_results([("some.json", some), *rest]) == part(1, 2, 3, 4)


def test_a_part_that_comes_twice_or_of_another_division_is_refused() -> None:
    with pytest.raises(FrameFolderError, match=r"b\.json: part 1/2 is in a\.json already"):
        merge_results([("a.json", shard(1, 2, 1)), ("b.json", shard(1, 2, 1))])
    with pytest.raises(FrameFolderError, match=r"b\.json: is part 2 of 3, a\.json is part 1 of 2"):
        merge_results([("a.json", shard(1, 2, 1)), ("b.json", shard(2, 3, 2))])
    with pytest.raises(
        FrameFolderError, match=r"part 2 of 2 of frames 1-8, a\.json is part 1 of 2;"
    ):
        merge_results([("a.json", shard(1, 2, 1)), ("b.json", shard(2, 2, 2, frames="1-8"))])


def test_notes_of_all_parts_are_kept_once() -> None:
    first, second = part(1), part(2)
    first["tests"]["a"]["notes"] = ["dark"]
    second["tests"]["a"]["notes"] = ["dark", "late"]
    assert merge_results([("1", first), ("2", second)])["tests"]["a"]["notes"] == ["dark", "late"]


def test_vmaf_of_parts_that_do_not_overlap_is_noted() -> None:
    parts = [(str(n), {**part(n), "metrics": {"vmaf": {}}}) for n in (1, 2)]
    assert "standing still" in merge_results(parts)["tests"]["a"]["notes"][0]
    sharded = [(str(n), {**shard(n, 2, n), "metrics": {"vmaf": {}}}) for n in (1, 2)]
    assert merge_results(sharded)["tests"]["a"]["notes"] == []


def test_the_harmonic_mean_is_of_scores_plus_one() -> None:
    # two scores, of whose reciprocals after adding 1, 1/4 and 1/12, the sum is 1/3
    assert harmonic_mean([3.0, None, 11.0]) == pytest.approx(5.0)
    assert harmonic_mean([]) is None
