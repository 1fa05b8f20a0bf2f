"""`[buffers]`: which channel is which buffer, as users write it in capture.toml or a layout file.

color = "beauty.RGB"                      # prefix and one letter a component
depth = "zpass:R"                         # channel R of the files `zpass.####.exr`
motion = ["mv:R", {channel = "G", file = "mv", factor = -1.0, zero = 0.5}]
material = "Diffuse Color.RGB + Glossy Color.RGB"    # see `buffer_expressions`
roughness = "1 - smoothness.R"
metallic = 0.0                            # a constant; [0.8, 0.8, 0.8] of three channels
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    model_serializer,
    model_validator,
)
from pydantic.json_schema import SkipJsonSchema

from rtsr_cli.core.captures.buffer_expressions import (
    explain_letters,
    explain_signs,
    is_expression,
    list_letters,
    parse_expression,
    split_name,
    write_sum,
)
from rtsr_cli.core.captures.layouts import ChannelPlace, ChannelSum, Component
from rtsr_cli.core.documents import describe_value
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, CONSTANTS, Buffer
from rtsr_cli.core.limits import LARGEST_FACTOR

MADE_OF_LIGHT = (Buffer.COLOR, Buffer.LIGHTING)
"""What a renderer computed: a constant would be a picture of nothing."""


Factor = Annotated[
    float,
    Field(ge=-LARGEST_FACTOR, le=LARGEST_FACTOR, allow_inf_nan=False, strict=True),
]


class ChannelSpec(BaseModel):
    """One component: `value = (stored - zero) * factor`; `channel` and `file` may be patterns."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    channel: str = Field(min_length=1)
    file: str = Field(default="*", min_length=1)
    factor: Factor = 1.0
    zero: Factor = 0.0

    @model_validator(mode="before")
    @classmethod
    def _from_text(cls, value: object) -> object:
        if not isinstance(value, str):
            return value
        place = split_name(value)
        return {"channel": place.channel, "file": place.file}

    @property
    def is_constant(self) -> bool:
        """Tell whether no file holds it."""
        return False

    def component(self) -> Component:
        """The component as a layout declares it."""
        place = ChannelPlace(channel=self.channel, file=self.file, scoped=True)
        return Component(places=(place,), factor=self.factor, offset=self.zero)

    def __str__(self) -> str:
        """Write it as a user would."""
        return self.channel if self.file == "*" else f"{self.file}:{self.channel}"


class SumSpec(BaseModel):
    """One component that is a sum of channels, or a constant."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    # made here alone, of text whose numbers are bounded where it is read
    sum: SkipJsonSchema[ChannelSum]

    @property
    def is_constant(self) -> bool:
        """Tell whether no file holds it."""
        return not self.sum.terms

    def component(self) -> Component:
        """The component as a layout declares it."""
        return Component(places=(self.sum,))

    @model_serializer
    def write(self) -> str | float:
        """Write it as a user would."""
        return str(self) if self.sum.terms else self.sum.constant

    def __str__(self) -> str:
        """Write it as a user would."""
        named = [(t.factor, t.place.file, t.place.channel) for t in self.sum.terms]
        return write_sum(
            [(f, c if file == "*" else f"{file}:{c}") for f, file, c in named], self.sum.constant
        )


MOST_ENTRIES = 64
"""Entries of a list that are read to say what is wrong with them; of more it is their number."""


@dataclass(frozen=True)
class _Written:
    """What stands in the file for a buffer, and how many channels that has."""

    value: object
    channels: int

    def __repr__(self) -> str:
        """Return what stands in the file."""
        return describe_value(self.value)


def _list_components(written: object) -> object:
    """One entry a component: a name, a table, or a sum.

    Raises:
        ValueError: it is an expression that cannot be read; names the column.
    """
    if not isinstance(written, _Written):
        return written
    value, channels = written.value, written.channels
    if isinstance(value, bool) or (
        isinstance(value, list) and any(v is True or v is False for v in value)
    ):
        raise ValueError("true and false are no channels and no numbers")
    if isinstance(value, str):
        return _list_of_text(value, channels)
    if isinstance(value, list):
        if len(value) > MOST_ENTRIES:
            raise ValueError(f"needs {channels} channels, not {len(value)}")
        return [_read_entry(entry, i) for i, entry in enumerate(value, start=1)]
    if _is_number(value):
        return [_make_constant(value)] * channels
    return [value] if isinstance(value, Mapping) else value


def _list_of_text(text: str, channels: int) -> list[object]:
    if is_expression(text):
        return [SumSpec(sum=s) for s in parse_expression(text, channels, scoped=True)]
    letters = list_letters(text, channels)
    before = text.removesuffix(letters)
    return [before + letter for letter in letters] if letters else [text]


def _read_entry(entry: object, place: int) -> object:
    """Read an entry of a list, which is one component."""
    if _is_number(entry):
        return _make_constant(entry)
    if not isinstance(entry, str) or not is_expression(entry):
        return entry
    try:
        return SumSpec(sum=parse_expression(entry, 1, scoped=True)[0])
    except ValueError as error:
        raise ValueError(f"entry {place}: {error}") from error


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _make_constant(value: object) -> SumSpec:
    number = float(str(value))
    if not abs(number) <= LARGEST_FACTOR:
        raise ValueError(f"is out of range (allowed: up to {LARGEST_FACTOR:g})")
    return SumSpec(sum=ChannelSum(constant=number))


def _tell_kind(entry: object) -> str:
    return "<sum>" if isinstance(entry, SumSpec) else "<channel>"


ComponentSpec = ChannelSpec | SumSpec

ComponentSpecs = Annotated[
    list[
        Annotated[
            Annotated[ChannelSpec, Tag("<channel>")] | Annotated[SumSpec, Tag("<sum>")],
            Discriminator(_tell_kind),
        ]
    ],
    BeforeValidator(_list_components),
]

SPEC_TAGS = frozenset({"<channel>", "<sum>"})
"""Parts of an error's place that no user wrote."""


