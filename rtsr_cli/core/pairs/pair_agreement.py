"""Whether HR frames show what LR frames show: what both sizes hold, at the places of LR samples.

    sample q strays in b  <=>  b_lr(q) < min b_hr - t   or   b_lr(q) > max b_hr + t,  a channel

over HR pixels of q's block and one further to each side, for every buffer b that both sizes hold;
of object ids, where no such pixel has its id. Wherever in its pixel a sample lies, and whatever
mean of the pixel it is, that holds of few samples. Strays are counted buffer by buffer, of samples
that are no sky, and the mean over the buffers is what counts.

HR is refused only where another reading of it explains the strays: turned upside down, mirrored,
both, colours of surfaces in another order, encoded or times a factor at one size alone (of a few
per cent: `frame_tints`), normals with axes negated, or another frame by its depth. Of a right pair
none does, whatever noise, filters or differently made buffers it strays by.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
import torch
import torch.nn.functional as F

from rtsr_cli.core.captures.measuring.camera_structure import SIGNED_AXES
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.frames.selection import format_ranges
from rtsr_cli.core.imaging.color import encode_srgb
from rtsr_cli.core.pairs.frame_tints import measure_tint
from rtsr_cli.core.shapes import Image, Mask
from rtsr_cli.core.threads import map_in_threads

COMPARED = (
    Buffer.DEPTH,
    Buffer.NORMAL,
    Buffer.GEONORMAL,
    Buffer.OBJECT_ID,
    Buffer.ALBEDO,
    Buffer.MATERIAL,
)
"""Buffers that are the same at both sizes: radiance is not, and vectors are in pixels."""

RELATIVE, ABSOLUTE = 5e-3, 0.02
"""t: of depth relative to it, of others; what halves and 8 bits leave, and more."""

FEW_STRAYS = 0.1
"""Share of samples that stray up to which no turned reading is tried: right pairs have 0.05 at most
(`benchmarks/pair_agreement.py`: textures between pixel centres), turned ones 0.41 at least."""

FEW_SHIFTED = 0.015
"""The same of depth alone, up to which no other moment is tried. Textures that are finer than HR
pixels may fit the frame after better than their own; depth has no such, and 0.010 of it strays."""

FAR_BETTER = 3.0
"""How many times fewer samples stray where another reading is right."""

MOST_STRAYS = 0.4
"""Share of samples that stray beyond which both sizes hardly show one picture: where a buffer of
four is empty at one size, a quarter does."""

LEAST_SAMPLES = 64
"""That are no sky; fewer tell nothing."""

ENOUGH_SAMPLES = 1 << 13
"""Of more, every second, third ... row and column is looked at: shares are known to 0.006 then."""

TURNED = {
    "upside down": (-2,),
    "mirrored left to right": (-1,),
    "turned by half a turn": (-2, -1),
}
"""How HR pictures may lie beside LR's: dimensions that are flipped."""

TURN_REMEDY = (
    "render both sizes with one origin (pixels are read from the top left; capture.toml declares "
    "no other), or turn the HR files"
)
COLOURS = (Buffer.ALBEDO, Buffer.MATERIAL)
"""Buffers of three channels, which may be mixed up, or encoded."""

VECTORS = (Buffer.NORMAL, Buffer.GEONORMAL)
"""Buffers of unit vectors, whose axes may be negated."""

SWAPPED, ENCODED, DECODED = (
    "swapped in the channels of {buffer} (its R, G, B hold {order} of LR)",
    "sRGB-encoded in {buffer}, and LR linear",
    "linear in {buffer}, and LR sRGB-encoded",
)
"""How colours of HR may look beside LR's."""

ORDERS = tuple(order for order in permutations(range(3)) if order != (0, 1, 2))
"""Channel i of HR is channel order[i] of LR."""

FACTOR = "to be about {factor:.3g} x LR in {buffer}"
"""How colours of HR may look beside LR's, all channels alike."""

TINT = "to be about {factors} x LR in the R, G, B of {buffer}"
"""The same, each channel by itself."""

LEAST_FACTOR, MOST_FACTOR = 1.2, 2000.0
"""Ratios to either side of 1 that are called a factor: from what no rounding makes to 0..255, and
to depth in millimetres."""

