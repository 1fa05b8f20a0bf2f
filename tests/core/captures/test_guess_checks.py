"""What pixels can be, whatever they are called."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rtsr_cli.core.captures.channel_guesses import guess_buffers, guess_material
from rtsr_cli.core.captures.guess_checks import looks_like
from rtsr_cli.core.frames.buffers import Buffer

RNG = np.random.default_rng(0)
COUNT = 500

Values = NDArray[np.float64]

UNITS = RNG.normal(size=(COUNT, 3))
UNITS /= np.linalg.norm(UNITS, axis=1, keepdims=True)
COLOURS = RNG.uniform(0, 1, (COUNT, 3))
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
