"""`rtsr demodulate` after parsing: plans of every frame set, one run, a summary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from tqdm import tqdm

from rtsr_cli.commands.basics import LOG
from rtsr_cli.commands.options import emit
from rtsr_cli.commands.running import (
    FAILED,
    announce,
    check_frames,
    log_repairs,
    plan_facts,
    read_options,
    selection,
    stopped,
    until_stopped,
)
from rtsr_cli.commands.stopping import unwinding
from rtsr_cli.core import demodulating
from rtsr_cli.core.choices import DemodulationMode, LutConvention, NonfinitePolicy
from rtsr_cli.core.demodulating import DemodulateOptions, DemodulatePlan, FrameReport
from rtsr_cli.core.derive import DerivationConfig
from rtsr_cli.core.io.atomic import check_writable
from rtsr_cli.core.io.opening import open_radiance


def run_demodulate(chosen: Mapping[str, Any]) -> int:
    """Plan every frame set, then run; return the exit code."""
    options = DemodulateOptions(
        derivation=DerivationConfig(
            mode=DemodulationMode(chosen["mode"]),
            lut=LutConvention(chosen["convention"]),
            epsilon=chosen["epsilon"],
        ),
        inverse=chosen["inverse"],
        full=chosen["full"],
        jobs=chosen["jobs"],
        overwrite=chosen["overwrite"],
        on_nonfinite=NonfinitePolicy(chosen["on_nonfinite"]),
        selection=selection(chosen),
    )
    found = open_radiance(chosen["in_folder"], read_options(chosen), lighting=options.inverse)
    plans = [
        demodulating.plan_frames(name, reader, chosen["out_folder"] / name, options)
        for name, reader in found
    ]
    check_frames(chosen, [plan.reader for plan in plans])
    for plan in plans:
        _announce(chosen, plan, options)
    if chosen["dry_run"]:
        return 0
    for plan in plans:
        check_writable(plan.folder)
    reports: list[FrameReport] = []
    pending = sum(len(plan.pending) for plan in plans)
    with unwinding(), tqdm(total=pending, unit="frame", disable=None) as bar:
        for report in until_stopped(demodulating.run_frames(p, options) for p in plans):
            reports.append(report)
            bar.update(not report.kept)
            _tell(chosen, report)
    code = _summary(chosen, reports, options)
    for report in reports:
        if report.stops:
            done = sum(not r.kept and not r.failed for r in reports)
            raise stopped(report.failed, done, pending)
    return code


def _announce(chosen: Mapping[str, Any], plan: DemodulatePlan, options: DemodulateOptions) -> None:
    facts = plan_facts(plan.name, [plan.reader], plan.selected, plan.pending)
    facts |= {
        "read_bytes": plan.read_bytes,
        "write_bytes_at_most": plan.write_bytes(options),
    }
    announce(chosen, facts, [plan.reader], plan.selected)


def _tell(chosen: Mapping[str, Any], report: FrameReport) -> None:
    if chosen["as_json"]:
        emit({"event": "frame", **asdict(report)})
    elif report.failed and not report.stops:
        LOG.error("Failed: %s", report.failed)


def _summary(
    chosen: Mapping[str, Any], reports: list[FrameReport], options: DemodulateOptions
) -> int:
    fresh = [r for r in reports if not r.kept and not r.failed]
    failed = sum(bool(r.failed) for r in reports)
    facts = {
        "written": len(fresh),
        "kept": sum(r.kept for r in reports),
        "failed": failed,
        "error": max((r.error for r in fresh), default=0.0),
        "undivided": sum(r.undivided for r in fresh) / max(len(fresh), 1),
        "nonfinite": sum(r.nonfinite for r in fresh),
        "stopped": any(r.stops for r in reports),
    }
    if chosen["as_json"]:
        emit({"event": "done", **facts})
        return FAILED if failed else 0
    LOG.info(
        "%s: %d written, %d kept, %d failed",
        chosen["out_folder"],
        facts["written"],
        facts["kept"],
        failed,
    )
    log_repairs({r.path.name: r.nonfinite for r in fresh if r.nonfinite})
    if fresh and not options.inverse:
        LOG.info(
            "largest recomposition error %.2e of max(|c|, 1e-3); %.2f %% of the pixels not divided",
            facts["error"],
            100 * facts["undivided"],
        )
    return FAILED if failed else 0
