"""Whether every buffer of a pair's frame is of that frame: files of one buffer may be exchanged.

A buffer b of LR frame k strays from HR frame k where `pair_agreement` says so, and strays for sure
where all HR pixels around are alike. It is another frame's, n, where

    strays(b_lr(k), b_hr(n)) or strays(b_lr(n), b_hr(k))  <  strays(b_lr(k), b_hr(k)) / 3

by more than counting samples leaves to chance, and another buffer tells k from n: of cameras that
stand still all frames are alike, and nothing is said. Which size holds the wrong one is told by the
outlines that it follows. Radiance is there at LR alone, and is another frame's by these only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.pairs.outlines import STEPS, Outlines, draw_outlines, hold_against
from rtsr_cli.core.pairs.pair_agreement import (
    ABSOLUTE,
    ENOUGH_SAMPLES,
    FAR_BETTER,
    FEW_SHIFTED,
    FEW_STRAYS,
    LEAST_SAMPLES,
    RELATIVE,
)
from rtsr_cli.core.shapes import Image
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

FLAT = 0.1
"""What HR pixels around a sample differ by at most where they are alike; of depth, of itself."""

FEW_FLAT = 0.001
"""Share of samples that stray from HR pixels that are alike, up to which nothing is doubted: right
pairs have 0.0005 at most."""

SURE = 4.0
"""Standard deviations of counts by which strays of the own frame are more than those of others."""


MOST_RECENT = 16
"""Frames whose outlines are kept."""


@dataclass(frozen=True)
class Strays:
    """How many of the samples that were looked at stray, and how many of them for sure."""

    counted: int
    strays: int
    flat: int

    @property
    def share(self) -> float:
        """Of those that stray."""
        return self.strays / self.counted

    @property
    def doubtful(self) -> bool:
        """Tell whether more stray than what right pairs have."""
        flat = self.flat > FEW_FLAT * self.counted and self.flat >= SURE
        return flat or self.share > FEW_STRAYS

    def is_far_above(self, other: Strays) -> bool:
        """Tell whether another frame fits far better, beyond chance."""
        samples = self.counted / other.counted
        return self.strays - FAR_BETTER * samples * other.strays > SURE * math.sqrt(self.strays)


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


def find_foreign(
    own: tuple[GBuffer, GBuffer],
    reads: tuple[Read, Read],
    number: int,
    scale: int,
    others: Sequence[int],
) -> ForeignBuffer | None:
    """Find buffers of a frame that fit another frame at the other size, and not their own.

    None where nothing says so, or other frames cannot be read.

    Args:
        own: buffers of the frame, of LR and of HR.
        reads: read the same buffers of other frames.
        number: of the frame.
        scale: S.
        others: numbers of those that are tried.
    """
    held = [b for b in HELD if b in own[0] and b in own[1]]
    doubted = list(_list_doubted(own, held, scale))
    if not doubted:
        return None
    try:
        found = [_find_frame(b, own, reads, scale, others) for b in doubted]
        alike = [(b, fit) for b, fit in zip(doubted, found, strict=True) if fit is not None]
        if not alike:
            return None
        lr, hr, share = alike[0][1]
        other = lr if hr is None else hr
        assert other is not None
        buffers = tuple(b for b, fit in alike if fit[:2] == (lr, hr))
        told_by = _tell_apart(own, reads, other, scale, [b for b in held if b not in doubted])
        if told_by is None and not _differs(doubted[0], own[0], reads[0], other):
            return None
        size = _name_size(buffers[0], own, reads, number, other)
    except FrameFolderError:
        return None
    return ForeignBuffer(
        buffers=buffers,
        number=number,
        other=other,
        fits=(number if lr is None else lr, number if hr is None else hr),
        size=size,
        share=share,
        told_by=told_by or "",
    )


def _list_doubted(
    own: tuple[GBuffer, GBuffer], held: Sequence[Buffer], scale: int
) -> Iterator[Buffer]:
    for buffer in held:
        found = count_strays(buffer, *own, scale, GLANCE_SAMPLES)
        if found is None or not (found.flat or found.share > FEW_STRAYS / 2):
            continue
        found = count_strays(buffer, *own, scale)
        if found is not None and found.doubtful:
            yield buffer


Fit = tuple[int | None, int | None, float]
"""LR frame, HR frame, None for the frame itself; share that strays as it is."""


def _find_frame(
    buffer: Buffer,
    own: tuple[GBuffer, GBuffer],
    reads: tuple[Read, Read],
    scale: int,
    others: Sequence[int],
) -> Fit | None:
    """The frame which the buffer of one size fits, and not that of its own."""
    # what is sky is told by depth
    kept = {buffer, Buffer.DEPTH}
    small, large = (gbuffer.only(kept & gbuffer.keys()) for gbuffer in own)
    tried: dict[tuple[int | None, int | None], tuple[GBuffer, GBuffer]] = {}
    for other in others:
        tried[None, other] = small, reads[1](other, large.keys())
        tried[other, None] = reads[0](other, small.keys()), large
    for dark in (False, True) if buffer is Buffer.EMISSION else (False,):
        strays = count_strays(buffer, small, large, scale, dark_sky=dark)
        counted = {
            n: count_strays(buffer, *pair, scale, dark_sky=dark) for n, pair in tried.items()
        }
        best = _choose({n: found for n, found in counted.items() if found is not None})
        if strays is not None and best is not None and strays.is_far_above(best[1]):
            return (*best[0], strays.share)
    return None


def _choose(
    found: dict[tuple[int | None, int | None], Strays],
) -> tuple[tuple[int | None, int | None], Strays] | None:
    """The pair that fits best: of two files that are exchanged both do, with the other's."""

    def rate(frames: tuple[int | None, int | None]) -> tuple[float, float]:
        back = found.get(frames[::-1])
        return found[frames].share, 1.0 if back is None else back.share

    best = min(found, key=rate, default=None)
    return None if best is None else (best, found[best])


