"""`rtsr precompute-lut` after parsing: one table, one EXR, one picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rtsr_cli import __version__
from rtsr_cli.commands.interruption import unwinding
from rtsr_cli.core.choices import LutConvention
from rtsr_cli.core.imaging.brdf_lut import integrate_lut
from rtsr_cli.core.io.exr import write_exr
from rtsr_cli.core.io.png import write_png


def write_table(outputs: tuple[Path, ...], *, size: int, samples: int, convention: str) -> None:
    """Write A and B to the first path, and a picture (red A, green B) to the second if given.

    Raises:
        OutputError: a file cannot be written.
    """
    scale, bias = integrate_lut(size, samples, LutConvention(convention))[0].numpy()
    attributes = {
        "software": f"rtsr {__version__}",
        "rtsr:version": __version__,
        "rtsr:lutConvention": convention,
        "rtsr:lutSamples": samples,
    }
    with unwinding():
        for picture in outputs[1:]:
            rgb = np.stack((scale, bias, np.zeros_like(scale)), axis=-1)
            write_png(picture, np.rint(rgb * 255).astype(np.uint8))
        write_exr(outputs[0], {"A": scale, "B": bias}, attributes=attributes)
