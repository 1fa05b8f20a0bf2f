"""The errors a user can cause; `cli.py` alone turns them into a message and an exit code."""

from __future__ import annotations


class RtsrError(Exception):
    """Base of every error with a message for the user: what, where, and what to do."""


class FrameFolderError(RtsrError):
    """A folder, sequence or file that cannot be used as it is."""


class MissingBufferError(RtsrError):
    """A buffer that a system needs and a frame does not hold."""


class ShapeMismatchError(RtsrError):
    """Sizes that have to agree and do not."""


class ConfigError(RtsrError):
    """A file written by the user (capture.toml, a layout, a training config) that is not valid."""


class OutputError(RtsrError):
    """An output that cannot be written, or that rtsr did not write and must not replace."""
