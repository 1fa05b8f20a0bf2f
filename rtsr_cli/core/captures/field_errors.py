"""What is wrong with a field of a user's file, in few words, from what pydantic says of it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from rtsr_cli.core.documents import describe_value
from rtsr_cli.core.errors import did_you_mean

KINDS = {
    "int": "a whole number",
    "float": "a number",
    "finite_number": "a finite number",
    "bool": "true or false",
    "string": "text",
    "list": "a list",
    "tuple": "a list",
    "frozen_set": "a list",
    "dict": "a table",
    "model": "a table",
}
"""What a value should be, by how the type of an error begins."""

TEXTS = {
    "greater_than_equal": "{value} is out of range (allowed: {ge:g} or more)",
    "greater_than": "{value} is out of range (allowed: more than {gt:g})",
    "less_than_equal": "{value} is out of range (allowed: {le:g} or less)",
    "less_than": "{value} is out of range (allowed: less than {lt:g})",
    "too_short": "has {actual_length} entries (allowed: {min_length} or more)",
    "too_long": "has {actual_length} entries (allowed: {max_length} or less)",
    "missing": "is missing",
    "string_too_short": "is empty",
    "string_too_long": "{value} is longer than {max_length} letters",
}
"""What is said, by the type of an error."""


def describe_field_error(error: Mapping[str, Any]) -> str:
    """Say what is wrong with a value, and what is allowed.

    Args:
        error: of pydantic's `ValidationError.errors()`.
    """
    kind, context = error["type"], error.get("ctx", {})
    value = describe_value(error["input"])
    if kind in TEXTS:
        return TEXTS[kind].format(value=value, **context)
    if kind in {"enum", "literal_error"}:
        names = re.findall(r"'([^']*)'", context["expected"])
        return f"{value} is not known{did_you_mean(value, names, listed='allowed')}"
    for begin, what in KINDS.items():
        if kind.startswith(begin):
            return f"{value} is not {what}"
    return f"{error['msg'].removeprefix('Value error, ')} (got {value})"
