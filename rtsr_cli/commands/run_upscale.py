"""`rtsr upscale` after parsing: plans of every shot, one run, a summary."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any

import torch

from rtsr_cli.commands.basics import device_named
from rtsr_cli.commands.following import follow
from rtsr_cli.commands.running import (
    announce,
    check_frames,
    plan_facts,
    read_options,
    selection,
    until_stopped,
)
from rtsr_cli.commands.stopping import unwinding
from rtsr_cli.core import planning, tiling, upscaling
from rtsr_cli.core.choices import JitterMode, NonfinitePolicy, Precision
from rtsr_cli.core.io.atomic import check_writable
from rtsr_cli.core.io.opening import open_pairs
from rtsr_cli.core.io.outputs import PREVIEW_SUFFIX
from rtsr_cli.core.io.pairs import Inputs, PairSource
from rtsr_cli.core.io.simulation import Simulation
from rtsr_cli.core.networks import Loaded, has_weights, load_network
from rtsr_cli.core.planning import ShotPlan, UpscaleOptions
from rtsr_cli.core.precision import settled
from rtsr_cli.core.settings import to_plain
from rtsr_cli.core.system import System
from rtsr_cli.core.weights import read_weights
from rtsr_cli.models import PREFERENCE, load_system


def run_upscale(chosen: Mapping[str, Any]) -> int:
    """Plan every shot, then run; return the exit code."""
    device = device_named(chosen["device"])
    options = UpscaleOptions(
        device=device,
        precision=settled(Precision(chosen["precision"]), torch.device(device)),
        jobs=chosen["jobs"],
        tile=chosen["tile"],
        overwrite=chosen["overwrite"],
        pictures=(PREVIEW_SUFFIX,) if chosen["previews"] else (),
        debug=chosen["debug_buffers"],
        selection=selection(chosen),
    )
    base = Inputs(lr=(), on_nonfinite=NonfinitePolicy(chosen["on_nonfinite"]))
    jobs = []
    for name, source in _pairs(chosen):
        system = _system(chosen, source, base)
        loaded = load_network(system, source.scale, options.device, chosen["weights_file"])
        plan = planning.plan_shot(
            name,
            source,
            system,
            inputs=planning.system_inputs(system, base, loaded.config),
            folder=chosen["out_folder"] / name,
            options=options,
            config=_stamped(chosen, system, source, loaded, options),
            passthrough=chosen["passthrough"],
        )
        jobs.append((plan, loaded.network))
    check_frames(chosen, [plan.source.reader for plan, _ in jobs])
    for plan, _ in jobs:
        _announce(chosen, plan, options)
    if chosen["dry_run"]:
        return 0
    for plan, _ in jobs:
        check_writable(plan.folder)
    events = until_stopped(upscaling.run_shot(*job, options) for job in jobs)
    with unwinding():
        return follow(chosen, events, sum(len(p.pending) for p, _ in jobs))


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


def _system(chosen: Mapping[str, Any], source: PairSource, base: Inputs) -> System:
    """Return the system asked for, that of the weights, or the first preferred one that can run."""
    if chosen["system"] is not None:
        return load_system(chosen["system"])
    if chosen["weights_file"] is not None:
        return load_system(read_weights(chosen["weights_file"]).system)
    systems = [load_system(preferred) for preferred in PREFERENCE]
    for system in systems:
        fits = not system.scales or source.scale in system.scales
        able = fits and has_weights(system, source.scale)
        if able and not source.missing(planning.system_inputs(system, base)):
            return system
    return systems[-1]


def _stamped(
    chosen: Mapping[str, Any],
    system: System,
    source: PairSource,
    loaded: Loaded,
    options: UpscaleOptions,
) -> object:
    """Choices that change the outputs' bytes."""
    requested = upscaling.requested_tile(tile=chosen["tile"], debug=chosen["debug_buffers"])
    side = tiling.tile_side(system, source.lr_size, source.scale, requested)
    names = (
        "simulate_lr",
        "samples_per_pixel",
        "jitter",
        "lr_filter",
        "on_nonfinite",
        "passthrough",
    )
    network = [loaded.digest, options.precision.value] if loaded.weights else []
    divisor = asdict(system.derivation(loaded.config))
    return [to_plain(loaded.config), divisor, side, network, [chosen[n] for n in names]]


def _announce(chosen: Mapping[str, Any], plan: ShotPlan, options: UpscaleOptions) -> None:
    source, scale = plan.source, plan.source.scale
    height, width = source.lr_size
    facts = plan_facts(plan.name, source.readers, plan.selected, plan.pending)
    facts |= {
        "system": plan.system.name,
        "scale": scale,
        "lr_size": [width, height],
        "size": [width * scale, height * scale],
        "read_bytes": plan.read_bytes,
        "write_bytes_at_most": plan.write_bytes(options),
    }
    unnamed = chosen["system"] is None and chosen["weights_file"] is None
    default = " (the best that these inputs allow)" if unnamed else ""
    what = (
        f", {width} x {height} -> {width * scale} x {height * scale}, "
        f"system {plan.system.name}{default}"
    )
    announce(chosen, facts, source.readers, plan.selected, what)
