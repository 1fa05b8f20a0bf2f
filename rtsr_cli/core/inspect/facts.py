"""An inspection as plain values: what `rtsr inspect --json` prints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from rtsr_cli.core.captures.bound_channels import BoundBuffer
from rtsr_cli.core.captures.measuring.geometry_finder import DepthFinding
from rtsr_cli.core.captures.measuring.jitter_finder import JitterFinding
from rtsr_cli.core.captures.measuring.motion_finding import MotionCandidate
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.gaps import flatten_gaps
from rtsr_cli.core.inspect.pixel_statistics import NEVER_NEGATIVE, PixelStatistics
from rtsr_cli.core.inspect.readiness import SystemReadiness
from rtsr_cli.core.inspect.shot_inspection import SetInspection, ShotInspection


def describe_shot(inspection: ShotInspection) -> dict[str, Any]:
    """Return the inspection as the plain values of `--json`."""
    facts = describe_set(inspection.main)
    facts["shot"] = inspection.name
    facts["systems"] = _describe_readiness(inspection.systems)
    facts["commands"] = {n: _describe_readiness(c) for n, c in inspection.commands.items()}
    facts["fixes"] = [asdict(fix) for fix in inspection.fixes]
    facts["filter_width_px"] = inspection.filter_width_px
    if inspection.hr is not None:
        facts["hr"] = describe_set(inspection.hr)
    return facts


def _describe_readiness(systems: Mapping[str, SystemReadiness]) -> dict[str, dict[str, Any]]:
    return {
        name: {"ready": r.ready, "missing": list(r.missing), "how": r.how}
        for name, r in systems.items()
    }


def describe_set(inspected: SetInspection) -> dict[str, Any]:
    """Return one resolution as plain values."""
    reader = inspected.reader
    return {
        "root": str(inspected.root),
        "layout": None if reader is None else reader.layout.name,
        "verified": None if reader is None else reader.layout.verified,
        "layers": list(inspected.layers),
        "layer": (reader.layer or None) if reader is not None else None,
        "frames": list(inspected.numbers),
        "missing": {key: flatten_gaps(gaps) for key, gaps in inspected.missing.items()},
        "size": None if reader is None else [reader.size[1], reader.size[0]],
        "channels": {key: list(names) for key, names in inspected.channels.items()},
        "unknown": {key: list(names) for key, names in inspected.unknown.items()},
        "guesses": {buffer.value: list(places) for buffer, places in inspected.guessed.items()},
        "buffers": {
            b.value: _describe_buffer(inspected, b, s) for b, s in inspected.statistics.items()
        },
        "camera": reader is not None and reader.has_camera,
        "camera_check": _describe_camera_check(inspected),
        "motion": _describe_motion(inspected),
        "depth": _describe_depth(inspected),
        "normal": _describe_normals(inspected),
        "sky": _describe_sky(inspected),
        "nonfinite": {
            buffer.value: statistics.nonfinite
            for buffer, statistics in inspected.statistics.items()
            if statistics.nonfinite
        },
        "negative": {
            buffer.value: statistics.negative
            for buffer, statistics in inspected.statistics.items()
            if statistics.negative and buffer in NEVER_NEGATIVE
        },
        "lossy": {name: asdict(buffer) for name, buffer in inspected.lossy.items()},
        "problems": [problem.text for problem in inspected.problems],
        "notes": [] if inspected.settled is None else list(inspected.settled.notes),
    }


def _describe_buffer(
    inspected: SetInspection, buffer: Buffer, statistics: PixelStatistics
) -> dict[str, Any]:
    bound = BoundBuffer(()) if inspected.reader is None else inspected.reader.binding[buffer]
    samples = () if inspected.reader is None else inspected.reader.samples.get(buffer, ())
    return {
        "channels": [f"{c.stream}:{c.channel}" if c.stream else c.channel for c in bound],
        **({"samples": len(samples)} if samples else {}),
        **({"expression": bound.describe(streams=True)} if not bound.is_as_stored else {}),
        "min": statistics.low,
        "max": statistics.high,
        "median": statistics.median,
        "zero_frames": list(statistics.zero),
    }


def _describe_candidate(candidate: MotionCandidate, *, tied: bool) -> dict[str, Any]:
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


def _describe_sky(inspected: SetInspection) -> dict[str, Any] | None:
    """Share of the pixels, what it was found by, and depth values that no surface has."""
    found = None if inspected.settled is None else inspected.settled.measured.sky
    if found is None:
        return None
    return {
        "share": round(found.share, 5),
        "rule": found.rule,
        "impossible": round(found.impossible + found.lost, 5),
    }


def _describe_motion(inspected: SetInspection) -> dict[str, Any] | None:
    """`best` is the reading that stands alone; `used` is what commands will read by."""
    reader, settled = inspected.reader, inspected.settled
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
        "best": None if best is None else _describe_best(best, margin, jitter),
        "margin": margin,
        "by_geometry": measured.by_geometry is not None,
        "ties": [str(c.convention) for c in finding.ties] if finding is not None else [],
        "candidates": [
            _describe_candidate(c, tied=best is None and c in finding.ties) for c in candidates
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


def _describe_best(
    best: MotionCandidate, margin: float | None, jitter: JitterFinding | None
) -> dict[str, Any]:
    """Facts of the reading that stands alone; its margin is that over the next one."""
    in_vectors = None if jitter is None else jitter.in_vectors
    return _describe_candidate(best, tied=False) | {"margin": margin, "jittered": in_vectors}


def _describe_camera_check(inspected: SetInspection) -> dict[str, Any] | None:
    """What holds of the matrices of all frames, as the text says it.

    `verified` names what agrees with those that were looked at, `refused` says why none are used,
    `unverified` what is in doubt: all, or those of single frames, which lie off the path.
    """
    if inspected.settled is None or inspected.settled.measured.camera is None:
        return None
    found = inspected.settled.measured.camera
    return {
        "verified": list(found.proofs),
        "undecided": list(found.undecided),
        "refused": inspected.settled.reader.camera_unfit or None,
        "unverified": " ".join(text for text in (found.doubt, found.strays) if text) or None,
        "errors": {name: float(f"{error:.4g}") for name, error in found.errors.items()},
    }


def _describe_depth(inspected: SetInspection) -> dict[str, Any] | None:
    reader, settled = inspected.reader, inspected.settled
    if reader is None or settled is None or Buffer.DEPTH not in reader.stored:
        return None
    used = reader.conventions.depth
    finding: DepthFinding = settled.measured.depth
    return {
        "kind": used.kind.value,
        "reversed": used.reversed,
        "unit_m": used.unit_m,
        "from": "near" if used.from_near else "camera",
        "measured": finding.best is not None,
        "margin": round(finding.margin, 4),
        "error": None if finding.best is None else finding.best.error,
        "measure": finding.measure,
    }


def _describe_normals(inspected: SetInspection) -> dict[str, Any] | None:
    reader, settled = inspected.reader, inspected.settled
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
