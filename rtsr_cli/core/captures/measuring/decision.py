"""Settling how a dump is read: option > capture.toml > measured > preset.

What is declared is obeyed, and a measurement that contradicts it is said. A preset gives way to a
clear measurement. A preset that nobody has verified runs only when the measurement is clear, or
when capture.toml names it and declares its motion.
"""

from __future__ import annotations

import math
from dataclasses import replace

from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.layouts import Layout, OpenMotion
from rtsr_cli.core.captures.measuring.camera_decision import decide_camera
from rtsr_cli.core.captures.measuring.depth_size import check_depth_size
from rtsr_cli.core.captures.measuring.geometry_finder import MOTION, POSITION, DepthFinding
from rtsr_cli.core.captures.measuring.jitter_finder import JitterVerdict
from rtsr_cli.core.captures.measuring.measured_reader import (
    MeasuredReader,
    add_warning,
    take_measurement,
)
from rtsr_cli.core.captures.measuring.measurement import measure_storage
from rtsr_cli.core.captures.measuring.motion_choices import (
    describe_distrust,
    describe_repeated,
    describe_undecided,
    describe_unfit,
)
from rtsr_cli.core.captures.measuring.motion_finding import MotionCandidate, MotionFinding
from rtsr_cli.core.captures.measuring.normal_axes import NormalAxes, describe_axes
from rtsr_cli.core.captures.measuring.normal_evidence import NormalEvidence
from rtsr_cli.core.captures.measuring.position_evidence import PositionEvidence
from rtsr_cli.core.captures.measuring.sky_finder import DOUBTFUL, ClearedDepth
from rtsr_cli.core.captures.measuring.trust import is_jitter_trusted, is_motion_trusted
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.errors import FrameFolderError, MissingBufferError, RtsrError
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer
from rtsr_cli.core.frames.camera import GIVE_CAMERAS
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.frames.conventions import (
    SKY_MARKERS,
    DepthKind,
    NormalConvention,
    NormalSpace,
    RoughnessKind,
    SkyRule,
)
from rtsr_cli.core.frames.motion import MotionConvention, MotionDirection

WIDE_MARGIN = 0.02
WIDE_SIGNIFICANCE = 5.0
"""A reading of motion whose error is this share above the best one's, by this many standard errors,
is contradicted."""

WIDE_DEPTH_MARGIN = 0.5
"""A reading of depth is contradicted where another one has less than half its error."""


UNIT_ROUNDING = 1e-3
"""Units whose ratio differs from 1 by no more are one."""

CLEAR = 0.75
"""Among frames that repeat, a reading holds whose error is this share of taking all for still."""


def measure_and_decide(
    reader: FrameReader,
    capture: CaptureDeclaration,
    *,
    named: bool,
    motion: bool = True,
    beside: MeasuredReader | None = None,
) -> MeasuredReader:
    """Measure a few frames and decide; nothing is raised, what is not decided is said.

    Args:
        reader: as surveyed.
        capture: what the user declares.
        named: whether the user named the layout.
        motion: whether vectors are of interest.
        beside: frames of the same shot at another size, which lead.
    """
    wanted = motion and Buffer.MOTION in reader.stored
    motions = () if beside is None else _list_motions(beside)
    measured = measure_storage(reader, reader.conventions, motion=wanted, motions=motions)
    settled = MeasuredReader(
        reader=reader, measured=measured, warnings=reader.warnings, notes=reader.notes
    )
    if not (reader.layout.verified or named or Buffer.MOTION in reader.stored):
        settled = replace(settled, undecided=_describe_undocumented(reader))
    settled = decide_camera(settled, leads=motion)
    for step in (
        _check_plausible,
        _check_repeats,
        _decide_motion,
        _decide_jitter,
        _decide_depth,
        check_depth_size,
        _decide_sky,
        check_position,
        _check_ray_positions,
        _decide_normal,
        _check_normal_axes,
        _check_roughness,
    ):
        if motion or step not in {_decide_motion, _check_repeats}:
            settled = step(settled, capture)
    settled = _add_resting(settled)
    settled = _add_distrust(settled, capture) if motion else settled
    text = settled.motion_undecided
    if text and not (named or capture.buffers or reader.layout.verified):
        # nothing but its vectors could have proved a layout that nobody named
        settled = replace(settled, undecided=text)
    trusted = not text and is_motion_trusted(settled, capture)
    finding = settled.measured.motion
    distrust = (
        ""
        if text or trusted or finding is None
        else describe_distrust(
            settled.reader.conventions.motion, finding, declared=capture.motion.decides()
        )
    )
    reader = replace(
        settled.reader,
        motion_undecided=text,
        undecided=settled.undecided,
        faulty=frozenset(fault.buffer for fault in measured.faults),
        motion_trusted=trusted,
        motion_distrust=distrust,
        jitter_trusted=is_jitter_trusted(settled.measured.jitter),
    )
    return replace(settled, reader=_bind_forward_motion(reader))


