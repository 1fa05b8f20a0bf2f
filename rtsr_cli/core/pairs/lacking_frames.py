"""Frames that lack a buffer which others hold and a run needs: as if their files were missing.

Policy skip leaves them out, with policy hold the frame before stands in, which is taken whole.

What a run needs of a shot shows where every frame that lacks anything is left out; of those, it
then gets back the ones that have all that it needs. What it can do without leaves no frame out.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from typing import TypeVar

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.pairs.sources import PairInputs, PairSource

Opened = TypeVar("Opened", PairSource, FrameReader)
"""A shot as a command reads it."""

RADIANCE = frozenset({Buffer.COLOR})
"""What no frame may lack, unless a command reads frames that were not rendered."""

OpenShots = Callable[[frozenset[Buffer]], Iterable[tuple[str, Opened]]]
"""Surveys every shot, by relative path, without the frames that lack one of some buffers."""

ListNeeded = Callable[[Opened, Opened], Collection[Buffer]]
"""Of a shot as it is, and of it without frames that lack anything: what a run needs of those."""


def leave_out_lacking(
    open_shots: OpenShots[Opened], policy: MissingPolicy, list_needed: ListNeeded[Opened]
) -> Iterable[tuple[str, Opened]]:
    """Survey every shot; unless the policy is error, without frames that lack what a run needs.

    Args:
        open_shots: surveys them.
        policy: for frames that are missing, and for those that lack buffers.
        list_needed: what is needed of them.

    Raises:
        RtsrError: as `open_shots` and `list_needed`.
    """
    if policy is MissingPolicy.ERROR:
        return open_shots(frozenset())
    shots = dict(open_shots(RADIANCE))
    lacking = frozenset(b for one in shots.values() for r in _list_readers(one) for b in r.partial)
    if not lacking:
        return shots.items()
    needed: set[Buffer] = set()
    for name, without in open_shots(RADIANCE | lacking):
        needed |= lacking.intersection(list_needed(shots[name], without))
    return open_shots(RADIANCE | needed)


def _list_readers(opened: PairSource | FrameReader) -> tuple[FrameReader, ...]:
    return (opened,) if isinstance(opened, FrameReader) else opened.readers


def list_needed_inputs(
    whole: PairSource,
    without: PairSource,
    inputs: PairInputs,
    numbers: Collection[int] | None = None,
) -> frozenset[Buffer]:
    """Return the stored buffers that some inputs need; none where all frames have what they need.

    Args:
        whole: a shot as it is.
        without: the same without frames that lack anything.
        inputs: what is read of it.
        numbers: of the frames that are read so; all if None.
    """
    if not whole.missing(inputs, numbers):
        return frozenset()
    reads = without.resolve(replace(inputs, lr_optional=(), hr_optional=()))
    return reads.lr.stored | reads.hr.stored
