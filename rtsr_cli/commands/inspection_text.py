"""What `rtsr inspect` says: its events, and a report for a person."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from tqdm import tqdm

from rtsr_cli.commands.exit_codes import FAILED, REFUSED
from rtsr_cli.commands.log import LOG, show
from rtsr_cli.commands.options import emit
from rtsr_cli.commands.readiness_text import list_readiness_lines
from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.channel_guesses import write_guess
from rtsr_cli.core.captures.layout_names import LAYOUT_NAMES
from rtsr_cli.core.captures.measuring.jitter_finder import JitterVerdict
from rtsr_cli.core.captures.measuring.measured_reader import MeasuredReader
from rtsr_cli.core.captures.measuring.motion_choices import write_motion
from rtsr_cli.core.captures.measuring.motion_finding import (
    SIGNIFICANT_T,
    MotionCandidate,
    MotionFinding,
)
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.sample_channels import describe_samples, stand_for_pixel
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.frames.selection import format_ranges
from rtsr_cli.core.inspect.events import (
    CaptureBlocked,
    CaptureWritten,
    FolderRefused,
    InspectEvent,
    InspectionDone,
    ShotInspected,
    ShotsListed,
)
from rtsr_cli.core.inspect.facts import describe_shot
from rtsr_cli.core.inspect.readiness import Severity
from rtsr_cli.core.inspect.shot_inspection import SetInspection, ShotInspection

LABEL = 12
"""Width of the first column."""

MOST_CANDIDATES = 3

JITTER = {JitterVerdict.CONSISTENT: "as declared, or none", JitterVerdict.UNKNOWN: "not clear"}
"""Verdicts that need more words than their name."""

FAR_WORSE = 100
"""Times as far off as the best reading of depth: so many say it, whatever the number is."""

SURE = 1.0 - 1.0 / FAR_WORSE
"""The margin of that."""

CODES = {
    Severity.REMARK: 0,
    Severity.PIXELS: FAILED,
    Severity.HOLES: REFUSED,
    Severity.REFUSED: REFUSED,
}
"""Exit codes where a command would refuse the frames as they are; where it would fail on some."""


def show_report(events: Iterable[InspectEvent]) -> int:
    """Print what an inspection says, for a person; return the exit code."""
    bar = tqdm(disable=True)
    for event in events:
        match event:
            case ShotsListed():
                bar = tqdm(total=event.count, unit="shot", disable=_list_shot_lines(event))
            case ShotInspected():
                for line in list_report_lines(event.inspection):
                    LOG.info("%s", line)
                bar.update()
            case CaptureWritten():
                show(_format_value(event))
            case CaptureBlocked():
                show(f"Error: {event.message}", err=True)
            case InspectionDone():
                bar.close()
                return CODES[event.gravity]
    return REFUSED


def show_facts(events: Iterable[InspectEvent]) -> int:
    """Print what an inspection says, as one JSON object; return the exit code."""
    facts: dict[str, dict[str, Any]] = {}
    bar = tqdm(disable=True)
    for event in events:
        match event:
            case FolderRefused():
                show(f"Error: {event.message}", err=True)
                emit(describe_shot(event.inspection))
                return REFUSED
            case ShotsListed():
                bar = tqdm(total=event.count, unit="shot", disable=_list_shot_lines(event))
            case ShotInspected():
                facts[event.inspection.name] = describe_shot(event.inspection)
                bar.update()
            case CaptureWritten():
                show(_format_value(event), err=True)
            case CaptureBlocked():
                show(f"Error: {event.message}", err=True)
                facts[event.shot]["problems"].append(event.message)
            case InspectionDone():
                bar.close()
                emit(next(iter(facts.values())) if len(facts) == 1 else {"shots": facts})
                return CODES[event.gravity]
    return REFUSED


def _list_shot_lines(listed: ShotsListed) -> bool | None:
    """Show no bar of one shot; of more, where stderr is a terminal."""
    return None if listed.count > 1 else True


def _format_value(capture: CaptureWritten) -> str:
    also = "" if capture.kept is None else f"; the former one is kept as {capture.kept.name}"
    return f"{capture.path}: written{also}"


def list_report_lines(inspection: ShotInspection) -> Iterator[str]:
    """Everything about a shot."""
    yield from _list_set_lines(inspection.main, inspection.capture)
    if inspection.hr is not None:
        yield from _list_set_lines(inspection.hr, inspection.capture)
    width = inspection.filter_width_px
    if width is not None:
        yield _format_line("filter", _describe_filter(width, measured=inspection.filter_measured))
    for label, text in list_readiness_lines(inspection):
        yield _format_line(label, text)
    yield from _list_next_steps(inspection)
    yield ""


def _describe_filter(width: float, *, measured: bool) -> str:
    if not width:
        return (
            "none over radiance alone: it and the G-buffer show the same of an LR pixel, as "
            "declared or measured"
        )
    said = "measured" if measured else "as declared"
    return f"over LR radiance, standard deviation {width:.2f} LR pixels ({said})"


def _format_line(label: str, text: str) -> str:
    return f"  {label:<{LABEL}}{text}"


def _list_set_lines(frame_set: SetInspection, declared: CaptureDeclaration) -> Iterator[str]:
    yield str(frame_set.root)
    reader = frame_set.reader
    if reader is None:
        yield from _list_unread_lines(frame_set)
        yield from _list_guess_lines(frame_set)
        yield from _list_problem_lines(frame_set)
        return
    yield _format_line("layout", _describe_layout(reader))
    if frame_set.layers:
        read = f"{reader.layer or 'each for its own buffers'} is read"
        yield _format_line("layers", f"{', '.join(frame_set.layers)} ({read})")
    yield _format_line("frames", _describe_frames(frame_set, reader))
    yield _format_line("size", f"{reader.size[1]} x {reader.size[0]}{_describe_windows(reader)}")
    yield from _list_buffer_lines(frame_set, reader)
    several = len(reader.frames.streams) > 1
    for key, names in frame_set.unknown.items():
        yield _format_line("not used", f"{key + ': ' if several else ''}{' '.join(names)}")
    yield from _list_guess_lines(frame_set)
    yield _format_line("camera", _describe_camera(reader, frame_set.settled))
    if frame_set.settled is not None:
        yield from _list_convention_lines(frame_set.settled, declared)
        yield from _list_roughness_lines(frame_set, reader, declared)
        yield from _list_id_lines(frame_set)
        for note in frame_set.settled.notes:
            if not note.startswith(SKY_NOTE):
                yield _format_line("note", note)
    yield from _list_problem_lines(frame_set)


def _list_unread_lines(frame_set: SetInspection) -> Iterator[str]:
    """Channels of frames that cannot be read; the layers where only one has to be chosen."""
    if frame_set.layers:
        yield _format_line("layers", f"{', '.join(frame_set.layers)} (none is read: choose one)")
        return
    known = frame_set.known_layout
    yield _format_line("layout", f"{known} (not read: see below)" if known else "not understood")
    for key, names in frame_set.channels.items():
        yield _format_line("channels", f"{key + ': ' if key else ''}{' '.join(names)}")


def _describe_layout(reader: FrameReader) -> str:
    layout = reader.layout
    preset = layout.name in LAYOUT_NAMES
    doubt = " (unverified: known from documentation only)" if preset and not layout.verified else ""
    return f"{layout.name}{doubt}: {layout.description}"


def _describe_frames(frame_set: SetInspection, reader: FrameReader) -> str:
    text = f"{format_ranges(frame_set.numbers)} ({len(frame_set.numbers)})"
    if reader.step != 1:
        text += f", in steps of {reader.step}"
    text += ", none missing" if not frame_set.missing else ""
    looked = len(frame_set.looked_at)
    return text if looked == len(reader.numbers) else f"{text}; pixels of {looked} looked at"


def _describe_windows(reader: FrameReader) -> str:
    display = reader.display
    plane = display.seen_from(display)
    held = {place for file in reader.places for place in file.places}
    if held == {plane}:
        return ""
    windows = next(iter(held)) if len(held) == 1 else f"{len(held)} data windows"
    read = "" if reader.region == plane else f", {reader.region} is read"
    return f"; files hold {windows} of an image plane of {display.width} x {display.height}{read}"


def _list_buffer_lines(frame_set: SetInspection, reader: FrameReader) -> Iterator[str]:
    label = "buffers"
    for buffer, s in frame_set.statistics.items():
        where = _describe_place(reader, buffer)
        numbers = f"{s.low:.4g} .. {s.high:.4g}, median {s.median:.4g}"
        yield _format_line(label, f"{buffer:<14}{where:<32} {numbers}")
        label = ""


def _describe_place(reader: FrameReader, buffer: Buffer) -> str:
    """Which channels of which file sequence a buffer is, or what is computed of them."""
    bound = reader.binding[buffer]
    several = len(reader.frames.streams) > 1
    samples = reader.samples.get(buffer, ())
    if samples and bound == stand_for_pixel(buffer, samples):
        return describe_samples(buffer, samples, streams=several)
    if not bound.is_as_stored:
        return bound.describe(streams=several)
    channels = " ".join(c.channel for c in bound)
    place = ", ".join(dict.fromkeys(c.stream for c in bound)) if several else ""
    return f"{place}: {channels}" if place else channels


def _list_guess_lines(frame_set: SetInspection) -> Iterator[str]:
    for buffer, places in frame_set.guessed.items():
        value = write_guess(buffer, places)
        yield _format_line("maybe", f"{buffer} = {value}   ({BUFFER_SPECS[buffer].unit})")
    if frame_set.guessed:
        yield _format_line(
            "", "declare what is right under [buffers] in capture.toml (--write starts one)"
        )


def _describe_camera(reader: FrameReader, settled: MeasuredReader | None) -> str:
    if reader.camera_unfit:
        return "the matrices that are there are not used, see the warning below"
    if reader.has_camera:
        read = f", read as {reader.matrices}" if reader.matrices.words else ""
        return f"worldToCamera and worldToNDC of every frame{read}; {_describe_proof(settled)}"
    if reader.camera_faults:
        return (
            f"the matrices of {say_frames(reader.without_camera)} cannot be those of a camera, see "
            "the warning below"
        )
    if len(reader.without_camera) < len(reader.cameras):
        return f"{say_frames(reader.without_camera)} without matrices, the others have them"
    return "no matrices: neither in the headers, nor in a file that capture.toml names"


def _describe_proof(settled: MeasuredReader | None) -> str:
    found = None if settled is None else settled.measured.camera
    if found is None or not found.proofs:
        return "unverified"
    but = f"; these frames cannot rule out {found.likenesses}" if found.undecided else ""
    apart = "; single frames are in doubt, see the warning below" if found.strays else ""
    unread = settled is not None and bool(settled.reader.motion_undecided)
    how = f" ({ANY_READING})" if unread and any("motion" in name for name in found.proofs) else ""
    return f"verified by {', '.join(found.proofs)}{how}{but}{apart}"


SAME_VECTORS = "fits as well: the vectors of neighbouring files are nearly alike"
"""Said of a reading that differs from the best in the file alone, and hardly in the vectors."""

SKY_NOTE = "sky measured: "
"""How the note begins that the line of sky says, too."""

ANY_READING = "if motion is read in one of the ways that fit alike, which are listed below"
"""Said of cameras that agree with vectors which are not read."""


def _list_convention_lines(settled: MeasuredReader, declared: CaptureDeclaration) -> Iterator[str]:
    reader = settled.reader
    if {Buffer.MOTION, Buffer.FORWARD} & reader.stored:
        how = "not read; presumed as" if reader.motion_undecided else "read as"
        yield _format_line("motion", f"{how} {reader.conventions.motion}")
        yield from _list_motion_lines(settled, declared)
    if Buffer.DEPTH in reader.stored:
        depth = reader.conventions.depth
        kind = f"{depth.kind}{', reversed' if depth.reversed else ''}"
        unit = "" if depth.kind == "device" else f", {depth.unit_m:g} m a unit"
        kind += ", from the near plane" if depth.from_near else ""
        yield _format_line("depth", f"{kind}{unit}{_describe_depth_proof(settled)}")
    sky = settled.measured.sky
    if sky is not None:
        yield _format_line("sky", f"{sky.share:.1%} of the pixels, by {sky.rule}")
    if Buffer.NORMAL in reader.stored:
        normal = reader.conventions.normal
        known = ", measured" if settled.measured.proves_normals else ""
        if Buffer.NORMAL in reader.contradicted:
            known = "; not read, see the warning below"
        packed = "packed (n + 1) / 2" if normal.packed else "-1..1"
        yield _format_line("normals", f"{normal.space} space, {packed}{known}")


def _list_motion_lines(settled: MeasuredReader, declared: CaptureDeclaration) -> Iterator[str]:
    measured = settled.measured
    finding = measured.motion
    if finding is None:
        yield _format_line(
            "", "not measured: that needs two adjacent frames with radiance or albedo"
        )
        return
    if not finding.candidates:
        yield _format_line("", "not measured: no stored vector differs from zero")
        return
    yield _format_line(
        "",
        f"measured on {say_frames(measured.frames)}, {finding.moving:.0%} of the pixels move; "
        "difference to the neighbouring frame fetched along the vectors, best readings of all "
        f"({finding.unmoved_error:.3f} if fetched without them):",
    )
    used = finding.of(settled.reader.conventions.motion)
    # the one that is read leads, whichever fits best
    listed = [*([used] if used is not None else []), *finding.candidates[:MOST_CANDIDATES]]
    for candidate in dict.fromkeys(listed):
        marks = [SAME_VECTORS if candidate.same_vectors else _describe_fit(candidate, finding)]
        if candidate is used and not settled.reader.motion_undecided:
            marks += [f"used: {_explain_reading(candidate, settled, declared)}"]
        text = f"{candidate.error:.3f}  {candidate.convention}: {'; '.join(marks)}"
        yield _format_line("", f"  {text}")
    if finding.alike:
        yield _format_line("", f"  {_describe_tie(finding, used, settled)}")
    if finding.best is None:
        yield _format_line(
            "", "  none fits much better than no motion at all: these frames tell little of it"
        )
    jitter = settled.measured.jitter
    if jitter is not None:
        yield _format_line(
            "jitter",
            f"{JITTER.get(jitter.verdict, jitter.verdict)} (frames lie up to "
            f"{jitter.spread_px:.2f} px beside where vectors lead)",
        )


def _describe_fit(candidate: MotionCandidate, finding: MotionFinding) -> str:
    """Say whether a reading may be right, by how much worse it fits than the best one."""
    if not candidate.margin:
        return "fits best"
    how = "about as well" if candidate in finding.alike else "worse"
    return (
        f"fits {how} (the best is {candidate.margin:.1%} lower, "
        f"{candidate.significance:.2f} standard errors)"
    )


def _describe_tie(
    finding: MotionFinding, used: MotionCandidate | None, settled: MeasuredReader
) -> str:
    """Say that readings cannot be told apart, and the line that declares another than is used."""
    count = len(finding.alike)
    said = f"{count} readings fit alike (less than {SIGNIFICANT_T:g} standard errors apart)"
    others = [c for c in finding.alike if c is not used]
    if used is None or settled.reader.motion_undecided or not others:
        return f"{said}: the pictures alone cannot tell which is right"
    shifted = any(c.convention.file_offset for c in finding.alike)
    line = write_motion(others[0].convention, shifted=shifted)
    if settled.measured.by_geometry is used:
        return f"{said} in the pictures alone; told apart by {settled.measured.geometry}"
    return (
        f"{said}: the pictures alone cannot tell which is right. If the one used is wrong, declare "
        f"another at the head of capture.toml: {line}"
    )


def _explain_reading(
    used: MotionCandidate, settled: MeasuredReader, declared: CaptureDeclaration
) -> str:
    """Say what decides how vectors are read."""
    measured = settled.measured
    proven = f"singled out by {measured.geometry}" if measured.by_geometry is used else ""
    if declared.motion.decides():
        return f"it is declared, and {proven}" if proven else "it is declared"
    if proven:
        return proven
    if measured.best is used:
        return "it is measured"
    # the layout's own name: what capture.toml adds to it says nothing of motion
    return f"layout '{settled.reader.layout.name.partition(' + ')[0]}' says so"


def _describe_depth_proof(settled: MeasuredReader) -> str:
    depth = settled.measured.depth
    if settled.reader.has_rays_by_positions and Buffer.DEPTH in settled.reader.readable:
        return ", made planar by the world positions (no camera is there)"
    if depth.best is None:
        return " (not measured: that needs camera matrices and a camera that travels)"
    worse = f"{1.0 / (1.0 - depth.margin):.2g}" if depth.margin < SURE else f"over {FAR_WORSE}"
    return (
        f", measured: points fit to {depth.best.error:.2g} {depth.measure}, {worse} x closer than "
        "by the next reading"
    )


def _list_roughness_lines(
    frame_set: SetInspection, reader: FrameReader, declared: CaptureDeclaration
) -> Iterator[str]:
    if Buffer.ROUGHNESS in reader.stored:
        kind = reader.conventions.roughness
        known = f"{kind}, declared" if declared.roughness == kind else ""
        yield _format_line("roughness", known or _doubt_roughness(frame_set, reader))


def _list_id_lines(frame_set: SetInspection) -> Iterator[str]:
    """Say of ids that are all 0 where they come from; nothing needs them."""
    ids = frame_set.statistics.get(Buffer.OBJECT_ID)
    if ids is not None and ids.low == ids.high == 0.0:
        yield _format_line(
            "ids",
            "0 in every pixel: no object was given a number (Blender: Pass Index under Object, "
            "Relations); objects are not told apart by them",
        )


def _doubt_roughness(frame_set: SetInspection, reader: FrameReader) -> str:
    """Say how roughness is read that nobody declares, and what speaks against it."""
    kind = reader.conventions.roughness
    bound = reader.binding[Buffer.ROUGHNESS]
    names = " ".join(c.channel + c.stream for c in bound).lower()
    if bound.is_inverted and kind != "smoothness":
        return f"taken as {kind}, made of smoothness by what is declared under [buffers]"
    if kind != "smoothness" and any(word in names for word in ("smooth", "gloss")):
        return f'taken as {kind}, but its name says smoothness: roughness = "smoothness"?'
    low = frame_set.statistics[Buffer.ROUGHNESS].median < 0.05
    hint = " (small values: GGX alpha, perhaps?)" if low and kind == "perceptual" else ""
    return f"taken as {kind}{hint}; pictures do not tell, declare it if it is another"


SIGNS = {False: "warning", True: "PROBLEM"}
"""What problems are called: those that commands run with, and those that change an exit code."""


def _list_problem_lines(frame_set: SetInspection) -> Iterator[str]:
    for problem in frame_set.problems:
        first, *others = problem.text.splitlines()
        yield _format_line(SIGNS[problem.gravity > Severity.REMARK], first)
        yield from (_format_line("", line) for line in others)


def _list_next_steps(inspection: ShotInspection) -> Iterator[str]:
    if not any(r.ready for r in inspection.systems.values()):
        return
    if inspection.hr is not None:
        yield _format_line("try", f"rtsr upscale {inspection.root} OUT")
        return
    root = inspection.main.root
    yield _format_line(
        "try", f"rtsr upscale {root} OUT --scale 2          # if these are LR frames"
    )
    yield _format_line("", f"rtsr upscale {root} OUT --simulate-lr 2    # if they are HR captures")
