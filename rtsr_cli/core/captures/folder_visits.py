"""Walking a tree of folders: each of them once, whatever links lead to it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.folders import find_real_path, list_content

MOST_NAMED = 5
"""Folders that are left out and named; the rest is counted."""


class FolderVisits:
    """Which folders of a tree were visited, and which are left out, and why.

    A folder that several paths lead to is visited by that which is no link. Links to one folder
    outside of the tree are as many shots; a link that leads to a folder above it is never followed.
    """

    def __init__(self) -> None:
        """Start with nothing visited."""
        self._own: dict[Path, Path] = {}
        self._seen: set[Path] = set()
        self._following = False
        self._links: list[Path] = []
        self._left_out: list[str] = []

    def enter(self, folder: Path) -> list[Path] | None:
        """Remember a visit; return the folders in a folder that are not hidden.

        None where it was visited before, or cannot be read: it is left out then, and named.
        """
        real = find_real_path(folder)
        if real in self._seen:
            self._left_out.append(f"{folder} (leads to {real}, which is read already)")
            return None
        self._seen.add(real)
        if not self._following:
            self._own[folder] = real
        try:
            return list_content(folder).subfolders
        except FrameFolderError as error:
            self._left_out.append(str(error))
            return None

    def put_off_links(self, folders: Iterable[Path]) -> list[Path]:
        """Return those of some folders that are no links; links wait for `next_links`."""
        folders = list(folders)
        links = [path for path in folders if path.is_symlink()]
        self._links += links
        return [path for path in folders if path not in links]

    def next_links(self) -> Iterator[Path]:
        """Links to folders, as long as walking them finds more."""
        self._following = True
        while self._links:
            link = self._links.pop(0)
            if link.parent in self._own:
                # what another link of the tree led to may be named a second time
                self._seen = set(self._own.values())
            if find_real_path(link.parent).is_relative_to(target := find_real_path(link)):
                self._left_out.append(f"{link} (leads to {target}, which holds it)")
            else:
                yield link

    @property
    def remarks(self) -> tuple[str, ...]:
        """What was left out, for the user, in one line."""
        named = "; ".join(self._left_out[:MOST_NAMED])
        more = len(self._left_out) - MOST_NAMED
        rest = f" and {more} more" if more > 0 else ""
        return (f"not searched: {named}{rest}",) if named else ()
