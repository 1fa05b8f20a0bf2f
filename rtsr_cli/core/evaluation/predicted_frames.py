"""Which frames are judged where some of them are stamped as predicted: those, and no others.

What was rendered is no system's merit. Metrics of change are of the whole alternating sequence:
rendered, predicted, rendered, ...; the frames between the judged ones take part in them alone.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.files.provenance import read_past
from rtsr_cli.core.frames.selection import Selection

Frames = Mapping[str, set[int]]
"""By the folder's root, the frames that it has."""


def holds_only_predicted(reader: FrameReader) -> bool:
    """Tell whether every frame that was surveyed is stamped: what lies between was left out."""
    surveyed = set(reader.cameras)
    return bool(surveyed) and surveyed <= reader.predicted


def list_stamped(tests: Collection[FrameReader]) -> frozenset[int]:
    """Frames that are stamped in any test."""
    return frozenset(n for reader in tests for n in reader.predicted)


def keep_stamped(
    there: Frames, tests: Collection[FrameReader], stamped: Collection[int]
) -> dict[str, set[int]]:
    """Leave the frames that are stamped; of folders without any stamp, the same ones.

    Args:
        there: what each folder has.
        tests: whose stamps count; all others are references.
        stamped: frames that are stamped in any of them.
    """
    own = {str(r.frames.root): set(r.predicted) for r in tests if r.predicted}
    return {root: numbers & own.get(root, set(stamped)) for root, numbers in there.items()}


def list_between(
    there: Frames, judged: Collection[int], available: Collection[int], selection: Selection
) -> tuple[int, ...]:
    """Frames that every folder has and that none of the judged ones is, in their part of a shot.

    Args:
        there: what each folder has.
        judged: frames of this part that are judged.
        available: those of all parts.
        selection: frames that are asked for.
    """
    common = set.intersection(*map(set, there.values())) - set(available)
    asked = common if selection.frames is None else common & selection.frames
    part = set(judged)

    def leads(number: int) -> int:
        return max((n for n in available if n < number), default=min(available))

    return tuple(sorted(n for n in asked if leads(n) in part))


def read_history(reader: FrameReader, number: int) -> int | None:
    """Rendered frames that a prediction had before it; None where nothing says so."""
    if number not in reader.predicted:
        return None
    return read_past(reader.header_of(reader.path(number)).attributes)
