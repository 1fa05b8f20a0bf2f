"""All that is wrong with a shot's files stands in one message."""

from __future__ import annotations

from pathlib import Path

import pytest

from rtsr_cli.core.errors import FrameFolderError, LayerChoiceError
from rtsr_cli.core.pairs.file_faults import MOST_FAULTS, naming_every_fault


def test_other_faults_are_added_once() -> None:
    def fail() -> None:
        with naming_every_fault(lambda: ["a is cut", "b is not there"]):
            raise FrameFolderError("a is cut")

    with pytest.raises(FrameFolderError) as caught:
        fail()
    assert str(caught.value) == "a is cut. Also: b is not there"


def test_of_many_faults_the_rest_is_counted() -> None:
    texts = [f"file {n} is cut" for n in range(MOST_FAULTS + 3)]
    with (
        pytest.raises(FrameFolderError, match="And 3 more") as caught,
        naming_every_fault(lambda: texts),
    ):
        raise FrameFolderError(texts[0])
    assert str(caught.value).count("is cut") == MOST_FAULTS


def test_errors_of_a_kind_of_their_own_stay_as_they_are() -> None:
    with pytest.raises(LayerChoiceError, match=r"^choose$"), naming_every_fault(lambda: ["more"]):
        raise LayerChoiceError("choose", ["a"], "color")


def test_nothing_is_asked_where_nothing_fails() -> None:
    def ask() -> list[str]:
        raise AssertionError(Path())

    with naming_every_fault(ask):
        pass
