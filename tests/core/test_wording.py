"""Counts and lists in sentences: one is no several."""

from __future__ import annotations

import pytest

from rtsr_cli.core.wording import join_names, say_count, say_missing, say_once, say_verb


@pytest.mark.parametrize(
    ("count", "said"), [(0, "0 values are"), (1, "1 value is"), (2, "2 values are")]
)
def test_one_thing_is_and_several_are(count: int, said: str) -> None:
    assert f"{say_count(count, 'value')} {say_verb(count)}" == said


def test_names_are_joined() -> None:
    assert join_names(["a", "b", "c"]) == "a, b and c"
    assert say_missing(["a"]) == "buffer 'a' is missing"
    assert say_missing(["a", "b"]) == "buffers 'a' and 'b' are missing"


def test_what_two_say_alike_is_said_once_with_both_measurements() -> None:
    said = {
        "lr": ["5.1% of 'depth' in frames 1-3", "roughness is 0", "alone"],
        "hr": ["roughness is 0", "5.0% of 'depth' in frames 1-3", "other"],
    }
    assert say_once(said) == [
        (("lr", "hr"), "5.1% (hr: 5.0%) of 'depth' in frames 1-3"),
        (("lr", "hr"), "roughness is 0"),
        (("lr",), "alone"),
        (("hr",), "other"),
    ]


@pytest.mark.parametrize(
    "texts",
    [
        ("5.1% of frame 1", "5.1% of frame 2"),
        ('0.5% (capture.toml: normal = "3.33 * N.XYZ")', '0.5% (capture.toml: normal = "1.0 * N")'),
        ("buffer a, 1.5 m", "buffer b, 1.5 m"),
    ],
)
def test_other_frames_lines_and_words_are_said_by_each(texts: tuple[str, str]) -> None:
    lr, hr = texts
    assert say_once({"lr": [lr], "hr": [hr]}) == [(("lr",), lr), (("hr",), hr)]
