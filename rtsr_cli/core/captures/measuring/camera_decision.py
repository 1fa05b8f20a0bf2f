"""What becomes of camera matrices after they were checked."""

from __future__ import annotations

from dataclasses import replace

from rtsr_cli.core.captures.measuring.measured_reader import MeasuredReader, add_warning
from rtsr_cli.core.captures.reader import FrameReader

REFUSED = "what needs a camera is refused, the rest runs"


def decide_camera(settled: MeasuredReader, *, leads: bool) -> MeasuredReader:
    """Take matrices that fail for unknown; say which are unverified, and what is left open.

    Args:
        settled: measured.
        leads: whether these frames say what is unverified; not the HR frames beside LR ones.
    """
    found = settled.measured.camera
    if found is None:
        return settled
    if found.unfit:
        reader = settled.reader.without_matrices(found.unfit)
        return add_warning(replace(settled, reader=reader), f"{found.unfit}; {REFUSED}")
    if found.doubt and leads:
        return replace(settled, notes=(*settled.notes, found.doubt))
    if found.undecided and not found.certain and leads:
        note = (
            f"camera: {' and '.join(found.proofs)} agree with the matrices, but cannot tell them "
            f"from ones that look {'; or '.join(found.undecided)}"
        )
        return replace(settled, notes=(*settled.notes, note))
    return settled


def share_verdict(reader: FrameReader, other: FrameReader) -> FrameReader:
    """Return a reader without matrices where those of the other resolution are not used."""
    if other.camera_unfit and not reader.camera_unfit:
        return reader.without_matrices(other.camera_unfit)
    return reader
