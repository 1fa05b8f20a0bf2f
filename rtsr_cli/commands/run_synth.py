"""`rtsr synth` after parsing: plans of every shot, one run, a summary."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from tqdm import tqdm

from rtsr_cli.commands.basics import LOG
from rtsr_cli.commands.options import emit
from rtsr_cli.commands.stopping import unwinding
from rtsr_cli.core.io.atomic import check_writable
from rtsr_cli.core.io.selection import ranges
from rtsr_cli.core.synth.choices import SynthOptions
from rtsr_cli.core.synth.shots import ShotPlan, check_size, plan_shot, run_shot


def run_synth(chosen: Mapping[str, Any]) -> int:
    """Plan every shot, then render; return the exit code."""
    options = SynthOptions(
        size=chosen["size"],
        scale=chosen["scale"],
        jitter=None if chosen["jitter"] == "none" else chosen["jitter"],
        samples=chosen["samples"],
        layout=chosen["layout"],
        static_camera=chosen["static_camera"],
    )
    check_size(options)
    plans = [
        plan_shot(seed, folder, options, tuple(chosen["frames"]), overwrite=chosen["overwrite"])
        for seed, folder in _shots(chosen)
    ]
    for plan in plans:
        _announce(chosen, plan)
        check_writable(plan.folder)
    counts = {"written": 0, "kept": 0}
    started = time.perf_counter()
    pending = sum(len(plan.pending) for plan in plans)
    with unwinding(), tqdm(total=pending, unit="file", disable=None) as bar:
        for plan in plans:
            for report in run_shot(plan, jobs=chosen["jobs"]):
                counts["kept" if report.kept else "written"] += 1
                bar.update(not report.kept)
                if chosen["as_json"]:
                    emit({"event": "file", **asdict(report)})
    seconds = time.perf_counter() - started
    if chosen["as_json"]:
        emit({"event": "done", "seconds": round(seconds, 3), **counts})
    else:
        LOG.info(
            "%s: %d written, %d kept, %.1f s",
            chosen["out_folder"],
            counts["written"],
            counts["kept"],
            seconds,
        )
    return 0


def _shots(chosen: Mapping[str, Any]) -> list[tuple[int, Any]]:
    """Seed and folder of each shot."""
    out, seed, count = chosen["out_folder"], chosen["seed"], chosen["shots"]
    if count is None:
        return [(seed, out)]
    return [(seed + i, out / f"{i:04d}") for i in range(count)]


def _announce(chosen: Mapping[str, Any], plan: ShotPlan) -> None:
    height, width = plan.options.size
    files = len(plan.numbers) * len(plan.options.roles)
    if chosen["as_json"]:
        emit(
            {
                "event": "plan",
                "seed": plan.seed,
                "folder": plan.folder,
                "size": [width, height],
                "files": files,
                "pending": len(plan.pending),
            }
        )
        return
    LOG.info(
        "%s: seed %d, frames %s, %d x %d, %s; %d files to write, %d done already",
        plan.folder,
        plan.seed,
        ranges(plan.numbers),
        width,
        height,
        " ".join(plan.options.roles),
        len(plan.pending),
        files - len(plan.pending),
    )