def _list_motions(settled: MeasuredReader) -> tuple[MotionConvention, ...]:
    """How vectors are read; nothing where there are none, or that is not decided."""
    reader = settled.reader
    if reader.motion_undecided or not {Buffer.MOTION, Buffer.FORWARD} & reader.stored:
        return ()
    return (reader.conventions.motion,)


def _describe_undocumented(reader: FrameReader) -> str:
    name = reader.layout.name
    return (
        f"these channels look like layout '{name}', which is known from documentation only, and no "
        f"motion vectors are there to check it by; name it to use it (capture.toml: layout = "
        f'"{name}", or --layout {name})'
    )


def require_decision(settled: MeasuredReader, *, sharded: bool) -> FrameReader:
    """Return the reader, or refuse one that nothing decides.

    Raises:
        FrameFolderError: nothing proves the layout, and there is no radiance, which needs no proof;
            or parts of a sharded run might measure differently.
    """
    if settled.undecided and Buffer.COLOR not in settled.reader.stored:
        raise FrameFolderError(f"{settled.reader.frames.root}: {settled.undecided}")
    if sharded and settled.by_measurement:
        raise FrameFolderError(
            f"{settled.reader.frames.root}: {', '.join(settled.by_measurement)} is measured, not "
            "declared, and --shard needs it declared so that all parts agree; run "
            "'rtsr inspect --write' once"
        )
    unread = (NOT_READ,) if settled.motion_undecided else ()
    if settled.undecided:
        unread = (ONLY_RADIANCE.format(settled.reader.layout.name),)
    warnings = (*settled.warnings, *describe_unmet(settled.reader))
    return replace(settled.reader, warnings=warnings, notes=(*settled.notes, *unread))


def describe_unmet(reader: FrameReader) -> list[str]:
    """Say which buffers are not read for want of a camera: what needs them is refused."""
    return [unmet.describe(buffer) for buffer, unmet in reader.unmet.items()]


NOT_READ = (
    "motion is not read: nothing decides how it is stored ('rtsr inspect' shows what is known)"
)
"""Said by commands that can do without; those that cannot are refused."""


ONLY_RADIANCE = (
    "nothing but radiance is read: layout '{0}' is known from documentation only; name it to use "
    'the rest (capture.toml: layout = "{0}", or --layout {0})'
)
"""Said by commands that can do with radiance alone."""


def _is_contradicted(candidate: MotionCandidate | None) -> bool:
    return (
        candidate is not None
        and candidate.margin >= WIDE_MARGIN
        and candidate.significance >= WIDE_SIGNIFICANCE
    )


UNFIT = 1.5
"""Vectors whose best reading is this much worse than no motion at all are not the frames'."""


def _check_plausible(settled: MeasuredReader, capture: CaptureDeclaration) -> MeasuredReader:
    """Warn of buffers that hold nothing of the frames, and of vectors that fit no frame at all.

    What reads such vectors is refused, unless it is declared how they are to be read.
    """
    for fault in settled.measured.faults:
        settled = add_warning(settled, fault.text)
    if settled.measured.motion is None or not _fits_nothing(settled):
        return settled
    settled = add_warning(
        settled,
        "the motion vectors say that things move, the frames do not follow them: the same "
        "frame several times, or vectors of another sequence?",
    )
    if capture.motion.decides():
        return settled
    return replace(settled, motion_undecided=describe_unfit(settled.reader))


