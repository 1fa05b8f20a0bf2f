"""8-bit PNG pictures, for people to look at."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import torch
from numpy.typing import NDArray

from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.frames.conventions import ColorSpace
from rtsr_cli.core.imaging.color import encode_reinhard, encode_srgb
from rtsr_cli.core.imaging.primaries import to_rec709
from rtsr_cli.core.io.atomic import write_atomically
from rtsr_cli.core.shapes import Color

PNG_END = b"IEND\xae\x42\x60\x82"
"""Last bytes of every PNG."""


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
        written = (
            output.open(str(part), spec)
            and output.write_image(np.ascontiguousarray(rgb))
            and output.close()
        )
        if not (written and part.read_bytes().endswith(PNG_END)):
            # of a full disk the library says nothing, but Python does, and by number
            part.write_bytes(rgb.tobytes())
            raise RuntimeError(output.geterror() or "the picture was cut short")

    write_atomically(path, write)


JPEG_QUALITY = "jpeg:90"


def encoded(rgb: NDArray[np.uint8], kind: str) -> bytes:
    """Return (height, width, 3) values as the bytes of a "png" or "jpeg" file.

    Raises:
        OutputError: the picture cannot be encoded.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"picture.{kind}"
        spec = oiio.ImageSpec(rgb.shape[1], rgb.shape[0], rgb.shape[2], "uint8")
        spec.attribute("compression", JPEG_QUALITY if kind == "jpeg" else "zip")
        output = oiio.ImageOutput.create(str(path))
        if output is None or not (
            output.open(str(path), spec)
            and output.write_image(np.ascontiguousarray(rgb))
            and output.close()
        ):
            raise OutputError(f"{path}: this OpenImageIO cannot write {kind}")
        return path.read_bytes()


def preview(color: Color, space: ColorSpace | None = None) -> NDArray[np.uint8]:
    """Linear radiance to display: Rec.709, c/(1+c), sRGB curve, 8 bit; non-finite pixels magenta.

    Args:
        color: linear radiance.
        space: its primaries; None is taken for Rec.709.
    """
    linear = to_rec709(torch.nan_to_num(color[0:1].float()), space)
    encoded = encode_srgb(encode_reinhard(linear))[0]
    finite = torch.isfinite(color[0]).all(0)
    magenta = torch.tensor([1.0, 0.0, 1.0]).view(3, 1, 1)
    pixels = torch.where(finite.cpu(), encoded.cpu(), magenta)
    array: NDArray[np.uint8] = (pixels * 255.0 + 0.5).to(torch.uint8).permute(1, 2, 0).numpy()
    return array
