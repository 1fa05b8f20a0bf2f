from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.settings import (
    SettingsSource,
    parse_assignments,
    read_toml,
    resolve_settings,
    to_plain,
    to_toml,
)


class Colour(StrEnum):
    RED = "red"
    BLUE = "blue"


class Channels(StrEnum):
    ONE = "1"
    THREE = "3"


@dataclass(frozen=True, kw_only=True)
class Inner:
    rate: float = 0.5
    name: str = "x"


@dataclass(frozen=True, kw_only=True)
class Outer:
    count: int = 3
    flag: bool = False
    colour: Colour = Colour.RED
    channels: Channels = Channels.ONE
    names: tuple[str, ...] = ()
    limit: int | None = None
    inner: Inner = field(default_factory=Inner)


def test_without_sources_the_defaults_hold() -> None:
    assert resolve_settings(Outer) == Outer()


def test_a_later_source_wins_and_tables_merge() -> None:
    first = SettingsSource("file", {"count": 4, "inner": {"rate": 1, "name": "y"}})
    second = SettingsSource(
        "--set", {"inner": {"rate": 0.25}, "colour": "blue", "names": ["a", "b"]}
    )
    resolved = resolve_settings(Outer, first, second)
    assert resolved == Outer(
        count=4, colour=Colour.BLUE, names=("a", "b"), inner=Inner(rate=0.25, name="y")
    )


def test_a_name_of_digits_may_be_read_as_a_number() -> None:
    assert resolve_settings(Outer, parse_assignments(["channels=3"])).channels is Channels.THREE


def test_a_whole_number_serves_as_a_number() -> None:
    rate = resolve_settings(Outer, SettingsSource("s", {"inner": {"rate": 2}})).inner.rate
    assert isinstance(rate, float)
    assert rate == 2.0


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"cuont": 1}, "there is no 'cuont', did you mean 'count'?"),
        ({"inner": {"rat": 1}}, "there is no 'inner.rat', did you mean 'rate'?"),
        ({"count": 1.5}, "count = 1.5: a whole number is wanted"),
        ({"count": True}, "a whole number is wanted"),
        ({"flag": 1}, "true or false is wanted"),
        ({"inner": 3}, "inner is a table of settings"),
        ({"colour": "green"}, "not one of red, blue"),
        ({"names": "a"}, "a list is wanted"),
    ],
)
def test_what_does_not_fit_is_said_with_its_source(values: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        resolve_settings(Outer, SettingsSource("my.toml", values))
    assert said in str(caught.value)
    assert str(caught.value).startswith("my.toml: ")


def test_every_problem_is_listed() -> None:
    with pytest.raises(ConfigError) as caught:
        resolve_settings(
            Outer,
            SettingsSource("a", {"cuont": 1, "flag": 7}),
            SettingsSource("b", {"inner": {"x": 1}}),
        )
    assert all(word in str(caught.value) for word in ("cuont", "flag", "inner.x"))


def test_assignments_are_toml_values_or_texts() -> None:
    source = parse_assignments(["a.b=3", "a.c=[1, 2]", "d=hello", "e = true", "f=1e-4"])
    assert source.values == {"a": {"b": 3, "c": [1, 2]}, "d": "hello", "e": True, "f": 1e-4}


@pytest.mark.parametrize("text", ["nothing", "=3"])
def test_what_is_no_assignment_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="write it as"):
        parse_assignments([text])


def test_a_setting_is_no_table_afterwards() -> None:
    with pytest.raises(ConfigError, match="given a value before"):
        parse_assignments(["a=1", "a.b=2"])


def test_broken_toml_names_file_and_line(tmp_path: Path) -> None:
    path = tmp_path / "run.toml"
    path.write_text("[training]\nsteps = = 3\n")
    with pytest.raises(ConfigError, match=r"run\.toml.*line 2"):
        read_toml(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml"):
        read_toml(tmp_path / "none.toml")


@given(
    st.builds(
        Outer,
        count=st.integers(-10, 10**9),
        flag=st.booleans(),
        colour=st.sampled_from(Colour),
        names=st.lists(st.text(st.characters(codec="ascii"), max_size=5)).map(tuple),
        limit=st.none() | st.integers(0, 9),
        inner=st.builds(Inner, rate=st.floats(-1e9, 1e9), name=st.text(max_size=5)),
    )
)
def test_what_is_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, config: Outer
) -> None:
    path = tmp_path_factory.mktemp("toml") / "c.toml"
    path.write_text(to_toml(to_plain(config)), encoding="utf-8")
    assert resolve_settings(Outer, read_toml(path)) == config
