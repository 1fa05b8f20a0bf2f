"""Precedence of option, capture.toml, measurement and preset, on made-up measurements."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rtsr_cli.core.captures.bound_channels import BoundBuffer, BoundChannel, BoundSum
from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.layouts import OpenMotion
from rtsr_cli.core.captures.measuring import decision
from rtsr_cli.core.captures.measuring.decision import measure_and_decide, require_decision
from rtsr_cli.core.captures.measuring.geometry_finder import DepthCandidate, DepthFinding
from rtsr_cli.core.captures.measuring.jitter_finder import JitterFinding, JitterVerdict
from rtsr_cli.core.captures.measuring.measured_reader import MeasuredReader
from rtsr_cli.core.captures.measuring.measured_storage import StorageMeasurement
from rtsr_cli.core.captures.measuring.motion_finding import MotionCandidate, MotionFinding
from rtsr_cli.core.captures.measuring.normal_axes import NormalAxes
from rtsr_cli.core.captures.measuring.normal_finder import NormalFinding
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.shots import collect_frame_set
from rtsr_cli.core.captures.survey import open_frames
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import (
    DepthConvention,
    DepthKind,
    NormalSpace,
    RoughnessKind,
    SkyRule,
)
from rtsr_cli.core.frames.motion import MotionConvention, MotionDirection, MotionUnit, YAxis

C = MotionDirection.CURRENT_MINUS_PREVIOUS
P = MotionDirection.PREVIOUS_MINUS_CURRENT
NEGATED = MotionConvention(direction=C)
Settle = Callable[..., MeasuredReader]


def reader_of(folder: Path, declared: CaptureDeclaration | None = None) -> FrameReader:
    names = ("R", "G", "B", "motion.X", "motion.Y", "depth.Z", "normal.X", "normal.Y", "normal.Z")
    for number in (1, 2, 3):
        planes = {name: np.full((4, 6), number, np.float32) for name in names}
        write_exr(folder / f"f.{number:04d}.exr", planes)
    frames = collect_frame_set(folder)
    assert frames is not None
    return open_frames(frames, layout=None, capture=declared or CaptureDeclaration(), side_car={})


def candidate(convention: MotionConvention, error: float, best: float, t: float) -> MotionCandidate:
    return MotionCandidate(
        convention=convention,
        error=error,
        margin=1.0 - best / error,
        significance=t,
        offsets_px=((0.0, 0.0),),
    )


def clear(best: MotionConvention, *others: MotionConvention) -> MotionFinding:
    """A finding in which one reading stands far before the others."""
    ranked = [candidate(best, 0.1, 0.1, 0.0)]
    ranked += [candidate(c, 0.3, 0.1, 20.0) for c in others]
    return MotionFinding(candidates=tuple(ranked), unmoved_error=0.4, moving=1.0, triples=(1,))


def tied(*conventions: MotionConvention) -> MotionFinding:
    ranked = [candidate(c, 0.1 + 0.0001 * i, 0.1, 0.5 * i) for i, c in enumerate(conventions)]
    return MotionFinding(candidates=tuple(ranked), unmoved_error=0.4, moving=1.0, triples=(1,))


@pytest.fixture
def settled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Settle:
    """Settle a small dump whose measurement is given."""

    def run(
        measured: StorageMeasurement,
        capture: CaptureDeclaration | None = None,
        **layout: Any,
    ) -> MeasuredReader:
        reader = reader_of(tmp_path, capture)
        reader = replace(reader, layout=replace(reader.layout, **layout))
        monkeypatch.setattr(decision, "measure_storage", lambda *_, **__: measured)
        return measure_and_decide(reader, capture or CaptureDeclaration(), named=False)

    return run


def capture(**tables: object) -> CaptureDeclaration:
    return CaptureDeclaration.model_validate(tables)


def test_a_preset_that_agrees_is_kept_without_a_word(settled: Settle) -> None:
    result = settled(StorageMeasurement(motion=clear(MotionConvention(), NEGATED)))
    assert result.reader.conventions.motion == MotionConvention()
    assert (result.warnings, result.notes, result.by_measurement) == ((), (), ())


def test_a_clear_measurement_overrules_the_preset_and_is_said(settled: Settle) -> None:
    result = settled(StorageMeasurement(motion=clear(NEGATED, MotionConvention())))
    assert result.reader.conventions.motion == NEGATED
    assert result.by_measurement == ("motion",)
    assert "current-minus-previous" in result.notes[0]


def test_a_narrow_lead_does_not_overrule_the_preset(settled: Settle) -> None:
    finding = MotionFinding(
        candidates=(
            candidate(NEGATED, 0.1, 0.1, 0.0),
            candidate(MotionConvention(), 0.1015, 0.1, 4.0),
        ),
        unmoved_error=0.4,
        moving=1.0,
        triples=(1,),
    )
    assert (
        settled(StorageMeasurement(motion=finding)).reader.conventions.motion == MotionConvention()
    )


def test_a_declaration_is_obeyed_and_the_contradiction_said_once(settled: Settle) -> None:
    declared = capture(motion={"direction": C, "unit": "pixels", "y_axis": "down"})
    result = settled(StorageMeasurement(motion=clear(MotionConvention(), NEGATED)), declared)
    assert result.reader.conventions.motion == NEGATED
    assert len(result.warnings) == 1
    assert "67% lower" in result.warnings[0]
    assert result.by_measurement == ()


def test_what_is_not_declared_is_taken_from_the_measurement(settled: Settle) -> None:
    uv = MotionConvention(unit=MotionUnit.UV, direction=C, y_axis=YAxis.UP)
    presumed = MotionConvention(y_axis=YAxis.UP)
    result = settled(
        StorageMeasurement(motion=clear(uv, presumed)), capture(motion={"y_axis": "up"})
    )
    assert result.reader.conventions.motion == uv
    assert result.warnings == ()


def test_ties_leave_a_verified_preset_alone(settled: Settle) -> None:
    result = settled(StorageMeasurement(motion=tied(NEGATED, MotionConvention())))
    assert result.reader.conventions.motion == MotionConvention()
    assert result.undecided == ""


def ahead(*conventions: MotionConvention) -> MotionFinding:
    """A tie far before the preset."""
    finding = tied(*conventions)
    return replace(
        finding, candidates=(*finding.candidates, candidate(MotionConvention(), 0.3, 0.1, 15.0))
    )


def test_a_tie_far_before_a_verified_preset_is_refused_and_not_read_as_the_preset(
    settled: Settle,
) -> None:
    uv = MotionConvention(unit=MotionUnit.UV, direction=C)
    result = settled(StorageMeasurement(motion=ahead(NEGATED, uv)))
    assert "can be read in ways that fit equally well" in result.motion_undecided
    assert 'unit = "uv"' in result.motion_undecided


def test_a_tie_far_before_a_declaration_is_warned_about(settled: Settle) -> None:
    declared = capture(motion={"direction": P, "unit": "pixels", "y_axis": "down"})
    uv = MotionConvention(unit=MotionUnit.UV, direction=C)
    result = settled(StorageMeasurement(motion=ahead(NEGATED, uv)), declared)
    assert result.reader.conventions.motion == MotionConvention()
    assert "the frames fit others better" in result.warnings[0]
    assert result.motion_undecided == ""


def test_readings_that_all_fit_worse_than_none_speak_against_no_declaration(
    settled: Settle,
) -> None:
    declared = capture(motion={"direction": P, "unit": "pixels", "y_axis": "down"})
    finding = replace(ahead(NEGATED), unmoved_error=0.05)
    assert finding.ties == ()
    result = settled(StorageMeasurement(motion=finding), declared)
    assert result.reader.conventions.motion == MotionConvention()
    assert not any("fit others" in text for text in result.warnings)


def test_a_preset_that_fits_worse_but_not_by_far_is_kept_and_doubted(settled: Settle) -> None:
    behind = candidate(MotionConvention(), 0.112, 0.1, 4.6)
    finding = replace(clear(NEGATED), candidates=(*clear(NEGATED).candidates, behind))
    result = settled(StorageMeasurement(motion=finding))
    assert result.reader.conventions.motion == MotionConvention()
    assert "11% lower, 4.6 standard errors" in result.warnings[0]
    declared = capture(motion={"direction": P, "unit": "pixels", "y_axis": "down"})
    assert settled(StorageMeasurement(motion=finding), declared).warnings == ()


def test_ties_that_nothing_declares_leave_radiance_and_name_the_choices(settled: Settle) -> None:
    result = settled(StorageMeasurement(motion=tied(NEGATED, MotionConvention())), verified=False)
    run = require_decision(result, sharded=False)
    assert run.readable == {Buffer.COLOR}
    assert re.search(r"(?s)current-minus-previous.*previous-minus-current", run.undecided)


def test_without_radiance_what_nothing_proves_is_refused_with_the_choices(settled: Settle) -> None:
    result = settled(StorageMeasurement(motion=tied(NEGATED, MotionConvention())), verified=False)
    binding = {b: c for b, c in result.reader.binding.items() if b is not Buffer.COLOR}
    bare = replace(result, reader=replace(result.reader, binding=binding))
    with pytest.raises(
        FrameFolderError, match=r"(?s)current-minus-previous.*previous-minus-current"
    ):
        require_decision(bare, sharded=False)


def test_vectors_that_a_layout_leaves_open_stop_nothing_else(settled: Settle) -> None:
    other = MotionConvention(unit=MotionUnit.UV)
    result = settled(StorageMeasurement(motion=tied(NEGATED, other)), open_motion=OpenMotion.SIZE)
    run = require_decision(result, sharded=False)
    assert run.stored - run.readable == {Buffer.MOTION}
    assert "current-minus-previous" in run.motion_undecided


def test_vectors_that_a_layout_leaves_open_are_read_where_they_fit(settled: Settle) -> None:
    size = OpenMotion.SIZE
    told = settled(StorageMeasurement(motion=clear(NEGATED)), open_motion=size).reader
    assert told.conventions.motion == NEGATED
    presumed = MotionConvention()
    fits = settled(StorageMeasurement(motion=tied(NEGATED, presumed)), open_motion=size).reader
    assert fits.conventions.motion == presumed
    assert told.readable == fits.readable == fits.stored


@pytest.mark.parametrize("finding", [None, tied(NEGATED, MotionConvention())])
def test_vectors_whose_direction_sources_disagree_about_are_never_presumed(
    settled: Settle, finding: MotionFinding | None
) -> None:
    measured = StorageMeasurement(motion=finding)
    result = settled(measured, open_motion=OpenMotion.SENSE)
    assert result.reader.stored - result.reader.readable == {Buffer.MOTION}
    assert "declare" in result.motion_undecided
    declared = capture(motion={"direction": C, "unit": "pixels", "y_axis": "down"})
    told = settled(measured, declared, open_motion=OpenMotion.SENSE).reader
    assert told.conventions.motion == NEGATED
    assert told.readable == told.stored


@pytest.mark.parametrize("right", [NEGATED, MotionConvention()])
def test_of_two_directions_that_sources_name_the_one_that_fits_is_read(
    settled: Settle, right: MotionConvention
) -> None:
    # a camera that goes on evenly: vectors to the next frame fit as well
    ahead = replace(right, direction=MotionDirection.NEXT_MINUS_CURRENT)
    result = settled(StorageMeasurement(motion=tied(ahead, right)), open_motion=OpenMotion.SENSE)
    assert result.reader.conventions.motion == right
    assert result.reader.readable == result.reader.stored


def test_a_declaration_settles_a_tie(settled: Settle) -> None:
    declared = capture(motion={"direction": C, "unit": "pixels", "y_axis": "down"})
    result = settled(
        StorageMeasurement(motion=tied(MotionConvention(), NEGATED)), declared, verified=False
    )
    assert require_decision(result, sharded=True).conventions.motion == NEGATED


def test_an_unverified_preset_runs_on_a_clear_measurement(settled: Settle) -> None:
    result = settled(StorageMeasurement(motion=clear(NEGATED)), verified=False)
    assert require_decision(result, sharded=False).conventions.motion == NEGATED


def test_jitter_is_called_undeclared_only_where_no_frame_declares_any(settled: Settle) -> None:
    finding = JitterFinding(verdict=JitterVerdict.UNDECLARED, spread_px=0.5)
    measured = StorageMeasurement(
        motion=clear(MotionConvention()), jitter=finding, frames=(1, 2, 3)
    )
    (free,) = settled(measured).warnings
    assert "that is not declared" in free
    (bound,) = settled(measured, capture(jitter_px=[0.125, 0.125])).warnings
    assert "beside the offset that jitter_px declares" in bound
    assert "not declared" not in bound
    (denied,) = settled(measured, capture(jitter_px=[0.0, 0.0])).warnings
    assert "jitter_px declares none, which is obeyed" in denied


def test_vectors_that_cannot_be_measured_prove_no_unverified_preset(settled: Settle) -> None:
    run = require_decision(settled(StorageMeasurement(), verified=False), sharded=False)
    assert "fewer than two frames" in run.undecided
    assert run.readable == {Buffer.COLOR}
    assert "nothing but radiance is read" in run.notes[-1]


def test_shards_refuse_what_is_only_measured(settled: Settle) -> None:
    result = settled(StorageMeasurement(motion=clear(NEGATED, MotionConvention())))
    assert require_decision(result, sharded=False).conventions.motion == NEGATED
    with pytest.raises(FrameFolderError, match="inspect --write"):
        require_decision(result, sharded=True)


def test_vectors_about_the_next_frame_become_forward_vectors(settled: Settle) -> None:
    ahead = MotionConvention(direction=MotionDirection.NEXT_MINUS_CURRENT)
    reader = settled(StorageMeasurement(motion=clear(ahead, MotionConvention()))).reader
    assert Buffer.MOTION not in reader.stored
    frame = reader.read(2, (Buffer.FORWARD,))
    assert float(frame.gbuffer[Buffer.FORWARD][0, 0, 0, 0]) == 2.0


def test_vectors_of_the_file_after_are_read_from_it_and_the_last_frame_resets(
    settled: Settle,
) -> None:
    late = MotionConvention(file_offset=1)
    reader = settled(StorageMeasurement(motion=clear(late, MotionConvention()))).reader
    assert float(reader.read(1, (Buffer.MOTION,)).gbuffer[Buffer.MOTION][0, 0, 0, 0]) == 2.0
    assert float(reader.read(3, (Buffer.MOTION,)).gbuffer[Buffer.MOTION].abs().max()) == 0.0
    assert reader.resets == {3}
    assert reader.path(2) in reader.files(1, (Buffer.MOTION,))


@pytest.mark.parametrize(
    ("verdict", "inverted"),
    [(JitterVerdict.IN_VECTORS, False), (JitterVerdict.IN_VECTORS_INVERTED, True)],
)
def test_measured_jitter_in_the_vectors_is_taken_out(
    settled: Settle, verdict: JitterVerdict, inverted: bool
) -> None:
    finding = JitterFinding(verdict=verdict, slope=-1.0, spread_px=0.5)
    result = settled(StorageMeasurement(motion=clear(MotionConvention()), jitter=finding))
    motion = result.reader.conventions.motion
    assert (motion.jittered, motion.jitter_inverted) == (True, inverted)
    assert result.by_measurement == ("jitter",)


@pytest.mark.parametrize(
    ("verdict", "declared", "said"),
    [
        (JitterVerdict.UNDECLARED, None, "not declared"),
        (JitterVerdict.WRONG_SIGN, None, "wrong sign"),
        (JitterVerdict.IN_VECTORS, False, "contain the jitter"),
        (JitterVerdict.CONSISTENT, True, "no jitter"),
    ],
)
def test_jitter_that_is_not_as_declared_is_warned_about(
    settled: Settle, verdict: JitterVerdict, declared: bool | None, said: str
) -> None:
    finding = JitterFinding(verdict=verdict, slope=0.0, spread_px=0.5)
    tables = {} if declared is None else {"motion": {"jittered": declared}}
    measured = StorageMeasurement(motion=clear(MotionConvention()), jitter=finding)
    (warning,) = settled(measured, capture(**tables)).warnings
    assert said in warning


def depth_finding(best: DepthConvention, other: DepthConvention) -> DepthFinding:
    ranked = (
        DepthCandidate(convention=best, error=0.001),
        DepthCandidate(convention=other, error=2.0),
    )
    return DepthFinding(candidates=ranked, measure="px of motion")


def test_measured_depth_overrules_the_preset_and_not_a_declaration(settled: Settle) -> None:
    centimetres = DepthConvention(kind=DepthKind.RAY, unit_m=0.01)
    measured = StorageMeasurement(depth=depth_finding(centimetres, DepthConvention()))
    free = settled(measured)
    assert free.reader.conventions.depth == centimetres
    assert free.by_measurement == ("depth",)
    bound = settled(measured, capture(depth={"unit": "m", "kind": "planar"}))
    assert bound.reader.conventions.depth == DepthConvention()
    assert "obeyed" in bound.warnings[0]


def test_measured_normals_overrule_the_preset_and_are_not_read_where_declared_otherwise(
    settled: Settle,
) -> None:
    finding = NormalFinding(packed=True, space=NormalSpace.VIEW, facing={})
    free = settled(StorageMeasurement(normal=finding)).reader.conventions.normal
    assert (free.packed, free.space) == (True, NormalSpace.VIEW)
    bound = settled(StorageMeasurement(normal=finding), capture(normal={"packed": False}))
    assert not bound.reader.conventions.normal.packed
    assert "they are not read" in bound.warnings[0]
    assert Buffer.NORMAL in bound.reader.contradicted
    assert Buffer.NORMAL not in bound.reader.readable


@pytest.mark.parametrize("declared", [{}, {"space": "world"}])
def test_depth_tells_the_axes_of_normals_and_what_it_contradicts_is_not_read(
    settled: Settle, declared: dict[str, str]
) -> None:
    finding = NormalFinding(packed=False, facing={})
    view = NormalAxes(
        buffer=Buffer.NORMAL,
        apart={NormalSpace.WORLD: 90.0, NormalSpace.VIEW: 30.0},
        turned=80.0,
        axes=np.diag([1.0, 1.0, -1.0, 1.0]),
        lines=('"X"', '"Y"', '"-1 * Z"'),
    )
    seen = settled(
        StorageMeasurement(normal=finding, normal_axes=(view,)), capture(normal=declared)
    )
    assert seen.reader.conventions.normal.space is NormalSpace.VIEW
    assert not seen.reader.contradicted
    assert [w for w in seen.warnings if "are of view space: they are read so" in w] == list(
        seen.warnings
    )
    assert bool(seen.warnings) == bool(declared)
    other = replace(view, apart={NormalSpace.WORLD: 90.0, NormalSpace.VIEW: 85.0}, turned=30.0)
    lost = settled(
        StorageMeasurement(normal=finding, normal_axes=(other,)), capture(normal=declared)
    )
    assert Buffer.NORMAL in lost.reader.contradicted
    assert '[buffers] normal = ["X", "Y", "-1 * Z"]' in lost.warnings[0]
    right = replace(view, apart={NormalSpace.WORLD: 40.0, NormalSpace.VIEW: 60.0}, turned=55.0)
    kept = settled(
        StorageMeasurement(normal=finding, normal_axes=(right,)), capture(normal=declared)
    )
    assert not kept.warnings


def test_normals_that_contradict_others_get_the_one_remedy_that_leaves_those_right(
    settled: Settle,
) -> None:
    shading = NormalAxes(
        buffer=Buffer.NORMAL,
        apart={NormalSpace.WORLD: 90.0, NormalSpace.VIEW: 10.0},
        turned=80.0,
        axes=np.diag([1.0, 1.0, -1.0, 1.0]),
    )
    own = {NormalSpace.WORLD: 10.0, NormalSpace.VIEW: 90.0}
    geometric = replace(shading, buffer=Buffer.GEONORMAL, apart=own)
    finding = NormalFinding(packed=False, facing={})
    seen = settled(StorageMeasurement(normal=finding, normal_axes=(shading, geometric)))
    (warning,) = seen.warnings
    assert warning.startswith("geonormal as view space does not stand")
    assert warning.endswith("it is not read; write them in view space")
    # nothing tells how the others are: either may be
    unknown = replace(shading, apart={NormalSpace.WORLD: 90.0, NormalSpace.VIEW: 90.0}, turned=90.0)
    seen = settled(
        StorageMeasurement(
            normal=NormalFinding(packed=False, space=NormalSpace.VIEW, facing={}),
            normal_axes=(geometric, unknown),
        ),
        capture(normal={"space": "view"}),
    )
    assert seen.warnings[-1].endswith('or declare [normal] space = "world"')


def test_of_an_unverified_layout_without_motion_radiance_is_read_until_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(decision, "measure_storage", lambda *_, **__: StorageMeasurement())
    reader = reader_of(tmp_path)
    binding = {b: c for b, c in reader.binding.items() if b is not Buffer.MOTION}
    reader = replace(reader, binding=binding, layout=replace(reader.layout, verified=False))
    unnamed = measure_and_decide(reader, CaptureDeclaration(), named=False)
    run = require_decision(unnamed, sharded=False)
    assert "known from documentation only" in run.undecided
    assert run.readable == {Buffer.COLOR}
    named = measure_and_decide(reader, CaptureDeclaration(), named=True)
    assert require_decision(named, sharded=False).readable == reader.stored


def test_a_layout_that_is_named_runs_without_the_vectors_that_nothing_decides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(decision, "measure_storage", lambda *_, **__: StorageMeasurement())
    reader = reader_of(tmp_path)
    reader = replace(reader, layout=replace(reader.layout, verified=False))
    run = require_decision(
        measure_and_decide(reader, CaptureDeclaration(), named=True), sharded=False
    )
    assert run.stored - run.readable == {Buffer.MOTION}
    assert "fewer than two frames" in run.motion_undecided
    assert run.notes == (decision.NOT_READ,)
    beside = measure_and_decide(reader, CaptureDeclaration(), named=True, motion=False)
    assert beside.motion_undecided == ""


def unfit(*conventions: MotionConvention) -> MotionFinding:
    """A finding in which no reading is better than taking everything for still."""
    ranked = [candidate(c, 0.5, 0.4, 9.0) for c in conventions]
    return MotionFinding(
        candidates=(candidate(NEGATED, 0.4, 0.4, 0.0), *ranked),
        unmoved_error=0.1,
        moving=1.0,
        triples=(1,),
    )


def test_vectors_that_fit_nothing_leave_a_verified_layout_readable(settled: Settle) -> None:
    result = settled(StorageMeasurement(motion=unfit(MotionConvention())))
    assert "no reading of the motion vectors fits" in result.motion_undecided
    run = require_decision(result, sharded=False)
    assert run.stored - run.readable == {Buffer.MOTION}
    assert any("the frames do not follow them" in text for text in run.warnings)


def test_vectors_that_fit_nothing_prove_no_layout_that_nobody_named(settled: Settle) -> None:
    result = settled(StorageMeasurement(motion=unfit(MotionConvention())), verified=False)
    run = require_decision(result, sharded=False)
    assert "no reading of the motion vectors fits" in run.undecided
    assert run.readable == {Buffer.COLOR}


def test_frames_that_repeat_are_said_and_their_vectors_not_read(settled: Settle) -> None:
    finding = replace(clear(MotionConvention(), NEGATED), unmoved_error=0.1)
    result = settled(StorageMeasurement(motion=finding, repeated=(2, 3)))
    assert "frames 2-3 show the picture of the frame before them" in result.warnings[-1]
    assert "frames repeat the one before them" in result.motion_undecided
    assert 'motion = {unit = "pixels"' in result.motion_undecided
    assert result.undecided == ""


def test_a_clear_reading_holds_though_a_frame_repeats(settled: Settle) -> None:
    result = settled(StorageMeasurement(motion=clear(MotionConvention(), NEGATED), repeated=(2,)))
    assert "frame 2 shows" in result.warnings[-1]
    assert result.motion_undecided == ""


def test_declared_vectors_are_read_though_frames_repeat(settled: Settle) -> None:
    declared = capture(motion={"direction": P, "unit": "pixels", "y_axis": "down"})
    finding = replace(clear(MotionConvention(), NEGATED), unmoved_error=0.1)
    result = settled(StorageMeasurement(motion=finding, repeated=(2,)), declared)
    assert result.motion_undecided == ""


def test_a_declared_unit_that_makes_kilometres_is_warned_about_and_obeyed(settled: Settle) -> None:
    bound = settled(
        StorageMeasurement(median_depth=7e3),
        capture(depth={"unit": "m"}),
        other_depth_units=(0.01,),
    )
    assert bound.reader.conventions.depth.unit_m == 1.0
    assert "7 km at 1 m a unit" in bound.warnings[0]


@pytest.mark.parametrize(
    ("kind", "factor", "twice"),
    [
        (RoughnessKind.SMOOTHNESS, -1.0, True),
        (RoughnessKind.SMOOTHNESS, 1.0, False),
        (RoughnessKind.PERCEPTUAL, -1.0, False),
    ],
)
def test_roughness_that_is_inverted_twice_is_warned_of(
    kind: RoughnessKind, factor: float, twice: bool, tmp_path: Path
) -> None:
    term = BoundChannel(stream="", channel="smooth.R", factor=factor)
    bound = BoundBuffer((BoundSum(terms=(term,), constant=0.5 - factor / 2),))
    reader = reader_of(tmp_path)
    reader = replace(
        reader,
        binding={**reader.binding, Buffer.ROUGHNESS: bound},
        conventions=replace(reader.conventions, roughness=kind),
    )
    warnings = measure_and_decide(reader, CaptureDeclaration(), named=True).warnings
    assert any("roughness is inverted twice" in text for text in warnings) == twice


def test_sky_marked_by_what_is_not_there_is_warned_of(tmp_path: Path) -> None:
    reader = reader_of(tmp_path)
    depth = DepthConvention(sky=SkyRule.ALPHA)
    reader = replace(reader, conventions=replace(reader.conventions, depth=depth))
    warnings = measure_and_decide(reader, CaptureDeclaration(), named=True).warnings
    assert any('sky = "alpha" is declared, but there is no alpha' in text for text in warnings)


@pytest.mark.parametrize(
    ("best", "second", "said"), [(0.079, 0.097, True), (0.0008, 0.097, False), (0.01, 0.011, False)]
)
def test_a_depth_that_fits_poorly_is_said(
    settled: Settle, best: float, second: float, said: bool
) -> None:
    readings = (DepthConvention(), DepthConvention(kind=DepthKind.RAY))
    candidates = tuple(
        DepthCandidate(convention=c, error=e) for c, e in zip(readings, (best, second), strict=True)
    )
    finding = DepthFinding(candidates=candidates, measure="px of motion")
    notes = settled(StorageMeasurement(depth=finding)).notes
    assert any("no reading of depth fits the camera well" in text for text in notes) == said


def test_declared_vectors_that_are_not_relied_upon_are_said(settled: Settle) -> None:
    sense = {"unit": "pixels", "y_axis": "down", "direction": "previous-minus-current"}
    declared = capture(motion=sense)
    said = "no system is the default for its sake"
    still = MotionFinding(candidates=(), unmoved_error=0.4, moving=0.5, triples=(2,))
    notes = settled(StorageMeasurement(motion=still), declared).notes
    assert any(said in text for text in notes)
    for finding in (clear(MotionConvention(), NEGATED), tied(MotionConvention(), NEGATED)):
        notes = settled(StorageMeasurement(motion=finding), declared).notes
        assert not any(said in text for text in notes)
    assert not any(said in text for text in settled(StorageMeasurement(motion=still)).notes)
