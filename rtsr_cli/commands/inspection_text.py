"""What `rtsr inspect` says: its events, and a report for a person."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import click
from tqdm import tqdm

from rtsr_cli.commands.exit_codes import FAILED, REFUSED
from rtsr_cli.commands.log import LOG
from rtsr_cli.commands.options import emit
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer
from rtsr_cli.core.imaging.motion_finder import SIGNIFICANT_T
from rtsr_cli.core.inspect.events import (
    CaptureBlocked,
    CaptureWritten,
    FolderRefused,
    InspectEvent,
    InspectionDone,
    ShotInspected,
    ShotsListed,
)
from rtsr_cli.core.inspect.facts import shot_facts
from rtsr_cli.core.inspecting import SetInspection, ShotInspection
from rtsr_cli.core.io.layout_names import LAYOUT_NAMES
from rtsr_cli.core.io.reading import FrameReader
from rtsr_cli.core.io.selection import ranges
from rtsr_cli.core.io.settling import Settled
from rtsr_cli.core.readiness import Gravity

LABEL = 12
"""Width of the first column."""

MOST_CANDIDATES = 3

CODES = {
    Gravity.REMARK: 0,
    Gravity.PIXELS: FAILED,
    Gravity.HOLES: REFUSED,
    Gravity.REFUSED: REFUSED,
}
"""Exit codes where a command would refuse the frames as they are; where it would fail on some."""


def show_report(events: Iterable[InspectEvent]) -> int:
    """Print what an inspection says, for a person; return the exit code."""
    bar = tqdm(disable=True)
    for event in events:
        match event:
            case ShotsListed():
                bar = tqdm(total=event.count, unit="shot", disable=_one_shot(event))
            case ShotInspected():
                for line in report(event.inspection):
                    LOG.info("%s", line)
                bar.update()
            case CaptureWritten():
                click.echo(_written(event))
            case CaptureBlocked():
                click.echo(f"Error: {event.message}", err=True)
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
                click.echo(f"Error: {event.message}", err=True)
                emit(shot_facts(event.inspection))
                return REFUSED
            case ShotsListed():
                bar = tqdm(total=event.count, unit="shot", disable=_one_shot(event))
            case ShotInspected():
                facts[event.inspection.name] = shot_facts(event.inspection)
                bar.update()
            case CaptureWritten():
                click.echo(_written(event), err=True)
            case CaptureBlocked():
                click.echo(f"Error: {event.message}", err=True)
                facts[event.shot]["problems"].append(event.message)
            case InspectionDone():
                bar.close()
                emit(next(iter(facts.values())) if len(facts) == 1 else {"shots": facts})
                return CODES[event.gravity]
    return REFUSED


def _one_shot(listed: ShotsListed) -> bool | None:
    """Show no bar of one shot; of more, where stderr is a terminal."""
    return None if listed.count > 1 else True


def _written(capture: CaptureWritten) -> str:
    also = "" if capture.kept is None else f"; the former one is kept as {capture.kept.name}"
    return f"{capture.path}: written{also}"


def report(inspection: ShotInspection) -> Iterator[str]:
    """Everything about a shot."""
    yield from _set(inspection.main)
    if inspection.hr is not None:
        yield from _set(inspection.hr)
    yield from _systems(inspection)
    yield from _next(inspection)
    yield ""


def _line(label: str, text: str) -> str:
    return f"  {label:<{LABEL}}{text}"


def _set(found: SetInspection) -> Iterator[str]:
    yield str(found.root)
    reader = found.reader
    if reader is None:
        yield _line("layout", "not understood")
        for key, names in found.channels.items():
            yield _line("channels", f"{key + ': ' if key else ''}{' '.join(names)}")
        yield from _guesses(found)
        yield from _problems(found)
        return
    yield _line("layout", _layout(reader))
    yield _line("frames", _frames(found, reader))
    yield _line("size", f"{reader.size[1]} x {reader.size[0]}{_windows(reader)}")
    yield from _buffers(found, reader)
    for key, names in found.unknown.items():
        yield _line("not used", f"{key + ': ' if key else ''}{' '.join(names)}")
    yield from _guesses(found)
    yield _line("camera", _camera(reader))
    if found.settled is not None:
        yield from _conventions(found, reader, found.settled)
    yield from _problems(found)


def _layout(reader: FrameReader) -> str:
    layout = reader.layout
    preset = layout.name in LAYOUT_NAMES
    doubt = " (unverified: known from documentation only)" if preset and not layout.verified else ""
    return f"{layout.name}{doubt}: {layout.description}"


def _frames(found: SetInspection, reader: FrameReader) -> str:
    text = f"{ranges(found.numbers)} ({len(found.numbers)})"
    if reader.step != 1:
        text += f", in steps of {reader.step}"
    text += ", none missing" if not found.missing else ""
    looked = len(found.looked_at)
    return text if looked == len(reader.numbers) else f"{text}; pixels of {looked} looked at"


def _windows(reader: FrameReader) -> str:
    region, display = reader.region, reader.display
    if region == display:
        return ""
    return (
        f" at ({region.left}, {region.top}) of an image plane of {display.width} x {display.height}"
    )


def _buffers(found: SetInspection, reader: FrameReader) -> Iterator[str]:
    label = "buffers"
    for buffer, s in found.statistics.items():
        streams = dict.fromkeys(c.stream for c in reader.binding[buffer])
        channels = " ".join(c.channel for c in reader.binding[buffer])
        place = ", ".join(streams) if len(reader.frames.streams) > 1 else ""
        where = f"{place}: {channels}" if place else channels
        numbers = f"{s.low:.4g} .. {s.high:.4g}, median {s.median:.4g}"
        yield _line(label, f"{buffer:<14}{where:<32} {numbers}")
        label = ""


def _guesses(found: SetInspection) -> Iterator[str]:
    for buffer, places in found.guessed.items():
        listed = ", ".join(f'"{p}"' for p in places)
        yield _line("maybe", f"{buffer} = [{listed}]   ({BUFFER_SPECS[buffer].unit})")
    if found.guessed:
        yield _line(
            "", "declare what is right under [buffers] in capture.toml (--write starts one)"
        )


def _camera(reader: FrameReader) -> str:
    if reader.has_camera:
        return "worldToCamera and worldToNDC of every frame"
    return 'no matrices (give them in a side-car: capture.toml, camera = "camera.csv")'


def _conventions(found: SetInspection, reader: FrameReader, settled: Settled) -> Iterator[str]:
    if {Buffer.MOTION, Buffer.FORWARD} & reader.stored:
        yield _line("motion", f"read as {reader.conventions.motion}")
        yield from _motion(settled)
    if Buffer.DEPTH in reader.stored:
        depth = reader.conventions.depth
        kind = f"{depth.kind}{', reversed' if depth.reversed else ''}"
        unit = "" if depth.kind == "device" else f", {depth.unit_m:g} m a unit"
        yield _line("depth", f"{kind}{unit}{_depth_proof(settled)}")
    if Buffer.NORMAL in reader.stored:
        normal = reader.conventions.normal
        proof = settled.measured.normal
        known = ", measured" if proof is not None and proof.space is not None else ""
        packed = "packed (n + 1) / 2" if normal.packed else "-1..1"
        yield _line("normals", f"{normal.space} space, {packed}{known}")
    if Buffer.ROUGHNESS in reader.stored:
        yield _line("roughness", _roughness(found, reader))
    for note in settled.notes:
        yield _line("note", note)


def _motion(settled: Settled) -> Iterator[str]:
    finding = settled.measured.motion
    if finding is None:
        yield _line("", "not measured: that needs two adjacent frames with radiance or albedo")
        return
    if not finding.candidates:
        yield _line("", "not measured: no stored vector differs from zero")
        return
    yield _line(
        "",
        f"measured on {ranges(settled.measured.frames)}, {finding.moving:.0%} of the pixels move; "
        f"error without motion {finding.unmoved_error:.3f}",
    )
    used = finding.of(settled.reader.conventions.motion)
    listed = [*finding.candidates[:MOST_CANDIDATES], *([used] if used is not None else [])]
    for candidate in dict.fromkeys(listed):
        mark = " (tie)" if candidate in finding.ties and len(finding.ties) > 1 else ""
        if settled.measured.by_geometry is candidate:
            mark += " (singled out by camera and depth)"
        behind = "best"
        if candidate.margin:
            behind = f"{candidate.margin:.1%} behind, {candidate.significance:.2f} standard errors"
        mark += " (the winner's vectors)" if candidate.same_vectors else ""
        mark += " (as it is read)" if candidate is used else ""
        yield _line("", f"  {candidate.error:.3f}  {candidate.convention}: {behind}{mark}")
    if len(finding.ties) > 1:
        yield _line("", f"  tie: less than {SIGNIFICANT_T:g} standard errors behind the best")
    jitter = settled.measured.jitter
    if jitter is not None:
        yield _line("jitter", f"{jitter.verdict} (largest offset found {jitter.spread_px:.2f} px)")


def _depth_proof(settled: Settled) -> str:
    depth = settled.measured.depth
    if depth.best is None:
        return " (not measured: that needs camera matrices and a camera that travels)"
    return (
        f", measured: error {depth.best.error:.2g} {depth.measure}, {depth.margin:.0%} below next"
    )


def _roughness(found: SetInspection, reader: FrameReader) -> str:
    kind = reader.conventions.roughness
    names = " ".join(c.channel + c.stream for c in reader.binding[Buffer.ROUGHNESS]).lower()
    if kind != "smoothness" and any(word in names for word in ("smooth", "gloss")):
        return f'taken as {kind}, but its name says smoothness: roughness = "smoothness"?'
    low = found.statistics[Buffer.ROUGHNESS].median < 0.05
    hint = " (small values: GGX alpha, perhaps?)" if low and kind == "perceptual" else ""
    return f"taken as {kind}{hint}; pictures do not tell, declare it if it is another"


def _problems(found: SetInspection) -> Iterator[str]:
    for problem in found.problems:
        first, *others = problem.text.splitlines()
        yield _line("PROBLEM", first)
        yield from (_line("", line) for line in others)


def _systems(inspection: ShotInspection) -> Iterator[str]:
    label = "systems"
    for name, readiness in inspection.systems.items():
        if readiness.ready:
            text = f"ready{' with ' + readiness.how if readiness.how else ''}"
        else:
            text = f"missing: {', '.join(readiness.missing)}"
        yield _line(label, f"{name:<16}{text}")
        label = ""


def _next(inspection: ShotInspection) -> Iterator[str]:
    if not any(r.ready for r in inspection.systems.values()):
        return
    if inspection.hr is not None:
        yield _line("try", f"rtsr upscale {inspection.root} OUT")
        return
    root = inspection.main.root
    yield _line("try", f"rtsr upscale {root} OUT --scale 2          if these are LR frames")
    yield _line("", f"rtsr upscale {root} OUT --simulate-lr 2    if they are HR captures")
