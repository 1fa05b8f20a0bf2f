"""`capture.toml` and camera side-cars: what the user declares about a shot.

Everything is validated together: one error lists every wrong field with its path.
"""

from __future__ import annotations

import csv
import json
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import torch
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PositiveFloat,
    TypeAdapter,
    ValidationError,
)

from rtsr_cli.core.errors import ConfigError, did_you_mean
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.conventions import (
    ColorSpace,
    Conventions,
    DepthKind,
    NormalSpace,
    RoughnessKind,
    SpecularWorkflow,
)
from rtsr_cli.core.frames.motion import Axes, Jitter, MotionDirection, MotionUnit, YAxis
from rtsr_cli.core.imaging.resampling import HALTON_BASES, radical_inverse

CAPTURE_FILE = "capture.toml"

T = TypeVar("T")


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class MotionCapture(_Strict):
    """`[motion]`: see `MotionConvention`; a field left out keeps the layout's value."""

    unit: MotionUnit | None = None
    direction: MotionDirection | None = None
    y_axis: YAxis | None = None
    axes: Axes | None = None
    jittered: bool | None = None
    jitter_inverted: bool | None = None
    scale: float | None = Field(default=None, allow_inf_nan=False)
    zero: float | None = Field(default=None, allow_inf_nan=False)
    file_offset: int | None = Field(default=None, ge=-1, le=1)


class DepthCapture(_Strict):
    """`[depth]`: kind, sense, and metres in one stored unit (or the unit's name)."""

    kind: DepthKind | None = None
    reversed: bool | None = None
    unit: Literal["m", "cm", "mm", "km", "ft", "in"] | PositiveFloat | None = None
    sky: float | None = Field(default=None, allow_inf_nan=False)


class NormalCapture(_Strict):
    """`[normal]`: axes, and whether (n + 1) / 2 is stored."""

    space: NormalSpace | None = None
    packed: bool | None = None


class JitterPattern(StrEnum):
    """Sequences that engines jitter with."""

    HALTON = "halton"


class JitterSequence(_Strict):
    """`jitter_px = {pattern = "halton", period = 8}`: element 1 is that of `first_frame`."""

    pattern: JitterPattern = JitterPattern.HALTON
    period: int = Field(default=8, ge=1)
    first_frame: int = 1
    scale: float = 1.0

    def at(self, number: int) -> Jitter:
        """Offset of a frame: Halton(2,3) - 0.5, times `scale`."""
        index = (number - self.first_frame) % self.period + 1
        x, y = ((radical_inverse(index, base) - 0.5) * self.scale for base in HALTON_BASES)
        return x, y


Offset = Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)]

JitterPx = tuple[Offset, Offset]
"""(x right, y down), LR pixels."""

UNIT_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0, "ft": 0.3048, "in": 0.0254}
"""Metres in a named unit of length."""


class Capture(_Strict):
    """The whole of `capture.toml`; every field may be left out."""

    layout: str | None = None
    motion: MotionCapture = MotionCapture()
    depth: DepthCapture = DepthCapture()
    normal: NormalCapture = NormalCapture()
    roughness: RoughnessKind | None = None
    specular: SpecularWorkflow | None = None
    colorspace: ColorSpace | None = None
    jitter_px: JitterPx | JitterSequence | dict[int, JitterPx] | None = None
    scale: int | None = Field(default=None, ge=1)
    frame_step: int = Field(default=1, ge=1)
    camera_cuts: frozenset[int] = frozenset()
    camera: str | None = None

    def jitter(self, number: int) -> Jitter | None:
        """Jitter of a frame as declared, None if it is not."""
        if isinstance(self.jitter_px, JitterSequence):
            return self.jitter_px.at(number)
        if isinstance(self.jitter_px, dict):
            return self.jitter_px.get(number)
        return self.jitter_px

    def conventions(self, preset: Conventions) -> Conventions:
        """Return a layout's conventions with the declared ones in their place."""
        depth = _declared(self.depth)
        if "unit" in depth:
            unit = depth.pop("unit")
            depth["unit_m"] = UNIT_METRES[unit] if isinstance(unit, str) else unit
        return Conventions(
            motion=replace(preset.motion, **_declared(self.motion)),
            depth=replace(preset.depth, **depth),
            normal=replace(preset.normal, **_declared(self.normal)),
            roughness=self.roughness or preset.roughness,
            specular=self.specular or preset.specular,
            colorspace=self.colorspace or preset.colorspace,
        )


