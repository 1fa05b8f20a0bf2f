"""From the primaries that radiance is stored in to Rec.709, which pictures and metrics expect."""

from __future__ import annotations

import functools
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import cast

import torch

from rtsr_cli.core.frames.conventions import ColorSpace
from rtsr_cli.core.shapes import Color

COLOUR_NAMES = {
    ColorSpace.REC709: "ITU-R BT.709",
    ColorSpace.REC2020: "ITU-R BT.2020",
    ColorSpace.P3D65: "Display P3",
    ColorSpace.AP1: "ACEScg",
    ColorSpace.AP0: "ACES2065-1",
}
"""Names of the primaries in colour-science."""

ADAPTATION = "Bradford"
"""How white points are matched: as the ACES transforms do."""


@contextmanager
def _hide_module(name: str) -> Iterator[None]:
    """Let a module look as if it were not installed."""
    known = sys.modules.get(name)
    sys.modules[name] = cast(ModuleType, None)
    try:
        yield
    finally:
        del sys.modules[name]
        if known is not None:
            sys.modules[name] = known


def import_colour() -> ModuleType:
    """Import colour-science; the one way to do so, in tests, too.

    It would keep objects of OpenImageIO, whose binding layer (nanobind) reports at length what is
    still held when the process ends, after everything else that was said. It finds none instead.
    """
    with warnings.catch_warnings(), _hide_module("OpenImageIO"):
        # colour-science warns of plotting libraries that are not there
        warnings.simplefilter("ignore")
        return import_module("colour")


@functools.cache
def rec709_matrix(space: ColorSpace) -> tuple[tuple[float, ...], ...]:
    """3 x 3 matrix from linear RGB of a space to linear Rec.709, white points adapted."""
    names = COLOUR_NAMES[space], COLOUR_NAMES[ColorSpace.REC709]
    colour = import_colour()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        matrix = colour.matrix_RGB_to_RGB(*names, ADAPTATION)
    return tuple(tuple(float(v) for v in row) for row in matrix)


def to_rec709(color: Color, space: ColorSpace | None) -> Color:
    """Linear Rec.709 of linear RGB in `space`; None is taken for Rec.709.

    Colours outside of Rec.709 become negative in a channel. colour-science is imported only where
    there is something to convert.
    """
    if space is None or space is ColorSpace.REC709:
        return color
    matrix = color.new_tensor(rec709_matrix(space))
    return torch.einsum("rc,nchw->nrhw", matrix, color)
