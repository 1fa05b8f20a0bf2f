"""Holding what a channel is called against what it holds: a name that values contradict is none."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rtsr_cli.core.captures.channel_guesses import GuessCheck, Place, hints_at
from rtsr_cli.core.captures.reader import read_planes
from rtsr_cli.core.captures.shots import FrameSet
from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.frames.buffers import Buffer

Values = NDArray[np.float64]
"""Finite pixels of a group of channels, n x c."""

SLACK = 2e-3
"""How far beyond their range numbers may lie by rounding."""

BRIGHTEST = 1.5
"""A surface's colour is hardly above this."""

MOST = 0.98
"""Share of the pixels that have to be like a buffer's."""

LENGTH_SLACK = 0.05
"""How far from 1 the length of a stored normal may be."""

FAR = 6e4
"""Distances from here on are the sky's: the largest that half holds, or more."""

LEAST_SURFACE = 0.02
"""Share of a picture that has to be surface before its distances prove anything."""

EVEN = 0.05
"""How far neighbouring distances lie apart in the median, as a share of them, and how far all of
them reach at the least."""

PLANE = 1
SPACE = 3
"""Channels of a number, and of a vector or colour."""


def choose_files(
    frames: FrameSet, readable: Mapping[str, Collection[int]]
) -> dict[str, tuple[Path, ...]]:
    """Choose the first and the middle file of every sequence, of frames that can be read."""
    chosen = {}
    for key, numbers in readable.items():
        known = sorted(numbers)
        picked = dict.fromkeys([known[0], known[len(known) // 2]]) if known else ()
        chosen[key] = tuple(frames.streams[key].files[n] for n in picked)
    return chosen


def check_guesses(
    files: Mapping[str, Sequence[Path]], bound: Collection[Buffer] = ()
) -> GuessCheck:
    """Return what holds a guess against pixels.

    Args:
        files: for each file sequence, the files of the frames to look at.
        bound: buffers that are there already, for which nothing is looked at.
    """

    def check(buffer: Buffer, places: Sequence[Place]) -> bool:
        if buffer in bound:
            return False
        pictures = _read_pictures(files, places)
        if not pictures or not looks_like(buffer, _list_pixels(pictures)):
            return False
        return not hints_at(buffer, places) or all(proves_distance(p[0]) for p in pictures)

    return check


Picture = NDArray[np.float64]
"""Channels of one frame, c x h x w."""


def _read_pictures(files: Mapping[str, Sequence[Path]], places: Sequence[Place]) -> list[Picture]:
    """Some channels of one sequence; none where they cannot be read."""
    (stream,) = {stream for stream, _ in places}
    names = [channel for _, channel in places]
    pictures = []
    try:
        for path in files.get(stream, ()):
            planes = read_planes(path, names)
            pictures.append(np.stack([planes[n].astype(np.float64) for n in names]))
    except (RtsrError, OSError, ValueError):
        return []
    return pictures


def _list_pixels(pictures: Sequence[Picture]) -> Values:
    """Finite pixels of some frames."""
    values: Values = np.concatenate([p.reshape(len(p), -1).T for p in pictures])
    return values[np.isfinite(values).all(axis=1)]


def looks_like(buffer: Buffer, values: Values) -> bool:
    """Tell whether pixels can be those of a buffer; what tells nothing is no proof.

    Args:
        buffer: that they may be.
        values: all channels of the group, those of the buffer first.
    """
    check = _CHECKS.get(buffer)
    return check is not None and len(values) > 0 and check(values)


def _is_grey(values: Values) -> bool:
    """One number, however often it is written; a fourth channel may be coverage."""
    colours = values[:, :SPACE]
    return bool((np.ptp(colours, axis=1) <= SLACK).all())


def _is_share(values: Values) -> bool:
    """A number from 0 to 1 that is not 0 everywhere."""
    first = values[:, 0]
    inside = first.min() >= -SLACK and first.max() <= 1.0 + SLACK
    return _is_grey(values) and bool(inside) and bool(first.any())


def _is_mask(values: Values) -> bool:
    """A share that may be 0 everywhere: nothing is of metal."""
    return _is_share(values) or (_is_grey(values) and not values[:, 0].any())


def _are_unit_vectors(values: Values) -> bool:
    """Tell normals, packed or not, sky left out."""
    if values.shape[1] < SPACE:
        return False
    vectors = values[:, :SPACE]
    vectors = vectors[vectors.any(axis=1)]
    return any(_share_of_units(v) >= MOST for v in (vectors, vectors * 2.0 - 1.0))


def _share_of_units(vectors: Values) -> float:
    if not len(vectors):
        return 0.0
    lengths = np.linalg.norm(vectors, axis=1)
    return float((np.abs(lengths - 1.0) < LENGTH_SLACK).mean())


def _are_vectors(values: Values) -> bool:
    """Motion: two numbers that vary, with nothing behind them that varies on its own."""
    if values.shape[1] == SPACE and np.ptp(values[:, 2]) > SLACK:
        return False
    pair = values[:, :2]
    return bool(np.ptp(pair, axis=0).any()) and not _are_unit_vectors(values)


def _is_colour(values: Values) -> bool:
    """Light: three numbers that are not below 0, and no normals."""
    if values.shape[1] < SPACE:
        return False
    below = (values[:, :SPACE] < -SLACK).any(axis=1).mean()
    return bool(below <= 1.0 - MOST) and not _are_unit_vectors(values)


def _is_surface_colour(values: Values) -> bool:
    """Reflectance: a colour that is hardly above 1, and not black everywhere."""
    dark = (values[:, :SPACE] <= BRIGHTEST).all(axis=1).mean()
    return _is_colour(values) and bool(dark >= MOST) and bool(values[:, :SPACE].any())


def _is_distance(values: Values) -> bool:
    """A number that varies and is hardly below 0; no mask, which has two."""
    first = values[:, 0]
    is_mask = bool(((first == 0.0) | (first == 1.0)).all())
    below = float((first < 0).mean())
    return _is_grey(values) and bool(np.ptp(first) > 0) and below <= 1.0 - MOST and not is_mask


def proves_distance(plane: NDArray[np.float64]) -> bool:
    """Tell distances by themselves: above 0, no shares, no whole numbers, the same beside each.

    What is far away may be cleared to anything.
    """
    surface = np.isfinite(plane) & (plane > 0.0) & (plane < FAR)
    values = plane[surface]
    if values.size < LEAST_SURFACE * plane.size or values.max() <= BRIGHTEST:
        return False
    both = surface[:, 1:] & surface[:, :-1]
    if not both.any() or (values == np.round(values)).all():
        return False
    beside, before = plane[:, 1:][both], plane[:, :-1][both]
    steps = np.abs(beside - before) / np.maximum(beside, before)
    return float(np.median(steps)) <= EVEN and float(np.ptp(values)) > EVEN * float(values.max())


def _is_number(values: Values) -> bool:
    first = values[:, 0]
    return _is_grey(values) and bool((first == np.round(first)).all()) and bool(first.any())


def _are_positions(values: Values) -> bool:
    if values.shape[1] < SPACE or _are_unit_vectors(values):
        return False
    return bool((np.ptp(values[:, :SPACE], axis=0) > 0).all())


_CHECKS: Mapping[Buffer, Callable[[Values], bool]] = {
    Buffer.MOTION: _are_vectors,
    Buffer.FORWARD: _are_vectors,
    Buffer.ALBEDO: _is_surface_colour,
    Buffer.SPECULAR: _is_surface_colour,
    Buffer.MATERIAL: _is_surface_colour,
    Buffer.NORMAL: _are_unit_vectors,
    Buffer.DEPTH: _is_distance,
    Buffer.ROUGHNESS: _is_share,
    Buffer.METALLIC: _is_mask,
    Buffer.EMISSION: _is_colour,
    Buffer.OBJECT_ID: _is_number,
    Buffer.POSITION: _are_positions,
    Buffer.NOV: _is_share,
    Buffer.REACTIVE: _is_mask,
    Buffer.COLOR: _is_colour,
}
