"""What `inspect` is asked for; imports no torch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.requests import accept_words


@dataclass(frozen=True, kw_only=True)
class InspectRequest:
    """Which folder is looked at, and whether its declarations are written down.

    Attributes:
        in_folder: folder of frames, or of shots.
        write: put what was found down as capture.toml in each shot's folder.
        overwrite: let that replace a capture.toml; the former one is kept as capture.toml.bak.
        every: look at the pixels of every frame, however many there are.
        capture_file: declarations in place of the shots' capture.toml.
        layout: channel layout or a TOML file of one; None to detect it.
        layer: layer or stereo view that is read of files with several.
        view: stereo view that is read, of that layer if one is named.
    """

    in_folder: Path
    write: bool = False
    overwrite: bool = False
    every: bool = False
    capture_file: Path | None = None
    layout: str | None = None
    layer: str | None = None
    view: str | None = None

    def __post_init__(self) -> None:
        """Accept paths as text."""
        accept_words(self)