def _fits_nothing(settled: MeasuredReader) -> bool:
    """Tell whether vectors are far worse than none, or as good as those of unrelated frames."""
    finding = settled.measured.motion
    if finding is None or not finding.candidates or settled.measured.by_geometry is not None:
        return False
    best, presumed = finding.candidates[0], finding.of(settled.reader.conventions.motion)
    nowhere = best.leads_nowhere and (presumed is None or presumed.leads_nowhere)
    return nowhere or best.error > UNFIT * finding.unmoved_error + WIDE_MARGIN


def _decide_motion(settled: MeasuredReader, capture: CaptureDeclaration) -> MeasuredReader:
    reader, measured = settled.reader, settled.measured
    if Buffer.MOTION not in reader.stored or settled.motion_undecided:
        return settled
    presumed = reader.conventions.motion
    best = measured.best
    against = measured.motion.of(presumed) if measured.motion is not None else None
    if best is None and measured.motion is not None:
        best = _tell_open_motion(reader.layout, _is_plain(presumed), measured.motion)
    agreed = best is not None and best.convention == _is_plain(presumed)
    declared = capture.motion.declared()
    clear = _is_contradicted(against) or measured.by_geometry is not None
    if best is None and _is_contradicted(against):
        return _describe_better_fits(settled, capture)
    if best is not None and not agreed and (clear or _is_unproven(settled, capture)):
        # what is declared stays; what is not is taken from the measurement
        chosen = replace(best.convention, **declared)
        if _is_plain(chosen) != best.convention:
            lower = against.margin if against is not None else 1.0
            proof = (
                f"as {measured.geometry} tell"
                if measured.by_geometry
                else f"error {lower:.0%} lower"
            )
            text = (
                f"motion is declared as {presumed}, but the frames fit {best.convention} better "
                f"({proof}); the declaration is obeyed. Correct it, or check with 'rtsr inspect'"
            )
            return add_warning(settled, text)
        source = "capture.toml and the layout have" if declared else "the layout has"
        note = f"motion measured: {chosen} ({source} it as {presumed})"
        return take_measurement(settled, "motion", note, motion=chosen)
    if agreed or not _is_unproven(settled, capture):
        doubt = "" if agreed else _describe_doubt(against, best, capture)
        return add_warning(settled, doubt) if doubt else settled
    return replace(settled, motion_undecided=describe_undecided(reader, measured.motion))


def _tell_open_motion(
    layout: Layout, presumed: MotionConvention, finding: MotionFinding
) -> MotionCandidate | None:
    """Of readings that tie, the one that the layout leaves; None where it leaves several or none.

    Where size is open, what fits is the layout's reading: its sense never was. Where sense is open,
    no vectors lead to the next frame.
    """
    senses = {
        OpenMotion.NOTHING: (),
        OpenMotion.SIZE: (presumed.direction,),
        OpenMotion.SENSE: (
            MotionDirection.CURRENT_MINUS_PREVIOUS,
            MotionDirection.PREVIOUS_MINUS_CURRENT,
        ),
    }
    left = [replace(presumed, direction=sense) for sense in senses[layout.open_motion]]
    fitting = [c for c in finding.ties if c.convention in left]
    return fitting[0] if len(fitting) == 1 else None


def _check_repeats(settled: MeasuredReader, capture: CaptureDeclaration) -> MeasuredReader:
    """Say that frames are there several times, though their vectors say that things move."""
    reader, measured = settled.reader, settled.measured
    if not measured.repeated:
        return settled
    settled = add_warning(
        settled,
        f"{_say_repeated(measured.repeated)}, though the motion vectors there say that things "
        "move: were files copied, or are pictures held for several frames? Render motion of zero "
        "there, or leave such frames out",
    )
    finding = measured.motion
    best = None if finding is None else finding.best
    clear = finding and best and best.error < CLEAR * finding.unmoved_error
    if clear or capture.motion.decides():
        return settled
    return replace(settled, motion_undecided=describe_repeated(reader))


