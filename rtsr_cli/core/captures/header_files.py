"""Headers of a shot's files, each of them read once, many at a time."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from rtsr_cli.core.captures.misnamed_frames import list_misnamed
from rtsr_cli.core.captures.shots import FrameSet
from rtsr_cli.core.errors import FrameFolderError, RtsrError
from rtsr_cli.core.files.exr import ExrHeader
from rtsr_cli.core.files.header_cache import HeaderCache
from rtsr_cli.core.files.library_output import silence_library

SURVEY_THREADS = 4
"""Headers are small: a few threads hide the latency of a network drive."""

SURVEY_BLOCK = 32
"""Files that a thread takes at once: handing over one costs as much as reading its header."""

Headers = Mapping[str, Mapping[int, ExrHeader]]
"""Per file sequence and frame number, what the file says of itself."""


class HeaderFiles:
    """Headers of the files of a shot, each of them read once."""

    def __init__(self) -> None:
        """Start with nothing read."""
        self._known: dict[Path, ExrHeader] = {}
        self._cache = HeaderCache()
        self._names: dict[frozenset[str], frozenset[str]] = {}

    def of(self, path: Path) -> ExrHeader:
        """Return the header of a file.

        Raises:
            FrameFolderError: it is no readable EXR; names it.
        """
        header = self._known.get(path)
        if header is None:
            header = self._cache.read(path)
            # the files of a sequence have the same channels: the names are held once
            names = self._names.setdefault(header.channels, header.channels)
            # attributes of later parts (manifests) are read again by those who need them
            header = self._known[path] = replace(header, channels=names, later=())
        return header

    def of_first(self, frames: FrameSet) -> dict[str, ExrHeader]:
        """Return the header of the first file of each sequence.

        Raises:
            FrameFolderError: one is no readable EXR; names it.
        """
        return {
            key: self.of(next(iter(stream.files.values())))
            for key, stream in frames.streams.items()
        }

    def try_all(self, paths: Iterable[Path]) -> list[ExrHeader | RtsrError]:
        """Return the header of every file, or what is wrong with the file."""
        remaining = iter(paths)
        blocks = iter(lambda: list(itertools.islice(remaining, SURVEY_BLOCK)), [])
        with ThreadPoolExecutor(SURVEY_THREADS) as pool:
            return list(itertools.chain.from_iterable(pool.map(self._try_block, blocks)))

    def _try_block(self, paths: list[Path]) -> list[ExrHeader | RtsrError]:
        with silence_library():
            return [self._try(path) for path in paths]

    def _try(self, path: Path) -> ExrHeader | RtsrError:
        try:
            return self.of(path)
        except RtsrError as error:
            return error


def read_headers(
    frames: FrameSet, files: HeaderFiles, numbers: Collection[int] | None = None
) -> Headers:
    """Read the header of every file.

    Args:
        frames: the files.
        files: what is read of them already.
        numbers: of the frames that are of interest; a sequence that has none of them is read whole.

    Raises:
        FrameFolderError: one is no readable EXR, or no file at all; names it.
    """
    for wrong in list_misnamed(frames).values():
        raise FrameFolderError(wrong)
    headers, errors = read_readable(frames, files, numbers)
    for error in errors:
        raise error
    return headers


def _narrow_frames(frames: FrameSet, numbers: Collection[int] | None) -> FrameSet:
    """Leave the files of some frames."""
    if numbers is None:
        return frames
    wanted = frozenset(numbers)
    streams = {}
    for key, stream in frames.streams.items():
        there = {n: stream.files[n] for n in stream.files if n in wanted}
        streams[key] = replace(stream, files=there or stream.files)
    return replace(frames, streams=streams)


def read_readable(
    frames: FrameSet, files: HeaderFiles, numbers: Collection[int] | None = None
) -> tuple[Headers, list[RtsrError]]:
    """Read the header of every file that can be read; say what is wrong with the others.

    Args:
        frames: the files.
        files: what is read of them already.
        numbers: of the frames that are of interest, as in `read_headers`.
    """
    frames = _narrow_frames(frames, numbers)
    headers: dict[str, dict[int, ExrHeader]] = {}
    errors: list[RtsrError] = []
    for key, stream in frames.streams.items():
        good: dict[int, ExrHeader] = {}
        for number, header in zip(stream.files, files.try_all(stream.files.values()), strict=True):
            if isinstance(header, RtsrError):
                errors.append(header)
            else:
                good[number] = header
        headers[key] = good
    return headers, errors
