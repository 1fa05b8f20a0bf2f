"""Texts that others wrote, read within `limits`: TOML, JSON and plain text.

Everything that is wrong with such a file ends in one `DocumentError`.
"""

from __future__ import annotations

import json
import re
import stat
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rtsr_cli.core.limits import (
    LARGEST_WHOLE,
    MIB,
    MOST_DEPTH,
    MOST_LETTERS,
    MOST_TEXT_BYTES,
    MOST_TOML_BYTES,
    MOST_VALUES,
)

TOO_DEEP = f"is nested more than {MOST_DEPTH} levels deep"

UNDOTTED = re.compile(r'"(?:[^"\\]|\\.)*"|\'[^\']*\'')
"""Texts in quotes, whose dots part no key."""

KEY_LETTERS = re.compile(r"[^\w\-. \t]+")
"""What stands between keys."""


class DocumentError(ValueError):
    """What is wrong with a text, in words that follow the file's name and a colon."""


def check_regular(path: Path) -> int:
    """Hold a path to lead to a regular file, as others never end; return its size.

    Raises:
        DocumentError: it is a pipe, a device, a folder, or not there.
    """
    try:
        status = path.stat()
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise DocumentError(f"cannot be read ({why})") from error
    if not stat.S_ISREG(status.st_mode):
        raise DocumentError("is no regular file")
    return status.st_size


def read_text(
    path: Path, most: int = MOST_TEXT_BYTES, kind: str = "text", *, pipes: bool = False
) -> str:
    """Read a text of at most so many bytes; of a pipe only where a user may have named one.

    Raises:
        DocumentError: it cannot be read, is larger, no UTF-8, or holds NUL, as no text does.
    """
    if not (pipes and path.is_fifo()):
        check_regular(path)
    try:
        with path.open("rb") as file:
            content = file.read(most + 1)
    except OSError as error:
        raise DocumentError(f"cannot be read ({error.strerror or error})") from error
    if len(content) > most:
        raise DocumentError(f"is larger than {most / MIB:g} MiB, the most that is read of one")
    if b"\0" in content:
        raise DocumentError(f"is not valid {kind}: byte {content.index(bytes(1))} is NUL")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DocumentError(f"is not valid {kind}: byte {error.start} is no UTF-8") from error


def parse_json(text: str) -> Any:
    """Parse JSON.

    Raises:
        DocumentError: it is none, or nested too deeply, or holds too many values.
    """
    if sum(map(text.count, ",[{")) > MOST_VALUES:
        raise DocumentError(f"holds more than {MOST_VALUES} values")
    try:
        content = json.loads(text)
    except RecursionError as error:
        raise DocumentError(TOO_DEEP) from error
    except ValueError as error:
        raise _explain_unparsed(error, "JSON") from error
    check_content(content)
    return content


def parse_toml(text: str) -> dict[str, Any]:
    """Parse TOML.

    Raises:
        DocumentError: it is none, or nested too deeply.
    """
    # the parser's time grows with the square of a key's parts
    if any(_count_parts(line) > MOST_DEPTH for line in text.split("\n")):
        raise DocumentError(TOO_DEEP)
    try:
        content = tomllib.loads(text)
    except RecursionError as error:
        raise DocumentError(TOO_DEEP) from error
    except ValueError as error:
        raise _explain_unparsed(error, "TOML") from error
    check_content(content)
    return content


def _count_parts(line: str) -> int:
    """Parts of the longest dotted key of a line, 0 where it has fewer dots than would matter."""
    if line.count(".") < MOST_DEPTH:
        return 0
    keys = KEY_LETTERS.split(UNDOTTED.sub("x", line))
    return max(sum(1 for part in key.split(".") if part.strip()) for key in keys)


def _explain_unparsed(error: ValueError, kind: str) -> DocumentError:
    """Say why a parser gave up, without what Python advises programmers of long numbers."""
    why = shorten_value(str(error).partition("; use sys.")[0], 3 * MOST_LETTERS)
    return DocumentError(f"is not valid {kind}: {why}")


def read_json(path: Path) -> Any:
    """Read a file of JSON.

    Raises:
        DocumentError: see `read_text` and `parse_json`.
    """
    return parse_json(read_text(path, kind="JSON"))


def read_toml_text(path: Path) -> dict[str, Any]:
    """Read a file of TOML.

    Raises:
        DocumentError: see `read_text` and `parse_toml`.
    """
    return parse_toml(read_text(path, MOST_TOML_BYTES, "TOML"))


def check_content(content: object) -> None:
    """Hold parsed content to a depth, so that walking it ends, and numbers to a length.

    Raises:
        DocumentError: it is deeper, or one is longer.
    """
    level: list[object] = [content]
    for _ in range(MOST_DEPTH + 1):
        if any(isinstance(value, int) and abs(value) > LARGEST_WHOLE for value in level):
            raise DocumentError("holds a whole number of too many digits")
        level = [inner for value in level for inner in _list_held(value)]
        if not level:
            return
    raise DocumentError(TOO_DEEP)


def _list_held(value: object) -> Iterable[object]:
    """What a table or list holds."""
    if isinstance(value, Mapping):
        return value.values()
    return value if isinstance(value, list) else ()


def describe_value(value: object) -> str:
    """Write a value for a message, in short; numbers of any length, lists of any size."""
    if isinstance(value, str):
        return shorten_value(repr(value[: MOST_LETTERS + 1]))
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and abs(value) >= 10**MOST_LETTERS:
        return "a number of very many digits"
    if isinstance(value, list | tuple):
        return shorten_value(f"[{', '.join(map(describe_value, value[:MOST_LETTERS]))}]")
    if isinstance(value, Mapping):
        first = list(value.items())[:MOST_LETTERS]
        pairs = (f"{describe_value(key)}: {describe_value(held)}" for key, held in first)
        return shorten_value(f"{{{', '.join(pairs)}}}")
    return shorten_value(repr(value))


def shorten_value(text: str, most: int = MOST_LETTERS) -> str:
    """Cut what would not fit into a line with the rest of the message."""
    return text if len(text) <= most else f"{text[: most - 3]}..."
