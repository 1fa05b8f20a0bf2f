"""`capture.toml`: what the user declares about a shot.

Everything is validated together: one error lists every wrong field with its path.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_serializer,
)

from rtsr_cli.core.captures.channel_tables import SPEC_TAGS, BufferTable
from rtsr_cli.core.captures.field_errors import describe_field_error
from rtsr_cli.core.captures.layout_names import LAYOUT_SUFFIX
from rtsr_cli.core.captures.regions import RegionRule
from rtsr_cli.core.documents import DocumentError, read_toml_text, shorten_value
from rtsr_cli.core.errors import ConfigError, did_you_mean
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera_convention import CameraConvention, CameraWord
from rtsr_cli.core.frames.conventions import (
    ColorSpace,
    Conventions,
    DepthKind,
    NormalSpace,
    RoughnessKind,
    SkyRule,
    SpecularWorkflow,
)
from rtsr_cli.core.frames.motion import Axes, Jitter, MotionDirection, MotionUnit, YAxis
from rtsr_cli.core.imaging.resampling import HALTON_BASES, radical_inverse
from rtsr_cli.core.limits import (
    LARGEST_FACTOR,
    LARGEST_FRAME,
    MOST_PATH_LETTERS,
    MOST_PROBLEMS,
    SMALLEST_FACTOR,
)

CAPTURE_FILE = "capture.toml"

T = TypeVar("T")


UNIT_METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0, "ft": 0.3048, "in": 0.0254}
"""Metres in a named unit of length."""


def _length_in_metres(value: object) -> object:
    """Let a length be the name of a unit."""
    if not isinstance(value, str):
        return value
    if value not in UNIT_METRES:
        raise ValueError(f"no unit is called '{value}'{did_you_mean(value, UNIT_METRES)}")
    return UNIT_METRES[value]


def _refuse_other_kinds(value: object) -> object:
    """Take whole numbers, and texts of them: keys of tables and cells of CSV are texts."""
    if isinstance(value, bool | float):
        raise ValueError("is not a whole number")  # noqa: TRY004 (pydantic lets others through)
    return value


def refuse_truth(value: object) -> object:
    """Take numbers and texts of them, and not true for 1."""
    if isinstance(value, bool):
        raise ValueError("is not a number")  # noqa: TRY004
    return value


def _refuse_tiny(value: float) -> float:
    """Take no 0, nor what is one as soon as it is squared."""
    if abs(value) < SMALLEST_FACTOR:
        raise ValueError(f"is too small (allowed: {SMALLEST_FACTOR:g} or more, to either side)")
    return value


Length = Annotated[
    float, Field(gt=0.0, le=LARGEST_FACTOR, strict=True), AfterValidator(_refuse_tiny)
]
"""Metres, above 0."""

LengthUnit = Annotated[Length, BeforeValidator(_length_in_metres)]
"""Metres in one stored unit, or the unit's name."""

FrameNumber = Annotated[
    int, Field(ge=-LARGEST_FRAME, le=LARGEST_FRAME), BeforeValidator(_refuse_other_kinds)
]

Factor = Annotated[
    float, Field(ge=-LARGEST_FACTOR, le=LARGEST_FACTOR, allow_inf_nan=False, strict=True)
]

LARGEST_STORED = 3.5e38
"""Values that float channels hold go so far."""

Stored = Annotated[
    float, Field(ge=-LARGEST_STORED, le=LARGEST_STORED, allow_inf_nan=False, strict=True)
]


NO_SWITCH = "true and false are no numbers and no words"


def _holds_boolean(value: object) -> bool:
    """Tell whether a value, or an entry of a list, is true or false; tables see to their own."""
    if isinstance(value, list | tuple):
        return any(_holds_boolean(entry) for entry in value)
    return isinstance(value, bool)


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)

    @field_validator("*", mode="before")
    @classmethod
    def _refuse_booleans(cls, value: object, info: ValidationInfo) -> object:
        """Let true and false be values of switches alone: elsewhere they would be 1 and 0."""
        annotation = cls.model_fields[str(info.field_name)].annotation
        if bool in (annotation, *get_args(annotation)) or not _holds_boolean(value):
            return value
        raise ValueError(NO_SWITCH)

    def declared(self) -> dict[str, Any]:
        """Return the fields that the user gave."""
        return {k: v for k, v in self.model_dump().items() if v is not None}