def _add_channel_counts(table: object) -> object:
    """Say of what stands in the file for a buffer how many channels that has."""
    if not isinstance(table, Mapping):
        return table
    counts = {buffer.value: spec.channels for buffer, spec in BUFFER_SPECS.items()}
    return {
        key: _Written(value, counts[key]) if key in counts and isinstance(key, str) else value
        for key, value in table.items()
    }


def _explain_names(specs: list[ComponentSpec], channels: int) -> str:
    names = [spec.channel for spec in specs if isinstance(spec, ChannelSpec)]
    counted = (explain_letters(name, channels) for name in names[:1] if len(specs) == 1)
    return next(filter(None, (*map(explain_signs, names), *counted)), "")


def _check_channel_counts(
    table: dict[Buffer, list[ComponentSpec]],
) -> dict[Buffer, list[ComponentSpec]]:
    """Hold every buffer to its number of channels, and radiance to be in files."""
    wrong = [
        f"{buffer} needs {BUFFER_SPECS[buffer].channels} channels, not {len(specs)}"
        f"{_explain_names(specs, BUFFER_SPECS[buffer].channels)}"
        for buffer, specs in table.items()
        if len(specs) != BUFFER_SPECS[buffer].channels
    ]
    wrong += [
        f"{buffer} is what was rendered, and no constant; name its channels"
        for buffer in MADE_OF_LIGHT
        if buffer in table and all(spec.is_constant for spec in table[buffer])
    ]
    wrong += [text for buffer, specs in table.items() if (text := _check_constants(buffer, specs))]
    if Buffer.SKY in table:
        wrong.append("sky is not read: it follows from depth and normals")
    if wrong:
        raise ValueError("; ".join(wrong))
    return table


def _check_constants(buffer: Buffer, specs: list[ComponentSpec]) -> str:
    """Say of a constant that the buffer never has its value; empty where it may."""
    least, largest = CONSTANTS.get(buffer, (-math.inf, math.inf))
    values = [s.sum.constant for s in specs if isinstance(s, SumSpec) and s.is_constant]
    wrong = [value for value in values if not least <= value <= largest]
    if not wrong:
        return ""
    allowed = f"{least:g} or more" if largest == math.inf else f"{least:g} to {largest:g}"
    return f"{buffer} = {wrong[0]:g} is out of range (allowed: {allowed})"


BufferTable = Annotated[
    dict[Buffer, ComponentSpecs],
    BeforeValidator(_add_channel_counts),
    AfterValidator(_check_channel_counts),
]
"""Buffer name -> what its channels are."""


def build_components(
    table: Mapping[Buffer, list[ComponentSpec]],
) -> dict[Buffer, tuple[Component, ...]]:
    """Return the table as a layout declares it."""
    return {buffer: tuple(s.component() for s in specs) for buffer, specs in table.items()}
