"""Why better systems are passed over, in few words."""

from __future__ import annotations

import pytest

from rtsr_cli.core.pairs.sources import DECLARED_MOTION
from rtsr_cli.core.run.default_system import (
    GIVE_HR,
    NO_CAMERA,
    name_together,
    suggest_remedies,
)
from rtsr_cli.models import load_system

TRAINED = {"fusesr", "fusesr-fast"}


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["fusesr", "fusesr-fast"], ["networks"]),
        (["fusesr", "demod-guided", "demod-bicubic"], ["fusesr", "demod-*"]),
        (["fusesr", "fusesr-fast", "demod-guided", "demod-bicubic"], ["demod-*", "networks"]),
        (["demod-guided"], ["demod-guided"]),
    ],
)
def test_systems_are_named_together(names: list[str], said: list[str]) -> None:
    assert name_together([load_system(name) for name in names], TRAINED) == said


def test_a_pattern_covers_no_system_of_which_something_else_is_said() -> None:
    systems = [load_system(name) for name in ("demod-guided", "demod-bicubic")]
    assert name_together(systems, TRAINED, {"demod-temporal"}) == ["demod-guided", "demod-bicubic"]
    assert name_together(systems, TRAINED, {"fusesr", "bicubic"}) == ["demod-*"]


@pytest.mark.parametrize(
    ("lacks", "remedies"),
    [
        (["metallic", "roughness"], ["declare constants or material"]),
        (["albedo", "roughness"], ["declare material"]),
        (["hr frames", "roughness"], [GIVE_HR, "declare constants or material"]),
        (["hr frames", "camera", "motion"], [GIVE_HR, NO_CAMERA, "render or declare the rest"]),
        (["camera of frame 7"], [NO_CAMERA]),
        (["camera", DECLARED_MOTION], [NO_CAMERA, "declare the rest"]),
        (["motion"], ["render or declare it"]),
        (["hr normal"], ["the other size has it: render both alike"]),
        (["hr normal", "camera"], [NO_CAMERA, "render or declare the rest"]),
    ],
)
def test_the_remedies_are_those_of_all_that_is_missing(
    lacks: list[str], remedies: list[str]
) -> None:
    assert list(suggest_remedies(lacks)) == remedies
