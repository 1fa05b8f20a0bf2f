"""What becomes of camera matrices after they were checked."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
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
    if found.foreign_positions:
        settled = add_warning(settled, found.foreign_positions)
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
        bare = settled.reader.without_matrices(unfit)
        reader = replace(bare, camera_unfit_singly=found.single)
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

    What is made of a camera at one size and without it at the other is not alike. So where those of
    single frames cost a size its matrices, it takes those of the other if its own frames prove
    them; else matrices that are not used at one size are not used at the other, unless its own
    frames prove them. Where they differ, those that are proven are used, or both, and that is said.
    To pixels that are turned right matrices look wrong: nothing is said of those of HR then.

    Args:
        lr, hr: readers, each with what was found of its own frames.
        misfit: says how HR's pixels are none of LR's, empty if they are; asked where it matters.
    """
    if hr.camera_unfit and not lr.camera_unfit and (turned := misfit()):
        said = tuple(text for text in hr.warnings if hr.camera_unfit not in text)
        return lr, replace(hr, warnings=said, camera_unfit=turned)
    if lr.camera_unfit or hr.camera_unfit:
        return _replace_unfit(lr, hr)
    lr, hr = _fill_gaps(lr, hr, "HR"), _fill_gaps(hr, lr, "LR")
    apart = _list_apart(lr, hr)
    said = (_describe_apart(apart, lr, hr), *_describe_dispute(lr, hr))
    if apart and _is_proven_beside(lr, hr):
        hr = hr.with_matrices_of(lr, apart)
    elif apart and _is_proven_beside(hr, lr):
        lr = lr.with_matrices_of(hr, apart)
    return lr, replace(hr, warnings=(*hr.warnings, *(text for text in said if text)))


def _replace_unfit(lr: FrameReader, hr: FrameReader) -> tuple[FrameReader, FrameReader]:
    """Let the size whose matrices are proven lend them to the other; else use none at all."""
    if lr.camera_unfit and hr.camera_unfit:
        return lr, hr
    if lr.camera_unfit:
        return _take_proven(lr, hr, "HR")
    return _take_proven(hr, lr, "LR")[::-1]


def _take_proven(
    unfit: FrameReader, other: FrameReader, size: str
) -> tuple[FrameReader, FrameReader]:
    reason = unfit.camera_unfit
    serves = unfit.camera_unfit_singly and other.camera_certain and other.has_camera
    if not serves:
        return unfit, other if other.camera_certain else other.without_matrices(reason)
    served = f"those of the {size} frames, which are the same camera's, are used in their place"
    said = tuple(
        text.replace(f"{reason}; {REFUSED}", f"{reason}; {served}") for text in unfit.warnings
    )
    return replace(unfit.with_matrices_of(other, None), warnings=said), other


def _fill_gaps(reader: FrameReader, other: FrameReader, size: str) -> FrameReader:
    """Take the matrices of frames that have none from the other size, where they are proven."""
    lacking = [n for n in reader.without_camera if n not in reader.held]
    filled = [n for n in lacking if n in other.cameras and other.cameras[n].has_matrices]
    if not filled or not other.camera_certain:
        return reader
    note = f"camera: the matrices of {say_frames(filled)} are those of the {size} frames"
    taken = reader.with_matrices_of(other, filled)
    return replace(taken, notes=(*reader.notes, note))


def _is_proven_beside(reader: FrameReader, other: FrameReader) -> bool:
    """Tell whether a size's own frames prove its matrices, and the other's do not."""
    return reader.camera_certain and not other.camera_certain


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


def _list_apart(lr: FrameReader, hr: FrameReader) -> list[int]:
    """Numbers of the frames whose matrices differ; stand-ins are paired with their own."""
    run, other = gather_run(lr.cameras), gather_run(hr.cameras)
    differing = [] if run is None or other is None else find_apart(run, other)
    return [n for n in differing if n not in lr.held and n not in hr.held]


def _describe_apart(apart: Sequence[int], lr: FrameReader, hr: FrameReader) -> str:
    if not apart:
        return ""
    used = "Both are used as they are"
    if _is_proven_beside(lr, hr):
        used = "The LR frames', which agree with what is seen, are used at both sizes"
    elif _is_proven_beside(hr, lr):
        used = "The HR frames', which agree with what is seen, are used at both sizes"
    return (
        f"the camera matrices of {say_frames(apart)} are not those of the LR frames: matrices of "
        f"another frame, or convention? {used}; write the same into both"
    )