NEGATED = "negated in {axes} of {buffer}"
"""How vectors of HR may look beside LR's."""

TURNED_AXES = "of a world of other axes in {buffer} (its x, y, z hold {axes} of LR)"
"""The same where axes are swapped."""

COLOUR_REMEDY = "write {buffer} alike at both sizes: linear, its channels in the order R, G, B"
VECTOR_REMEDY = (
    "write {buffer} alike at both sizes: in one space, with the same handedness and direction"
)

UNIT_RATIOS = tuple(
    one / other for one, other in permutations((1.0, 0.01, 0.001, 0.3048, 0.0254), 2)
)
"""Metres, centimetres, millimetres, feet and inches in each other."""

UNIT_ERROR = 0.02
"""Relative: what different samples leave of such a ratio."""

UNIT_REMEDY = "write {buffer} in one unit at both sizes"

NUMBER_REMEDY = "number the files of both sizes alike, each by its moment"

OUTSIDE_REMEDY = "render this frame anew at both sizes, with one camera"

FEW_INNER = 0.01
"""Share of the inner samples of surfaces that stray up to which both sizes are of one moment: right
pairs have 0.000, other moments 0.2 at least, where a camera moves."""

INNER_RANGE = {Buffer.DEPTH: 0.05, Buffer.OBJECT_ID: 0.0, Buffer.GEONORMAL: 0.1, Buffer.NORMAL: 0.1}
"""What a buffer differs by at most around an inner sample; of depth relative to it."""

MOST_AROUND = 4
"""Frames around one that it is compared with."""

MOST_OTHERS = 6
"""Frames around one whose depth strays that are tried in the place of its HR frame."""

MOST_DOUBTED = 3
"""Frames that something else speaks against which are looked at beside three of the sequence."""


@dataclass(frozen=True, kw_only=True)
class Misfit:
    """How HR frames do not show what LR frames show.

    Attributes:
        frame: number of the frame in which it was seen first.
        strays: share of its samples that stray, mean over the buffers.
        frames: numbers of those in which it is so, ascending.
        looked_at: numbers of those that were compared, ascending.
        looks: what HR is beside LR, as it looks; empty where nothing explains it.
        remedy: what to do about that.
        buffer: in which it is so, where that is one of several.
        factors: how many times LR's values HR's are there, a channel, where that is all there is
            to it.
    """

    frame: int
    strays: float
    frames: tuple[int, ...] = ()
    looked_at: tuple[int, ...] = ()
    looks: str = ""
    remedy: str = ""
    buffer: Buffer | None = None
    factors: tuple[float, ...] = ()

    @property
    def where(self) -> str:
        """Name the frames, and among how many they were found: few are looked at."""
        frames = self.frames or (self.frame,)
        if len(self.looked_at) < 2:
            return say_frames(frames)
        others = format_ranges(self.looked_at)
        if frames == self.looked_at:
            return f"all frames looked at ({others})"
        return f"{say_frames(frames)} (of frames {others}, which were looked at)"

    def is_like(self, other: Misfit) -> bool:
        """Tell whether another frame misfits in the same way."""
        turned = self.remedy == TURN_REMEDY and self.looks != other.looks
        return (self.remedy, self.buffer) == (other.remedy, other.buffer) and not turned


Read = Callable[[int], GBuffer]
"""Number -> the buffers that are compared."""