class MotionCapture(_Strict):
    """`[motion]`: see `MotionConvention`; a field left out keeps the layout's value."""

    unit: MotionUnit | None = None
    direction: MotionDirection | None = None
    y_axis: YAxis | None = None
    axes: Axes | None = None
    jittered: bool | None = None
    jitter_inverted: bool | None = None
    scale: Annotated[Factor, AfterValidator(_refuse_tiny)] | None = None
    zero: Factor | None = None
    file_offset: int | None = Field(default=None, ge=-1, le=1, strict=True)

    def decides(self) -> bool:
        """Tell whether nothing about sense and size of the vectors is left open."""
        return None not in {self.unit, self.direction, self.y_axis}


def _tell_sky_kind(value: object) -> str:
    """Tell rules of the sky from values of depth, so that errors speak of the one meant."""
    return "rule" if isinstance(value, str) else "value"


SkyDepth = Annotated[
    Annotated[Stored, Tag("value")] | Annotated[SkyRule, Tag("rule")],
    Discriminator(_tell_sky_kind),
]
"""A stored value from which on depth is sky (upwards; from 0 and below downwards), or a rule."""


class DepthStart(StrEnum):
    """Where ray distances begin."""

    CAMERA = "camera"
    NEAR = "near"


class DepthCapture(_Strict):
    """`[depth]`: kind, sense, metres in one stored unit (or its name), and what is sky.

    `from` says where ray distances begin, `near` the depth of the near plane in metres.
    """

    kind: DepthKind | None = None
    reversed: bool | None = None
    unit: LengthUnit | None = None
    sky: SkyDepth | None = None
    start: DepthStart | None = Field(default=None, alias="from")
    near: Length | None = None


class NormalCapture(_Strict):
    """`[normal]`: axes, whether (n + 1) / 2 is stored, and the vector that marks sky."""

    space: NormalSpace | None = None
    packed: bool | None = None
    sky: tuple[Factor, Factor, Factor] | None = None


class JitterPattern(StrEnum):
    """Sequences that engines jitter with."""

    HALTON = "halton"


MOST_PERIOD = 1 << 20
"""Frames until a pattern comes again."""

MOST_JITTER = 2.0
"""Factor of a pattern, which reaches half a pixel to each side: offsets go from -1 to 1."""


class JitterSequence(_Strict):
    """`jitter_px = {pattern = "halton", period = 8}`: element 1 is that of `first_frame`."""

    pattern: JitterPattern = JitterPattern.HALTON
    period: int = Field(default=8, ge=1, le=MOST_PERIOD, strict=True)
    first_frame: FrameNumber = 1
    scale: float = Field(default=1.0, ge=-MOST_JITTER, le=MOST_JITTER, strict=True)

    def at(self, number: int) -> Jitter:
        """Offset of a frame: Halton(2,3) - 0.5, times `scale`."""
        index = (number - self.first_frame) % self.period + 1
        x, y = ((radical_inverse(index, base) - 0.5) * self.scale for base in HALTON_BASES)
        return x, y


Offset = Annotated[
    float, Field(ge=-1.0, le=1.0, allow_inf_nan=False), BeforeValidator(refuse_truth)
]

JitterPx = tuple[Offset, Offset]
"""(x right, y down), LR pixels."""


def _tell_jitter_kind(value: object) -> str:
    """Tell the three ways of writing jitter apart, so that errors speak of the one meant."""
    if isinstance(value, JitterSequence):
        return "sequence"
    if not isinstance(value, Mapping):
        return "offset"
    numbers = [str(key).removeprefix("-").isdigit() for key in value]
    return "frames" if value and all(numbers) else "sequence"


JitterTable = Annotated[
    Annotated[JitterPx, Tag("offset")]
    | Annotated[JitterSequence, Tag("sequence")]
    | Annotated[dict[FrameNumber, JitterPx], Tag("frames")],
    Discriminator(_tell_jitter_kind),
]
"""One offset for all frames, a pattern, or one a frame."""

