"""Units of positions: measured numbers are never exactly those that somebody declares."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.measuring.decision import check_position
from rtsr_cli.core.captures.measuring.measured_reader import MeasuredReader
from rtsr_cli.core.pairs.opening import ReadOptions, find_shots_of, measure_set, open_shot


@pytest.fixture(scope="module")
def settled(sample_root: Path) -> MeasuredReader:
    shot = find_shots_of(sample_root, ReadOptions())[0]
    return measure_set(shot.frames, open_shot(shot, sample_root, ReadOptions()), jittered=True)


@pytest.mark.parametrize(("measured", "warned"), [(0.010000001, False), (0.0254, True)])
def test_only_another_unit_contradicts_the_declared_one(
    settled: MeasuredReader, measured: float, warned: bool
) -> None:
    conventions = replace(settled.reader.conventions, position_unit_m=0.01)
    found = replace(
        settled,
        reader=replace(settled.reader, conventions=conventions),
        measured=replace(settled.measured, position_unit_m=measured),
    )
    declared = CaptureDeclaration.model_validate({"position": {"unit": 0.01}})
    said = check_position(found, declared).warnings[len(settled.warnings) :]
    assert len(said) == int(warned)
