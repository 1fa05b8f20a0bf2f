"""Finding how a dump stores its motion vectors, by warping pictures under every hypothesis.

The right reading of the vectors makes a frame look like its neighbour fetched along them; a wrong
direction, sign, axis, unit or centre does not. Hypotheses are `MotionConvention`s.

1. Screening: every hypothesis on some moving pixels of every triple of frames.
2. Final: the best of them on many pixels, each with its best constant offset (jitter that is
   in the vectors or the pictures shows as one), compared where all of them stay inside the frame.
Differences are paired over blocks of the image, so that a margin comes with its significance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol, TypeVar

import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.motion_finding import (
    MotionCandidate,
    MotionFinding,
)
from rtsr_cli.core.captures.measuring.motion_hypotheses import list_hypotheses
from rtsr_cli.core.captures.measuring.motion_trials import (
    FrameTriple,
    MotionEvidence,
    PixelSamples,
    fit_offset,
    lay_out_picture,
    sample_differences,
)
from rtsr_cli.core.frames.motion import Jitter, MotionConvention
from rtsr_cli.core.shapes import Size

STILL_PX = 1e-4
"""A stored vector this close to its centre is no motion, whatever its unit."""

SCREEN_PIXELS, FINAL_PIXELS, OFFSET_PIXELS = 768, 12288, 2048
"""Pixels of a triple that are looked at."""

SCREEN_BATCH = 32
"""Hypotheses that are screened in one sweep."""

FINALISTS = 12

OFFSET_GAIN = 0.04
"""An offset is taken for real where it lowers the error by this share; smaller gains are chance."""

LEAST_INSIDE = 0.5
"""A hypothesis that leads more than this share of the pixels out of the frame is not compared."""

BLOCKS = 8
"""Blocks of the image along each axis, over which differences are paired."""

LEAST_BLOCK_PIXELS = 8

LEAST_BLOCKS = 8
"""Of fewer blocks chance is not told from what is not."""

LEAST_UNRELATED = 0.1
"""Pictures whose pixels differ less from each other, of 1 for chance, hold nothing to follow."""

SAME_VECTORS_PX = 0.2
"""Vectors of neighbouring files that are this close do not tell which file is meant: interpolation
alone makes such a difference."""


T = TypeVar("T")
R = TypeVar("R")


class ParallelMap(Protocol):
    """`map`, or something that does the same in several threads."""

    def __call__(self, work: Callable[[T], R], items: Iterable[T], /) -> Iterable[R]:
        """Return the results in the order of the items."""


def find_centre(stored: Tensor) -> float:
    """Stored value of no motion: 0.5 where everything lies in 0..1 and most of it near 0.5."""
    low, high = float(stored.min()), float(stored.max())
    middle = float((stored - 0.5).abs().median())
    return 0.5 if low >= 0.0 and high <= 1.0 and middle < min(0.25, float(stored.median())) else 0.0


def _make_triples(
    frames: Mapping[int, MotionEvidence], centre: float, screen: Size
) -> list[FrameTriple]:
    pictures = {n: lay_out_picture(e) for n, e in frames.items()}
    stored = {n: e.stored[0].flatten(1) for n, e in frames.items()}
    jitter = {n: e.jitter_px for n, e in frames.items()}
    triples = []
    for number, picture in pictures.items():
        if number - 1 not in pictures:
            continue
        moving = ((stored[number] - centre).abs().amax(0) > STILL_PX).nonzero()[:, 0]
        if len(moving) == 0:
            continue
        chooser = torch.Generator().manual_seed(number % 2**32)
        index = moving[torch.randperm(len(moving), generator=chooser)[:FINAL_PIXELS]]
        width = picture.size[1]
        samples = PixelSamples(
            (index % width).float(),
            (index // width).float(),
            picture.rows[index],
            None if picture.ids is None else picture.ids[index],
        )
        size = picture.size
        triples.append(FrameTriple(number, pictures, stored, jitter, samples, index, size, screen))
    # a frame with both neighbours answers every question; one with a single one only some
    complete = [t for t in triples if t.number + 1 in pictures]
    return complete or triples


def _screen_hypotheses(
    triples: Sequence[FrameTriple], tried: Sequence[MotionConvention], each: ParallelMap
) -> list[MotionConvention]:
    """Sort hypotheses by their mean error on few pixels; those that lead outside come last."""
    totals = torch.zeros(len(tried))
    for errors in each(partial(_measure_screening_errors, tried), triples):
        totals += errors
    return [tried[i] for i in totals.argsort(stable=True).tolist()]


def _measure_screening_errors(tried: Sequence[MotionConvention], triple: FrameTriple) -> Tensor:
    errors = torch.ones(len(tried))
    few = triple.samples.first(SCREEN_PIXELS)
    for start in range(0, len(tried), SCREEN_BATCH):
        batch = tried[start : start + SCREEN_BATCH]
        pictures, shifts = zip(*(triple.shift(h, SCREEN_PIXELS) for h in batch), strict=True)
        for other in dict.fromkeys(pictures):
            chosen = [i for i, picture in enumerate(pictures) if picture is other]
            error, inside = sample_differences(few, other, torch.stack([shifts[i] for i in chosen]))
            count = inside.sum(1)
            mean = (error * inside).sum(1) / count.clamp(min=1)
            mean = torch.where(count > LEAST_INSIDE * len(few.x), mean, torch.ones_like(mean))
            errors[[start + i for i in chosen]] = mean
    return errors


@dataclass(frozen=True)
class _TrialErrors:
    """Errors of one hypothesis on the pixels of one triple, as it is and with its best offset.

    `elsewhere` are those of fetching along the same vectors from where other pixels are.
    """

    plain: Tensor
    moved: Tensor
    inside: Tensor
    offset: Jitter
    elsewhere: Tensor


def _try_convention(triple: FrameTriple, convention: MotionConvention) -> _TrialErrors:
    other, shift = triple.shift(convention, FINAL_PIXELS)
    plain, inside = sample_differences(triple.samples, other, shift)
    # the order of the samples is random
    elsewhere, _ = sample_differences(triple.samples.turned(), other, shift)
    few = triple.samples.first(OFFSET_PIXELS)
    offset = fit_offset(few, other, shift[:, :OFFSET_PIXELS])
    moved, inside_moved = sample_differences(triple.samples, other, shift + offset[:, None])
    if float(moved.mean()) < (1.0 - OFFSET_GAIN) * float(plain.mean()):
        at = (float(offset[0]), float(offset[1]))
        return _TrialErrors(plain, moved, inside & inside_moved, at, elsewhere)
    return _TrialErrors(plain, plain, inside, (0.0, 0.0), elsewhere)


def _block_means(
    triple: FrameTriple, trials: Sequence[_TrialErrors], unmoved: Tensor
) -> tuple[Tensor, ...]:
    """Mean errors a block of each hypothesis and of standing still: plain, with offsets, elsewhere.

    Only pixels count at which all hypotheses stay inside, but for those that hardly do anywhere.
    """
    height, width = triple.size
    row = (triple.samples.y * BLOCKS / height).long()
    column = (triple.samples.x * BLOCKS / width).long()
    near = [t for t in trials if float(t.inside.float().mean()) > LEAST_INSIDE]
    common = torch.stack([t.inside for t in near]).all(0) if near else trials[0].inside
    block = (row * BLOCKS + column)[common]
    count = torch.zeros(BLOCKS * BLOCKS).index_add_(0, block, torch.ones(len(block)))

    def means(errors: Sequence[Tensor]) -> Tensor:
        stacked = torch.stack([*errors, unmoved])[:, common]
        sums = torch.zeros(len(stacked), BLOCKS * BLOCKS).index_add_(1, block, stacked)
        return (sums / count)[:, count >= LEAST_BLOCK_PIXELS]

    kinds = ([getattr(t, kind) for t in trials] for kind in ("plain", "moved", "elsewhere"))
    return tuple(map(means, kinds))


def find_motion(
    frames: Mapping[int, MotionEvidence],
    *,
    screen: Size,
    include: Sequence[MotionConvention] = (),
    each: ParallelMap = map,
) -> MotionFinding:
    """Rank every reading of the stored vectors.

    Args:
        frames: consecutive frames by position in the sequence (0, 1, 2, ... or gaps between
            groups); three in a row allow every question, two only those about the previous one.
        screen: (height, width) that uv and ndc span; the images may be a part of it.
        include: conventions that take part in the final whatever the screening says (a preset,
            a declaration).
        each: how work is done on every triple of frames: one after the other, or at a time.
    """
    stored = torch.cat([e.stored.flatten() for e in frames.values()])
    centre = find_centre(stored)
    triples = _make_triples(frames, centre, screen)
    moved = [((e.stored - centre).abs().amax(1) > STILL_PX).float().mean() for e in frames.values()]
    moving = float(torch.stack(moved).mean())
    numbers = tuple(t.number for t in triples)
    if not triples:
        return MotionFinding(candidates=(), unmoved_error=1.0, moving=moving, triples=numbers)
    tried = [h for h in list_hypotheses(centre) if all(t.allows(h) for t in triples)]
    screened = _screen_hypotheses(triples, tried, each)
    finalists = list(dict.fromkeys([*screened[:FINALISTS], *_list_tryable(include, triples)]))
    return _judge_finalists(triples, finalists, each, moving=moving)


def _list_tryable(
    include: Sequence[MotionConvention], triples: Sequence[FrameTriple]
) -> list[MotionConvention]:
    plain = [replace(c, jittered=False, jitter_inverted=False) for c in include]
    return [c for c in plain if all(t.allows(c) for t in triples)]


def _judge_finalists(
    triples: Sequence[FrameTriple],
    finalists: Sequence[MotionConvention],
    each: ParallelMap,
    *,
    moving: float,
) -> MotionFinding:
    blocks, offsets = zip(*each(partial(_measure_final_errors, finalists), triples), strict=True)
    plain, moved, elsewhere = (torch.cat(parts, dim=1) for parts in zip(*blocks, strict=True))
    if moved.shape[1] == 0:
        return MotionFinding(candidates=(), unmoved_error=1.0, moving=moving, triples=())
    best = int(moved[:-1].mean(1).argmin())
    # where the best reading needs no offset, another one that does is not excused by it
    needed = any(by_triple[best] != (0.0, 0.0) for by_triple in offsets)
    errors = moved if needed else plain
    means = errors.mean(1)
    candidates = [
        MotionCandidate(
            convention=convention,
            error=float(means[i]),
            margin=float(1.0 - means[best] / means[i].clamp(min=1e-9)),
            significance=_significance(errors[i] - errors[best]),
            offsets_px=tuple(by_triple[i] for by_triple in offsets),
            same_vectors=i != best and _are_same_vectors(triples, convention, finalists[best]),
            gain=_measure_gain(errors[i], elsewhere[i]),
            gain_significance=_significance(elsewhere[i] - errors[i]),
        )
        for i, convention in enumerate(finalists)
    ]
    return MotionFinding(
        candidates=tuple(sorted(candidates, key=lambda c: c.error)),
        unmoved_error=float(means[-1]),
        moving=moving,
        triples=tuple(t.number for t in triples),
    )


def _measure_gain(errors: Tensor, elsewhere: Tensor) -> float | None:
    """1 - error along vectors / error elsewhere, by blocks; None where that is chance.

    Pictures without detail are alike everywhere.
    """
    unrelated = float(elsewhere.mean())
    if len(errors) < LEAST_BLOCKS or unrelated < LEAST_UNRELATED:
        return None
    return 1.0 - float(errors.mean()) / unrelated


def _measure_final_errors(
    finalists: Sequence[MotionConvention], triple: FrameTriple
) -> tuple[tuple[Tensor, ...], list[Jitter]]:
    """Block means of every finalist on one triple, and the offsets that fit best."""
    trials = [_try_convention(triple, convention) for convention in finalists]
    other, shift = triple.shift(replace(finalists[0], scale=0.0), FINAL_PIXELS)
    unmoved, _ = sample_differences(triple.samples, other, shift)
    return _block_means(triple, trials, unmoved), [trial.offset for trial in trials]


def _are_same_vectors(
    triples: Sequence[FrameTriple], one: MotionConvention, other: MotionConvention
) -> bool:
    """Tell whether two readings differ in the file only, and hardly in the vectors."""
    if replace(one, file_offset=0) != replace(other, file_offset=0):
        return False
    apart = [
        (t.shift(one, OFFSET_PIXELS)[1] - t.shift(other, OFFSET_PIXELS)[1]).abs().amax(0).median()
        for t in triples
    ]
    return float(torch.stack(apart).amax()) < SAME_VECTORS_PX


def _significance(differences: Tensor) -> float:
    """t = mean / standard error of paired differences; 0 where all are equal."""
    if len(differences) < 2 or float(differences.abs().amax()) == 0.0:
        return 0.0
    spread = differences.std() / len(differences) ** 0.5
    return float(differences.mean() / spread.clamp(min=1e-9))
