"""Files that cannot be read, and files that are not there: all that is wrong, said at once.

A shot fails by the first fault that is met; what else would stop it stands in the same message, so
that nobody renders one frame to learn of the next.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from rtsr_cli.core.errors import FrameFolderError

MOST_FAULTS = 5
"""So many are spelled out in one message; of more, the rest is counted."""


@contextmanager
def naming_every_fault(list_faults: Callable[[], Iterable[str]]) -> Iterator[None]:
    """Add to an error of a folder what else is wrong there.

    Args:
        list_faults: says all that is wrong; asked where something failed, and then only.

    Raises:
        FrameFolderError: as what is done inside, with the other faults in its message.
    """
    try:
        yield
    except FrameFolderError as error:
        # errors of a kind of their own carry more than a message
        plain = type(error) is FrameFolderError
        others = [text for text in list_faults() if text not in str(error)] if plain else []
        if not others:
            raise
        raise FrameFolderError(_join_faults(str(error), others)) from error


def _join_faults(first: str, others: list[str]) -> str:
    told = [first, *others[: MOST_FAULTS - 1]]
    left = len(others) + 1 - len(told)
    more = f". And {left} more: rtsr inspect names them all" if left > 0 else ""
    return ". Also: ".join(told) + more
