"""Warnings of several folders, each said once: what is wrong at LR is mostly so at HR."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.wording import join_names, say_once


def list_warnings(readers: Iterable[FrameReader]) -> list[str]:
    """What is to be said of the frames of some readers, with the folders in which it is so."""
    said = {reader.frames.root: reader.warnings for reader in readers}
    return [f"{name_folders(roots)}: {text}" for roots, text in join_warnings(said)]


def join_warnings(said: Mapping[Path, Sequence[str]]) -> list[tuple[tuple[Path, ...], str]]:
    """Join the warnings of folders that are alike but for what each has measured.

    Args:
        said: warnings by folder.

    Returns:
        Folders and text; see `say_once`.
    """
    plain = len({root.name for root in said}) == len(said)
    roots = {root.name if plain else str(root): root for root in said}
    texts = {name: said[root] for name, root in roots.items()}
    return [(tuple(roots[name] for name in names), text) for names, text in say_once(texts)]


def name_folders(roots: Sequence[Path]) -> str:
    """Name folders: `shot/lr and hr` where they lie side by side."""
    first, *others = roots
    beside = (r.name if r.parent == first.parent else str(r) for r in others)
    return join_names((str(first), *beside))
