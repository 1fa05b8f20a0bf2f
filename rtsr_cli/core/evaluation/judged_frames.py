"""Reading what is judged: one frame of the reference, the tests and the buffers, checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import torch
from torch import Tensor

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.evaluation.comparisons import Comparison
from rtsr_cli.core.evaluation.predicted_frames import read_history
from rtsr_cli.core.evaluation.regions import REGION_BUFFERS
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.primaries import to_rec709
from rtsr_cli.core.pairs.simulation import average_samples
from rtsr_cli.core.shapes import Color, Mask

REFERENCE = ""
"""Stands for the reference among methods."""


@dataclass(frozen=True, kw_only=True)
class JudgedFrame:
    """Everything that is compared of one frame, cut by the border.

    Attributes:
        number: frame number.
        reference: linear Rec.709, finite.
        tests: method -> the same.
        valid: method -> pixels that are finite there and in the reference, 1 x 1 x h x w booleans.
        nonfinite: method -> pixels that are not, in the test.
        nonfinite_reference: pixels that are not, in the reference.
        negative: method, or "" for the reference, -> values of radiance below 0, as stored.
        known: pixels of the reference that are finite, as `valid`.
        gbuffer: buffers, None where there are none.
        past: method -> rendered frames that its prediction had before it, as its file says.
        between: whether it lies between judged frames, and is compared for its change alone.
    """

    number: int
    reference: Color
    tests: Mapping[str, Color]
    valid: Mapping[str, Mask]
    nonfinite: Mapping[str, int]
    nonfinite_reference: int
    negative: Mapping[str, int]
    known: Mask
    gbuffer: Frame | None
    past: Mapping[str, int] = field(default_factory=dict)
    between: bool = False


def check_border(comparison: Comparison, border: int) -> None:
    """Raise if a border leaves nothing of the frames.

    Raises:
        FrameFolderError: names the reference's folder and the size.
    """
    height, width = comparison.size
    if min(height, width) <= 2 * border:
        raise FrameFolderError(
            f"{comparison.reference.frames.root}: a border of {border} pixels leaves nothing of "
            f"{width} x {height}; choose a smaller --border"
        )


def read_judged(
    comparison: Comparison, number: int, *, border: int, device: str = "cpu"
) -> JudgedFrame:
    """Read one frame of every folder.

    Raises:
        FrameFolderError: a file is damaged.
    """
    reference, known, below = _read_radiance(comparison.reference, number, comparison.samples)
    tests, valid, nonfinite = {}, {}, {}
    negative = {REFERENCE: below}
    for method, reader in comparison.tests.items():
        test, finite, negative[method] = _read_radiance(reader, number, 1)
        nonfinite[method] = int((~finite).sum())
        tests[method] = _cut(test, border).to(device)
        valid[method] = _cut(finite & known, border).to(device)
    past = {m: read_history(reader, number) for m, reader in comparison.tests.items()}
    return JudgedFrame(
        number=number,
        reference=_cut(reference, border).to(device),
        tests=tests,
        valid=valid,
        nonfinite=nonfinite,
        nonfinite_reference=int((~known).sum()),
        negative=negative,
        known=_cut(known, border).to(device),
        gbuffer=read_surfaces(comparison, number, border=border, device=device),
        past={m: count for m, count in past.items() if count is not None},
        between=number in comparison.between,
    )


def read_surfaces(
    comparison: Comparison, number: int, *, border: int, device: str = "cpu"
) -> Frame | None:
    """Read the buffers of one frame; None where there are none.

    Raises:
        FrameFolderError: a file is damaged.
    """
    reader = comparison.gbuffer
    if reader is None or number not in reader.numbers:
        return None
    height, width = comparison.size
    inside = (height - 2 * border, width - 2 * border)
    full = average_samples(
        reader.read(number, REGION_BUFFERS & reader.readable), comparison.samples
    )
    return full.crop(border, border, inside).to(device)


def _cut(image: Tensor, border: int) -> Tensor:
    return image[..., border : image.shape[-2] - border, border : image.shape[-1] - border]


def _read_radiance(reader: FrameReader, number: int, samples: int) -> tuple[Color, Tensor, int]:
    """Linear Rec.709 of a frame, not finite pixels black; which are finite; values below 0."""
    frame = reader.read(number, (Buffer.COLOR,))
    color = average_samples(frame, samples).gbuffer[Buffer.COLOR]
    finite = torch.isfinite(color).all(1, keepdim=True)
    if not bool(finite.all()):
        color = color.masked_fill(~finite, 0.0)
    below = int((color < 0).sum()) if float(color.amin()) < 0 else 0
    return to_rec709(color, reader.conventions.colorspace), finite, below
