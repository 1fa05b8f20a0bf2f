"""8-bit PNG pictures, for people to look at."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import torch
from numpy.typing import NDArray

from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.imaging.color import encode_reinhard, encode_srgb
from rtsr_cli.core.io.exr import write_atomically
from rtsr_cli.core.shapes import Color


def write_png(path: Path, rgb: NDArray[np.uint8]) -> None:
    """Write (height, width, 3) values as a PNG, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """

    def write(part: Path) -> None:
        # the temporary name ends in no image suffix, so the format is named here
        output = oiio.ImageOutput.create("png")
        if output is None:
            raise OutputError(f"{path}: this OpenImageIO cannot write PNG")
        spec = oiio.ImageSpec(rgb.shape[1], rgb.shape[0], rgb.shape[2], "uint8")
        if not (
            output.open(str(part), spec)
            and output.write_image(np.ascontiguousarray(rgb))
            and output.close()
        ):
            raise OutputError(f"{path}: {output.geterror()}")

    write_atomically(path, write)


def preview(color: Color) -> NDArray[np.uint8]:
    """Linear radiance to display: c/(1+c), sRGB curve, 8 bit; non-finite pixels magenta."""
    encoded = encode_srgb(encode_reinhard(torch.nan_to_num(color[0:1].float())))[0]
    finite = torch.isfinite(color[0]).all(0)
    magenta = torch.tensor([1.0, 0.0, 1.0]).view(3, 1, 1)
    pixels = torch.where(finite.cpu(), encoded.cpu(), magenta)
    array: NDArray[np.uint8] = (pixels * 255.0 + 0.5).to(torch.uint8).permute(1, 2, 0).numpy()
    return array
