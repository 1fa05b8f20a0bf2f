"""What pixels can be, whatever they are called."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rtsr_cli.core.captures.channel_guesses import guess_buffers, guess_material
from rtsr_cli.core.captures.guess_checks import looks_like, proves_distance
from rtsr_cli.core.frames.buffers import Buffer

RNG = np.random.default_rng(0)
COUNT = 500

Values = NDArray[np.float64]

UNITS = RNG.normal(size=(COUNT, 3))
UNITS /= np.linalg.norm(UNITS, axis=1, keepdims=True)
COLOURS = RNG.uniform(0, 1, (COUNT, 3))
MASK = RNG.integers(0, 2, (COUNT, 1)).astype(float)
GREY = np.repeat(RNG.uniform(0, 1, (COUNT, 1)), 3, axis=1)
SKY = np.concatenate([UNITS, np.zeros((COUNT, 3))])


@pytest.mark.parametrize(
    ("buffer", "values"),
    [
        (Buffer.NORMAL, UNITS),
        (Buffer.NORMAL, UNITS * 0.5 + 0.5),
        (Buffer.NORMAL, SKY),
        (Buffer.ALBEDO, COLOURS),
        (Buffer.ROUGHNESS, GREY),
        (Buffer.ROUGHNESS, GREY[:, :1]),
        (Buffer.METALLIC, np.zeros((COUNT, 1))),
        (Buffer.MOTION, RNG.normal(size=(COUNT, 2))),
        (Buffer.MOTION, np.pad(RNG.normal(size=(COUNT, 2)), ((0, 0), (0, 1)))),
        (Buffer.DEPTH, RNG.uniform(1, 90, (COUNT, 1))),
        (Buffer.COLOR, COLOURS * 30),
        (Buffer.OBJECT_ID, np.arange(COUNT, dtype=float)[:, None]),
        (Buffer.POSITION, RNG.normal(size=(COUNT, 3)) * 9),
    ],
)
def test_what_a_buffer_holds_is_believed(buffer: Buffer, values: Values) -> None:
    assert looks_like(buffer, values)


@pytest.mark.parametrize(
    ("buffer", "values"),
    [
        (Buffer.ROUGHNESS, COLOURS),
        (Buffer.METALLIC, COLOURS),
        (Buffer.DEPTH, COLOURS),
        (Buffer.DEPTH, MASK),
        (Buffer.ROUGHNESS, GREY * 40),
        (Buffer.ROUGHNESS, np.zeros((COUNT, 1))),
        (Buffer.MOTION, UNITS),
        (Buffer.MOTION, UNITS * 0.5 + 0.5),
        (Buffer.MOTION, np.zeros((COUNT, 2))),
        (Buffer.NORMAL, COLOURS),
        (Buffer.NORMAL, np.zeros((COUNT, 3))),
        (Buffer.ALBEDO, COLOURS * 30),
        (Buffer.ALBEDO, UNITS),
        (Buffer.COLOR, UNITS),
        (Buffer.OBJECT_ID, GREY),
        (Buffer.POSITION, UNITS),
        (Buffer.COLOR, np.zeros((0, 3))),
    ],
)
def test_what_contradicts_a_name_is_no_guess(buffer: Buffer, values: Values) -> None:
    assert not looks_like(buffer, values)


def test_a_name_that_is_contradicted_gives_way_to_what_only_one_buffer_looks_like() -> None:
    channels = {"shot": ["NormalVector.X", "NormalVector.Y", "NormalVector.Z"]}
    assert set(guess_buffers(channels)) == {Buffer.MOTION}
    assert set(guess_buffers(channels, lambda b, _: b is Buffer.NORMAL)) == {Buffer.NORMAL}
    assert guess_buffers(channels, lambda b, _: b is Buffer.COLOR) == {}


def test_light_is_no_surface() -> None:
    assert guess_buffers({"shot": [f"DiffuseDirect.{c}" for c in "RGB"]}) == {}


def test_material_is_the_only_two_colours_that_can_be_meant() -> None:
    names = [f"{layer}.{c}" for layer in ("DiffCol", "GlossCol") for c in "RGB"]
    assert guess_material({"shot": names}) == "DiffCol.RGB + GlossCol.RGB"
    assert guess_material({"shot": names[:3]}) == ""
    assert guess_material({"shot": names}, lambda *_: False) == ""
    twice = [*names, *(f"SpecColor.{c}" for c in "RGB")]
    assert guess_material({"shot": twice}) == ""


ROWS, COLUMNS = np.mgrid[0:48, 0:64].astype(float)
FLOOR = 40.0 / (ROWS + 4.0)
"""Distances of a floor, far away at the top."""


@pytest.mark.parametrize(
    "plane",
    [FLOOR, np.where(ROWS < 20, 0.0, FLOOR), np.where(ROWS < 20, 65504.0, FLOOR)],
    ids=["floor", "sky of 0", "sky far away"],
)
def test_distances_prove_themselves(plane: NDArray[np.float64]) -> None:
    assert proves_distance(plane)


@pytest.mark.parametrize(
    "plane",
    [
        FLOOR / 20.0,
        np.ones_like(FLOOR) * 3.3,
        np.round(FLOOR),
        -FLOOR,
        RNG.uniform(0.0, 9.0, FLOOR.shape),
        np.zeros_like(FLOOR),
    ],
    ids=["shares", "constant", "numbers of objects", "below 0", "noise", "nothing"],
)
def test_what_may_be_something_else_does_not(plane: NDArray[np.float64]) -> None:
    assert not proves_distance(plane)


def test_a_name_with_z_hints_at_depth_and_gives_way_to_one_that_says_it() -> None:
    both = {"shot": ["Zeta", "SceneDepth"]}
    assert guess_buffers(both)[Buffer.DEPTH] == ("SceneDepth",)
    assert guess_buffers({"shot": ["Zeta"]}) == {Buffer.DEPTH: ("Zeta",)}
    # of two that are as likely neither is offered
    assert guess_buffers({"shot": ["Zeta", "zFar"]}) == {}


@pytest.mark.parametrize("name", ["fuzz", "motion.Z", "hazard", "roughnessZ"])
def test_other_names_do_not_hint_at_depth(name: str) -> None:
    assert Buffer.DEPTH not in guess_buffers({"shot": [name]})
