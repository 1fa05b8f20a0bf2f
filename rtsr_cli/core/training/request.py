"""What `train` is asked for; imports no torch."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.choices import MissingPolicy, NonfinitePolicy
from rtsr_cli.core.errors import RequestError
from rtsr_cli.core.requests import accept_words, check_ranges

SCALE_RANGE = (2, 16)


@dataclass(frozen=True, kw_only=True)
class TrainRequest:
    """Which network is trained on what, and where the run is kept; or what is packed.

    Attributes:
        system: name of the system.
        data: folders of shots, and packs.
        out_folder: folder of the run; either this or `pack_file`.
        scale: the same as the setting training.scale, over the others; None to leave it to them.
        config_file: settings in TOML; None for the defaults.
        assignments: single settings over the file's, like "training.steps=5000".
        init_file: weights to start from; None for fresh ones.
        pack_file: file that packed crops are written to, in place of training.
        pack_crops: how many crops are packed.
        cache_folder: where decoded frames are kept; None for `cache` beside the output.
        device: torch device, or `auto`.
        layout: channel layout or a TOML file of one; None to detect it.
        layer: layer or stereo view that is read of files with several.
        view: stereo view that is read, of that layer if one is named.
        capture_file: declarations in place of the shots' capture.toml.
        on_missing: holes in the numbering.
        on_nonfinite: NaN and Inf in an input.
        dry_run: resolve the settings, read no frame, write nothing.
        overwrite: also replace files of RUN, or the pack, that rtsr did not write.
    """

    system: str
    data: tuple[Path, ...]
    out_folder: Path | None = None
    scale: int | None = None
    config_file: Path | None = None
    assignments: tuple[str, ...] = ()
    init_file: Path | None = None
    pack_file: Path | None = None
    pack_crops: int = 1000
    cache_folder: Path | None = None
    device: str = "auto"
    layout: str | None = None
    layer: str | None = None
    view: str | None = None
    capture_file: Path | None = None
    on_missing: MissingPolicy = MissingPolicy.ERROR
    on_nonfinite: NonfinitePolicy = NonfinitePolicy.ERROR
    dry_run: bool = False
    overwrite: bool = False

    def __post_init__(self) -> None:
        """Check what goes together.

        Raises:
            RequestError: something does not.
        """
        accept_words(self)
        if (self.out_folder is None) == (self.pack_file is None):
            raise RequestError("give either --out RUN or --pack FILE")
        if not self.data:
            raise RequestError("name at least one folder or pack of DATA")
        check_ranges(self, scale=SCALE_RANGE, pack_crops=(1, math.inf))

    @property
    def output_folder(self) -> Path:
        """Folder that everything is written below."""
        if self.out_folder is not None:
            return self.out_folder
        assert self.pack_file is not None
        return self.pack_file.parent
