"""What two revisions made of one case, held against each other: files, events, text, exit codes."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from PIL import Image
from safetensors.numpy import load_file

TIMES = {"seconds", "time", "elapsed", "wall", "crops_per_second", "samples_per_second"}
STAMPS = {"stamp", "config_hash", "configHash", "version", "versions", "revision"}
ATTRIBUTES = {"rtsr:stamp", "rtsr:configHash", "rtsr:version", "rtsr:revision", "software"}
"""Header attributes that name the program and its settings, not the picture."""

TEXT = (
    (re.compile(r'"steps_per_s": [0-9.e+-]+'), '"steps_per_s": <speed>'),
    (re.compile(r"\b[0-9a-f]{16,64}\b"), "<hash>"),
    (re.compile(r"\b\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d)?\S*"), "<date>"),
    (re.compile(r"\b\d+(\.\d+)? ?(s|ms|seconds|frames/s)\b"), "<time>"),
)
PREVIEW_LEVELS = 1
"""Of 255, that a picture may differ where a tolerance holds."""


@dataclass(frozen=True, kw_only=True)
class Difference:
    """One thing that is not the same.

    Attributes:
        where: file or stream, and what in it.
        what: the difference in words.
        size: largest difference in log(1 + x); infinite where there is no measure.
        allowed: True if it lies within the case's tolerance.
    """

    where: str
    what: str
    size: float = math.inf
    allowed: bool = False


@dataclass(frozen=True, kw_only=True)
class Run:
    """What one revision made of a case.

    Attributes:
        folder: that it ran in.
        tree: of the revision.
        codes: exit codes of its command lines.
        out: standard output.
        err: standard error.
    """

    folder: Path
    tree: Path
    codes: tuple[int, ...]
    out: str
    err: str


def compare(
    before: Run, after: Run, patterns: tuple[str, ...], within: float | None
) -> Iterator[Difference]:
    """Yield what differs."""
    if before.codes != after.codes:
        yield Difference(where="exit codes", what=f"{before.codes} and {after.codes}")
    yield from _streams("stdout", (before, before.out), (after, after.out), within)
    yield from _streams("stderr", (before, before.err), (after, after.err), within)
    names = [_names(run.folder, patterns) for run in (before, after)]
    for name in sorted(names[0] ^ names[1]):
        yield Difference(where=name, what="only before" if name in names[0] else "only after")
    for name in sorted(names[0] & names[1]):
        yield from _files(name, before, after, within)


def _names(folder: Path, patterns: tuple[str, ...]) -> set[str]:
    root = folder / "out" if patterns != ("**/*",) else folder
    paths = (path for pattern in patterns for path in root.glob(pattern))
    return {str(path.relative_to(folder)) for path in paths if path.is_file()}


def _files(name: str, before: Run, after: Run, within: float | None) -> Iterator[Difference]:
    a, b = before.folder / name, after.folder / name
    if a.read_bytes() == b.read_bytes():
        return
    match a.suffix:
        case ".exr":
            yield from _exr(name, a, b, within)
        case ".png":
            yield from _png(name, a, b, within)
        case ".csv":
            yield from _csv(name, a, b, within)
        case ".safetensors":
            yield from _planes(name, load_file(a), load_file(b), within)
        case _:
            texts = [path.read_text("utf-8", errors="replace") for path in (a, b)]
            yield from _streams(name, (before, texts[0]), (after, texts[1]), within)


def _streams(
    where: str, before: tuple[Run, str], after: tuple[Run, str], within: float | None
) -> Iterator[Difference]:
    """Compare text: JSON value by value, other text line by line."""
    texts = [_plain(*before), _plain(*after)]
    if texts[0] == texts[1]:
        return
    values = [_json(text) for text in texts]
    if values[0] is not None and values[1] is not None:
        yield from _values(where, values[0], values[1], within)
        return
    lines = [text.splitlines() for text in texts]
    for index, (a, b) in enumerate(zip(*lines, strict=False), 1):
        if a != b:
            yield Difference(where=f"{where}:{index}", what=f"\n      {a[:600]}\n      {b[:600]}")
    if len(lines[0]) != len(lines[1]):
        yield Difference(where=where, what=f"{len(lines[0])} and {len(lines[1])} lines")


def _plain(run: Run, text: str) -> str:
    """Take out what tells where and when it ran."""
    text = text.replace(str(run.folder), "<cwd>").replace(str(run.tree), "<tree>")
    if _json(text) is None:
        for pattern, word in TEXT:
            text = pattern.sub(word, text)
    return text


def _json(text: str) -> Any:
    """Return the value of a JSON text, or the list of one that has a value a line; else None."""
    if not text.lstrip().startswith(("{", "[")):
        return None
    try:
        return json.loads(text)
    except ValueError:
        pass
    try:
        return [json.loads(line) for line in text.splitlines()]
    except ValueError:
        return None


def _values(where: str, a: Any, b: Any, within: float | None) -> Iterator[Difference]:
    if isinstance(a, dict) and isinstance(b, dict):
        for key in sorted({*a, *b} - TIMES - STAMPS):
            if key not in a or key not in b:
                what = "only before" if key in a else "only after"
                yield Difference(where=f"{where}.{key}", what=what)
            else:
                yield from _values(f"{where}.{key}", a[key], b[key], within)
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for index, (x, y) in enumerate(zip(a, b, strict=True)):
            yield from _values(f"{where}[{index}]", x, y, within)
    elif isinstance(a, float) and isinstance(b, float):
        yield from _numbers(where, a, b, within)
    elif a != b and _plain_value(a) != _plain_value(b):
        yield Difference(where=where, what=f"\n      {str(a)[:600]}\n      {str(b)[:600]}")


def _plain_value(value: Any) -> Any:
    if isinstance(value, str):
        for pattern, word in TEXT:
            value = pattern.sub(word, value)
    return value


def _numbers(where: str, a: float, b: float, within: float | None) -> Iterator[Difference]:
    if a == b or (math.isnan(a) and math.isnan(b)):
        return
    size = abs(_log(np.float64(a)) - _log(np.float64(b)))
    allowed = within is not None and bool(size <= within * (1 + abs(_log(np.float64(a)))))
    yield Difference(where=where, what=f"{a} and {b}", size=float(size), allowed=allowed)


def _csv(where: str, a: Path, b: Path, within: float | None) -> Iterator[Difference]:
    rows = [list(csv.DictReader(io.StringIO(p.read_text("utf-8")))) for p in (a, b)]
    numbers = [[{k: _number(v) for k, v in row.items()} for row in table] for table in rows]
    yield from _values(where, numbers[0], numbers[1], within)


def _number(text: str) -> float | str:
    try:
        return float(text)
    except (TypeError, ValueError):
        return text


def _exr(where: str, a: Path, b: Path, within: float | None) -> Iterator[Difference]:
    try:
        parts = [OpenEXR.File(str(path), separate_channels=True).parts for path in (a, b)]
    except RuntimeError as error:
        yield Difference(where=where, what=f"cannot be read: {error}")
        return
    if len(parts[0]) != len(parts[1]):
        yield Difference(where=where, what=f"{len(parts[0])} and {len(parts[1])} parts")
    for one, other in zip(*parts, strict=False):
        heads = [_header(part.header) for part in (one, other)]
        for key in sorted(k for k in {*heads[0], *heads[1]} if heads[0].get(k) != heads[1].get(k)):
            what = f"{heads[0].get(key)} and {heads[1].get(key)}"
            yield Difference(where=f"{where} header {key}", what=what)
        planes = [{k: c.pixels for k, c in part.channels.items()} for part in (one, other)]
        yield from _planes(where, planes[0], planes[1], within)


def _header(header: dict[str, Any]) -> dict[str, str]:
    return {
        key: repr(value) for key, value in header.items() if key not in {*ATTRIBUTES, "channels"}
    }


def _planes(
    where: str, a: dict[str, np.ndarray], b: dict[str, np.ndarray], within: float | None
) -> Iterator[Difference]:
    if list(a) != list(b):
        yield Difference(where=where, what=f"channels {list(a)} and {list(b)}")
    for name in sorted({*a} & {*b}):
        yield from _plane(f"{where} {name}", a[name], b[name], within)


def _plane(where: str, a: np.ndarray, b: np.ndarray, within: float | None) -> Iterator[Difference]:
    if a.dtype != b.dtype or a.shape != b.shape:
        kinds = f"{a.dtype} {a.shape} and {b.dtype} {b.shape}"
        yield Difference(where=where, what=kinds)
        return
    if a.tobytes() == b.tobytes():
        return
    one, other = _log(a.astype(np.float64)), _log(b.astype(np.float64))
    with np.errstate(invalid="ignore"):
        size = np.where((one == other) | (np.isnan(one) & np.isnan(other)), 0, abs(one - other))
    size = np.where(np.isnan(size), np.inf, size)
    limit = -1.0 if within is None else within
    over = size > limit * (1 + abs(one))
    if a.dtype == np.float16:
        over &= abs(_rank(a) - _rank(b)) > 1 if within is not None else True
    count = int((a.view(f"u{a.itemsize}") != b.view(f"u{b.itemsize}")).sum())
    what = f"{count} of {a.size} values"
    allowed = within is not None and not over.any()
    yield Difference(where=where, what=what, size=float(size.max()), allowed=allowed)


def _rank(half: np.ndarray) -> np.ndarray:
    """Return integers that neighbouring halves have next to each other."""
    bits = half.view(np.int16).astype(np.int32)
    return np.where(bits < 0, -(bits & 0x7FFF), bits)


def _log(x: Any) -> Any:
    return np.sign(x) * np.log1p(abs(x))


def _png(where: str, a: Path, b: Path, within: float | None) -> Iterator[Difference]:
    one, other = (np.asarray(Image.open(path)).astype(np.int64) for path in (a, b))
    if one.shape != other.shape:
        yield Difference(where=where, what=f"{one.shape} and {other.shape}")
    elif (one != other).any():
        size = int(abs(one - other).max())
        allowed = within is not None and size <= PREVIEW_LEVELS
        what = f"{size} of 255 levels"
        yield Difference(where=where, what=what, size=math.log1p(size / 255), allowed=allowed)
