"""Choices that are typed in the commands, which import no core, are those of the library."""

from __future__ import annotations

import click
import pytest

from rtsr_cli.commands import demodulate, options, precompute_lut, upscale
from rtsr_cli.core.captures.presets import LAYOUTS
from rtsr_cli.core.choices import (
    MATERIAL_EPSILON,
    DemodulationMode,
    JitterMode,
    LutConvention,
    MissingPolicy,
    NonfinitePolicy,
    Precision,
)
from rtsr_cli.core.imaging import brdf_lut
from rtsr_cli.core.imaging.resampling import PIXEL_FILTERS


def option(command: click.Command, name: str) -> click.Parameter:
    return next(p for p in command.params if p.name == name)


DIVISORS = [mode for mode in DemodulationMode if mode is not DemodulationMode.NONE]


@pytest.mark.parametrize(
    ("command", "name", "values"),
    [
        (demodulate.command, "mode", DIVISORS),
        (demodulate.command, "convention", LutConvention),
        (precompute_lut.command, "convention", LutConvention),
        (upscale.command, "jitter", JitterMode),
        (upscale.command, "lr_filter", ["none", *PIXEL_FILTERS]),
        (upscale.command, "precision", Precision),
        (upscale.command, "on_missing", MissingPolicy),
        (upscale.command, "on_nonfinite", NonfinitePolicy),
    ],
)
def test_an_option_offers_what_the_library_has(
    command: click.Command, name: str, values: list[str]
) -> None:
    kind = option(command, name).type
    assert isinstance(kind, click.Choice)
    assert list(kind.choices) == [str(v) for v in values]


def test_the_tables_defaults_are_the_librarys() -> None:
    assert option(precompute_lut.command, "size").default == brdf_lut.DEFAULT_SIZE
    assert option(precompute_lut.command, "samples").default == brdf_lut.DEFAULT_SAMPLES
    assert option(demodulate.command, "epsilon").default == MATERIAL_EPSILON


def test_layouts_are_named_as_they_are_declared() -> None:
    assert tuple(LAYOUTS) == options.LAYOUT_NAMES
    assert all(layout.name == name for name, layout in LAYOUTS.items())