_TAGS = frozenset({"value", "rule", "offset", "sequence", "frames", "[key]", *SPEC_TAGS})
"""Parts of an error's place that no user wrote."""


class PositionCapture(_Strict):
    """`[position]`: metres in one stored unit of world positions (or the unit's name)."""

    unit: LengthUnit | None = None


def _list_words(value: object) -> object:
    """Let one word, or several in one text, be a list of them."""
    if isinstance(value, str):
        return value.replace(",", " ").split()
    return value


def _check_words(words: tuple[CameraWord, ...]) -> tuple[CameraWord, ...]:
    CameraConvention(words=frozenset(words))
    return words


class CameraCapture(_Strict):
    """`[camera]`: the side-car, and how matrices are stored; see `CameraWord`."""

    file: str | None = Field(default=None, max_length=MOST_PATH_LETTERS)
    convention: Annotated[
        tuple[CameraWord, ...],
        Field(max_length=len(CameraWord)),
        BeforeValidator(_list_words),
        AfterValidator(_check_words),
    ] = ()

    @property
    def matrices(self) -> CameraConvention:
        """How matrices are stored."""
        return CameraConvention(words=frozenset(self.convention))

    @model_serializer
    def _write(self) -> object:
        """Write the side-car alone as its name."""
        if not self.convention:
            return self.file
        named = {} if self.file is None else {"file": self.file}
        return named | {"convention": [word.value for word in self.convention]}


def _name_side_car(value: object) -> object:
    """Let the name of the side-car stand for the table."""
    return {"file": value} if isinstance(value, str) else value


CameraTable = Annotated[CameraCapture, BeforeValidator(_name_side_car)]


class ConventionTables(_Strict):
    """What channel names do not say; every field may be left out."""

    motion: MotionCapture = MotionCapture()
    depth: DepthCapture = DepthCapture()
    normal: NormalCapture = NormalCapture()
    position: PositionCapture = PositionCapture()
    roughness: RoughnessKind | None = None
    specular: SpecularWorkflow | None = None
    colorspace: ColorSpace | None = None

    def conventions(self, preset: Conventions) -> Conventions:
        """Return a layout's conventions with the declared ones in their place."""
        depth = self.depth.declared()
        for name, field in (("unit", "unit_m"), ("near", "near_m")):
            if name in depth:
                depth[field] = depth.pop(name)
        if "start" in depth:
            depth["from_near"] = depth.pop("start") is DepthStart.NEAR
        return Conventions(
            motion=replace(preset.motion, **self.motion.declared()),
            depth=replace(preset.depth, **depth),
            normal=replace(preset.normal, **self.normal.declared()),
            roughness=self.roughness or preset.roughness,
            specular=self.specular or preset.specular,
            colorspace=self.colorspace or preset.colorspace,
            position_unit_m=self.position.unit or preset.position_unit_m,
        )


MOST_LICENCE_LETTERS = 200

MOST_SCALE = 64
"""HR pixels per LR pixel, along an axis."""

WIDEST_FILTER_PX = 2.0
"""Standard deviation of a pixel filter, in pixels."""


class CaptureDeclaration(ConventionTables):
    """The whole of `capture.toml`; every field may be left out.

    `layout` is the name of a preset or the path of a layout file, relative to capture.toml;
    `layer` that of the layer or view that is read of files with several, `view` that of the view.
    `filter_width_px` is the standard deviation of the pixel filter that went over radiance, in its
    pixels; 0 of point samples.
    `licence` says under which terms the frames are given, in words: it changes no pixel, and stands
    in the cards of networks that are trained on them.
    """

    layout: str | None = Field(default=None, max_length=MOST_PATH_LETTERS)
    layer: str | None = Field(default=None, min_length=1)
    view: str | None = Field(default=None, min_length=1)
    region: RegionRule | None = None
    buffers: BufferTable = {}
    jitter_px: JitterTable | None = None
    filter_width_px: (
        Annotated[float, Field(ge=0.0, le=WIDEST_FILTER_PX, allow_inf_nan=False, strict=True)]
        | None
    ) = None
    scale: int | None = Field(default=None, ge=1, le=MOST_SCALE, strict=True)
    frame_step: int = Field(default=1, ge=1, le=LARGEST_FRAME, strict=True)
    camera_cuts: frozenset[FrameNumber] = frozenset()
    camera: CameraTable = CameraCapture()
    licence: str | None = Field(default=None, min_length=1, max_length=MOST_LICENCE_LETTERS)

    def jitter(self, number: int) -> Jitter | None:
        """Jitter of a frame as declared, None if it is not."""
        if isinstance(self.jitter_px, JitterSequence):
            return self.jitter_px.at(number)
        if isinstance(self.jitter_px, dict):
            return self.jitter_px.get(number)
        return self.jitter_px


