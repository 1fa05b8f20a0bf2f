from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtsr_cli.core.captures.buffer_expressions import (
    is_expression,
    name_sums,
    parse_expression,
    write_sum,
)
from rtsr_cli.core.captures.layouts import ChannelSum
from rtsr_cli.core.frames.buffers import Buffer


def listed(component: ChannelSum) -> tuple[list[tuple[float, str, str]], float]:
    terms = [(t.factor, t.place.file, t.place.channel) for t in component.terms]
    return terms, component.constant


def test_a_sum_has_a_channel_of_each_name_in_every_component() -> None:
    found = parse_expression("Diffuse Color.RGB + Glossy Color.RGB", 3)
    assert [listed(component) for component in found] == [
        ([(1.0, "*", f"Diffuse Color.{c}"), (1.0, "*", f"Glossy Color.{c}")], 0.0) for c in "RGB"
    ]
    assert [[t.column for t in component.terms] for component in found] == [[1, 21]] * 3


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.5", ([], 0.5)),
        ("1 - smoothness.R", ([(-1.0, "*", "smoothness.R")], 1.0)),
        ("2 * a.R - 1", ([(2.0, "*", "a.R")], -1.0)),
        ("a.R * 2 * 0.25", ([(0.5, "*", "a.R")], 0.0)),
        ("- a.R", ([(-1.0, "*", "a.R")], 0.0)),
        ("-1 * a.R + 3", ([(-1.0, "*", "a.R")], 3.0)),
        ("mask:A + fog:A", ([(1.0, "mask", "A"), (1.0, "fog", "A")], 0.0)),
        ("Depth-left.Z + 1", ([(1.0, "*", "Depth-left.Z")], 1.0)),
        ("'Key - rim.R' + 1", ([(1.0, "*", "Key - rim.R")], 1.0)),
        ("Bob's light.R + 1", ([(1.0, "*", "Bob's light.R")], 1.0)),
    ],
)
def test_what_one_component_is(text: str, expected: object) -> None:
    assert is_expression(text)
    assert listed(parse_expression(text, 1)[0]) == expected


@pytest.mark.parametrize(
    ("text", "channels", "ends"),
    [
        ("a.RGB", 3, "RGB"),
        ("a.BGR", 3, "BGR"),
        ("a.RRR", 3, "RRR"),
        ("a.ZYX", 3, "ZYX"),
        ("a.XY", 2, "XY"),
        ("a.GA", 2, "GA"),
        ("a.A", 1, "A"),
        ("file:RGB", 3, "RGB"),
    ],
)
def test_letters_at_the_end_of_a_name_are_a_channel_each(
    text: str, channels: int, ends: str
) -> None:
    found = parse_expression(text, channels)
    assert [c.terms[0].place.channel[-1] for c in found] == list(ends)


def test_the_name_of_a_buffer_of_one_channel_is_whole() -> None:
    assert parse_expression("rgb", 1)[0].terms[0].place.channel == "rgb"


@pytest.mark.parametrize(
    ("text", "channels", "message"),
    [
        ("a.RGB + ", 3, "column 8: a channel or a number is missing after '\\+'"),
        ("* a.R", 1, "column 1: a channel or a number is missing"),
        ("a.R * b.R", 1, "column 7: channels are added or subtracted, not multiplied"),
        ("(a.R + b.R)", 1, "column 1: there are no parentheses"),
        ("a.R / 2", 1, "column 5: '/' is no operator; multiply"),
        ("'a.R + b", 1, "column 1: a closing ' is missing"),
        ("1 + a.R", 3, "column 5: 'a.R' is 1 channel, the buffer has 3"),
        ("'a' 'b'", 1, r"column 5: an operator \(\+, -, \*\) is missing"),
        ("1e400 * a", 1, "numbers are out of range"),
        (" + ".join(["a"] * 17), 1, "has 17 terms"),
    ],
)
def test_what_cannot_be_read_is_named_with_its_column(
    text: str, channels: int, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        parse_expression(text, channels)


@pytest.mark.parametrize("text", ["a.R", "Diffuse Color.RGB", "Depth-left.Z", "mv*:R", "1-a", ""])
def test_a_name_is_no_expression(text: str) -> None:
    assert not is_expression(text)


TERMS = st.lists(
    st.tuples(
        st.floats(-1e6, 1e6).filter(bool), st.sampled_from(["a.R", "b c.G", "x - y.B", "1", "f:X"])
    ),
    min_size=1,
    max_size=4,
)


@given(TERMS, st.floats(-1e6, 1e6))
def test_what_is_written_reads_as_it_was(terms: list[tuple[float, str]], constant: float) -> None:
    read = parse_expression(write_sum(terms, constant), 1)[0]
    names = [
        (t.factor, (t.place.file + ":" if t.place.file != "*" else "") + t.place.channel)
        for t in read.terms
    ]
    assert names == terms
    assert read.constant == constant


@given(st.text(st.sampled_from("ab.RGB' +-*/()1e:"), max_size=20), st.integers(1, 3))
def test_any_text_is_read_or_refused(text: str, channels: int) -> None:
    try:
        found = parse_expression(text, channels)
    except ValueError:
        return
    assert len(found) == channels


def test_a_layout_names_sums_that_are_tried_in_order() -> None:
    components = name_sums(Buffer.MATERIAL, "material.RGB", "a.RGB + b.RGB")
    assert len(components) == 3
    assert [len(components[0].sum_of(turn).terms) for turn in (0, 1)] == [1, 2]
