from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.inspect.readiness import (
    Severity,
    ShotProblem,
    judge_readiness,
    list_single_sources,
    match_resolutions,
)
from rtsr_cli.models import load_system

BICUBIC, TAAU = load_system("bicubic"), load_system("taau")


@pytest.fixture
def reader(
    write_frames: Callable[..., Path], open_folder: Callable[..., FrameReader], tmp_path: Path
) -> FrameReader:
    return open_folder(write_frames(tmp_path / "lr"))


@pytest.fixture
def hr(
    write_frames: Callable[..., Path], open_folder: Callable[..., FrameReader], tmp_path: Path
) -> FrameReader:
    return open_folder(write_frames(tmp_path / "hr", (1, 2), size=(24, 32)))


def test_frames_alone_need_the_scale_unless_it_is_declared(reader: FrameReader) -> None:
    assert judge_readiness(BICUBIC, list_single_sources(reader, None), []).how == "--scale S"
    assert judge_readiness(BICUBIC, list_single_sources(reader, 2), []).how == ""


def test_options_add_up(reader: FrameReader) -> None:
    holes = ShotProblem(text="a gap", gravity=Severity.HOLES)
    found = judge_readiness(BICUBIC, list_single_sources(reader, None), [holes])
    assert (found.ready, found.how) == (True, "--scale S --on-missing skip")


def test_a_refusal_is_what_every_system_lacks(reader: FrameReader) -> None:
    refused = ShotProblem(text="no EXR", gravity=Severity.REFUSED, lacks="readable frames")
    found = judge_readiness(BICUBIC, list_single_sources(reader, 2), [refused, refused])
    assert (found.ready, found.missing) == (False, ("readable frames",))


def test_remarks_and_pixels_keep_nobody_back(reader: FrameReader) -> None:
    problems = [ShotProblem(text=g.name, gravity=g) for g in (Severity.REMARK, Severity.PIXELS)]
    assert judge_readiness(BICUBIC, list_single_sources(reader, 2), problems).how == ""


def test_vectors_that_nothing_decides_are_missing_where_they_are_read(reader: FrameReader) -> None:
    undecided = replace(reader, motion_undecided="a tie")
    assert judge_readiness(BICUBIC, list_single_sources(undecided, 2), []).ready
    found = judge_readiness(TAAU, list_single_sources(undecided, 2), [])
    assert (found.ready, found.missing) == (False, ("a declared motion convention",))


def test_hr_frames_that_are_missing_are_holes_and_of_another_ratio_a_refusal(
    reader: FrameReader, hr: FrameReader
) -> None:
    sources, (problem,) = match_resolutions(reader, hr, None)
    assert problem.gravity is Severity.HOLES
    assert "HR lacks frame 3" in problem.text
    assert judge_readiness(BICUBIC, sources, [problem]).how == "--on-missing skip"
    sources, (problem,) = match_resolutions(reader, hr, 3)
    assert (list(sources), problem.gravity) == ([], Severity.REFUSED)


def test_a_scale_that_a_system_is_not_made_for_is_missing(
    reader: FrameReader, hr: FrameReader
) -> None:
    sources, _ = match_resolutions(reader, hr, None)
    found = judge_readiness(replace(BICUBIC, scales=(3, 4)), sources, [])
    assert found.missing == ("HR frames of 3x or 4x the size of LR's (these are 2x)",)
    found = judge_readiness(replace(BICUBIC, scales=(1,)), sources, [])
    assert found.missing == ("frames of one size: name the folder lr or hr alone",)