def _say_repeated(numbers: tuple[int, ...]) -> str:
    one = len(numbers) == 1
    return (
        f"{say_frames(numbers)} show{'s' if one else ''} the picture of the frame before "
        f"{'it' if one else 'them'}"
    )


def _add_resting(settled: MeasuredReader) -> MeasuredReader:
    """Where motion stays undecided, say that frames repeat, which hinders the measurement."""
    measured = settled.measured
    moves = measured.motion is not None and measured.motion.moving > 0.0
    if not (settled.motion_undecided and measured.resting and moves):
        return settled
    return add_warning(
        settled,
        f"{_say_repeated(measured.resting)} (were files copied, or are pictures held for "
        "several frames?), so that little of the motion can be measured",
    )


def _add_distrust(settled: MeasuredReader, capture: CaptureDeclaration) -> MeasuredReader:
    """Say why vectors that are declared are not relied upon where no system is named."""
    finding = settled.measured.motion
    unsaid = (
        finding is not None
        and finding.moving > 0.0
        and not _is_contradicted(finding.of(_is_plain(settled.reader.conventions.motion)))
    )
    declared = capture.motion.decides() and Buffer.MOTION in settled.reader.stored
    if not declared or not unsaid or is_motion_trusted(settled, capture):
        return settled
    note = (
        "motion is read as declared, but these frames do not show that it is right: no system is "
        "the default for its sake (name one: --system)"
    )
    return replace(settled, notes=(*settled.notes, note))


def _describe_doubt(
    presumed: MotionCandidate | None, best: MotionCandidate | None, capture: CaptureDeclaration
) -> str:
    """Say that a preset fits worse than another reading, though not so clearly as to give way."""
    if capture.motion.decides() or presumed is None or best is None or presumed.tied:
        return ""
    if presumed.margin < WIDE_MARGIN:
        return ""
    return (
        f"motion is read as {presumed.convention}, but the frames fit {best.convention} better "
        f"(error {presumed.margin:.0%} lower, {presumed.significance:.1f} standard errors, which "
        "is not enough to decide it); declare [motion] in capture.toml"
    )


def _describe_better_fits(settled: MeasuredReader, capture: CaptureDeclaration) -> MeasuredReader:
    """Several readings tie, and what is presumed is far behind all of them."""
    finding = settled.measured.motion
    if not capture.motion.decides():
        return replace(settled, motion_undecided=describe_undecided(settled.reader, finding))
    if finding is None or not finding.ties:
        # no reading fits better than none: that speaks against no declaration
        return settled
    others = "; or ".join(str(c.convention) for c in finding.ties)
    text = (
        f"motion is declared as {settled.reader.conventions.motion}, but the frames fit others "
        f"better: {others}; the declaration is obeyed. Correct it, or check with 'rtsr inspect'"
    )
    return add_warning(settled, text)


def _is_plain(convention: MotionConvention) -> MotionConvention:
    return replace(convention, jittered=False, jitter_inverted=False)


def _is_unproven(settled: MeasuredReader, capture: CaptureDeclaration) -> bool:
    """Tell whether nothing but an unverified preset, or nothing at all, speaks for the vectors."""
    layout = settled.reader.layout
    left_open = layout.open_motion is not OpenMotion.NOTHING
    return (left_open or not layout.verified) and not capture.motion.decides()


def _decide_jitter(settled: MeasuredReader, capture: CaptureDeclaration) -> MeasuredReader:
    finding = settled.measured.jitter
    if finding is None or settled.measured.repeated or Buffer.MOTION not in settled.reader.stored:
        return settled
    convention = settled.reader.conventions.motion
    if finding.verdict in {_verdict_of_declaration(convention), JitterVerdict.UNKNOWN}:
        return settled
    inverted = finding.verdict is JitterVerdict.IN_VECTORS_INVERTED
    if capture.motion.jittered is None and (
        inverted or finding.verdict is JitterVerdict.IN_VECTORS
    ):
        changed = replace(convention, jittered=True, jitter_inverted=inverted)
        note = f"jitter measured: {finding.verdict}; it is taken out"
        return take_measurement(settled, "jitter", note, motion=changed)
    text = _JITTER_WARNINGS.get(finding.verdict, "")
    cameras = (settled.reader.cameras[n] for n in settled.measured.frames)
    if finding.verdict is JitterVerdict.UNDECLARED:
        if any(any(c.jitter_px) for c in cameras):
            text = OTHER_JITTER
        elif capture.jitter_px is not None:
            text = DENIED_JITTER
    return add_warning(settled, text.format(finding.spread_px)) if text else settled


