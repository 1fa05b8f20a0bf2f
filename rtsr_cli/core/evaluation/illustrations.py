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

from rtsr_cli.core.evaluation.judged_frames import REFERENCE, JudgedFrame, read_judged
from rtsr_cli.core.evaluation.judgement import JudgedShot, Judgement
from rtsr_cli.core.evaluation.metric_table import METRICS, Better, MetricRules
from rtsr_cli.core.evaluation.protocols import ShownPicture
from rtsr_cli.core.files.picture_bytes import encode_picture
from rtsr_cli.core.metrics.flip import ldr_flip
from rtsr_cli.core.metrics.heat_map import heat_map
from rtsr_cli.core.metrics.temporal import stack_rows
from rtsr_cli.core.reporting.report import Crop, Moment, Picture, Strip
from rtsr_cli.core.shapes import Color, Mask, PixelMap

MOST_PICTURES = 42
"""Pictures of whole frames in a report: about 10 MB."""

MOST_MOMENTS, LEAST_MOMENTS = 6, 2

WIDEST_PX = 960
"""Whole frames are shown no wider; their worst part is shown pixel by pixel beside."""

CROP_PX = 160
BOX_STEP_PX = 8
"""Places at which the worst part may begin."""

MOST_STRIPS = 6
STRIP_HEIGHT_PX = 96
"""Short sequences are stretched to about so many rows."""

MAGENTA = (1.0, 0.0, 1.0)
"""Pixels that are not finite."""

MARK_PX = 3
"""Side of their marks in whole frames, odd."""


def draw_moments(shots: Sequence[JudgedShot], judgement: Judgement) -> Iterator[Moment]:
    """Show the frames on which the methods are worst, worst first, the middling one, spoilt ones.

    Raises:
        RtsrError: a frame cannot be read any more.
    """
    name = _choose_ranking_metric(judgement.run.rules.metrics)
    ranked = sorted(
        _rank_frames(shots, name), key=lambda ranked_frame: ranked_frame[0], reverse=True
    )
    count = MOST_PICTURES // (2 * len(shots[0].frames) + 1)
    worst = ranked[: max(LEAST_MOMENTS, min(MOST_MOMENTS, count)) - 1]
    middle = len(ranked) // 2
    middling = ranked[middle : middle + 1] if middle >= len(worst) else []
    reasons: dict[tuple[str, int], list[str]] = {}
    for place, (_, shot, number) in enumerate([*worst, *middling]):
        rank = _format_ordinal(place) if place < len(worst) else "middling"
        why = f"{rank} by {METRICS[name].title}{_describe_owner(shot, number, name)}"
        reasons[shot.comparison.shot, number] = [why]
    spoilt = list(_list_spoilt_frames(shots))
    for shot, number, why in spoilt:
        reasons.setdefault((shot.comparison.shot, number), []).append(why)
    by_name = {shot.comparison.shot: shot for shot in shots}
    closer = {(shot.comparison.shot, number) for shot, number, _ in spoilt}
    for key, whys in reasons.items():
        frame = read_judged(by_name[key[0]].comparison, key[1], border=judgement.run.border)
        yield _draw_moment(
            key[0], frame, "; ".join(whys), rules=judgement.run.rules, spoilt=key in closer
        )


def _describe_owner(shot: JudgedShot, number: int, name: str) -> str:
    """Say of which method a frame's value is, or that it is a mean and who is worst."""
    metric = METRICS[name]
    facts = {method: f.get(str(number), {}) for method, f in shot.frames.items()}
    known = {method: v for method, f in facts.items() if (v := f.get(name)) is not None}
    if not known:
        return ""
    worst = (max if metric.better is Better.LOWER else min)(known, key=lambda m: known[m])
    value = f"{known[worst]:.4g} {metric.unit}".rstrip()
    if len(facts) == 1:
        return f" of {worst}, {value}"
    return f", the mean of {len(known)} tests; {worst} has the worst, {value}"


def _list_spoilt_frames(shots: Sequence[JudgedShot]) -> Iterator[tuple[JudgedShot, int, str]]:
    """(shot, number, why) of the frames with most pixels that are not finite: test, reference."""
    for key in ("nonfinite", "nonfinite_reference"):
        counts = [
            (int(facts.get(key, 0)), shot, number, method)
            for shot in shots
            for method, frames in shot.frames.items()
            for number, facts in frames.items()
        ]
        bad = [count for count in counts if count[0]]
        if bad:
            most, shot, number, method = max(bad, key=lambda count: count[0])
            whose = method if key == "nonfinite" else "the reference"
            yield shot, int(number), f"pixels of {whose} that are not finite: {most}"


def _choose_ranking_metric(metrics: Sequence[str]) -> str:
    """FLIP where it was computed, else the first metric that frames have."""
    per_frame = [n for n in metrics if METRICS[n].measure or METRICS[n].whole]
    return "flip" if "flip" in metrics or not per_frame else per_frame[0]


def _rank_frames(shots: Sequence[JudgedShot], name: str) -> Iterator[tuple[float, JudgedShot, int]]:
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


