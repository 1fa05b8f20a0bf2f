"""The errors a user can cause, and the hints in their messages.

`cli.py` alone turns an error into a message and an exit code.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class RtsrError(Exception):
    """Base of every error with a message for the user: what, where, and what to do."""


class RequestError(RtsrError):
    """Choices that do not go together; on the command line a usage error."""


class FrameFolderError(RtsrError):
    """A folder, sequence or file that cannot be used as it is."""


class LayerChoiceError(FrameFolderError):
    """Files that hold one buffer in several layers or views, of which the user has to choose."""

    def __init__(self, message: str, layers: Iterable[str], buffer: str) -> None:
        """Remember the choices.

        Args:
            message: for the user; names them.
            layers: names of the layers.
            buffer: that they hold.
        """
        super().__init__(message)
        self.layers = tuple(layers)
        self.buffer = buffer


class InputChangedError(FrameFolderError):
    """A file that is no longer what it was when the run was planned."""


class NonfiniteError(FrameFolderError):
    """A frame whose inputs hold NaN or Inf, or whose output would; `count` says how many."""

    def __init__(self, message: str, count: int) -> None:
        """Remember how many there are."""
        super().__init__(message)
        self.count = count


class MissingBufferError(RtsrError):
    """A buffer that a system needs and a frame does not hold."""


class ShapeMismatchError(RtsrError):
    """Sizes that have to agree and do not."""


class MetricError(RtsrError):
    """Images that a metric cannot compare, or a metric's program that failed."""


class MetricUnavailableError(RtsrError):
    """A metric whose weights or program are not installed; the message says how to get them."""


class ConfigError(RtsrError):
    """A file written by the user (capture.toml, a layout, a training config) that is not valid."""


class CheckpointError(RtsrError):
    """Weights or a training state that cannot be used."""


class TrainingError(RtsrError):
    """A training run that cannot go on."""


class OutputError(RtsrError):
    """An output that cannot be written, or that rtsr did not write and must not replace."""


class OutputBlockedError(OutputError):
    """A disk that is full or a folder that takes no more files: every other write fails alike."""


LEAST_LIKE = 0.5
"""Of two names of two letters that are the other way round."""

MOST_LISTED, MOST_NEAREST = 20, 5
"""Names that are listed in full, and how many of the nearest of more."""


def did_you_mean(
    word: str, known: Iterable[str], *, listed: str = "there are", meant: str = ""
) -> str:
    """Return `, did you mean 'x'?` for a near miss, and what there is: all, or the nearest.

    Args:
        word: as written.
        known: what it might have been.
        listed: said before what there is.
        meant: what it stands for, if that is known better than by its letters.
    """
    names = list(known)
    close = [meant] if meant else find_close(word, names)
    hint = f", did you mean '{close[0]}'?" if close else ""
    if len(names) > MOST_LISTED:
        nearest = find_nearest(word, names)
        return f"{hint} (nearest of {len(names)}: {', '.join(nearest)})"
    return f"{hint} ({listed}: {', '.join(names)})" if names else hint


def find_close(word: str, known: Iterable[str]) -> list[str]:
    """Return the name that a word may be a slip of, if one is."""
    return difflib.get_close_matches(word, list(known), n=1, cutoff=LEAST_LIKE)


def find_nearest(word: str, known: Iterable[str], most: int = MOST_NEAREST) -> list[str]:
    """Return the names that are most like a word, the nearest first.

    A layer before a dot may have been left out; small and capital letters are one.
    """
    matcher = difflib.SequenceMatcher(b=word.lower(), autojunk=False)

    def measure(name: str) -> float:
        matcher.set_seq1(name.lower())
        whole = matcher.ratio()
        matcher.set_seq1(name.partition(".")[2].lower())
        return max(whole, matcher.ratio())

    return sorted(known, key=measure, reverse=True)[:most]
