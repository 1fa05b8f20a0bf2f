"""Pictures as bytes, for reports."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rtsr_cli.core.errors import OutputError

JPEG_QUALITY = "jpeg:90"


def encode_picture(rgb: NDArray[np.uint8], kind: str) -> bytes:
    """Return (height, width, 3) values as the bytes of a "png" or "jpeg" file.

    Raises:
        OutputError: the picture cannot be encoded.
    """
    # what plans a report writes none yet
    import OpenImageIO as oiio  # noqa: N813

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
