"""What `precompute-lut` is asked for; imports no torch."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.choices import LutConvention
from rtsr_cli.core.errors import RequestError
from rtsr_cli.core.requests import accept_words, check_ranges

SUFFIX = ".exr"

MIN_SIZE, MAX_SIZE = 2, 8192
"""Texels a side; the largest table takes 512 MiB."""

MIN_SAMPLES = 16


@dataclass(frozen=True, kw_only=True)
class PrecomputeLutRequest:
    """Which table of the split sum is made, and where it is written.

    Attributes:
        out: EXR file.
        size: texels a side; texel centres at (i + 0.5) / size.
        samples: of the integral of a texel.
        convention: how a roughness becomes alpha and k.
        preview: also write a PNG beside it (red A, green B).
        overwrite: replace files that are there.
    """

    out: Path
    size: int = 512
    samples: int = 1024
    convention: LutConvention = LutConvention.KARIS
    preview: bool = False
    overwrite: bool = False

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            RequestError: the file is no EXR, or a number is out of its range.
        """
        accept_words(self)
        if self.out.suffix.lower() != SUFFIX:
            raise RequestError(f"{self.out} must end in {SUFFIX}")
        check_ranges(self, size=(MIN_SIZE, MAX_SIZE), samples=(MIN_SAMPLES, math.inf))

    @property
    def outputs(self) -> tuple[Path, ...]:
        """Files that are written, the table first."""
        return (self.out, self.out.with_suffix(".png")) if self.preview else (self.out,)