def read_capture(path: Path) -> CaptureDeclaration:
    """Read a capture.toml.

    Raises:
        ConfigError: not TOML, or wrong fields; lists every one with its path.
    """
    try:
        content = read_toml_text(path)
    except DocumentError as error:
        raise ConfigError(f"{path}: {error}") from error
    capture = validate_content(CaptureDeclaration, content, path)
    if capture.layout is not None and capture.layout.endswith(LAYOUT_SUFFIX):
        return capture.model_copy(update={"layout": str(path.parent / capture.layout)})
    return capture


def validate_content(kind: type[T], content: object, path: Path) -> T:
    """Hold the content of a user's file to a type.

    Raises:
        ConfigError: lists every wrong field with its path.
    """
    try:
        return TypeAdapter(kind).validate_python(content)
    except ValidationError as error:
        items = error.errors(include_url=False)
        # of a table's key that is none, nothing else is said
        unknown = {item["loc"][:-1] for item in items if item["loc"][-1:] == ("[key]",)}
        told = (item for item in items if item["loc"] not in unknown)
        lines = dict.fromkeys(_describe_error(item, kind) for item in islice(told, MOST_PROBLEMS))
        more = error.error_count() - MOST_PROBLEMS
        rest = f"; and {more} more" if more > 0 else ""
        raise ConfigError(f"{path}: " + "; ".join(lines) + rest) from error


def _describe_error(item: Mapping[str, Any], kind: Any) -> str:
    loc = [part for part in item["loc"] if part not in _TAGS]
    place = ".".join(shorten_value(str(part)) for part in loc)
    if "[key]" in item["loc"] and item["type"] == "enum":
        return f"{place}: no such buffer{did_you_mean(str(loc[-1]), [b.value for b in Buffer])}"
    if _is_misplaced_buffer(item, loc):
        return f"{place}: what a buffer is made of belongs below a line [buffers]"
    if item["type"] != "extra_forbidden":
        return f"{place}: {describe_field_error(item)}"
    return f"{place}: no such field{did_you_mean(str(loc[-1]), _list_known_names(kind, loc[:-1]))}"


def _is_misplaced_buffer(item: Mapping[str, Any], loc: Sequence[object]) -> bool:
    """Tell whether a line of [buffers] stands above every table, where other fields are."""
    if len(loc) != 1 or loc[0] not in {buffer.value for buffer in Buffer}:
        return False
    # a number in place of a word, or a word in place of a table
    is_word, wants_word = isinstance(item["input"], str), item["type"] in {"enum", "literal_error"}
    return item["type"] == "extra_forbidden" or (is_word is not wants_word)


def _list_known_names(kind: Any, parents: Sequence[object]) -> list[str]:
    """Names that a table may hold: of the models that the path leads to."""
    models = _list_models_in(kind)
    for parent in parents:
        fields = [m.model_fields[str(parent)] for m in models if str(parent) in m.model_fields]
        # a key of a table or an index of a list leads to what it holds
        models = [m for f in fields for m in _list_models_in((f.annotation, *f.metadata))] or models
    return [name for model in models for name in list_field_names(model)]


def _list_models_in(annotation: Any) -> list[type[BaseModel]]:
    """Models that values of an annotation can be, however deep they are."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    parts = annotation if isinstance(annotation, tuple) else get_args(annotation)
    return [model for part in parts for model in _list_models_in(part)]


def list_field_names(model: type[BaseModel]) -> list[str]:
    """Names of a table's fields, as users write them."""
    return [field.alias or name for name, field in model.model_fields.items()]
