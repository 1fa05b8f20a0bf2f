"""Detecting the layout of files whose layout nobody names: the one that explains most buffers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

from rtsr_cli.core.captures.bound_channels import Binding
from rtsr_cli.core.captures.channel_matching import (
    LayoutMatch,
    Streams,
    make_ambiguity_error,
    make_layer_error,
    match_layout,
)
from rtsr_cli.core.captures.layouts import Layout
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import Buffer

LISTED = 12
"""Channels that a message names before it is cut."""


def list_channels(streams: Streams) -> str:
    """Channels of all files for a message, cut if there are many."""
    channels = sorted({c for names in streams.values() for c in names})
    return ", ".join(channels[:LISTED]) + (", ..." if len(channels) > LISTED else "")


def detect_layout(
    streams: Streams, candidates: Iterable[Layout], where: str, layer: str | None = None
) -> tuple[Layout, Binding]:
    """Choose the layout that explains most buffers.

    Layouts that find the same channels are one, the first in the order given; one that would
    have to guess between file sequences is out, unless it alone explains most.

    Raises:
        FrameFolderError: none explains any, two explain equally many in different ways, the
            folder holds two dumps at once, or a file two layers; names the choices.
    """
    found = [(layout, match_layout(layout, streams, layer)) for layout in candidates]
    matches = [(layout, m) for layout, m in found if m.knows(layer)] or found
    names = [channel for held in streams.values() for channel in held]
    clear = [
        (layout, m)
        for layout, m in matches
        if not m.ambiguous and _is_plausible(layout, m) and _is_marked(layout, names)
    ]
    best = max((len(m.binding) for _, m in clear), default=0)
    guess = max((m for _, m in matches if m.ambiguous), key=lambda m: m.explained, default=None)
    if guess is not None and guess.explained > best:
        raise FrameFolderError(f"{where}: {make_ambiguity_error(guess.ambiguous)}")
    if best == 0:
        raise FrameFolderError(
            f"{where}: no layout knows these channels ({list_channels(streams)}); name one with "
            f"--layout ({', '.join(layout.name for layout, _ in found)}), or say which channel "
            "is which buffer in [buffers] of capture.toml"
        )
    winners = [(layout, m) for layout, m in clear if len(m.binding) == best]
    winner = winners[0]
    if winner[1].rivals:
        raise make_layer_error(winner[1].rivals, where)
    different = [layout.name for layout, m in winners if m.binding != winner[1].binding]
    if different:
        raise FrameFolderError(
            f"{where}: layouts {', '.join([winner[0].name, *different])} fit these channels "
            f"equally well ({list_channels(streams)}); choose one with --layout"
        )
    _refuse_second_dump(winner, clear, where)
    return winner[0], winner[1].binding


def _is_plausible(layout: Layout, matched: LayoutMatch) -> bool:
    """Tell whether a layout may be presumed: wide patterns alone do not prove an unverified one."""
    return layout.verified or Buffer.COLOR in matched.binding


def _is_marked(layout: Layout, channels: Sequence[str]) -> bool:
    """Tell whether channels hold what a layout is known by, if it is by anything."""
    return not layout.marks or any(
        fnmatchcase(channel, mark) for mark in layout.marks for channel in channels
    )


def _refuse_second_dump(
    winner: tuple[Layout, LayoutMatch], others: Iterable[tuple[Layout, LayoutMatch]], where: str
) -> None:
    layout, chosen = winner
    for other, m in others:
        shared = [b for b in m.binding if b in chosen.binding]
        if shared and not m.streams & chosen.streams:
            raise FrameFolderError(
                f"{where}: holds two dumps: layout {layout.name} in "
                f"{', '.join(map(repr, sorted(chosen.streams)))} and layout {other.name} in "
                f"{', '.join(map(repr, sorted(m.streams)))}, both with '{shared[0]}'; keep one a "
                "folder, or choose one with --layout"
            )
