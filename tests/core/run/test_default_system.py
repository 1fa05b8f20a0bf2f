"""Why better systems are passed over, in few words."""

from __future__ import annotations

import pytest

from rtsr_cli.core.run.default_system import name_together, suggest_remedy
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


@pytest.mark.parametrize(
    ("lacks", "remedy"),
    [
        (["metallic", "roughness"], "declare constants or material"),
        (["albedo", "roughness"], "declare material"),
        (["hr frames", "roughness"], "give G-buffers of the target size"),
        (["camera of frame 7"], "give the cameras"),
        (["motion"], "render or declare"),
        (["hr normal"], "the other size has it: render both alike"),
        (["hr normal", "camera"], "give the cameras"),
    ],
)
def test_the_remedy_is_that_of_what_is_missing(lacks: list[str], remedy: str) -> None:
    assert suggest_remedy(lacks).startswith(remedy)