def _tell_apart(
    own: tuple[GBuffer, GBuffer],
    reads: tuple[Read, Read],
    other: int,
    scale: int,
    fitting: Sequence[Buffer],
) -> Buffer | None:
    """The first buffer which fits its own frame, and not the other one."""
    for buffer in fitting:
        strays = count_strays(buffer, *own, scale)
        beside = count_strays(buffer, own[0], reads[1](other, (buffer,)), scale)
        if strays is None or beside is None or beside.share <= FEW_SHIFTED:
            continue
        if beside.is_far_above(strays):
            return buffer
    return None


def _differs(buffer: Buffer, lr: GBuffer, read: Read, other: int) -> bool:
    """Tell whether a buffer of LR is not the same in another frame: it moves."""
    beside = count_strays(buffer, lr, read(other, (buffer,)), 1)
    return beside is not None and beside.share > FEW_SHIFTED


def _name_size(
    buffer: Buffer,
    own: tuple[GBuffer, GBuffer],
    reads: tuple[Read, Read],
    number: int,
    other: int,
) -> str:
    """The size whose buffer follows the outlines of another frame; empty where none tells."""
    found = []
    for size, gbuffer, read in zip(("LR", "HR"), own, reads, strict=True):
        around = draw_outlines(gbuffer.only(gbuffer.keys() & {*HELD}), buffer)
        beside = draw_outlines(read(other, gbuffer.keys() & {*HELD}), buffer)
        follows = None if around is None or beside is None else hold_against(around, beside)
        if follows is not None and follows.of_other:
            found.append(size)
    return found[0] if len(found) == 1 else ""


def find_foreign_radiance(
    read: Callable[[int], Outlines | None], number: int, others: Sequence[int]
) -> ForeignBuffer | None:
    """Find a frame whose outlines LR radiance follows, and not those of its own.

    Args:
        read: outlines of LR frames, whose jumps are those of radiance.
        number: of the frame.
        others: numbers of those that are tried, the nearest first.
    """
    try:
        own = read(number)
        if own is None:
            return None
        followed: dict[int, float] = {}
        for other in others:
            beside = read(other)
            found = None if beside is None else hold_against(own, beside)
            if found is not None and found.of_own and not followed:
                return None
            if found is not None and found.of_other:
                followed[other] = found.share
    except FrameFolderError:
        return None
    if not followed:
        return None
    other = min(followed, key=followed.__getitem__)
    return ForeignBuffer(buffers=(Buffer.COLOR,), number=number, other=other, size="LR")


