"""Camera side-cars: a CSV or JSON file with a row a frame, for engines whose headers carry none."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.captures.camera_rows import CameraRow, unify_names
from rtsr_cli.core.captures.capture_file import (
    CaptureDeclaration,
    list_field_names,
    validate_content,
)
from rtsr_cli.core.captures.nss_cameras import NssClip, is_nss_content
from rtsr_cli.core.documents import DocumentError, parse_json, read_text
from rtsr_cli.core.errors import ConfigError, did_you_mean
from rtsr_cli.core.limits import MOST_COLUMNS, MOST_ROWS


@dataclass(frozen=True, kw_only=True)
class SideCar:
    """What a camera side-car holds.

    Attributes:
        rows: one a frame, by its number.
        reversed_depth: sense of device depth that it states; None where it does not.
    """

    rows: Mapping[int, CameraRow]
    reversed_depth: bool | None = None


def read_side_car(path: Path) -> SideCar:
    """Read a camera side-car, CSV or JSON, a row a frame.

    Raises:
        ConfigError: unreadable, or wrong fields; lists every one with its row.
    """
    is_json = path.suffix.lower() == ".json"
    try:
        text = read_text(path)
        content = parse_json(text) if is_json else None
        rows = _parse_json_rows(content, path) if is_json else _parse_csv_rows(text)
        _check_count(rows)
        rows = _unify_rows(rows)
    except DocumentError as error:
        raise ConfigError(f"{path}: the camera side-car {error}") from error
    except (ValueError, csv.Error) as error:
        raise ConfigError(f"{path}: is not a camera side-car: {error}") from error
    _check_columns(rows, path)
    cameras = validate_content(list[CameraRow], rows, path)
    repeated = sorted(n for n, count in Counter(c.frame for c in cameras).items() if count > 1)
    if repeated:
        raise ConfigError(f"{path}: frames {', '.join(map(str, repeated))} have more than one row")
    return SideCar(
        rows={row.frame: row for row in cameras}, reversed_depth=_read_depth_sense(content)
    )


SIDE_CARS = (".csv", ".json")
"""How the names of camera side-cars end."""


def find_side_car(folder: Path) -> str:
    """Name the first file of a folder that holds cameras, by name; empty if none does."""
    try:
        names = sorted(p.name for p in folder.iterdir() if p.suffix.lower() in SIDE_CARS)
    except OSError:
        return ""
    return next((name for name in names if _holds_cameras(folder / name)), "")


def _holds_cameras(path: Path) -> bool:
    """Tell whether a file is a camera side-car, with matrices in every row."""
    try:
        rows = read_side_car(path).rows.values()
    except ConfigError:
        return False
    return all(row.is_placed for row in rows)


def add_depth_sense(capture: CaptureDeclaration, side_car: SideCar) -> CaptureDeclaration:
    """Add the sense of device depth that a side-car states, if none is declared."""
    if capture.depth.reversed is not None or side_car.reversed_depth is None:
        return capture
    depth = capture.depth.model_copy(update={"reversed": side_car.reversed_depth})
    return capture.model_copy(update={"depth": depth})


def _read_depth_sense(content: object) -> bool | None:
    """Sense of device depth that a JSON file states."""
    if not isinstance(content, Mapping) or not is_nss_content(content):
        return None
    stated = content.get("ReverseZ")
    return stated if isinstance(stated, bool) else None


def _parse_json_rows(content: object, path: Path) -> object:
    if is_nss_content(content):
        return [frame.row() for frame in validate_content(NssClip, content, path).frames]
    if isinstance(content, Mapping) and content and all(_is_keyed(*i) for i in content.items()):
        return [{"frame": number, **row} for number, row in content.items()]
    return content.get("frames", content) if isinstance(content, Mapping) else content


def _is_keyed(key: object, row: object) -> bool:
    """Tell whether an entry of a JSON object is a row by its frame number."""
    number = str(key).removeprefix("-")
    return number.isdecimal() and isinstance(row, Mapping) and "frame" not in row


def _unify_rows(rows: object) -> object:
    """Call the columns of all rows by one name each; what is no row is refused later."""
    if not isinstance(rows, list):
        return rows
    return [unify_names(row) if isinstance(row, Mapping) else row for row in rows]


def _parse_csv_rows(text: str) -> list[dict[str, str]]:
    rows = csv.DictReader(text.splitlines(), skipinitialspace=True)
    if len(rows.fieldnames or ()) > MOST_COLUMNS:
        raise ValueError(f"it has more than {MOST_COLUMNS} columns")
    _check_count(range(text.count("\n")))
    return [{k: v for k, v in row.items() if k and v} for row in rows]


def _check_count(rows: object) -> None:
    if rows == []:
        raise ValueError("it holds no row; each frame is one, its number in the column 'frame'")
    if isinstance(rows, list | range) and len(rows) > MOST_ROWS:
        raise ValueError(f"it has more than {MOST_ROWS} rows")


def _check_columns(rows: object, path: Path) -> None:
    """Raise where a row has columns that nobody reads: a misspelt one would be lost silently."""
    listed = rows if isinstance(rows, list) else []
    known = list(list_field_names(CameraRow))
    used = dict.fromkeys(key for row in listed if isinstance(row, Mapping) for key in row)
    unknown = [key for key in used if key not in {*known, *CameraRow.model_fields}]
    if unknown:
        lines = (
            f"no column is called '{key}'{did_you_mean(str(key), known)}"
            for key in unknown[:MOST_COLUMNS]
        )
        raise ConfigError(f"{path}: " + "; ".join(lines))
