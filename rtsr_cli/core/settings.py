"""Strict settings: frozen dataclasses filled from TOML files and `--set` options.

Later sources win. Every problem is listed, with the source, the dotted name and a suggestion.
Runs without the libraries that `capture.toml` is checked with, as training has to.
"""

from __future__ import annotations

import json
import types
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from rtsr_cli.core.documents import (
    DocumentError,
    describe_value,
    parse_toml,
    read_toml_text,
    shorten_value,
)
from rtsr_cli.core.errors import ConfigError, did_you_mean

T = TypeVar("T")


@dataclass(frozen=True)
class SettingsSource:
    """Values, nested as tables, and what they come from."""

    name: str
    values: Mapping[str, Any]


class _Problems(list[str]):
    """Everything that is wrong so far."""


def resolve_settings(kind: type[T], *sources: SettingsSource) -> T:
    """Return a dataclass: its defaults, overridden by each source in turn.

    Raises:
        ConfigError: a name is unknown or a value unfit; lists them all.
    """
    problems = _Problems()
    values = _fill_fields(kind, sources, "", problems)
    if problems:
        raise ConfigError("; ".join(problems))
    return kind(**values)


def _fill_fields(
    kind: type[Any], sources: Sequence[SettingsSource], above: str, problems: _Problems
) -> dict[str, Any]:
    hints = get_type_hints(kind)
    known = {field.name: hints[field.name] for field in fields(kind)}
    values: dict[str, Any] = {}
    tables: dict[str, list[SettingsSource]] = {}
    for source in sources:
        for name, value in source.values.items():
            dotted = f"{above}{name}"
            if name not in known:
                hint = did_you_mean(name, known)
                problems.append(f"{source.name}: there is no '{shorten_value(dotted)}'{hint}")
            elif is_dataclass(known[name]):
                if isinstance(value, Mapping):
                    tables.setdefault(name, []).append(SettingsSource(source.name, value))
                else:
                    problems.append(f"{source.name}: {dotted} is a table of settings, not a value")
            else:
                try:
                    values[name] = _convert_value(known[name], value)
                except ValueError as error:
                    problems.append(f"{source.name}: {dotted} = {describe_value(value)}: {error}")
    for name, parts in tables.items():
        nested = known[name]
        values[name] = nested(**_fill_fields(nested, parts, f"{above}{name}.", problems))
    return values


def _convert_value(hint: Any, value: object) -> Any:
    """Bring a value to a field's type.

    Raises:
        ValueError: it does not fit; says what would.
    """
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        return None if value is None else _convert_value(_strip_optional(hint), value)
    if origin is tuple:
        if not isinstance(value, list | tuple):
            raise ValueError("a list is wanted")
        return tuple(_convert_value(get_args(hint)[0], item) for item in value)
    if isinstance(hint, type) and issubclass(hint, StrEnum):
        names = [member.value for member in hint]
        # TOML and `--set` read a name of digits as a number
        text = str(value) if type(value) is int else value
        if text not in names:
            raise ValueError(f"not one of {', '.join(names)}")
        return hint(text)
    return _convert_number(hint, value)


def _strip_optional(hint: Any) -> Any:
    return next(part for part in get_args(hint) if part is not types.NoneType)


def _convert_number(hint: Any, value: object) -> Any:
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is hint:
        return value
    names = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}
    raise ValueError(f"{names.get(hint, hint)} is wanted")


LARGEST_SETTING = 1e9
"""Numbers of settings go so far, where nothing else is said."""


def check_numbers(
    config: Any, table: str, least: Mapping[str, float], most: Mapping[str, float] | None = None
) -> None:
    """Hold numbers of settings to be no smaller, and no larger, than they may be.

    Args:
        config: a dataclass.
        table: what its settings are below, for messages.
        least: name -> smallest value.
        most: name -> largest value; `LARGEST_SETTING` of the others.

    Raises:
        ConfigError: some are not; lists them all.
    """
    ranges = {
        name: (smallest, (most or {}).get(name, LARGEST_SETTING))
        for name, smallest in least.items()
    }
    wrong = [
        f"{table}.{name} = {getattr(config, name):g}: a number from {smallest:g} to {largest:g}"
        for name, (smallest, largest) in ranges.items()
        if not smallest <= getattr(config, name) <= largest
    ]
    if wrong:
        raise ConfigError("; ".join(wrong))


def read_toml(path: Path) -> SettingsSource:
    """Read a file of settings.

    Raises:
        ConfigError: it is not there, or no TOML; names file and line.
    """
    try:
        return SettingsSource(path.name, read_toml_text(path))
    except DocumentError as error:
        raise ConfigError(f"{path}: {error}") from error


def parse_assignments(texts: Sequence[str]) -> SettingsSource:
    """Values of `--set a.b=c`; what is no TOML value is a text.

    Raises:
        ConfigError: a text is no assignment.
    """
    values: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name.strip():
            raise ConfigError(f"--set {shorten_value(text)}: write it as name.of.setting=value")
        *tables, last = name.strip().split(".")
        table = values
        for part in tables:
            table = table.setdefault(part, {})
            if not isinstance(table, dict):
                raise ConfigError(f"--set {shorten_value(text)}: '{part}' was given a value before")
        table[last] = _parse_value(value.strip())
    return SettingsSource("--set", values)


def _parse_value(text: str) -> Any:
    try:
        return parse_toml(f"value = {text}")["value"]
    except (DocumentError, KeyError):
        # what is no value is taken as the text that it is: of a name, a pattern
        return text


def to_plain(config: Any) -> dict[str, Any]:
    """Return settings as plain values: enums by value, None left out."""
    plain: dict[str, Any] = {}
    for field in fields(config):
        value = getattr(config, field.name)
        if is_dataclass(value):
            plain[field.name] = to_plain(value)
        elif isinstance(value, tuple):
            plain[field.name] = [str(v) if isinstance(v, StrEnum) else v for v in value]
        elif value is not None:
            plain[field.name] = value.value if isinstance(value, StrEnum) else value
    return plain


def to_toml(tables: Mapping[str, Any], above: str = "") -> str:
    """Write plain values as TOML: values first, then tables."""
    lines = [f"{k} = {_write_literal(v)}" for k, v in tables.items() if not isinstance(v, Mapping)]
    text = "\n".join(lines) + ("\n" if lines else "")
    for name, table in tables.items():
        if isinstance(table, Mapping):
            text += f"\n[{above}{name}]\n{to_toml(table, f'{above}{name}.')}"
    return text.lstrip("\n") if not above else text


def _write_literal(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_write_literal(item) for item in value)}]"
    if isinstance(value, str):
        # JSON's escapes are TOML's, but for this one control character, which JSON leaves bare
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)