OTHER_JITTER = (
    "the frames jitter by up to {:.2f} px beside the offset that jitter_px declares for all of "
    "them; declare jitter_px by frame"
)

DENIED_JITTER = (
    "the pictures lie by up to {:.2f} px beside where vectors lead, and jitter_px declares none, "
    "which is obeyed: of small frames, or of fine textures, pictures alone show as much; if the "
    "renderer does jitter, declare jitter_px by frame"
)

_JITTER_WARNINGS = {
    JitterVerdict.UNDECLARED: "motion or frames contain a jitter of up to {:.2f} px that is not "
    "declared; declare jitter_px (and [motion] jittered) in capture.toml",
    JitterVerdict.WRONG_SIGN: "jitter_px has the wrong sign: the frames lie the other way by up "
    "to {:.2f} px; negate it",
    JitterVerdict.IN_VECTORS: "the vectors contain the jitter (up to {:.2f} px), which [motion] "
    "jittered denies; the declaration is obeyed",
    JitterVerdict.IN_VECTORS_INVERTED: "the vectors contain the jitter inverted (up to {:.2f} px), "
    "against [motion] jittered; the declaration is obeyed",
    JitterVerdict.CONSISTENT: "the vectors contain no jitter, though [motion] jittered says so; "
    "the declaration is obeyed",
}
"""What is said where jitter is not as declared; a constant offset may have many reasons."""


def _verdict_of_declaration(convention: MotionConvention) -> JitterVerdict:
    if not convention.jittered:
        return JitterVerdict.CONSISTENT
    inverted = convention.jitter_inverted
    return JitterVerdict.IN_VECTORS_INVERTED if inverted else JitterVerdict.IN_VECTORS


def _decide_depth(settled: MeasuredReader, capture: CaptureDeclaration) -> MeasuredReader:
    finding = settled.measured.depth
    presumed = settled.reader.conventions.depth
    against = finding.of(presumed)
    best = finding.best
    poor = _describe_poor_fit(finding)
    if poor:
        settled = replace(settled, notes=(*settled.notes, poor))
    if best is None or against is None or best.convention == against.convention:
        return settled
    if best.error > (1.0 - WIDE_DEPTH_MARGIN) * against.error:
        return settled
    measured = best.convention
    reversed_ = " reversed" if measured.reversed else ""
    start = f" from the near plane ({measured.near_m:g} m)" if measured.from_near else ""
    text = f"{measured.kind}{reversed_}{start}, {measured.unit_m:g} m a unit"
    given = capture.depth.declared()
    if {"kind", "unit", "reversed", "start"} & set(given):
        return add_warning(
            settled,
            f"depth is declared as {presumed.kind}, {presumed.unit_m:g} m a unit, but the camera "
            f"fits {text} ({best.error:.3g} against {against.error:.3g} {finding.measure}); "
            "the declaration is obeyed",
        )
    chosen = replace(measured, sky=given.get("sky"))
    note = (
        f"depth measured: {text} (points fit to {best.error:.2g} {finding.measure}; not as "
        f"presumed: {presumed.kind}, {presumed.unit_m:g} m a unit, to {against.error:.2g})"
    )
    return take_measurement(settled, "depth", note, depth=chosen)


