"""`[buffers]`: which channel is which buffer, as users write it in capture.toml or a layout file.

color = "beauty.RGB"                      # prefix and one letter a component
depth = "zpass:R"                         # channel R of the files `zpass.####.exr`
motion = ["mv:R", {channel = "G", file = "mv", factor = -1.0, zero = 0.5}]
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    model_validator,
)

from rtsr_cli.core.captures.layouts import ChannelPlace, Component
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer
from rtsr_cli.core.limits import LARGEST_FACTOR

SHORTHANDS = frozenset(
    {"RGB", "XYZ", "UVW", "RG", "XY", "UV", "rgb", "xyz", "uvw", "rg", "xy", "uv"}
)
"""Ends of a channel that stand for one channel a letter."""


class ChannelSpec(BaseModel):
    """One component: `value = (stored - zero) * factor`; `channel` and `file` may be patterns."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    channel: str = Field(min_length=1)
    file: str = Field(default="*", min_length=1)
    factor: float = Field(default=1.0, ge=-LARGEST_FACTOR, le=LARGEST_FACTOR, allow_inf_nan=False)
    zero: float = Field(default=0.0, ge=-LARGEST_FACTOR, le=LARGEST_FACTOR, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _from_text(cls, value: object) -> object:
        if not isinstance(value, str):
            return value
        file, separated, channel = value.rpartition(":")
        return {"channel": channel, "file": file} if separated else {"channel": value}

    def component(self) -> Component:
        """The component as a layout declares it."""
        place = ChannelPlace(channel=self.channel, file=self.file)
        return Component(places=(place,), factor=self.factor, offset=self.zero)

    def __str__(self) -> str:
        """Write it as a user would."""
        return self.channel if self.file == "*" else f"{self.file}:{self.channel}"


def _as_list(value: object) -> object:
    """One string or table is a list of one; a shorthand is as many as it has letters."""
    if isinstance(value, Mapping):
        return [value]
    if not isinstance(value, str):
        return value
    letters = _split_letters(value)
    before = value.removesuffix(letters)
    return [before + letter for letter in letters] if letters else [value]


def _split_letters(text: str) -> str:
    """Return the shorthand at the end of a channel, '' if there is none."""
    last = text.rpartition(":")[2].rpartition(".")[2]
    return last if last in SHORTHANDS else ""


def _check_channel_counts(
    table: dict[Buffer, list[ChannelSpec]],
) -> dict[Buffer, list[ChannelSpec]]:
    """Hold every buffer to its number of channels."""
    wrong = [
        f"{buffer} needs {BUFFER_SPECS[buffer].channels} channels, not {len(specs)}"
        for buffer, specs in table.items()
        if len(specs) != BUFFER_SPECS[buffer].channels
    ]
    if Buffer.SKY in table:
        wrong.append("sky is not read: it follows from depth and normals")
    if wrong:
        raise ValueError("; ".join(wrong))
    return table


ChannelSpecs = Annotated[list[ChannelSpec], BeforeValidator(_as_list)]


def _keep_whole_name(table: object) -> object:
    """Keep a text whole where the buffer has one channel: "rg" is then a name, no shorthand."""
    if not isinstance(table, Mapping):
        return table
    single = {b.value for b, spec in BUFFER_SPECS.items() if spec.channels == 1}
    return {
        key: [value] if isinstance(value, str) and key in single else value
        for key, value in table.items()
    }


BufferTable = Annotated[
    dict[Buffer, ChannelSpecs],
    BeforeValidator(_keep_whole_name),
    AfterValidator(_check_channel_counts),
]
"""Buffer name -> the channels it is made of."""


def build_components(
    table: Mapping[Buffer, list[ChannelSpec]],
) -> dict[Buffer, tuple[Component, ...]]:
    """Return the table as a layout declares it."""
    return {buffer: tuple(s.component() for s in specs) for buffer, specs in table.items()}
