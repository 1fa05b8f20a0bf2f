"""How much is read of what others wrote, in one place: files beyond this are damaged or hostile.

What unpacks to more than its bytes is measured before memory is taken.
"""

from __future__ import annotations

MIB = 1 << 20

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

MOST_PROBLEMS = 20
"""Wrong fields of a file that are listed; the rest is counted."""

LARGEST_FRAME = 10**27
"""Frame numbers go so far, to either side."""

LARGEST_WHOLE = 10**30
"""Whole numbers of any file."""

LARGEST_FACTOR = 1e12
"""Factors and offsets of stored values go so far."""
