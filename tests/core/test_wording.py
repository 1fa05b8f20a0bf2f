"""Counts and lists in sentences: one is no several."""

from __future__ import annotations

import pytest

from rtsr_cli.core.wording import join_names, say_count, say_missing, say_verb


@pytest.mark.parametrize(
    ("count", "said"), [(0, "0 values are"), (1, "1 value is"), (2, "2 values are")]
)
def test_one_thing_is_and_several_are(count: int, said: str) -> None:
    assert f"{say_count(count, 'value')} {say_verb(count)}" == said


def test_names_are_joined() -> None:
    assert join_names(["a", "b", "c"]) == "a, b and c"
    assert say_missing(["a"]) == "buffer 'a' is missing"
    assert say_missing(["a", "b"]) == "buffers 'a' and 'b' are missing"
