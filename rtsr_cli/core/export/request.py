"""What `export` is asked for; imports no torch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.choices import Precision
from rtsr_cli.core.errors import RequestError
from rtsr_cli.core.requests import accept_words, check_ranges

MOST_SIDE = 16384
"""Of a frame that a file of one size takes."""

SCALES = (1, 16)

OPSETS = (15, 18)
"""Versions of ONNX' operators: Unity documents the first, torch traces the other."""

PRECISIONS = (Precision.FP32, Precision.FP16)
"""Number formats that runtimes take."""


@dataclass(frozen=True, kw_only=True)
class ExportRequest:
    """Write a system's network as ONNX files and a manifest.

    Attributes:
        source: name of a system, or a file of weights.
        out_folder: where the files go.
        scale: of the shipped weights of a system; None = the only scale that it comes with.
        precision: number format of the files, fp32 or fp16.
        size: (height, width) of the LR frames that the files take; None = any.
        opset: version of the operators, 15 or 18.
        overwrite: replace files that are there.
        frames_of: frames that the files are proven with, too, as the system's command takes them.
        proof_frames: numbers of these, None = all.
    """

    source: str
    out_folder: Path
    scale: int | None = None
    precision: Precision = Precision.FP32
    size: tuple[int, int] | None = None
    opset: int = OPSETS[0]
    overwrite: bool = False
    frames_of: Path | None = None
    proof_frames: frozenset[int] | None = None

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            RequestError: one is not among those that it may be.
        """
        accept_words(self)
        check_ranges(self, scale=SCALES)
        if self.precision not in PRECISIONS:
            raise RequestError(f"precision is {self.precision}: fp32 or fp16")
        if self.opset not in OPSETS:
            raise RequestError(f"opset is {self.opset}: {' or '.join(map(str, OPSETS))}")
        if self.proof_frames is not None and self.frames_of is None:
            raise RequestError("--proof-frames: of what --frames-of names; give it, too")
        if self.size is not None and not all(1 <= side <= MOST_SIDE for side in self.size):
            height, width = self.size
            raise RequestError(f"size is {width}x{height}: sides from 1 to {MOST_SIDE}")