def _declared(model: BaseModel) -> dict[str, Any]:
    return {k: v for k, v in model.model_dump().items() if v is not None}


def _numbers(value: object) -> object:
    """Let a cell of a CSV, or a nested list, be a flat list of numbers."""
    if isinstance(value, str):
        return value.replace(",", " ").replace(";", " ").split()
    if isinstance(value, Sequence) and value and isinstance(value[0], Sequence):
        return [number for row in value for number in row]
    return value


Matrix = Annotated[list[float], Field(min_length=16, max_length=16), BeforeValidator(_numbers)]


class CameraRow(_Strict):
    """One frame of a camera side-car; matrices are row-vector, 16 numbers, row by row."""

    model_config = ConfigDict(extra="ignore", frozen=True, populate_by_name=True)

    frame: int
    world_to_camera: Matrix | None = Field(default=None, alias="worldToCamera")
    world_to_ndc: Matrix | None = Field(default=None, alias="worldToNDC")
    jitter_px: Annotated[JitterPx, BeforeValidator(_numbers)] | None = None
    pre_exposure: float = Field(default=1.0, gt=0.0)
    cut: bool = False

    def metadata(self) -> CameraMetadata:
        """The row as camera metadata."""
        return CameraMetadata(
            world_to_camera=_tensor(self.world_to_camera),
            world_to_ndc=_tensor(self.world_to_ndc),
            jitter_px=self.jitter_px or (0.0, 0.0),
            pre_exposure=self.pre_exposure,
            cut=self.cut,
        )


def _tensor(values: list[float] | None) -> torch.Tensor | None:
    return None if values is None else torch.tensor(values, dtype=torch.float64).view(4, 4)


def read_capture(path: Path) -> Capture:
    """Read a capture.toml.

    Raises:
        ConfigError: not TOML, or wrong fields; lists every one with its path.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: is not valid TOML: {error}") from error
    return _validated(TypeAdapter(Capture), content, path)


def read_cameras(path: Path) -> dict[int, CameraRow]:
    """Read a camera side-car, CSV or JSON, a row a frame.

    Raises:
        ConfigError: unreadable, or wrong fields; lists every one with its row.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        rows = _json_rows(text) if path.suffix.lower() == ".json" else _csv_rows(text)
    except OSError as error:
        raise ConfigError(
            f"{path}: the camera side-car cannot be read ({error.strerror})"
        ) from error
    except (ValueError, csv.Error) as error:
        raise ConfigError(f"{path}: is not a camera side-car: {error}") from error
    cameras = _validated(TypeAdapter(list[CameraRow]), rows, path)
    repeated = sorted(n for n, count in Counter(c.frame for c in cameras).items() if count > 1)
    if repeated:
        raise ConfigError(f"{path}: frames {', '.join(map(str, repeated))} have more than one row")
    return {row.frame: row for row in cameras}


def _json_rows(text: str) -> object:
    content = json.loads(text)
    return content.get("frames", content) if isinstance(content, Mapping) else content


def _csv_rows(text: str) -> list[dict[str, str]]:
    rows = csv.DictReader(text.splitlines(), skipinitialspace=True)
    return [{k: v for k, v in row.items() if k and v} for row in rows]


def _validated(adapter: TypeAdapter[T], content: object, path: Path) -> T:
    try:
        return adapter.validate_python(content)
    except ValidationError as error:
        lines = dict.fromkeys(_describe(item) for item in error.errors())
        raise ConfigError(f"{path}: " + "; ".join(lines)) from error


def _describe(item: Mapping[str, Any]) -> str:
    place = ".".join(str(part) for part in item["loc"])
    if item["type"] != "extra_forbidden":
        return f"{place}: {item['msg']} (got {item['input']!r})"
    hint = did_you_mean(str(item["loc"][-1]), _field_names(item["loc"][:-1]))
    return f"{place}: no such field{hint}"


def _field_names(parents: Sequence[object]) -> list[str]:
    model: Any = Capture
    for parent in parents:
        known = getattr(model, "model_fields", {})
        model = known[parent].annotation if parent in known else None
    return list(getattr(model, "model_fields", ()))
