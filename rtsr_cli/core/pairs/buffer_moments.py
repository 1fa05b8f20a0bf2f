"""Whether every buffer of a pair's frame is of that frame: files of one buffer may be exchanged.

A buffer b is another frame's, n, than its own, k, where

    strays(b_lr(k), b_hr(n)) or strays(b_lr(n), b_hr(k))  <  strays(b_lr(k), b_hr(k)) / 3

by more than counting samples leaves to chance, and another buffer tells k from n: of cameras that
stand still all frames are alike, and nothing is said. Which size holds the wrong one is told by the
outlines that it follows. Radiance is there at LR alone, and is another frame's by these only.

Frames beside are read only where samples stray from the own frame about as they do from a frame
that was read just before: textures that are finer than HR pixels stray, too.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.pairs.outlines import STEPS, Outlines, draw_outlines, hold_against
from rtsr_cli.core.pairs.pair_agreement import FEW_SHIFTED, FEW_STRAYS
from rtsr_cli.core.pairs.stray_samples import (
    CutBlocks,
    PickedSamples,
    Strays,
    count_picked,
    count_strays,
    cut_blocks,
    pick_samples,
)
from rtsr_cli.core.wording import join_names, say_verb

HELD = (
    Buffer.DEPTH,
    Buffer.OBJECT_ID,
    Buffer.GEONORMAL,
    Buffer.NORMAL,
    Buffer.ALBEDO,
    Buffer.MATERIAL,
    Buffer.SPECULAR,
    Buffer.METALLIC,
    Buffer.ROUGHNESS,
    Buffer.EMISSION,
)
"""Buffers that are the same at both sizes, those first that tell frames apart best."""

GLANCE_SAMPLES = 1 << 11
"""Samples of a first look, which tells whether more are looked at."""

MOST_RECENT = 8
"""Frames of which is kept what was seen of them."""

NEAREST = 4
"""Frames around one of which any is as good as the one before it, to compare with."""


@dataclass(frozen=True)
class ForeignBuffer:
    """A buffer of a frame that is another frame's.

    Attributes:
        buffers: those of which it is so.
        number: of the frame.
        other: that whose they are.
        fits: LR frame and HR frame that fit each other in them; None of radiance.
        size: `LR` or `HR`, where the wrong ones are; empty where nothing tells.
        share: of the LR samples that stray.
        told_by: the buffer that is the frame's own; empty where there is none.
    """

    buffers: tuple[Buffer, ...]
    number: int
    other: int
    fits: tuple[int, int] | None = None
    size: str = ""
    share: float = 0.0
    told_by: str = ""


Read = Callable[[int, Collection[Buffer]], GBuffer]
"""Number, buffers -> those of them."""

Glance = Mapping[Buffer, tuple[PickedSamples, CutBlocks]]
"""Few samples of a frame at both sizes."""

Key = TypeVar("Key")
Value = TypeVar("Value")

Fit = tuple[int | None, int | None]
"""LR frame, HR frame; None for the one in question."""


class BufferMoments:
    """Finds buffers of frames that are another frame's.

    Args:
        lr, hr: read buffers of other frames, of either size.
        scale: S.
    """

    def __init__(self, lr: Read, hr: Read, scale: int) -> None:
        """Have seen no frame yet."""
        self._reads = lr, hr
        self._scale = scale
        self._glances: dict[tuple[int, frozenset[Buffer]], Glance] = {}
        self._outlines: dict[tuple[int, frozenset[Buffer]], Outlines | None] = {}

    def find(
        self, number: int, lr: GBuffer, hr: GBuffer, others: Sequence[int]
    ) -> ForeignBuffer | None:
        """Find buffers of a frame that are another frame's; None where nothing says so.

        Args:
            number: of the frame.
            lr, hr: its buffers, as stored.
            others: numbers of the frames that are tried, the nearest first.
        """
        try:
            found = self._find_stored((lr, hr), number, others)
            return found or self._find_radiance(lr, number, others)
        except FrameFolderError:
            # whoever reads that frame next says why
            return None

    def _find_stored(
        self, own: tuple[GBuffer, GBuffer], number: int, others: Sequence[int]
    ) -> ForeignBuffer | None:
        held = [b for b in HELD if b in own[0] and b in own[1]]
        glance = self._glance(number, own, frozenset(held))
        doubted = [b for b in held if self._doubts(b, own, glance, others)]
        if not doubted:
            return None
        beside = {n: tuple(read(n, held) for read in self._reads) for n in others}
        pairs: dict[Fit, tuple[GBuffer, GBuffer]] = {}
        for n, (small, large) in beside.items():
            pairs[None, n], pairs[n, None] = (own[0], large), (small, own[1])
        found = {b: self._choose_fit(b, own, pairs) for b in doubted}
        alike = {b: fit for b, fit in found.items() if fit is not None}
        if not alike:
            return None
        first = next(iter(alike))
        fit, share = alike[first]
        other = next(n for n in fit if n is not None)
        told_by = self._tell_apart(own, beside[other][1], [b for b in held if b not in doubted])
        if told_by is None and len(held) > len(doubted):
            return None
        if told_by is None and not _differs(first, own[0], beside[other][0]):
            return None
        return ForeignBuffer(
            buffers=tuple(b for b, (same, _) in alike.items() if same == fit),
            number=number,
            other=other,
            fits=(number if fit[0] is None else fit[0], number if fit[1] is None else fit[1]),
            size=_name_size(first, own, beside[other]),
            share=share,
            told_by=told_by or "",
        )

    def _doubts(
        self,
        buffer: Buffer,
        own: tuple[GBuffer, GBuffer],
        glance: Glance,
        others: Sequence[int],
    ) -> bool:
        """Tell whether samples stray, and about as many from a frame beside."""
        found = count_picked(*glance[buffer])
        if found is None or not (found.flat or found.share > FEW_STRAYS / 2):
            return False
        # the sky's emission may be its own frame's where that of lamps is not
        compared = others and buffer is not Buffer.EMISSION
        if compared and _is_own(buffer, found, glance, self._glance_beside(others, glance)):
            return False
        found = count_strays(buffer, *own, self._scale)
        return found is not None and found.doubtful

    def _glance(self, number: int, own: tuple[GBuffer, GBuffer], held: frozenset[Buffer]) -> Glance:
        glance = {
            b: (
                pick_samples(b, own[0], GLANCE_SAMPLES),
                cut_blocks(b, own[1], self._scale, GLANCE_SAMPLES),
            )
            for b in HELD
            if b in held
        }
        self._glances = _keep(self._glances, (number, held), glance)
        return glance

    def _glance_beside(self, others: Sequence[int], glance: Glance) -> Glance:
        """What was seen of a frame around, read if there is none."""
        held = frozenset(glance)
        known = self._glances
        for number in others[:NEAREST]:
            if (number, held) in known:
                return known[number, held]
        small, large = (read(others[0], held) for read in self._reads)
        return self._glance(others[0], (small, large), held)

    def _choose_fit(
        self,
        buffer: Buffer,
        own: tuple[GBuffer, GBuffer],
        pairs: Mapping[Fit, tuple[GBuffer, GBuffer]],
    ) -> tuple[Fit, float] | None:
        """The pair of files that fit where those of the frame do not; share of these."""
        for dark in (False, True) if buffer is Buffer.EMISSION else (False,):
            count = partial(count_strays, buffer, scale=self._scale, dark_sky=dark)
            strays = count(*own)
            counted = {fit: count(*pair) for fit, pair in pairs.items()}
            known = {fit: found for fit, found in counted.items() if found is not None}
            if strays is None or not known:
                continue
            best = min(known, key=partial(_rate, known))
            if strays.is_far_above(known[best]) and _fits_alone(best, known, strays):
                return best, strays.share
        return None

    def _tell_apart(
        self, own: tuple[GBuffer, GBuffer], beside: GBuffer, fitting: Sequence[Buffer]
    ) -> Buffer | None:
        """The first buffer which fits its own HR frame, and not the other one."""
        for buffer in fitting:
            strays = count_strays(buffer, *own, self._scale)
            found = count_strays(buffer, own[0], beside, self._scale)
            if strays is None or found is None or found.share <= FEW_SHIFTED:
                continue
            if found.is_far_above(strays):
                return buffer
        return None

    def _find_radiance(
        self, lr: GBuffer, number: int, others: Sequence[int]
    ) -> ForeignBuffer | None:
        """A frame whose outlines LR radiance follows, and not those of its own."""
        drawn = frozenset(lr.keys() & {Buffer.COLOR, *STEPS})
        own = draw_outlines(lr.only(drawn), Buffer.COLOR)
        self._outlines = _keep(self._outlines, (number, drawn), own)
        if own is None:
            return None
        known = self._outlines
        nearest = sorted(others[:NEAREST], key=lambda n: (n, drawn) not in known)
        followed: dict[int, float] = {}
        for other in (*nearest, *others[NEAREST:]):
            beside = self._draw(other, drawn)
            found = None if beside is None else hold_against(own, beside)
            if found is not None and found.of_own and not followed:
                return None
            if found is not None and found.of_other:
                followed[other] = found.share
        if not followed:
            return None
        other = min(followed, key=followed.__getitem__)
        return ForeignBuffer(buffers=(Buffer.COLOR,), number=number, other=other, size="LR")

    def _draw(self, number: int, drawn: frozenset[Buffer]) -> Outlines | None:
        if (number, drawn) not in self._outlines:
            outlines = draw_outlines(self._reads[0](number, drawn), Buffer.COLOR)
            self._outlines = _keep(self._outlines, (number, drawn), outlines)
            return outlines
        return self._outlines[number, drawn]


def _keep(known: dict[Key, Value], key: Key, value: Value) -> dict[Key, Value]:
    """What is known of the last frames, and of one more; the same dictionary is never changed."""
    return dict([*known.items(), (key, value)][-MOST_RECENT:])


def _is_own(buffer: Buffer, found: Strays, glance: Glance, beside: Glance) -> bool:
    """Tell whether a buffer fits its own frame better than one beside, or all of both is alike."""
    counted = {
        b: [
            count_picked(one, other)
            for one, other in ((glance[b][0], beside[b][1]), (beside[b][0], glance[b][1]))
        ]
        for b in glance
    }
    known = {b: [strays for strays in pair if strays is not None] for b, pair in counted.items()}
    moved = [b for b, pair in known.items() if any(each.share > FEW_SHIFTED for each in pair)]
    if not moved:
        return True
    return bool(known[buffer]) and all(each.is_above(found) for each in known[buffer])


def _rate(found: Mapping[Fit, Strays], fit: Fit) -> tuple[float, float]:
    """The less, the better; files of two frames that are exchanged fit both ways."""
    back = found.get(fit[::-1])
    return found[fit].share, 1.0 if back is None else back.share


def _fits_alone(best: Fit, found: Mapping[Fit, Strays], own: Strays) -> bool:
    """Tell whether other frames than the best one fit no better than the own one, most of them.

    Of a frame that fits none beside it, for what it shows itself, many fit better.
    """
    rest = sorted(strays.share for fit, strays in found.items() if fit not in (best, best[::-1]))
    return not rest or 2.0 * rest[len(rest) // 2] >= own.share


def _differs(buffer: Buffer, lr: GBuffer, beside: GBuffer) -> bool:
    """Tell whether a buffer of LR is not the same in another frame: it moves."""
    found = count_strays(buffer, lr, beside, 1)
    return found is not None and found.share > FEW_SHIFTED


def _name_size(buffer: Buffer, own: tuple[GBuffer, GBuffer], beside: tuple[GBuffer, ...]) -> str:
    """The size whose buffer follows the outlines of another frame; empty where none tells."""
    found = []
    for size, one, other in zip(("LR", "HR"), own, beside, strict=True):
        known = {*HELD} & one.keys() & other.keys()
        outlines = [draw_outlines(gbuffer.only(known), buffer) for gbuffer in (one, other)]
        if outlines[0] is None or outlines[1] is None:
            continue
        follows = hold_against(outlines[0], outlines[1])
        if follows is not None and follows.of_other:
            found.append(size)
    return found[0] if len(found) == 1 else ""


def describe_foreign(found: ForeignBuffer, lr_root: Path, hr_root: Path) -> str:
    """Say which buffer of which frame is another frame's, by what, and what to do."""
    number, other = found.number, found.other
    if found.fits is None:
        return (
            f"{lr_root}: frame {number}: radiance shows frame {other}: it changes where the "
            f"surfaces of frame {other} meet, and not where those of its own G-buffer do; "
            f"{_say_remedy('radiance')}; where radiance is right, a buffer of the G-buffer is of "
            f"frame {other} at both sizes"
        )
    names = join_names(found.buffers)
    small, large = found.fits
    root = lr_root if found.size == "LR" else hr_root
    verb = say_verb(len(found.buffers))
    wrong = (
        f"{names} of {found.size} {verb} of frame {other}"
        if found.size
        else f"{names} of LR or of HR {verb} of another frame"
    )
    fits = f", though {found.told_by} does fit" if found.told_by else ""
    beside = hr_root if found.size == "LR" else lr_root
    return (
        f"{root}: frame {number}: {wrong} (beside {beside}): in {found.buffers[0]}, HR frame "
        f"{large} fits LR frame {small}; as it is, {found.share:.1%} of the LR samples of frame "
        f"{number} are unlike all HR pixels around them{fits}; "
        f"{_say_remedy(names)}"
    )


def _say_remedy(names: str) -> str:
    return f"name the files of {names} by their own frames (two exchanged?), or render them again"