def find_misfit(
    lr: Read,
    hr: Read,
    numbers: Sequence[int],
    scale: int,
    *,
    stored: Collection[int],
    doubted: Sequence[int] = (),
    singly: bool = True,
) -> Misfit | None:
    """Say how both sizes differ, of the first frame where that is explained.

    The middle, the first and the last are looked at, and those that are doubted: single files may
    be of other moments, which `find_other_moment` says of their frame alone, as long as most of
    these frames fit. That both hardly show one picture is said of the first that tells.

    None where they do not, or frames cannot be read: whoever reads them next says why.

    Args:
        lr, hr: read the buffers of `COMPARED` that both sizes hold.
        numbers: of the LR frames.
        scale: S.
        stored: numbers of HR frames.
        doubted: numbers among those, whose frames something else speaks against.
        singly: whether single files of other moments are left to their own frames: not where they
            cost all frames their cameras.
    """
    looked_at = tuple(dict.fromkeys((*choose_frames(numbers), *doubted[:MOST_DOUBTED])))

    def judge(number: int) -> Misfit | FrameFolderError | None:
        try:
            return _judge_frame(lr, hr, number, scale, stored=stored, looked_at=looked_at)
        except FrameFolderError as error:
            return error

    found: dict[int, Misfit] = {}
    for number, misfit in zip(looked_at, map_in_threads(judge, looked_at), strict=True):
        if isinstance(misfit, FrameFolderError):
            break
        if misfit is not None:
            found[number] = misfit
    moved = [n for n, misfit in found.items() if misfit.remedy == NUMBER_REMEDY]
    single = moved if singly and 2 * len(moved) < len(found) else []
    judged = {n: misfit for n, misfit in found.items() if n not in single}
    first = next((misfit for misfit in judged.values() if misfit.looks), None)
    if first is None:
        first = next(iter(judged.values()), None)
        if first is None or first.strays <= MOST_STRAYS:
            return None
        alike = [n for n, misfit in judged.items() if misfit.strays > MOST_STRAYS]
    else:
        alike = [n for n, misfit in judged.items() if misfit.looks and misfit.is_like(first)]
    return replace(first, frames=tuple(sorted(alike)), looked_at=tuple(sorted(found)))


