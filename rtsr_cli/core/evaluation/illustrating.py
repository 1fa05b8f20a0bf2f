"""Pictures for the report: the worst frames beside their reference, FLIP maps, EPI strips.

Frames are read again when the scores are known, so that a run holds none of them meanwhile.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from rtsr_cli.core.evaluation.frames import JudgedFrame, read_judged
from rtsr_cli.core.evaluation.judging import REFERENCE, JudgedShot, Judgement
from rtsr_cli.core.evaluation.metric_table import METRICS, Better
from rtsr_cli.core.evaluation.protocols import Shown
from rtsr_cli.core.io.encoding import encoded
from rtsr_cli.core.metrics.flip import ldr_flip
from rtsr_cli.core.metrics.heat import heat_map
from rtsr_cli.core.metrics.temporal import epi
from rtsr_cli.core.reporting.report import Crop, Moment, Picture, Strip
from rtsr_cli.core.shapes import Color, PixelMap

MOST_PICTURES = 42
"""Pictures of whole frames in a report: about 10 MB."""

MOST_MOMENTS, LEAST_MOMENTS = 6, 2

WIDEST_PX = 960
"""Whole frames are shown no wider; their worst part is shown pixel by pixel beside."""

CROP_PX = 160
MOST_STRIPS = 6
STRIP_HEIGHT_PX = 96
"""Short sequences are stretched to about so many rows."""

MAGENTA = (1.0, 0.0, 1.0)
"""Pixels that are not finite."""


def moments(shots: Sequence[JudgedShot], judgement: Judgement) -> Iterator[Moment]:
    """Show the frames on which the methods are worst, worst first, and the middling one.

    Raises:
        RtsrError: a frame cannot be read any more.
    """
    name = _ranking(judgement.run.rules.metrics)
    ranked = sorted(_frames(shots, name), key=lambda found: found[0], reverse=True)
    count = MOST_PICTURES // (2 * len(shots[0].frames) + 1)
    worst = ranked[: max(LEAST_MOMENTS, min(MOST_MOMENTS, count)) - 1]
    middling = ranked[len(ranked) // 2 :][:1] if len(ranked) > len(worst) else []
    title = METRICS[name].title
    for place, (_, shot, number) in enumerate([*worst, *middling]):
        why = f"{_ordinal(place)} by {title}" if place < len(worst) else f"middling by {title}"
        yield _moment(shot, number, why, judgement)


def _ranking(metrics: Sequence[str]) -> str:
    """FLIP where it was computed, else the first metric that frames have."""
    per_frame = [n for n in metrics if METRICS[n].measure or METRICS[n].whole]
    return "flip" if "flip" in metrics or not per_frame else per_frame[0]


def _frames(shots: Sequence[JudgedShot], name: str) -> Iterator[tuple[float, JudgedShot, int]]:
    """(badness, shot, number) of every frame that counts: the mean over the methods."""
    sign = 1.0 if METRICS[name].better is Better.LOWER else -1.0
    for shot in shots:
        for number in shot.comparison.numbers:
            facts = [f[str(number)] for f in shot.frames.values() if str(number) in f]
            if not facts:
                continue
            values = [f.get(name) for f in facts]
            known = [v for v in values if v is not None and np.isfinite(v)]
            if facts[0]["counted"]:
                yield sign * float(np.mean(known)) if known else -np.inf, shot, number


def _ordinal(place: int) -> str:
    return "worst" if place == 0 else f"{place + 1}. worst"


def _moment(shot: JudgedShot, number: int, why: str, judgement: Judgement) -> Moment:
    run = judgement.run
    frame = read_judged(shot.comparison, number, border=run.border)
    reference = Shown(frame.reference, run.rules.protocol)
    tests = {m: Shown(color, run.rules.protocol) for m, color in frame.tests.items()}
    errors = {
        m: ldr_flip(s.structure, reference.structure, run.rules.ppd) for m, s in tests.items()
    }
    shown = {m: _marked(s.structure, frame, m) for m, s in tests.items()}
    box = _worst_box(torch.stack(list(errors.values())).mean(0))
    heat = {m: heat_map(error) for m, error in errors.items()}
    return Moment(
        shot=shot.comparison.shot,
        frame=number,
        why=why,
        size=(frame.reference.shape[-1], frame.reference.shape[-2]),
        reference=_whole(reference.structure),
        tests={m: _whole(image) for m, image in shown.items()},
        heat={m: _whole(image) for m, image in heat.items()},
        crop=Crop(
            box=box,
            reference=_part(reference.structure, box),
            tests={m: _part(image, box) for m, image in shown.items()},
            heat={m: _part(image, box) for m, image in heat.items()},
        ),
    )


def _marked(image: Color, frame: JudgedFrame, method: str) -> Color:
    """Show pixels that are not finite in magenta."""
    magenta = image.new_tensor(MAGENTA).view(1, 3, 1, 1)
    return torch.where(frame.valid[method], image, magenta)


def _worst_box(error: PixelMap) -> tuple[int, int, int, int]:
    """(left, top, width, height) of the square with the largest mean error."""
    height, width = error.shape[-2:]
    rows, columns = min(CROP_PX, height), min(CROP_PX, width)
    means = F.avg_pool2d(error[:, None], (rows, columns), stride=8)[0, 0]
    top, left = divmod(int(means.argmax()), means.shape[1])
    return left * 8, top * 8, columns, rows


def _bytes(image: Color) -> NDArray[np.uint8]:
    pixels = (image[0].float().clamp(0.0, 1.0) * 255.0).round().to(torch.uint8)
    array: NDArray[np.uint8] = pixels.permute(1, 2, 0).contiguous().cpu().numpy()
    return array


def _picture(image: Color, kind: str) -> Picture:
    pixels = _bytes(image)
    height, width = pixels.shape[:2]
    data = encoded(pixels, kind)
    return Picture(data=data, mime=f"image/{kind}", width=width, height=height)


def _whole(image: Color) -> Picture:
    height, width = image.shape[-2:]
    if width > WIDEST_PX:
        size = (round(height * WIDEST_PX / width), WIDEST_PX)
        image = F.interpolate(image, size, mode="area")
    return _picture(image, "jpeg")


def _part(image: Color, box: tuple[int, int, int, int]) -> Picture:
    left, top, width, height = box
    return _picture(image[..., top : top + height, left : left + width], "png")


def strips(shots: Sequence[JudgedShot]) -> Iterator[Strip]:
    """Show one row of every frame, time downwards, for the first shots."""
    for shot in shots[:MOST_STRIPS]:
        rows: Mapping[str, list[Tensor]] = shot.slice.rows
        pictures = {method: _strip(frames) for method, frames in rows.items()}
        yield Strip(
            shot=shot.comparison.shot,
            row=shot.slice.row,
            reference=pictures.pop(REFERENCE),
            tests=pictures,
        )


def _strip(rows: Sequence[Tensor]) -> Picture:
    image = epi([row.float() for row in rows])
    left = max(0, (image.shape[-1] - WIDEST_PX) // 2)
    image = image[..., left : left + WIDEST_PX]
    times = max(1, STRIP_HEIGHT_PX // image.shape[2])
    return _picture(image.repeat_interleave(times, dim=2), "png")
