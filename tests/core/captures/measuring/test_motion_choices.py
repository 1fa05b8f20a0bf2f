from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.measuring.motion_choices import describe_distrust, describe_undecided
from rtsr_cli.core.captures.measuring.motion_finding import MotionCandidate, MotionFinding
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.frames.motion import MotionConvention, MotionDirection, MotionUnit, YAxis

UV = MotionConvention(unit=MotionUnit.UV, scale=2.0, zero=0.5)


@pytest.fixture
def reader(
    write_frames: Callable[..., Path], open_folder: Callable[..., FrameReader], tmp_path: Path
) -> FrameReader:
    return open_folder(write_frames(tmp_path))


def tie(*readings: tuple[MotionConvention, float]) -> MotionFinding:
    candidates = [
        MotionCandidate(convention=c, error=e, margin=0.0, significance=0.1, offsets_px=())
        for c, e in readings
    ]
    return MotionFinding(candidates=tuple(candidates), unmoved_error=1.0, moving=1.0, triples=(1,))


def test_what_is_read_and_not_relied_upon_comes_with_the_line_that_declares_it() -> None:
    forth = replace(UV, direction=MotionDirection.NEXT_MINUS_CURRENT)
    finding = tie((UV, 0.1), (forth, 0.11))
    text = describe_distrust(forth, finding, declared=False)
    line = text.removeprefix("if it is right as it is read: ").partition(" at the head")[0]
    assert tomllib.loads(line)["motion"]["direction"] == "next-minus-current"
    unfit = describe_distrust(replace(UV, scale=1.0), finding, declared=False)
    assert "do not show which reading of it is right: name the system" in unfit
    assert "name the system" in describe_distrust(UV, finding, declared=True)


def choices(text: str) -> list[str]:
    return [line.strip() for line in text.splitlines() if line.startswith("    ")]


def test_choices_can_be_pasted_into_a_capture(reader: FrameReader) -> None:
    forth = replace(UV, direction=MotionDirection.NEXT_MINUS_CURRENT)
    text = describe_undecided(reader, tie((UV, 0.1), (forth, 0.11)))
    assert text.startswith("the motion vectors can be read in ways that fit equally well")
    read = [
        CaptureDeclaration.model_validate(tomllib.loads(f"{line}\n[depth]\n")).motion.declared()
        for line in choices(text)
    ]
    assert [replace(MotionConvention(), **fields) for fields in read] == [UV, forth]


def test_choices_that_differ_by_file_all_name_it(reader: FrameReader) -> None:
    text = describe_undecided(reader, tie((UV, 0.1), (replace(UV, file_offset=1), 0.1)))
    assert ["file_offset = 0}" in line for line in choices(text)] == [True, False]
    assert "file_offset = 1}" in choices(text)[1]


def test_no_sense_is_asked_of_a_vertical_component_that_is_zero(reader: FrameReader) -> None:
    back = replace(UV, direction=MotionDirection.CURRENT_MINUS_PREVIOUS)
    up, back_up = (replace(c, y_axis=YAxis.UP) for c in (UV, back))
    text = describe_undecided(reader, tie((UV, 0.1), (up, 0.1), (back, 0.2), (back_up, 0.21)))
    listed = choices(text)
    assert len(listed) == 3
    assert [line.endswith("zero everywhere: either y_axis") for line in listed] == [
        True,
        False,
        False,
    ]
    assert tomllib.loads(listed[0])["motion"]["y_axis"] == "down"


def test_what_cannot_be_measured_gets_an_example(reader: FrameReader) -> None:
    text = describe_undecided(reader, None)
    assert "fewer than two frames" in text
    (line,) = choices(text)
    assert tomllib.loads(line)["motion"]["direction"] == "previous-minus-current"
