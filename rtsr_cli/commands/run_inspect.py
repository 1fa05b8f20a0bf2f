"""`rtsr inspect` after parsing: a report to read or JSON, and capture.toml."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import click
from tqdm import tqdm

from rtsr_cli.commands.basics import LOG
from rtsr_cli.commands.inspection_text import report
from rtsr_cli.commands.options import emit
from rtsr_cli.commands.stopping import unwinding
from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.errors import OutputError, RtsrError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.geometry_finder import DepthFinding
from rtsr_cli.core.imaging.jitter_finder import JitterFinding
from rtsr_cli.core.imaging.motion_finder import Candidate
from rtsr_cli.core.inspecting import (
    SetInspection,
    ShotInspection,
    inspect_shot,
    refused,
)
from rtsr_cli.core.io.atomic import write_atomically
from rtsr_cli.core.io.capture import CAPTURE_FILE
from rtsr_cli.core.io.capture_writing import capture_toml
from rtsr_cli.core.io.opening import ReadOptions, declaration_files, shots_of
from rtsr_cli.core.pixel_survey import Statistics
from rtsr_cli.core.readiness import Gravity
from rtsr_cli.models import load_system, system_names

REFUSED, FAILED = 3, 1
"""Exit codes where a command would refuse the frames as they are; where it would fail on some."""

CODES = {
    Gravity.REMARK: 0,
    Gravity.PIXELS: FAILED,
    Gravity.HOLES: REFUSED,
    Gravity.REFUSED: REFUSED,
}


def run_inspect(chosen: Mapping[str, Any]) -> int:
    """Inspect every shot; return the exit code, the worst of all."""
    root = chosen["in_folder"]
    options = ReadOptions(
        layout=chosen["layout"], capture=chosen["capture_file"], on_missing=MissingPolicy.SKIP
    )
    systems = [load_system(name) for name in system_names()]
    try:
        files = declaration_files(root, options)
        shots = shots_of(root, options, files=files)
    except RtsrError as error:
        if not chosen["as_json"]:
            raise
        click.echo(f"Error: {error}", err=True)
        emit(shot_facts(refused(root, str(error), systems)))
        return REFUSED
    facts: dict[str, dict[str, Any]] = {}
    codes = set()
    for shot in tqdm(shots, unit="shot", disable=None if len(shots) > 1 else True):
        inspection = inspect_shot(
            shot, root, options, systems=systems, every=chosen["every"], files=files
        )
        facts[shot.name] = shot_facts(inspection)
        codes.add(CODES[inspection.gravity])
        if not chosen["as_json"]:
            for line in report(inspection):
                LOG.info("%s", line)
        in_the_way = (
            _write(inspection, overwrite=chosen["overwrite"], as_json=chosen["as_json"])
            if chosen["write"]
            else ""
        )
        if in_the_way:
            facts[shot.name]["problems"].append(in_the_way)
            codes.add(REFUSED)
    if chosen["as_json"]:
        emit(next(iter(facts.values())) if len(facts) == 1 else {"shots": facts})
    return max(codes)


def _write(inspection: ShotInspection, *, overwrite: bool, as_json: bool) -> str:
    """Write capture.toml; return why it could not be, which does not keep the report back."""
    path = inspection.root / CAPTURE_FILE
    main = inspection.main
    text = capture_toml(main.settled, inspection.capture, main.guessed, main.unknown)
    try:
        with unwinding():
            also = _put_down(path, text, overwrite=overwrite)
    except OutputError as error:
        click.echo(f"Error: {error}", err=True)
        return str(error)
    click.echo(f"{path}: written{also}", err=as_json)
    return ""


def _put_down(path: Path, text: str, *, overwrite: bool) -> str:
    """Write the file; return what became of a former one, whose comments are not carried over."""
    if not path.exists():
        write_atomically(path, partial(_put, text))
        return ""
    if not overwrite:
        raise OutputError(f"{path} exists; give --overwrite to replace it")
    kept = path.with_name(f"{path.name}.bak")
    write_atomically(kept, partial(shutil.copyfile, path))
    write_atomically(path, partial(_put, text))
    return f"; the former one is kept as {kept.name}"


def _put(text: str, path: Path) -> None:
    path.write_text(text, encoding="utf-8")


def shot_facts(inspection: ShotInspection) -> dict[str, Any]:
    """Return the inspection as the plain values of `--json`."""
    facts = set_facts(inspection.main)
    facts["shot"] = inspection.name
    facts["systems"] = {
        name: {"ready": r.ready, "missing": list(r.missing), "how": r.how}
        for name, r in inspection.systems.items()
    }
    if inspection.hr is not None:
        facts["hr"] = set_facts(inspection.hr)
    return facts


def set_facts(found: SetInspection) -> dict[str, Any]:
    """Return one resolution as plain values."""
    reader = found.reader
    return {
        "root": str(found.root),
        "layout": None if reader is None else reader.layout.name,
        "verified": None if reader is None else reader.layout.verified,
        "frames": list(found.numbers),
        "missing": found.missing,
        "size": None if reader is None else [reader.size[1], reader.size[0]],
        "channels": {key: list(names) for key, names in found.channels.items()},
        "unknown": {key: list(names) for key, names in found.unknown.items()},
        "guesses": {buffer.value: list(places) for buffer, places in found.guessed.items()},
        "buffers": {b.value: _buffer_facts(found, b, s) for b, s in found.statistics.items()},
        "camera": reader is not None and reader.has_camera,
        "motion": _motion_facts(found),
        "depth": _depth_facts(found),
        "normal": _normal_facts(found),
        "nonfinite": {
            buffer.value: statistics.nonfinite
            for buffer, statistics in found.statistics.items()
            if statistics.nonfinite
        },
        "problems": [problem.text for problem in found.problems],
        "notes": [] if found.settled is None else list(found.settled.notes),
    }


def _buffer_facts(found: SetInspection, buffer: Buffer, statistics: Statistics) -> dict[str, Any]:
    binding = found.reader.binding[buffer] if found.reader is not None else ()
    return {
        "channels": [f"{c.stream}:{c.channel}" if c.stream else c.channel for c in binding],
        "min": statistics.low,
        "max": statistics.high,
        "median": statistics.median,
        "zero_frames": list(statistics.zero),
    }


def _candidate_facts(candidate: Candidate, *, tied: bool) -> dict[str, Any]:
    convention = candidate.convention
    return {
        "unit": convention.unit.value,
        "direction": convention.direction.value,
        "y_axis": convention.y_axis.value,
        "axes": convention.axes.value,
        "scale": convention.scale,
        "zero": convention.zero,
        "file_offset": convention.file_offset,
        "error": round(candidate.error, 5),
        "margin": round(candidate.margin, 4),
        "significance": round(candidate.significance, 2),
        "tied": tied,
    }


def _motion_facts(found: SetInspection) -> dict[str, Any] | None:
    """`best` is the reading that stands alone; `used` is what commands will read by."""
    reader, settled = found.reader, found.settled
    if reader is None or settled is None or not {Buffer.MOTION, Buffer.FORWARD} & reader.stored:
        return None
    measured = settled.measured
    finding = measured.motion
    candidates = finding.candidates if finding is not None else ()
    best = measured.best
    jitter = measured.jitter
    others = [c for c in candidates if best is None or c.convention != best.convention]
    margin = round(others[0].margin, 4) if best is not None and others else None
    used = reader.conventions.motion
    return {
        "best": None if best is None else _best_facts(best, margin, jitter),
        "margin": margin,
        "by_geometry": measured.by_geometry is not None,
        "ties": [str(c.convention) for c in finding.ties] if finding is not None else [],
        "candidates": [
            _candidate_facts(c, tied=best is None and c in finding.ties) for c in candidates
        ]
        if finding is not None
        else [],
        "unmoved_error": None if finding is None else round(finding.unmoved_error, 5),
        "moving": None if finding is None else round(finding.moving, 5),
        "jitter": None
        if jitter is None
        else {"verdict": jitter.verdict.value, "spread_px": round(jitter.spread_px, 3)},
        "used": str(used),
        "undecided": settled.motion_undecided or settled.undecided or None,
    }


def _best_facts(
    best: Candidate, margin: float | None, jitter: JitterFinding | None
) -> dict[str, Any]:
    """Facts of the reading that stands alone; its margin is that over the next one."""
    in_vectors = None if jitter is None else jitter.in_vectors
    return _candidate_facts(best, tied=False) | {"margin": margin, "jittered": in_vectors}


def _depth_facts(found: SetInspection) -> dict[str, Any] | None:
    reader, settled = found.reader, found.settled
    if reader is None or settled is None or Buffer.DEPTH not in reader.stored:
        return None
    used = reader.conventions.depth
    finding: DepthFinding = settled.measured.depth
    return {
        "kind": used.kind.value,
        "reversed": used.reversed,
        "unit_m": used.unit_m,
        "measured": finding.best is not None,
        "margin": round(finding.margin, 4),
        "error": None if finding.best is None else finding.best.error,
        "measure": finding.measure,
    }


def _normal_facts(found: SetInspection) -> dict[str, Any] | None:
    reader, settled = found.reader, found.settled
    if reader is None or settled is None or Buffer.NORMAL not in reader.stored:
        return None
    used = reader.conventions.normal
    finding = settled.measured.normal
    return {
        "space": used.space.value,
        "packed": used.packed,
        "measured": finding is not None and finding.packed is not None,
        "facing": {} if finding is None else finding.facing,
    }
