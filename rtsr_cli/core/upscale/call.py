"""`upscale`: from a request to upscaled frames, event by event."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, replace

import torch

from rtsr_cli.core.choices import JitterMode, PixelFilter, SystemTask
from rtsr_cli.core.devices import resolve_device
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.network.exported import load_chosen_network
from rtsr_cli.core.network.load import LoadedNetwork
from rtsr_cli.core.network.tiling import choose_tile_side
from rtsr_cli.core.pairs.lacking_frames import leave_out_lacking, list_needed_inputs
from rtsr_cli.core.pairs.opening import open_pairs
from rtsr_cli.core.pairs.passthrough import find_passthrough
from rtsr_cli.core.pairs.simulation import Simulation
from rtsr_cli.core.pairs.sources import PairSource
from rtsr_cli.core.run.default_system import (
    PassedOver,
    choose_default,
    describe_passed_over,
)
from rtsr_cli.core.run.events import (
    BETTER,
    FILTER,
    FILTER_DOUBT,
    FrameDone,
    RunDone,
    RunStarted,
    ShotPlanned,
)
from rtsr_cli.core.run.frame_pairs import PairJob, PairReading, read_options
from rtsr_cli.core.run.given_network import name_given_system
from rtsr_cli.core.run.outputs import PREVIEW_SUFFIX
from rtsr_cli.core.run.plan import FrameOutputs, check_selection, plan_shot
from rtsr_cli.core.run.prediction import NetworkRun
from rtsr_cli.core.run.shot_runs import run_shots
from rtsr_cli.core.run.system_inputs import (
    SystemTable,
    check_system,
    describe_filter_width,
    measure_history_reach,
    require_known_filter,
    resolve_system_inputs,
)
from rtsr_cli.core.settings import to_plain
from rtsr_cli.core.system import System
from rtsr_cli.core.upscale.reconstruction import Reconstruction
from rtsr_cli.core.upscale.request import UpscaleRequest

COMMAND = "upscale"


def upscale_frames(
    request: UpscaleRequest, systems: SystemTable
) -> Iterator[ShotPlanned | RunStarted | FrameDone | RunDone]:
    """Plan every shot, then reconstruct frame after frame.

    Args:
        request: what is asked for.
        systems: that may be used.

    Yields:
        A plan for every shot; unless it is a dry run, the start, an end for every frame, the end.

    Raises:
        RtsrError: before the first frame: an input is missing or wrong, an output is in the way;
            after the last event: nothing more can be written.
    """
    jobs = [plan_upscaling(*shot, request, systems) for shot in open_whole(request, systems)]
    check_selection(request.selection, [job.plan.inputs for job, _ in jobs])
    for job, details in jobs:
        yield job.plan.announcement(details)
    if not request.dry_run:
        yield from run_shots([job for job, _ in jobs], request)


def open_whole(request: UpscaleRequest, systems: SystemTable) -> Iterable[tuple[str, PairSource]]:
    """Survey every shot, but for frames that lack what the chosen system needs.

    Which system that is shows where all frames that lack anything are left out.
    """

    def list_needed(whole: PairSource, without: PairSource) -> frozenset[Buffer]:
        system, _ = choose_system(request, without, systems)
        inputs = resolve_system_inputs(system, request.on_nonfinite)
        return list_needed_inputs(whole, without, inputs)

    return leave_out_lacking(
        lambda needed: open_shots(request, needed), request.on_missing, list_needed
    )


def open_shots(
    request: UpscaleRequest, needed: frozenset[Buffer] = frozenset()
) -> Iterator[tuple[str, PairSource]]:
    """Survey every shot of IN as LR/HR pairs, by relative path.

    Args:
        request: what is asked for.
        needed: buffers without which frames are left out.
    """
    simulation = None
    if request.simulate_lr is not None:
        simulation = Simulation(
            scale=request.simulate_lr,
            samples_per_pixel=request.samples_per_pixel or 1,
            jitter=request.jitter or JitterMode.NONE,
            lr_filter=request.lr_filter or PixelFilter.NONE,
        )
    return open_pairs(
        request.in_folder,
        replace(read_options(request), needed=needed),
        hr_folder=request.hr_folder,
        scale=request.scale,
        simulation=simulation,
    )


def plan_upscaling(
    name: str, source: PairSource, request: UpscaleRequest, systems: SystemTable
) -> tuple[PairJob, dict[str, object]]:
    """Check one shot; return its job, and what is told of it.

    Raises:
        RtsrError: an input is missing or wrong, an output is in the way.
    """
    device = resolve_device(request.device)
    system, passed_over = choose_system(request, source, systems)
    loaded = load_chosen_network(system, source.scale, device, request.weights_file, request.model)
    loaded.check_size(source.lr_size)
    inputs = resolve_system_inputs(system, request.on_nonfinite, loaded.config)
    check_system(system, source, inputs)
    require_known_filter(source, inputs, sharded=request.shard is not None)
    run = NetworkRun(
        system=system,
        network=loaded.network,
        device=device,
        precision=loaded.choose_precision(request.precision, torch.device(device)),
        # a tile has no debug picture of the whole
        tile=0 if request.debug_buffers or not loaded.takes_tiles else request.tile,
    )
    passed = find_passthrough(source, request.passthrough)
    reading = PairReading(source=source, inputs=inputs, passed=passed)
    plan = plan_shot(
        reading.of_shot(name),
        _name_outputs(name, reading, request),
        settings=collect_stamp_settings(request, reading, loaded, run),
        selection=request.selection,
        overwrite=request.overwrite,
        history=measure_history_reach(system),
    )
    work = Reconstruction(run, source, previews=request.previews, debug=request.debug_buffers)
    job = PairJob(plan, reading, work, history_frames=system.history_frames, device=device)
    return job, _describe_details(system, reading, passed_over)


def choose_system(
    request: UpscaleRequest, source: PairSource, systems: SystemTable
) -> tuple[System, list[PassedOver]]:
    """Return the system asked for, that of the network, or the first preferred one that can run.

    Beside it stand the preferred ones that were passed over.
    """
    given = name_given_system(
        systems, SystemTask.UPSCALE, weights=request.weights_file, model=request.model
    )
    if name := request.system or given:
        return systems.load(name), []
    return choose_default(source, systems, request.on_nonfinite)


def collect_stamp_settings(
    request: UpscaleRequest, reading: PairReading, loaded: LoadedNetwork, run: NetworkRun
) -> object:
    """Plain values of everything that, beside the inputs, decides the outputs' bytes."""
    system, source = run.system, reading.source
    scale = source.scale
    return [
        system.name,
        scale,
        to_plain(loaded.config),
        asdict(system.derivation(loaded.config)),
        choose_tile_side(system, source.lr_size, scale, run.tile),
        [loaded.digest, run.precision.value] if loaded.weights else [],
        request.simulate_lr,
        request.samples_per_pixel,
        request.jitter,
        request.lr_filter,
        source.filter_width_px if reading.inputs.filter_known else None,
        request.on_nonfinite,
        request.passthrough,
    ]


def _name_outputs(name: str, reading: PairReading, request: UpscaleRequest) -> FrameOutputs:
    pictures = (PREVIEW_SUFFIX,) if request.previews else ()
    folder = request.out_folder / name
    return reading.plan_outputs(folder, COMMAND, pictures=pictures, debug=request.debug_buffers)


def _describe_details(
    system: System, reading: PairReading, passed_over: Sequence[PassedOver]
) -> dict[str, object]:
    source = reading.source
    (height, width), scale = source.lr_size, source.scale
    return {
        "system": system.name,
        "scale": scale,
        "lr_size": [width, height],
        "size": [width * scale, height * scale],
        BETTER: describe_passed_over(source, passed_over, system),
        FILTER: describe_filter_width(source, reading.inputs),
        FILTER_DOUBT: _describe_doubts(reading),
    }


def _describe_doubts(reading: PairReading) -> str:
    """What the frames say against a declared filter, and against each other."""
    source, inputs = reading.source, reading.inputs
    filtered = source.filter_doubt if inputs.filter_known else ""
    unlike = source.misfit_doubt if inputs.hr else ""
    return "; ".join(text for text in (filtered, unlike) if text)
