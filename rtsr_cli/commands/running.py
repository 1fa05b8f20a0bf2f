"""What `upscale` and `demodulate` share after parsing: sources, progress, summary, exit code.

Imported when a command runs, so that usage errors need no torch.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from typing import Any

import click
import torch
from torch import nn
from tqdm import tqdm

from rtsr_cli.commands.options import emit
from rtsr_cli.core import demodulating, planning, upscaling
from rtsr_cli.core.demodulating import DemodulateOptions, FrameReport
from rtsr_cli.core.derive import DerivationConfig
from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.imaging.brdf_lut import LutConvention
from rtsr_cli.core.imaging.demodulation import DemodulationMode
from rtsr_cli.core.io.nonfinite import NonfinitePolicy
from rtsr_cli.core.io.opening import ReadOptions, open_pairs, open_radiance
from rtsr_cli.core.io.outputs import check_writable
from rtsr_cli.core.io.pairs import Inputs, PairSource
from rtsr_cli.core.io.selection import Selection, Shard
from rtsr_cli.core.io.simulation import JitterMode, Simulation
from rtsr_cli.core.io.survey import MissingPolicy, ranges
from rtsr_cli.core.planning import Precision, ShotPlan, UpscaleOptions
from rtsr_cli.core.system import System
from rtsr_cli.core.upscaling import FrameEvent, Status
from rtsr_cli.models import PREFERENCE, load_system

FAILED = 1
"""Exit code where some frames failed and the rest are done."""


def read_options(chosen: Mapping[str, Any]) -> ReadOptions:
    """Options of `reads_frames` as the library takes them."""
    return ReadOptions(
        layout=chosen["layout"],
        capture=chosen["capture_file"],
        on_missing=MissingPolicy(chosen["on_missing"]),
    )


def selection(chosen: Mapping[str, Any]) -> Selection:
    """`--frames` and `--shard`."""
    part = chosen["shard"]
    return Selection(
        frames=chosen["frames"], shard=Shard(index=part[0], count=part[1]) if part else None
    )


def device_named(name: str) -> str:
    """Resolve `auto`, and refuse a device that is not there.

    Raises:
        ConfigError: torch has no such device.
    """
    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    try:
        torch.empty(1, device=name)
    except (RuntimeError, AssertionError) as error:
        raise ConfigError(
            f"device '{name}' cannot be used ({str(error).splitlines()[0]}); choose --device cpu"
        ) from error
    return name


def run_upscale(chosen: Mapping[str, Any]) -> int:
    """Plan every shot, then run; return the exit code."""
    options = UpscaleOptions(
        device=device_named(chosen["device"]),
        precision=Precision(chosen["precision"]),
        jobs=chosen["jobs"],
        tile=chosen["tile"],
        overwrite=chosen["overwrite"],
        previews=chosen["previews"],
        debug=chosen["debug_buffers"],
        selection=selection(chosen),
    )
    base = Inputs(lr=(), on_nonfinite=NonfinitePolicy(chosen["on_nonfinite"]))
    jobs = []
    for name, source in _pairs(chosen):
        system = _system(chosen["system"], source, base)
        network = system.build(system.config(), source.scale).eval().to(options.device)
        plan = planning.plan_shot(
            name,
            source,
            system,
            inputs=planning.system_inputs(system, base),
            folder=chosen["out_folder"] / name,
            options=options,
            config=_stamped(chosen, system),
        )
        jobs.append((plan, network))
        _announce(chosen, plan)
    if chosen["dry_run"]:
        return 0
    for plan, _ in jobs:
        check_writable(plan.folder)
    return _finish(chosen, _events(jobs, options), sum(len(p.pending) for p, _ in jobs))


def _pairs(chosen: Mapping[str, Any]) -> Iterator[tuple[str, PairSource]]:
    simulation = None
    if chosen["simulate_lr"] is not None:
        simulation = Simulation(
            scale=chosen["simulate_lr"],
            samples_per_pixel=chosen["samples_per_pixel"],
            jitter=JitterMode(chosen["jitter"]),
            lr_filter=chosen["lr_filter"],
        )
    return open_pairs(
        chosen["in_folder"],
        read_options(chosen),
        hr_folder=chosen["hr_folder"],
        scale=chosen["scale"],
        simulation=simulation,
    )


def _system(name: str | None, source: PairSource, base: Inputs) -> System:
    """Return the system asked for, or the first of the preferred ones that has its inputs."""
    if name is not None:
        return load_system(name)
    systems = [load_system(preferred) for preferred in PREFERENCE]
    for system in systems:
        if not source.missing(planning.system_inputs(system, base)):
            return system
    return systems[-1]


def _stamped(chosen: Mapping[str, Any], system: System) -> object:
    """Choices that change the outputs' bytes."""
    names = (
        "simulate_lr",
        "samples_per_pixel",
        "jitter",
        "lr_filter",
        "precision",
        "on_nonfinite",
        "tile",
        "debug_buffers",
    )
    return [asdict(system.config()), asdict(system.derivation), [chosen[n] for n in names]]