def _decide_sky(settled: MeasuredReader, capture: CaptureDeclaration) -> MeasuredReader:
    """Take the measured rule of the sky for all frames, and say what no rule explains."""
    finding, presumed = settled.measured.sky, settled.reader.conventions
    settled = _check_sky_marker(settled)
    if finding is None or capture.depth.sky is not None or presumed.normal.sky is not None:
        return settled
    if finding.impossible >= DOUBTFUL:
        settled = add_warning(
            settled,
            f"{finding.impossible:.1%} of the depth values are 0, negative or no number, which no "
            "surface has, and do not look like sky; if they are, declare it (capture.toml: "
            '[depth] sky = 0.0, or "nan", "normal", "object_id", "alpha"; else sky = "none")',
        )
    if finding.strewn >= DOUBTFUL:
        settled = add_warning(
            settled,
            f"{finding.strewn:.1%} of the depth values are the sky's (0, negative or no number), "
            "but scattered over surfaces, and read as sky: render depth again, or declare what "
            'else marks the sky (capture.toml: [depth] sky = "normal", "object_id", "alpha")',
        )
    if finding.lost >= DOUBTFUL:
        settled = add_warning(
            settled,
            f"{finding.lost:.1%} of the depth values are -inf, which no surface has, on pixels "
            "that are not like the sky's (scattered, or with normals that vary), and read as sky: "
            "render depth again",
        )
    if finding.sky is None and finding.unmarked is not None:
        share, value = finding.unmarked
        settled = add_warning(
            settled,
            f"{share:.1%} of the pixels share the largest depth, {value:g}, far beyond all others: "
            f"if that is the sky, declare it (capture.toml: [depth] sky = {value:g}); it is read "
            'as surfaces (sky = "far" says that it is some)',
        )
    if finding.cleared is not None:
        settled = add_warning(settled, _describe_cleared(finding.cleared))
    if finding.sky is None or presumed.depth.kind is DepthKind.DEVICE:
        return settled
    depth = replace(presumed.depth, sky=finding.sky)
    rule = finding.rule.removesuffix(", measured")
    note = f"sky measured: {rule} ({finding.share:.1%} of the pixels)"
    return take_measurement(settled, "sky", note, depth=depth)


def _describe_cleared(cleared: ClearedDepth) -> str:
    """Say what looks like a sky among the surfaces' depths, and which line declares it."""
    if cleared.normal is not None:
        vector = ", ".join(f"{part:.4g}" for part in cleared.normal)
        line = f"[normal] sky = [{vector}]"
    else:
        line = f"[depth] sky = {cleared.value:g}"
        if cleared.beyond:
            line += (
                f", which takes the {cleared.beyond:.1%} of the pixels that lie farther for sky, "
                "too: better let the renderer write sky as 0, or farther than every surface"
            )
    return (
        f"{cleared.share:.1%} of the pixels have exactly one depth, {cleared.value:g}, and no "
        "material, as a sky has, while surfaces lie before and behind: they are read as "
        f"surfaces; if that is the sky, declare it (capture.toml: {line})"
    )


POOR_FIT = {MOTION: 0.02, POSITION: 0.005}
"""Errors of depth from which the best reading fits poorly, if the next one is hardly worse."""


def _describe_poor_fit(finding: DepthFinding) -> str:
    """Say that no reading of depth fits as a right one does; empty if one does."""
    best = finding.best
    clear = finding.margin >= WIDE_DEPTH_MARGIN
    few = len(finding.candidates) < 2
    if best is None or few or clear or best.error <= POOR_FIT.get(finding.measure, math.inf):
        return ""
    return (
        f"no reading of depth fits the camera well: the best one, {best.convention.kind}, "
        f"{best.convention.unit_m:g} m a unit, is off by {best.error:.2g} {finding.measure}, the "
        f"next one by {finding.candidates[1].error:.2g}; are the matrices' near plane, or the unit "
        "and start of ray distances, the renderer's ([depth] kind, unit, from, near)?"
    )


def _check_sky_marker(settled: MeasuredReader) -> MeasuredReader:
    """Say that what is declared to mark the sky is not there."""
    reader, finding = settled.reader, settled.measured.sky
    rule = reader.conventions.depth.sky
    marker = SKY_MARKERS.get(rule) if isinstance(rule, SkyRule) else None
    if marker is None or marker in reader.stored:
        return settled
    impossible = "" if finding is None else f"; {finding.impossible:.1%} of the depth values are "
    impossible += "0, negative or no number, and count as surfaces" if impossible else ""
    return add_warning(
        settled,
        f'[depth] sky = "{rule}" is declared, but there is no {marker}: only depth of '
        f"{SKY_DEPTH_M:g} or more is sky{impossible}; name its channel under [buffers], or leave "
        "the line out and what is sky is measured",
    )


