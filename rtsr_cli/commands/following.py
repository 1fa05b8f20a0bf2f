"""Following a run of frames: progress, failures, a summary, the exit code."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any

from tqdm import tqdm

from rtsr_cli.commands.basics import LOG
from rtsr_cli.commands.options import emit
from rtsr_cli.commands.running import FAILED, log_repairs, stopped
from rtsr_cli.core.upscaling import FrameEvent, Status


def follow(chosen: Mapping[str, Any], events: Iterable[FrameEvent], pending: int) -> int:
    """Show progress, print the summary, return the exit code."""
    counts = dict.fromkeys(Status, 0)
    repaired: dict[str, int] = {}
    blocked = ""
    started = time.perf_counter()
    with tqdm(total=pending, unit="frame", disable=None) as bar:
        for event in events:
            counts[event.status] += 1
            blocked = event.message if event.stops else ""
            if event.nonfinite:
                repaired[event.path.name] = event.nonfinite
            if event.status is not Status.KEPT:
                bar.update()
            if chosen["as_json"]:
                emit({"event": "frame", **asdict(event)})
            elif event.status is Status.FAILED and not event.stops:
                LOG.error("Failed: %s", event.message)
    seconds = time.perf_counter() - started
    totals = {status.value: count for status, count in counts.items()}
    if chosen["as_json"]:
        found = {"nonfinite": sum(repaired.values()), "stopped": bool(blocked)}
        emit({"event": "done", "seconds": round(seconds, 3), **totals, **found})
    else:
        listed = ", ".join(f"{count} {status}" for status, count in totals.items())
        LOG.info("%s: %s, %.1f s", chosen["out_folder"], listed, seconds)
        log_repairs(repaired)
    if blocked:
        raise stopped(blocked, counts[Status.WRITTEN], pending)
    return FAILED if counts[Status.FAILED] else 0
