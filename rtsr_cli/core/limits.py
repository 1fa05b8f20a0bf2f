"""How much is read of what others wrote, in one place: files beyond this are damaged or hostile.

What unpacks to more than its bytes is measured before memory is taken.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

MIB = 1 << 20

MOST_CHANNELS, MOST_PARTS = 4096, 512
"""Of an EXR file, over all its parts; the library's time grows with their square."""

MOST_HEADER_BYTES = 32 * MIB
"""Of an EXR file: previews and manifests are in it, and the library holds it four times."""

MOST_UNPACKED_BYTES, MOST_UNPACKED_RATIO = 1024 * MIB, 100
"""Pixels of an EXR file may take so much, or so many times the bytes of the file: rendered frames
compress to a half or a tenth, large files of nothing are taken for bombs."""

MOST_TOML_BYTES = 4 * MIB
"""Of a capture.toml, a layout, settings: jitter of 100,000 frames is 3 MiB."""

MOST_TEXT_BYTES = 64 * MIB
"""Of JSON and CSV: cameras of 50,000 frames, results of as many."""

MOST_VALUES = 4_000_000
"""Values of a JSON file: each takes up to 100 bytes of memory."""

MOST_ROWS = 250_000
"""Rows of a table: frames of a shot."""

MOST_COLUMNS = 64
"""Columns of a table."""

MOST_DEPTH = 64
"""Levels that tables and lists are nested in."""

MOST_LETTERS = 60
"""Letters of a value that a message repeats."""

MOST_PATH_LETTERS = 1024
"""Letters of a path that a file names."""

MOST_PROBLEMS = 20
"""Wrong fields of a file that are listed; the rest is counted."""

LARGEST_FRAME = 10**27
"""Frame numbers go so far, to either side."""

LARGEST_WHOLE = 10**30
"""Whole numbers of any file."""

LARGEST_FACTOR, SMALLEST_FACTOR = 1e12, 1e-12
"""Factors and offsets of stored values go so far; lengths, and what is divided by, so far down."""


class _FileLimits:
    """Whether the limits on EXR files hold, in this process."""

    lifted = False


@contextmanager
def lift_file_limits() -> Iterator[None]:
    """Read EXR files of any size inside: in all threads, for who knows where they come from."""
    before, _FileLimits.lifted = _FileLimits.lifted, True
    try:
        yield
    finally:
        _FileLimits.lifted = before


def are_files_limited() -> bool:
    """Tell whether the limits on EXR files hold."""
    return not _FileLimits.lifted
