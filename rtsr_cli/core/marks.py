"""The mark of files that rtsr wrote: `rtsr:version` and the version, where a format keeps facts.

An attribute of an EXR, a text of a PNG, a key of a JSON object, a meta element of a page, the first
line of a TOML or Markdown file. Files of tensors have their format's name instead, tables their
columns.
"""

from __future__ import annotations

from rtsr_cli import __version__

MARK = "rtsr:version"
"""Names the version that wrote a file."""

MARKED = {MARK: __version__}
"""The mark of formats that hold values by name."""

TOML_MARK = f"# {MARK} "
"""Begins the first line of a TOML file."""

TOML_MARK_LINE = f"{TOML_MARK}{__version__}\n"
"""That line."""

MARKDOWN_MARK = f"<!-- {MARK} "
"""Begins the first line of a Markdown file."""

MARKDOWN_MARK_LINE = f"{MARKDOWN_MARK}{__version__} -->\n"
"""That line."""