def check_position(settled: MeasuredReader, capture: CaptureDeclaration) -> MeasuredReader:
    """Positions only stand in for missing cameras, so that a contradiction is no more than said."""
    unit = settled.measured.position_unit_m
    conventions = settled.reader.conventions
    if unit is None or math.isclose(unit, conventions.metres_per_position, rel_tol=UNIT_ROUNDING):
        return settled
    if capture.position.unit is not None:
        return add_warning(
            settled,
            f"position is declared as {capture.position.unit:g} m a unit, but the camera fits "
            f"{unit:g}; the declaration is obeyed",
        )
    note = f"position measured: {unit:g} m a unit"
    return take_measurement(settled, "position", note, position_unit_m=unit)


def _check_ray_positions(settled: MeasuredReader, capture: CaptureDeclaration) -> MeasuredReader:
    """Leave ray distances unread that world positions should make planar, and do in no frame."""
    del capture
    reader, numbers = settled.reader, settled.measured.frames
    if not reader.has_rays_by_positions or not numbers:
        return settled
    for number in numbers:
        try:
            reader.read(number, (Buffer.DEPTH,))
        except MissingBufferError:
            continue
        except RtsrError:
            pass
        return settled
    text = (
        f"depth is not read: it is ray distance, no frame has camera matrices ({GIVE_CAMERAS}), "
        f"and the world positions of {say_frames(numbers)}, which could tell the camera, do not "
        "lie at these distances from any point: are both in the units that are declared ([depth] "
        "unit, [position] unit), and is depth measured along the ray?"
    )
    return _leave_unread(settled, Buffer.DEPTH, text)


def _decide_normal(settled: MeasuredReader, capture: CaptureDeclaration) -> MeasuredReader:
    finding = settled.measured.normal
    presumed = settled.reader.conventions.normal
    if finding is None or finding.packed is None:
        return settled
    axes = next((a for a in settled.measured.normal_axes if a.buffer is Buffer.NORMAL), None)
    space = finding.space
    if axes is not None:
        # what stands on surfaces tells more than what faces the camera
        other = axes.find_other(presumed.space)
        space = other if isinstance(other, NormalSpace) else presumed.space
    measured = NormalConvention(
        space=space or presumed.space, packed=finding.packed, sky=presumed.sky
    )
    if measured == presumed:
        return settled
    text = f"{measured.space} space{', packed' if measured.packed else ''}"
    given = capture.normal.declared()
    against = {key for key, value in vars(measured).items() if given.get(key, value) != value}
    if axes is not None and against <= {"space"} and axes.is_nearly(measured.space):
        settled = add_warning(settled, _describe_nearly(settled, axes, measured.space))
        return take_measurement(settled, "normal", f"normals measured: {text}", normal=measured)
    if against == {"space"} and axes is not None:
        # one line declares both sizes, so that none could say what one of them holds
        settled = add_warning(
            settled,
            f"normals are declared as {presumed.space} space, but by depth and cameras they are of "
            f"{measured.space} space: they are read so; declare [normal] space = "
            f'"{measured.space}" if both sizes are so, or write them alike',
        )
        return take_measurement(settled, "normal", f"normals measured: {text}", normal=measured)
    if against:
        return _leave_unread(
            settled,
            Buffer.NORMAL,
            f"normals are declared as {presumed.space} space"
            f"{', packed' if presumed.packed else ''}, but they look like {text}: they are not "
            f'read; declare [normal] space = "{measured.space}" and packed = '
            f"{str(measured.packed).lower()} where that is so at both sizes, or write them alike",
        )
    return take_measurement(settled, "normal", f"normals measured: {text}", normal=measured)


def _describe_nearly(settled: MeasuredReader, axes: NormalAxes, space: NormalSpace) -> str:
    """Say of normals in other axes than the matrices' world that a space is what comes near it."""
    told = "mirrored" if axes.is_mirrored else "turned"
    return (
        f"normals and camera matrices contradict each other: on the surfaces that depth shows "
        f"normals stand as those of a world {told} beside the matrices' (its axes are "
        f"{describe_axes(axes.axes)}). They are read as {space} space, which is "
        f"{axes.lean[space]:.0f} degrees from that: {_list_remedies(settled, axes)}"
    )