def _format_ordinal(place: int) -> str:
    return "worst" if place == 0 else f"{place + 1}. worst"


def _draw_moment(
    shot: str, frame: JudgedFrame, why: str, *, rules: MetricRules, spoilt: bool
) -> Moment:
    """Draw a frame; `spoilt`: its cut-out is where most pixels are not finite."""
    reference = ShownPicture(frame.reference, rules.protocol).structure
    tests = {m: ShownPicture(color, rules.protocol).structure for m, color in frame.tests.items()}
    errors = {m: ldr_flip(image, reference, rules.ppd) for m, image in tests.items()}
    counted = {m: error * frame.valid[m][:, 0] for m, error in errors.items()}
    bad = {m: ~valid for m, valid in frame.valid.items()}
    sought = {m: mask[:, 0].float() for m, mask in bad.items()} if spoilt else counted
    # a pixel of the reference that is not finite is bad in every test
    box = _find_worst_box(torch.stack(list(sought.values())).mean(0))
    heat = {m: heat_map(error) for m, error in errors.items()}
    return Moment(
        shot=shot,
        frame=frame.number,
        why=why,
        size=(reference.shape[-1], reference.shape[-2]),
        reference=_draw_whole(reference, ~frame.known),
        tests={m: _draw_whole(image, bad[m]) for m, image in tests.items()},
        heat={m: _draw_whole(image, bad[m]) for m, image in heat.items()},
        crop=Crop(
            box=box,
            reference=_draw_part(reference, ~frame.known, box),
            tests={m: _draw_part(image, bad[m], box) for m, image in tests.items()},
            heat={m: _draw_part(image, bad[m], box) for m, image in heat.items()},
        ),
    )


def _mark_nonfinite(image: Color, bad: Mask) -> Color:
    """Show pixels that are not finite in magenta."""
    return torch.where(bad, image.new_tensor(MAGENTA).view(1, 3, 1, 1), image)


def _find_worst_box(error: PixelMap) -> tuple[int, int, int, int]:
    """(left, top, width, height) of the square with the largest mean error."""
    height, width = error.shape[-2:]
    rows, columns = min(CROP_PX, height), min(CROP_PX, width)
    # the last squares reach over the border, so that none of its pixels is missed
    padded = F.pad(error[:, None], (0, BOX_STEP_PX - 1, 0, BOX_STEP_PX - 1))
    means = F.avg_pool2d(padded, (rows, columns), stride=BOX_STEP_PX)[0, 0]
    top, left = divmod(int(means.argmax()), means.shape[1])
    left, top = min(left * BOX_STEP_PX, width - columns), min(top * BOX_STEP_PX, height - rows)
    return left, top, columns, rows


def _to_bytes(image: Color) -> NDArray[np.uint8]:
    pixels = (image[0].float().clamp(0.0, 1.0) * 255.0).round().to(torch.uint8)
    array: NDArray[np.uint8] = pixels.permute(1, 2, 0).contiguous().cpu().numpy()
    return array


def _encode_picture(image: Color, kind: str) -> Picture:
    pixels = _to_bytes(image)
    height, width = pixels.shape[:2]
    data = encode_picture(pixels, kind)
    return Picture(data=data, mime=f"image/{kind}", width=width, height=height)


def _draw_whole(image: Color, bad: Mask) -> Picture:
    """A frame, scaled down where it is wide; bad pixels are enlarged so that one alone is seen."""
    height, width = image.shape[-2:]
    seen = bad.float()
    if width > WIDEST_PX:
        size = (round(height * WIDEST_PX / width), WIDEST_PX)
        image = F.interpolate(image, size, mode="area")
        seen = F.adaptive_max_pool2d(seen, size)
    seen = F.max_pool2d(seen, MARK_PX, stride=1, padding=MARK_PX // 2)
    return _encode_picture(_mark_nonfinite(image, seen > 0), "jpeg")


def _draw_part(image: Color, bad: Mask, box: tuple[int, int, int, int]) -> Picture:
    left, top, width, height = box
    inside = slice(top, top + height), slice(left, left + width)
    return _encode_picture(_mark_nonfinite(image, bad)[..., *inside], "png")


def draw_strips(shots: Sequence[JudgedShot]) -> Iterator[Strip]:
    """Show one row of every frame, time downwards, for the first shots that have some."""
    for shot in [shot for shot in shots if shot.slice.rows][:MOST_STRIPS]:
        rows: Mapping[str, list[Tensor]] = shot.slice.rows
        pictures = {method: _draw_strip(frames) for method, frames in rows.items()}
        yield Strip(
            shot=shot.comparison.shot,
            row=shot.slice.row,
            reference=pictures.pop(REFERENCE),
            tests=pictures,
        )


def _draw_strip(rows: Sequence[Tensor]) -> Picture:
    image = stack_rows([row.float() for row in rows])
    left = max(0, (image.shape[-1] - WIDEST_PX) // 2)
    image = image[..., left : left + WIDEST_PX]
    times = max(1, STRIP_HEIGHT_PX // image.shape[2])
    return _encode_picture(image.repeat_interleave(times, dim=2), "png")