def choose_frames(numbers: Sequence[int]) -> tuple[int, ...]:
    """The middle, the first and the last: frames that are looked at before a run."""
    return (numbers[len(numbers) // 2], numbers[0], numbers[-1])


def _judge_frame(
    lr: Read,
    hr: Read,
    number: int,
    scale: int,
    *,
    stored: Collection[int],
    looked_at: Collection[int],
) -> Misfit | None:
    """How many samples of a frame stray, and how HR looks if that explains it; None if few tell."""
    small, beside = lr(number), hr(number)
    strays = measure_strays(small, beside, scale)
    if strays is None:
        return None
    looks = _find_turn(small, beside, scale, strays)
    if looks:
        return Misfit(frame=number, strays=strays, looks=looks, remedy=TURN_REMEDY)
    other = _find_reading(small, beside, scale, number)
    if other is not None:
        return other
    others = list_around(number, stored, looked_at)
    moved = _find_moment((small, beside), (lr, hr), scale, number, others)
    return moved or Misfit(frame=number, strays=strays)


def _find_turn(lr: GBuffer, hr: GBuffer, scale: int, strays: float) -> str:
    """How HR is turned; empty where that does not explain the strays."""
    if strays <= FEW_STRAYS:
        return ""
    found = {
        looks: measure_strays(lr, flip(hr, dims), scale) or 0.0 for looks, dims in TURNED.items()
    }
    looks = min(found, key=found.__getitem__)
    return looks if found[looks] * FAR_BETTER < strays else ""


def _find_reading(lr: GBuffer, hr: GBuffer, scale: int, number: int) -> Misfit | None:
    """A buffer that fits if it is read otherwise at one size; None where all fit, or none does."""
    for buffer in (Buffer.DEPTH, *COLOURS, *VECTORS):
        if buffer not in lr or buffer not in hr:
            continue
        strays = measure_strays_of(buffer, lr[buffer], hr[buffer], lr, scale) or 0.0
        if strays <= FEW_STRAYS:
            continue
        scaled = buffer is Buffer.DEPTH
        found = {} if scaled else measure_readings(buffer, lr, hr, scale)
        factors = _list_factors(buffer, lr, hr, scale)
        found |= _measure_factors(buffer, lr, hr, scale, factors)
        if not found:
            continue
        looks = min(found, key=found.__getitem__)
        if found[looks] * FAR_BETTER >= strays and buffer in COLOURS:
            # three numbers fit more than one does: only where nothing simpler explains it
            factors = _list_tints(buffer, lr, hr, scale)
            found |= _measure_factors(buffer, lr, hr, scale, factors)
            looks = min(found, key=found.__getitem__)
        if found[looks] * FAR_BETTER < strays:
            remedy = UNIT_REMEDY if scaled else VECTOR_REMEDY
            remedy = COLOUR_REMEDY if buffer in COLOURS else remedy
            return Misfit(
                frame=number,
                strays=strays,
                looks=looks,
                remedy=remedy.format(buffer=buffer),
                buffer=buffer,
                factors=factors.get(looks, ()),
            )
    return _find_tint(lr, hr, scale, number)


def _find_tint(lr: GBuffer, hr: GBuffer, scale: int, number: int) -> Misfit | None:
    """Colours that are a few per cent apart in all of the picture."""
    for buffer in COLOURS:
        if buffer not in lr or buffer not in hr:
            continue
        told = torch.isfinite(lr[buffer]).all(1, keepdim=True)
        if Buffer.DEPTH in lr:
            told &= lr[Buffer.DEPTH] < SKY_DEPTH_M
        factors = measure_tint(lr[buffer], hr[buffer], told, scale)
        if factors is not None:
            alike = max(factors) <= min(factors) * (1.0 + RELATIVE)
            text = ", ".join(f"{factor:.3g}" for factor in factors)
            return Misfit(
                frame=number,
                strays=measure_strays_of(buffer, lr[buffer], hr[buffer], lr, scale) or 0.0,
                looks=FACTOR.format(factor=factors[0], buffer=buffer)
                if alike
                else TINT.format(factors=text, buffer=buffer),
                remedy=COLOUR_REMEDY.format(buffer=buffer),
                buffer=buffer,
                factors=(factors[0],) * len(factors) if alike else factors,
            )
    return None


Factors = dict[str, tuple[float, ...]]
"""How HR looks -> how many times LR's values its values are, a channel."""


def _measure_factors(
    buffer: Buffer, lr: GBuffer, hr: GBuffer, scale: int, factors: Factors
) -> dict[str, float]:
    """Share of LR samples that stray from HR without its factors, by how HR looks."""
    seen = {
        looks: hr[buffer] / torch.tensor(known, dtype=hr[buffer].dtype).view(1, -1, 1, 1)
        for looks, known in factors.items()
    }
    return {
        looks: measure_strays_of(buffer, lr[buffer], image, lr, scale) or 0.0
        for looks, image in seen.items()
    }


def _list_factors(buffer: Buffer, lr: GBuffer, hr: GBuffer, scale: int) -> Factors:
    """Factors that HR's colours may have, by how they look: the round one first."""
    if buffer is Buffer.DEPTH:
        factor = measure_factor(_leave_sky(lr[buffer]), _leave_sky(hr[buffer]), scale)
        known = [] if factor is None else [_round_unit(factor)]
    else:
        factor = measure_factor(lr[buffer], hr[buffer], scale) if buffer in COLOURS else None
        known = [] if factor is None else [_round_factor(factor, 2), factor]
    channels = lr[buffer].shape[1]
    return {FACTOR.format(factor=f, buffer=buffer): (f,) * channels for f in known}


def _round_unit(factor: float) -> float:
    """How many of one unit another is, if that is it."""
    near = min(UNIT_RATIOS, key=lambda ratio: abs(math.log(factor / ratio)))
    return near if abs(factor / near - 1.0) <= UNIT_ERROR else factor


def _leave_sky(depth: Image) -> Image:
    return torch.where(depth < SKY_DEPTH_M, depth.double(), torch.nan)


def _list_tints(buffer: Buffer, lr: GBuffer, hr: GBuffer, scale: int) -> Factors:
    """Factors that each channel may have: the round ones first; none where none is one."""
    parts = [slice(channel, channel + 1) for channel in range(lr[buffer].shape[1])]
    found = [measure_factor(lr[buffer][:, c], hr[buffer][:, c], scale) for c in parts]
    if not any(found):
        return {}
    exact = tuple(1.0 if factor is None else factor for factor in found)
    known = (*(tuple(_round_factor(f, digits) for f in exact) for digits in (1, 2)), exact)
    said = (", ".join(f"{factor:.3g}" for factor in factors) for factors in known)
    return {
        TINT.format(factors=text, buffer=buffer): factors
        for text, factors in zip(said, known, strict=True)
    }


def _round_factor(factor: float, digits: int) -> float:
    return float(f"{factor:.{digits}g}")


def measure_factor(image: Image, seen: Image, scale: int) -> float | None:
    """How many times LR's colours HR's are; None where that is about 1, or there are none.

        f = sum over q, c of the mean of HR in q's block / sum of LR

    over the blocks in which HR is of one colour, or all where there are too few of those: wherever
    in a texture samples lie, both sums are alike.

    Args:
        image: of LR samples, 1 x C x H x W.
        seen: of HR pixels, 1 x C x SH x SW.
        scale: S.
    """
    small, mean = image.double(), F.avg_pool2d(seen.double(), scale)
    counted = torch.isfinite(small) & torch.isfinite(mean) & (small > 0.0)
    high, low = _find_largest(seen.double(), scale), -_find_largest(-seen.double(), scale)
    flat = counted & (high <= low * (1.0 + RELATIVE))
    counted = flat if int(flat.sum()) >= LEAST_SAMPLES else counted
    if int(counted.sum()) < LEAST_SAMPLES:
        return None
    factor = float(mean[counted].sum() / small[counted].sum())
    ratio = max(factor, 1.0 / factor) if factor > 0.0 else 0.0
    return factor if LEAST_FACTOR <= ratio <= MOST_FACTOR else None


def measure_readings(buffer: Buffer, lr: GBuffer, hr: GBuffer, scale: int) -> dict[str, float]:
    """Share of LR samples that stray in a buffer by each other reading of it, by how HR looks.

    Args:
        buffer: of `COLOURS` or `VECTORS`, which both sizes hold.
        lr: buffers of LR samples, 1 x C x H x W.
        hr: of HR pixels, 1 x C x SH x SW.
        scale: S.
    """
    list_readings = _list_colour_readings if buffer in COLOURS else _list_vector_readings
    return {
        looks: measure_strays_of(buffer, image, seen, lr, scale) or 0.0
        for looks, image, seen in list_readings(buffer, lr[buffer], hr[buffer])
    }


Reading = tuple[str, Image, Image]
"""How HR looks beside LR if this is right, and both as they are then comparable."""


def _list_colour_readings(buffer: Buffer, image: Image, seen: Image) -> Iterator[Reading]:
    for order in ORDERS:
        said = ", ".join("RGB"[channel] for channel in order)
        # channel c of LR is where HR holds it
        restored = seen[:, [order.index(channel) for channel in range(3)]]
        yield SWAPPED.format(buffer=buffer, order=said), image, restored
    yield ENCODED.format(buffer=buffer), _encode(image), seen
    yield DECODED.format(buffer=buffer), image, _encode(seen)


def _list_vector_readings(buffer: Buffer, image: Image, seen: Image) -> Iterator[Reading]:
    for matrix in SIGNED_AXES[1:]:
        axes = torch.from_numpy(matrix[:3, :3]).to(seen)
        turned = torch.einsum("nihw,ji->njhw", seen, axes)
        negated = [n for n, i in zip("xyz", range(3), strict=True) if matrix[i, i] < 0.0]
        if np.array_equal(np.abs(matrix), np.eye(4)):
            looks = NEGATED.format(axes=", ".join(negated), buffer=buffer)
        else:
            # seen[i] = sum over j of the sign of A[j, i] times LR[j]
            held = [matrix[:3, i] for i in range(3)]
            said = (
                f"{'-' if column.min() < 0.0 else ''}{'xyz'[int(np.abs(column).argmax())]}"
                for column in held
            )
            looks = TURNED_AXES.format(buffer=buffer, axes=", ".join(said))
        yield looks, image, turned


def _encode(colour: Image) -> Image:
    return encode_srgb(colour.float())


def find_other_moment(
    lr: Read,
    hr: Read,
    number: int,
    scale: int,
    *,
    own: tuple[GBuffer, GBuffer],
    stored: Collection[int],
) -> Misfit | None:
    """Say that one of both files of a frame is of another frame, or of none of these.

    None where nothing says so, where sizes have nothing in common, or where other frames cannot be
    read.

    Args:
        lr, hr: read what tells moments of other frames: `choose_witness` of these.
        number: of the frame.
        scale: S.
        own: its buffers, of LR and of HR.
        stored: numbers of frames that both sizes have.
    """
    try:
        others = list_around(number, stored, choose_frames(sorted(stored)))
        found = _find_moment(own, (lr, hr), scale, number, others)
        return found or _find_outside(own, (lr, hr), scale, number, others)
    except FrameFolderError:
        return None


WITNESSES = (Buffer.DEPTH, Buffer.OBJECT_ID, Buffer.GEONORMAL, Buffer.NORMAL)
"""What tells moments, the surest first."""


def choose_witness(lr: GBuffer, hr: GBuffer) -> Buffer | None:
    """The buffer that tells whether both sizes of a frame are of one moment; None without any."""
    return next((b for b in WITNESSES if b in lr and b in hr), None)


def _find_outside(
    own: tuple[GBuffer, GBuffer],
    reads: tuple[Read, Read],
    scale: int,
    number: int,
    others: Sequence[int],
) -> Misfit | None:
    """A frame whose sizes show different surfaces where those of the frames around show the same.

    Of a right pair the inner samples of surfaces never stray, of whatever samples, filters and
    movers: where another moment's surface is, they do. Buffers that are made otherwise at one size
    stray in all frames.
    """
    small, beside = own
    witness = choose_witness(small, beside)
    if witness is None:
        return None
    few = FEW_SHIFTED if witness is Buffer.DEPTH else FEW_STRAYS
    strays = measure_strays_of(witness, small[witness], beside[witness], small, scale) or 0.0
    if strays <= few:
        return None
    inner = measure_inner_strays(witness, small, beside, scale)
    if inner is None or inner <= FEW_INNER:
        return None
    read_lr, read_hr = reads
    around = [
        measure_inner_strays(witness, read_lr(n), read_hr(n), scale) for n in others[:MOST_AROUND]
    ]
    usual = sorted(share for share in around if share is not None)
    if not usual or usual[len(usual) // 2] * FAR_BETTER >= inner:
        return None
    looks = f"of another moment or another scene in {witness} (and no frame around it fits better)"
    return Misfit(frame=number, strays=strays, looks=looks, remedy=OUTSIDE_REMEDY)


def list_around(number: int, stored: Collection[int], looked_at: Collection[int] = ()) -> list[int]:
    """Frames that are tried in the place of one: those around it, and those looked at."""
    around = sorted(stored, key=lambda n: (abs(n - number), n))[: MOST_OTHERS + 1]
    return [n for n in dict.fromkeys((*around, *looked_at)) if n in stored and n != number]


def _find_moment(
    own: tuple[GBuffer, GBuffer],
    reads: tuple[Read, Read],
    scale: int,
    number: int,
    others: Sequence[int],
) -> Misfit | None:
    """Another frame, where the depth of one of both files fits it and not its own frame."""
    small, beside = own
    if Buffer.DEPTH not in small or Buffer.DEPTH not in beside or not others:
        return None
    small = small.only((Buffer.DEPTH,))
    strays = measure_strays(small, beside, scale) or 0.0
    if strays <= FEW_SHIFTED:
        return None
    read_lr, read_hr = reads
    # HR's file of the frame may be lost, and stand in its place that of another one
    found = {(other, number): measure_strays(small, read_hr(other), scale) for other in others}
    for other in others:
        depth = read_lr(other).only((Buffer.DEPTH,))
        found[number, other] = measure_strays(depth, beside, scale)
    known = {pair: share for pair, share in found.items() if share is not None}
    best = min(known, key=known.__getitem__, default=None)
    if best is None or known[best] * FAR_BETTER >= strays:
        return None
    looks = f"of another moment (HR frame {best[0]} fits LR frame {best[1]})"
    return Misfit(frame=number, strays=strays, looks=looks, remedy=NUMBER_REMEDY)


def flip(gbuffer: GBuffer, dims: tuple[int, ...]) -> GBuffer:
    """Turn pictures; what they hold is left as it is.

    Args:
        gbuffer: to turn.
        dims: a value of `TURNED`.
    """
    flipped = {buffer: image.flip(dims) for buffer, image in gbuffer.items()}
    return gbuffer.with_buffers(flipped)


def measure_strays(lr: GBuffer, hr: GBuffer, scale: int) -> float | None:
    """Share of LR samples that stray, mean over the buffers; None where too few tell.

    Args:
        lr: buffers of LR samples, 1 x C x H x W.
        hr: the same buffers of HR pixels, 1 x C x SH x SW.
        scale: S.
    """
    found = (measure_strays_of(b, lr[b], hr[b], lr, scale) for b in lr.keys() & hr.keys())
    shares = [share for share in found if share is not None]
    return sum(shares) / len(shares) if shares else None


def measure_strays_of(
    buffer: Buffer, image: Image, seen: Image, lr: GBuffer, scale: int
) -> float | None:
    """Share of LR samples that stray in one buffer; None where too few tell.

    Args:
        buffer: of `COMPARED`.
        image: of LR samples, 1 x C x H x W.
        seen: of HR pixels, 1 x C x SH x SW.
        lr: buffers of the LR samples; their depth, if it is there, tells sky.
        scale: S.
    """
    counted = torch.isfinite(image.double()).all(1, keepdim=True)
    if Buffer.DEPTH in lr:
        counted &= lr[Buffer.DEPTH] < SKY_DEPTH_M
    known = int(counted.sum())
    if known < LEAST_SAMPLES:
        return None
    every = max(1, math.isqrt(known // ENOUGH_SAMPLES))
    strays = _find_strays(buffer, image, seen, scale, every)
    return float(strays[thin(counted, every)].double().mean())


def measure_inner_strays(buffer: Buffer, lr: GBuffer, hr: GBuffer, scale: int) -> float | None:
    """Share of the inner samples of surfaces that stray; None where too few are inner.

        q is inner  <=>  max b - min b <= r  over the 3 x 3 LR samples around q, and over HR pixels
                         of q's block and one further to each side

    Args:
        buffer: of `WITNESSES`.
        lr: buffers of LR samples, 1 x C x H x W.
        hr: the same of HR pixels, 1 x C x SH x SW.
        scale: S.
    """
    image, seen = lr[buffer].float(), hr[buffer].float()
    ranges = [
        (F.max_pool2d(image, 3, 1, padding=1), -F.max_pool2d(-image, 3, 1, padding=1)),
        (_find_largest(seen, scale), -_find_largest(-seen, scale)),
    ]
    counted = torch.isfinite(image).all(1, keepdim=True)
    if Buffer.DEPTH in lr:
        counted &= lr[Buffer.DEPTH] < SKY_DEPTH_M
    for high, low in ranges:
        most = INNER_RANGE[buffer] * (low.abs() if buffer is Buffer.DEPTH else 1.0)
        counted &= (high - low <= most).all(1, keepdim=True)
    if int(counted.sum()) < LEAST_SAMPLES:
        return None
    strays = _find_strays(buffer, lr[buffer], hr[buffer], scale)
    return float(strays[counted].double().mean())


def _find_strays(buffer: Buffer, image: Image, seen: Image, scale: int, every: int = 1) -> Mask:
    """Samples that stray, of every so many in both directions."""
    image = thin(image, every)
    if buffer is Buffer.OBJECT_ID:
        return _lack_id(image, seen, scale, every)
    image, seen = image.float(), seen.float()
    known = torch.isfinite(seen)
    high = _find_largest(seen.masked_fill(~known, -torch.inf), scale, every)
    low = -_find_largest(seen.masked_fill(~known, torch.inf).neg_(), scale, every)
    off = RELATIVE * image.abs() if buffer is Buffer.DEPTH else ABSOLUTE
    return ((image < low - off) | (image > high + off)).any(1, keepdim=True)


def thin(image: Image, every: int) -> Image:
    """Every so many samples in both directions, from the first on."""
    return image[..., ::every, ::every]


def _find_largest(image: Image, scale: int, every: int = 1) -> Image:
    """Of the S x S pixels of each block, and one further to each side; of every so many blocks."""
    return F.max_pool2d(image, scale + 2, scale * every, padding=1)


def _lack_id(ids: Image, seen: Image, scale: int, every: int) -> Mask:
    rows, columns = (side - scale + 1 for side in seen.shape[-2:])
    step = scale * every
    # -1 is no object's
    padded = F.pad(seen.double(), (1, 1, 1, 1), value=-1.0)
    found = torch.zeros_like(ids, dtype=torch.bool)
    for y in range(scale + 2):
        for x in range(scale + 2):
            found |= padded[..., y : y + rows : step, x : x + columns : step] == ids.double()
    return ~found.all(1, keepdim=True)