def _list_remedies(settled: MeasuredReader, axes: NormalAxes) -> str:
    """What to do about normals that are in other axes than the matrices' world."""
    remedy = "write them in the world that the camera matrices are of"
    if axes.lines:
        line = f"{axes.buffer} = [{', '.join(axes.lines)}]"
        remedy += f", or, if both sizes are so, declare [buffers] {line}"
    camera = settled.measured.camera
    open_ = camera is None or PositionEvidence.name not in camera.proofs
    if axes.is_mirrored and open_:
        remedy += (
            "; or, if it is the matrices that are of a mirrored world, write those of the world "
            "that normals are in (without world positions it cannot be told which of both is wrong)"
        )
    return remedy


def _check_normal_axes(settled: MeasuredReader, capture: CaptureDeclaration) -> MeasuredReader:
    """Leave normals unread that stand on their surfaces in other axes alone."""
    del capture
    space = settled.reader.conventions.normal.space
    for axes in settled.measured.normal_axes:
        other = axes.find_other(space)
        if other is None or axes.buffer in settled.reader.contradicted:
            continue
        if isinstance(other, NormalSpace):
            where, best = f"{other} space", axes.apart[other]
            remedy = f"write them in {space} space"
            # what is declared holds for all normals: others that are right would be wrong then
            if not _stands_right(settled, axes.buffer, space):
                remedy += f', or declare [normal] space = "{other}"'
        else:
            where, best = "a world of other axes (swapped or negated)", axes.turned
            remedy = _list_remedies(settled, axes)
        own = axes.apart[space]
        seen = (
            f"does not stand on {own:.0f}% of the surfaces that depth shows, and in {where} not on "
            f"{best:.0f}%"
        )
        if isinstance(other, NormalSpace) and own < best + NormalEvidence.slack:
            seen = (
                f"leans {axes.lean[space]:.1f} degrees from the surfaces that depth shows, and in "
                f"{where} {axes.lean[other]:.1f}"
            )
        text = f"{axes.buffer} as {space} space {seen}: it is not read; {remedy}"
        settled = _leave_unread(settled, axes.buffer, text)
    return settled


def _stands_right(settled: MeasuredReader, buffer: Buffer, space: NormalSpace) -> bool:
    """Tell whether normals in another buffer stand on their surfaces as they are read."""
    return any(
        axes.buffer is not buffer
        and axes.apart[space] <= NormalEvidence.limit
        and axes.find_other(space) is None
        for axes in settled.measured.normal_axes
    )


def _leave_unread(settled: MeasuredReader, buffer: Buffer, text: str) -> MeasuredReader:
    """Warn of a buffer that is contradicted, and read it no more: what needs it is refused."""
    contradicted = {**settled.reader.contradicted, buffer: text}
    settled = replace(settled, reader=replace(settled.reader, contradicted=contradicted))
    return add_warning(settled, text)


def _check_roughness(settled: MeasuredReader, capture: CaptureDeclaration) -> MeasuredReader:
    """Say that roughness is turned over twice: by its expression, and by its kind."""
    del capture
    reader = settled.reader
    bound = reader.binding.get(Buffer.ROUGHNESS)
    turned = reader.conventions.roughness is RoughnessKind.SMOOTHNESS
    if bound is None or not bound.is_inverted or not turned:
        return settled
    return add_warning(
        settled,
        f"roughness is inverted twice: it is made as {bound.describe(streams=False)}, and read as "
        'smoothness; declare one of both: [buffers] roughness, or roughness = "smoothness" (then '
        "[buffers] names the channel alone)",
    )


def _bind_forward_motion(reader: FrameReader) -> FrameReader:
    """Bind vectors about the next frame as `forward`; those about the previous one are missing."""
    if Buffer.MOTION not in reader.binding or not reader.conventions.motion.direction.to_next:
        return reader
    binding = dict(reader.binding)
    binding[Buffer.FORWARD] = binding.pop(Buffer.MOTION)
    return replace(reader, binding=binding)
