"""Which frames of a shot are rendered, and which are to predict from them."""

from __future__ import annotations

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.cadence import Cadence


def split_by_cadence(
    reader: FrameReader, cadence: Cadence
) -> tuple[frozenset[int], frozenset[int]]:
    """Return the numbers of rendered frames, and of the others.

    Raises:
        FrameFolderError: one of both is empty; names the folder, and what to say instead.
    """
    rendered = cadence.list_rendered(reader.numbers, reader.step)
    predicted = frozenset(reader.numbers) - rendered
    root = reader.frames.root
    if not rendered:
        raise FrameFolderError(
            f"{root}: none of its frames is among those that --rendered names; name frames that "
            "hold radiance"
        )
    if not predicted:
        raise FrameFolderError(
            f"{root}: all of its frames are rendered, none is left to predict; give the G-buffers "
            "of the time steps between them, and --every or --rendered"
        )
    return rendered, predicted
