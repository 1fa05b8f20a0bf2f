"""Camera side-cars: a CSV or JSON file with a row a frame, for engines whose headers carry none."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from rtsr_cli.core.captures.capture_file import (
    CaptureDeclaration,
    FrameNumber,
    JitterPx,
    list_field_names,
    validate_content,
)
from rtsr_cli.core.captures.nss_cameras import NssClip, is_nss_content
from rtsr_cli.core.documents import DocumentError, parse_json, read_text
from rtsr_cli.core.errors import ConfigError, did_you_mean
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.limits import LARGEST_FACTOR, MOST_COLUMNS, MOST_ROWS


def _flatten_numbers(value: object) -> object:
    """Let a cell of a CSV, or a nested list, be a flat list of numbers."""
    if isinstance(value, str):
        return value.replace(",", " ").replace(";", " ").split()
    if isinstance(value, Sequence) and value and isinstance(value[0], Sequence):
        return [number for row in value for number in row]
    return value


Matrix = Annotated[
    list[float], Field(min_length=16, max_length=16), BeforeValidator(_flatten_numbers)
]


class CameraRow(BaseModel):
    """One frame of a camera side-car; matrices are row-vector, 16 numbers, row by row."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    frame: FrameNumber
    world_to_camera: Matrix | None = Field(default=None, alias="worldToCamera")
    world_to_ndc: Matrix | None = Field(default=None, alias="worldToNDC")
    jitter_px: Annotated[JitterPx, BeforeValidator(_flatten_numbers)] | None = None
    pre_exposure: float = Field(default=1.0, gt=0.0, le=LARGEST_FACTOR)
    cut: bool = False

    def metadata(self) -> CameraMetadata:
        """The row as camera metadata."""
        return CameraMetadata(
            world_to_camera=_make_tensor(self.world_to_camera),
            world_to_ndc=_make_tensor(self.world_to_ndc),
            jitter_px=self.jitter_px or (0.0, 0.0),
            pre_exposure=self.pre_exposure,
            cut=self.cut,
        )


def _make_tensor(values: list[float] | None) -> torch.Tensor | None:
    return None if values is None else torch.tensor(values, dtype=torch.float64).view(4, 4)


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
    return content.get("frames", content) if isinstance(content, Mapping) else content


def _parse_csv_rows(text: str) -> list[dict[str, str]]:
    rows = csv.DictReader(text.splitlines(), skipinitialspace=True)
    if len(rows.fieldnames or ()) > MOST_COLUMNS:
        raise ValueError(f"it has more than {MOST_COLUMNS} columns")
    _check_count(range(text.count("\n")))
    return [{k: v for k, v in row.items() if k and v} for row in rows]


def _check_count(rows: object) -> None:
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
