"""What becomes of camera matrices after they were checked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from rtsr_cli.core.captures.measuring.camera_check import CameraFinding
from rtsr_cli.core.captures.measuring.camera_path import (
    CameraRun,
    find_apart,
    find_form_fault,
    find_strays,
    gather_run,
)
from rtsr_cli.core.captures.measuring.camera_structure import are_mirrored
from rtsr_cli.core.captures.measuring.measured_reader import MeasuredReader, add_warning
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.frames.sequence import FrameSequence

REFUSED = "what needs a camera is refused, the rest runs"


def decide_camera(settled: MeasuredReader, *, leads: bool) -> MeasuredReader:
    """Take matrices that fail for unknown; say which are unverified, and what is left open.

    Args:
        settled: measured.
        leads: whether these frames say what is unverified; not the HR frames beside LR ones.
    """
    gap = _describe_gap(settled.reader)
    settled = add_warning(settled, gap) if gap else settled
    found = settled.measured.camera
    if found is None:
        return settled
    if found.contradiction and leads:
        settled = add_warning(settled, found.contradiction)
    return _follow_finding(settled, found, leads=leads)


def _follow_finding(
    settled: MeasuredReader, found: CameraFinding, *, leads: bool
) -> MeasuredReader:
    """Do what a finding asks for, with the numbers of all frames looked at."""
    run = gather_run(settled.reader.cameras)
    unfit = found.unfit
    if run is not None and not unfit:
        unfit = find_form_fault(run, mirrored=_is_mirrored(settled))
    if unfit:
        reader = settled.reader.without_matrices(unfit)
        settled = replace(_hold_finding(settled, replace(found, unfit=unfit)), reader=reader)
        return add_warning(settled, f"{unfit}; {REFUSED}")
    doubt = found.doubt if found.disputed else ""
    reader = replace(settled.reader, camera_certain=found.certain, camera_doubt=doubt)
    settled = replace(settled, reader=reader)
    strays = "" if run is None or not leads else _find_strays(settled.reader, run)
    if strays:
        settled = add_warning(_hold_finding(settled, replace(found, strays=strays)), strays)
    if (found.stuck or found.beside) and leads:
        return add_warning(settled, found.doubt)
    if found.doubt and leads:
        return replace(settled, notes=(*settled.notes, found.doubt))
    if found.undecided and leads:
        note = (
            f"camera: the matrices fit {' and '.join(found.proofs)}, which cannot tell them from "
            f"{found.likenesses}"
        )
        return replace(settled, notes=(*settled.notes, note))
    return settled


def _describe_gap(reader: FrameReader) -> str:
    """Say which frames have matrices that are none, or none though others have some."""
    bare = [n for n in reader.without_camera if not reader.cameras[n].fault]
    if len(bare) == len(reader.cameras):
        return ""
    lacking = (
        f"{say_frames(bare)} without the camera matrices that the other frames have (4 x 4, "
        "worldToCamera and worldToNDC)"
    )
    said = "; ".join(text for text in (reader.camera_faults, lacking if bare else "") if text)
    return said and (
        f"{said}; {REFUSED}; write them into the headers, or give those of "
        'all frames in a side-car (capture.toml: camera = "camera.csv")'
    )


def _hold_finding(settled: MeasuredReader, found: CameraFinding) -> MeasuredReader:
    """Keep what is known of the cameras once the numbers of all frames are looked at."""
    return replace(settled, measured=replace(settled.measured, camera=found))


def _find_strays(reader: FrameReader, run: CameraRun) -> str:
    """Look for strays among frames in a row that no other one stands in for."""
    numbers = [n for n in run.numbers.tolist() if n not in reader.held]
    sequence = FrameSequence(numbers=numbers, step=reader.step, cuts=reader.resets)
    return find_strays(run, sequence.runs())


def _is_mirrored(settled: MeasuredReader) -> bool:
    """Tell the handedness of the cameras that were looked at."""
    views = (settled.reader.cameras[n].world_to_camera for n in settled.measured.frames)
    view = next((v for v in views if v is not None), None)
    return view is not None and bool(are_mirrored(view.numpy()))


def share_verdicts(
    lr: FrameReader, hr: FrameReader, misfit: Callable[[], str]
) -> tuple[FrameReader, FrameReader]:
    """Settle the cameras of both resolutions of a shot, whose cameras are the same.

    Matrices that are not used at one are not used at the other, unless its own frames prove them;
    where they differ, that is said. To pixels that are turned right matrices look wrong: nothing is
    said of those of HR then.

    Args:
        lr, hr: readers, each with what was found of its own frames.
        misfit: says how HR's pixels are none of LR's, empty if they are; asked where it matters.
    """
    if hr.camera_unfit and not lr.camera_unfit and (turned := misfit()):
        said = tuple(text for text in hr.warnings if hr.camera_unfit not in text)
        return lr, replace(hr, warnings=said, camera_unfit=turned)
    unfit = lr.camera_unfit or hr.camera_unfit
    if unfit:
        lr, hr = (
            r if r.camera_unfit or r.camera_certain else r.without_matrices(unfit) for r in (lr, hr)
        )
        return lr, hr
    said = (_describe_apart(lr, hr), *_describe_dispute(lr, hr))
    return lr, replace(hr, warnings=(*hr.warnings, *(text for text in said if text)))


def _describe_dispute(lr: FrameReader, hr: FrameReader) -> Iterator[str]:
    """Say why the cameras of one resolution are in doubt, and those of the other are not."""
    if hr.camera_doubt and not lr.camera_doubt:
        yield hr.camera_doubt
        why = (
            "agree with theirs, but have too few pixels for such an error to be seen"
            if lr.camera_certain
            else "do not tell"
        )
        yield f"the HR frames contradict their camera matrices; the LR frames {why}"
    if lr.camera_doubt and hr.camera_certain:
        yield (
            "the LR frames contradict their camera matrices, though the HR frames agree with "
            "theirs: files of LR may be what is wrong"
        )


def _describe_apart(lr: FrameReader, hr: FrameReader) -> str:
    run, other = gather_run(lr.cameras), gather_run(hr.cameras)
    differing = [] if run is None or other is None else find_apart(run, other)
    # frames that stand in for missing ones are of another moment, and paired with their own
    apart = [n for n in differing if n not in lr.held and n not in hr.held]
    if not apart:
        return ""
    return (
        f"the camera matrices of {say_frames(apart)} are not those of the LR frames: matrices of "
        "another frame, or convention? Both are used as they are; write the same into both"
    )