def count_strays(
    buffer: Buffer,
    lr: GBuffer,
    hr: GBuffer,
    scale: int,
    enough: int = ENOUGH_SAMPLES,
    *,
    dark_sky: bool = False,
) -> Strays | None:
    """Count LR samples that stray in one buffer; None where too few tell.

    Args:
        buffer: of `HELD`.
        lr: buffers of LR samples; their depth, if it is there, tells sky.
        hr: of HR pixels.
        scale: S.
        enough: samples of which more are not looked at.
        dark_sky: whether HR pixels of sky may be 0, too: the sky's emission may be a pass of its
            own, and of another frame than the lamps'.
    """
    height, width = lr.size
    every = max(1, math.isqrt(height * width // enough))
    rows, columns = (slice(1, side - 1, every) for side in (height, width))
    image = _make_comparable(buffer, lr[buffer][..., rows, columns])
    counted = torch.isfinite(image).all(1)
    if Buffer.DEPTH in lr:
        counted &= (lr[Buffer.DEPTH][..., rows, columns] < SKY_DEPTH_M)[:, 0]
    size = (counted.shape[-2], counted.shape[-1])
    known = int(counted.sum())
    if known < LEAST_SAMPLES:
        return None
    blocks = _cut_blocks(hr[buffer], scale, every, size)
    if buffer is Buffer.OBJECT_ID:
        strays = (blocks != image[..., None]).all(-1).any(1)
        flat = (blocks == blocks[..., :1]).all(-1).all(1)
    else:
        blocks = _make_comparable(buffer, blocks)
        high, low = blocks.amax(-1), blocks.amin(-1)
        if dark_sky and Buffer.DEPTH in hr:
            sky = (_cut_blocks(hr[Buffer.DEPTH], scale, every, size) >= SKY_DEPTH_M).any(-1)
            low = low.masked_fill(sky, 0.0)
        off = RELATIVE * image.abs() if buffer is Buffer.DEPTH else ABSOLUTE
        strays = ((image < low - off) | (image > high + off)).any(1)
        most = FLAT * low.abs() if buffer is Buffer.DEPTH else FLAT
        flat = (high - low <= most).all(1)
    strays &= counted
    return Strays(known, int(strays.sum()), int((strays & flat).sum()))


def _cut_blocks(image: Image, scale: int, every: int, size: tuple[int, int]) -> Tensor:
    """HR pixels of every so many blocks, and one further to each side, in the last dimension."""
    inner = image[..., scale - 1 :, scale - 1 :]
    blocks = inner.unfold(-2, scale + 2, scale * every).unfold(-2, scale + 2, scale * every)
    return blocks[..., : size[0], : size[1], :, :].flatten(-2)


def _make_comparable(buffer: Buffer, image: Image) -> Image:
    """Radiance by its logarithm-like curve x / (1 + x), so that one step suits all of it."""
    if buffer is Buffer.OBJECT_ID:
        return image
    image = image.float()
    return image / (1.0 + image.abs()) if buffer is Buffer.EMISSION else image


class RecentOutlines:
    """Outlines of the LR frames that were read last, with the jumps of radiance.

    Args:
        read: reads buffers of LR frames.
    """

    def __init__(self, read: Read) -> None:
        """Know none yet."""
        self._read = read
        self._known: dict[tuple[int, frozenset[Buffer]], Outlines | None] = {}

    def keep(self, number: int, gbuffer: GBuffer) -> frozenset[Buffer]:
        """Draw those of a frame that is read already; return what they are drawn of."""
        drawn = frozenset(gbuffer.keys() & {Buffer.COLOR, *STEPS})
        self._put((number, drawn), draw_outlines(gbuffer.only(drawn), Buffer.COLOR))
        return drawn

    def draw(self, number: int, drawn: frozenset[Buffer]) -> Outlines | None:
        """Draw those of any frame."""
        key = (number, drawn)
        if key not in self._known:
            self._put(key, draw_outlines(self._read(number, drawn), Buffer.COLOR))
        return self._known[key]

    def _put(self, key: tuple[int, frozenset[Buffer]], outlines: Outlines | None) -> None:
        self._known = dict([*self._known.items(), (key, outlines)][-MOST_RECENT:])


def describe_foreign(found: ForeignBuffer, lr_root: Path, hr_root: Path) -> str:
    """Say which buffer of which frame is another frame's, by what, and what to do."""
    number, other = found.number, found.other
    if found.fits is None:
        return (
            f"{lr_root}: frame {number}: radiance shows frame {other}: it changes where the "
            f"surfaces of frame {other} meet, and not where those of its own G-buffer do; "
            f"{_say_remedy('radiance')}"
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
        f"{root}: frame {number}: {wrong} (beside {beside}): HR frame {large} fits LR frame "
        f"{small} in {found.buffers[0]}, HR frame {number} does not fit LR frame {number} "
        f"({found.share:.1%} of its samples are unlike all HR pixels around them{fits}); "
        f"{_say_remedy(names)}"
    )


def _say_remedy(names: str) -> str:
    return f"name the files of {names} by their own frames (two exchanged?), or render them again"