def _announce(chosen: Mapping[str, Any], plan: ShotPlan) -> None:
    source, system = plan.source, plan.system
    height, width = source.lr_size
    scale = source.scale
    facts = {
        "shot": plan.name,
        "system": system.name,
        "scale": scale,
        "lr_size": [width, height],
        "size": [width * scale, height * scale],
        "layout": source.reader.layout.name,
        "frames": len(plan.selected),
        "pending": len(plan.pending),
    }
    if chosen["as_json"]:
        emit({"event": "plan", **facts})
        return
    default = " (the best that these inputs allow)" if chosen["system"] is None else ""
    click.echo(
        f"{source.reader.frames.root}: layout {facts['layout']}, frames "
        f"{ranges(plan.selected) or 'none'}, {width} x {height} -> "
        f"{width * scale} x {height * scale}, system {system.name}{default}; "
        f"{len(plan.pending)} to write, {len(plan.selected) - len(plan.pending)} done already"
    )


def _events(
    jobs: list[tuple[ShotPlan, nn.Module]], options: UpscaleOptions
) -> Iterator[FrameEvent]:
    for plan, network in jobs:
        yield from upscaling.run_shot(plan, network, options)


def _finish(chosen: Mapping[str, Any], events: Iterable[FrameEvent], pending: int) -> int:
    """Show progress, print the summary, return the exit code."""
    counts = dict.fromkeys(Status, 0)
    started = time.perf_counter()
    with tqdm(total=pending, unit="frame", disable=None) as bar:
        for event in events:
            counts[event.status] += 1
            if event.status is not Status.KEPT:
                bar.update()
            if chosen["as_json"]:
                emit({"event": "frame", **asdict(event)})
            elif event.status is Status.FAILED:
                click.echo(f"Failed: {event.message}", err=True)
    seconds = time.perf_counter() - started
    totals = {status.value: count for status, count in counts.items()}
    if chosen["as_json"]:
        emit({"event": "done", "seconds": round(seconds, 3), **totals})
    else:
        listed = ", ".join(f"{count} {status}" for status, count in totals.items())
        click.echo(f"{chosen['out_folder']}: {listed}, {seconds:.1f} s")
    return FAILED if counts[Status.FAILED] else 0


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
    for plan in plans:
        click.echo(
            f"{plan.reader.frames.root}: layout {plan.reader.layout.name}, frames "
            f"{ranges(plan.selected) or 'none'}; {len(plan.pending)} to write",
            err=chosen["as_json"],
        )
    if chosen["dry_run"]:
        return 0
    for plan in plans:
        check_writable(plan.folder)
    reports: list[FrameReport] = []
    with tqdm(total=sum(len(p.pending) for p in plans), unit="frame", disable=None) as bar:
        for plan in plans:
            for report in demodulating.run_frames(plan, options):
                reports.append(report)
                bar.update(not report.kept)
                _tell(chosen, report)
    return _summary(chosen, reports, options)


def _tell(chosen: Mapping[str, Any], report: FrameReport) -> None:
    if chosen["as_json"]:
        emit({"event": "frame", **asdict(report)})
    elif report.failed:
        click.echo(f"Failed: {report.failed}", err=True)


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
    }
    if chosen["as_json"]:
        emit({"event": "done", **facts})
        return FAILED if failed else 0
    click.echo(
        f"{chosen['out_folder']}: {facts['written']} written, {facts['kept']} kept, {failed} failed"
    )
    if fresh and not options.inverse:
        click.echo(
            f"largest recomposition error {facts['error']:.2e} of max(|c|, 1e-3); "
            f"{100 * facts['undivided']:.2f} % of the pixels not divided"
        )
    return FAILED if failed else 0
