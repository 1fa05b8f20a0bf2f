"""The table of the split sum as a file: one table, one EXR, one picture."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rtsr_cli import __version__
from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.files.folders import describe_obstacle, is_folder
from rtsr_cli.core.files.png import write_png
from rtsr_cli.core.imaging.brdf_lut import integrate_lut
from rtsr_cli.core.lut.request import PrecomputeLutRequest
from rtsr_cli.core.marks import MARKED


@dataclass(frozen=True, kw_only=True)
class LutWritten:
    """The summary.

    Attributes:
        paths: files that are written, the table first.
    """

    paths: tuple[Path, ...]


def precompute_lut(request: PrecomputeLutRequest) -> Iterator[LutWritten]:
    """Write A and B to an EXR, and a picture (red A, green B) where it is asked for.

    Raises:
        OutputError: a file cannot be written, or is there and may not be replaced.
    """
    for path in request.outputs:
        check_file(path, overwrite=request.overwrite)
    scale, bias = integrate_lut(request.size, request.samples, request.convention)[0].numpy()
    attributes = {
        "software": f"rtsr {__version__}",
        **MARKED,
        "rtsr:lutConvention": request.convention.value,
        "rtsr:lutSamples": request.samples,
    }
    table, *pictures = request.outputs
    for picture in pictures:
        rgb = np.stack((scale, bias, np.zeros_like(scale)), axis=-1)
        write_png(picture, np.rint(rgb * 255).astype(np.uint8))
    write_exr(table, {"A": scale, "B": bias}, attributes=attributes)
    yield LutWritten(paths=request.outputs)


def check_file(path: Path, *, overwrite: bool) -> None:
    """Refuse before anything is computed.

    Raises:
        OutputError: no such folder, a folder without write permission, or a file in the way.
    """
    folder = path.parent
    obstacle = describe_obstacle(folder)
    if obstacle:
        raise OutputError(f"{path}: {obstacle}; choose another place for the table")
    if not is_folder(folder):
        raise OutputError(f"{path}: the folder {folder} does not exist; create it first")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(f"{path}: the folder {folder} cannot be written to")
    if os.path.lexists(path) and not overwrite:
        raise OutputError(f"{path} exists; give --overwrite to replace it")
