"""`extrapolate`: from a request to predicted frames, event by event."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import asdict, replace

import torch

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.devices import resolve_device
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.extrapolate.prediction import Extrapolation
from rtsr_cli.core.extrapolate.request import ExtrapolateRequest
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.cadence import count_past, measure_reach
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.frames.selection import format_ranges
from rtsr_cli.core.network.exported import load_chosen_network
from rtsr_cli.core.network.load import LoadedNetwork
from rtsr_cli.core.pairs.lacking_frames import leave_out_lacking, list_needed_inputs
from rtsr_cli.core.pairs.opening import open_single_sets
from rtsr_cli.core.pairs.passthrough import find_passthrough
from rtsr_cli.core.pairs.sources import PairSource
from rtsr_cli.core.run.default_system import choose_default, describe_passed_over
from rtsr_cli.core.run.events import BETTER, FrameDone, RunDone, RunStarted, ShotPlanned
from rtsr_cli.core.run.frame_pairs import PairJob, PairReading, read_options
from rtsr_cli.core.run.given_network import name_given_system
from rtsr_cli.core.run.outputs import PREVIEW_SUFFIX
from rtsr_cli.core.run.plan import FrameOutputs, check_selection, plan_shot
from rtsr_cli.core.run.prediction import NetworkRun
from rtsr_cli.core.run.rendered_frames import split_by_cadence
from rtsr_cli.core.run.shot_inputs import HistoryReach
from rtsr_cli.core.run.shot_runs import run_shots
from rtsr_cli.core.run.system_inputs import (
    SystemTable,
    check_inputs,
    resolve_system_inputs,
    resolve_unshaded_inputs,
)
from rtsr_cli.core.settings import to_plain
from rtsr_cli.core.system import System

COMMAND = "extrapolate"

RELEASE_EVERY = 16
"""Frames after which freed memory goes back to the system. Clearing what comes back took a third
of the time at 1280 x 720.
"""


def extrapolate_frames(
    request: ExtrapolateRequest, systems: SystemTable
) -> Iterator[ShotPlanned | RunStarted | FrameDone | RunDone]:
    """Plan every shot, then predict frame after frame.

    Args:
        request: what is asked for.
        systems: that may be used.

    Yields:
        A plan for every shot; unless it is a dry run, the start, an end for every frame, the end.

    Raises:
        RtsrError: before the first frame: an input is missing or wrong, an output is in the way;
            after the last event: nothing more can be written.
    """
    opened = open_whole(request, systems)
    jobs = [plan_extrapolation(name, source, request, systems) for name, source in opened]
    check_selection(request.selection, [job.plan.inputs for job, _ in jobs])
    for job, details in jobs:
        yield job.plan.announcement(details)
    if not request.dry_run:
        yield from run_shots([job for job, _ in jobs], request)


def open_whole(
    request: ExtrapolateRequest, systems: SystemTable
) -> Iterable[tuple[str, PairSource]]:
    """Survey every shot, but for frames that lack what the chosen system needs.

    Which system that is shows where all frames that lack anything are left out.
    """
    options = read_options(request, unrendered=True)

    def list_needed(whole: PairSource, without: PairSource) -> frozenset[Buffer]:
        rendered, _ = split_by_cadence(without.reader, request.cadence)
        system, _ = choose_extrapolator(request, without, systems, lambda system: "", rendered)
        shaded, predicted = split_by_cadence(whole.reader, request.cadence)
        read = (
            (resolve_system_inputs(system, request.on_nonfinite), shaded),
            (resolve_unshaded_inputs(system, request.on_nonfinite), predicted),
        )
        needed = (list_needed_inputs(whole, without, inputs, of) for inputs, of in read)
        return frozenset[Buffer]().union(*needed)

    return leave_out_lacking(
        lambda needed: open_single_sets(request.in_folder, replace(options, needed=needed)),
        request.on_missing,
        list_needed,
    )


def plan_extrapolation(
    name: str, source: PairSource, request: ExtrapolateRequest, systems: SystemTable
) -> tuple[PairJob, dict[str, object]]:
    """Check one shot; return its job, and what is told of it.

    Raises:
        RtsrError: an input is missing or wrong, an output is in the way.
    """
    numbers = source.reader.numbers
    rendered, predicted = split_by_cadence(source.reader, request.cadence)
    outputs_of = frozenset(numbers) if request.keep_rendered else predicted
    selected = [n for n in request.selection.of(numbers) if n in outputs_of]
    reach = measure_reach(numbers, rendered)
    nearest = list_read(numbers, selected, reach) & rendered
    _check_rendered(source, nearest)

    def refuse(system: System) -> str:
        return describe_other_cadence(system, numbers, rendered)

    system, better = choose_extrapolator(request, source, systems, refuse, nearest)
    device = resolve_device(request.device)
    loaded = load_chosen_network(system, 1, device, request.weights_file, request.model)
    loaded.check_size(source.lr_size)
    run = NetworkRun(
        system=system,
        network=loaded.network,
        device=device,
        precision=loaded.choose_precision(request.precision, torch.device(device)),
        tile=0,
    )
    frames = max(system.history_frames, reach)
    reading = read_without_radiance(
        source, system, request, (list_read(numbers, selected, frames), predicted), loaded.config
    )
    plan = plan_shot(
        reading.of_shot(name),
        _name_outputs(name, reading, request),
        settings=collect_stamp_settings(request, loaded, run, rendered),
        selection=request.selection,
        overwrite=request.overwrite,
        history=HistoryReach(frames=frames),
        outputs_of=outputs_of,
    )
    past = count_past(plan.sequence.runs(), rendered)
    work = Extrapolation(
        run,
        source,
        {n: past[n] for n in predicted},
        previews=request.previews,
        debug=request.debug_buffers,
    )
    job = PairJob(
        plan,
        reading,
        work,
        history_frames=frames,
        device=device,
        release_every=RELEASE_EVERY,
    )
    return job, _describe_details(system, source, (rendered, predicted), better)


def collect_stamp_settings(
    request: ExtrapolateRequest, loaded: LoadedNetwork, run: NetworkRun, rendered: frozenset[int]
) -> object:
    """Plain values of everything that, beside the inputs, decides the outputs' bytes."""
    return [
        run.system.name,
        to_plain(loaded.config),
        asdict(run.system.derivation(loaded.config)),
        [loaded.digest, run.precision.value] if loaded.weights else [],
        sorted(rendered),
        request.on_nonfinite,
        request.passthrough,
    ]


def _name_outputs(name: str, reading: PairReading, request: ExtrapolateRequest) -> FrameOutputs:
    pictures = (PREVIEW_SUFFIX,) if request.previews else ()
    folder = request.out_folder / name
    return reading.plan_outputs(folder, COMMAND, pictures=pictures, debug=request.debug_buffers)


def _describe_details(
    system: System,
    source: PairSource,
    frames: tuple[frozenset[int], frozenset[int]],
    better: str,
) -> dict[str, object]:
    """What is told of a shot; `frames` are the rendered ones and those to predict."""
    (height, width), (rendered, predicted) = source.lr_size, frames
    return {
        "system": system.name,
        "size": [width, height],
        "rendered": len(rendered),
        "predicted": len(predicted),
        BETTER: better,
    }


def read_without_radiance(
    source: PairSource,
    system: System,
    request: ExtrapolateRequest,
    frames: tuple[frozenset[int], frozenset[int]],
    config: object,
) -> PairReading:
    """Say what is read of rendered frames, and of the others, whose radiance never is.

    Args:
        source: of the frames.
        system: that reads them.
        request: what is asked for.
        frames: those that are read, and all that were not rendered.
        config: of the system.

    Raises:
        FrameFolderError: a buffer is missing.
    """
    read, predicted = frames
    inputs = resolve_system_inputs(system, request.on_nonfinite, config)
    unshaded = resolve_unshaded_inputs(system, request.on_nonfinite, config)
    reads = f"system '{system.name}'"
    for wanted, numbers in ((inputs, read - predicted), (unshaded, read & predicted)):
        check_inputs(reads, source, wanted, remedy=", or choose another --system", numbers=numbers)
    return PairReading(
        source=source,
        inputs=inputs,
        passed=find_passthrough(source, request.passthrough, radiance=False),
        unshaded=dict.fromkeys(sorted(predicted), unshaded),
    )


def choose_extrapolator(
    request: ExtrapolateRequest,
    source: PairSource,
    systems: SystemTable,
    refuse: Callable[[System], str],
    rendered: frozenset[int],
) -> tuple[System, str]:
    """Return the system asked for, that of the weights, or the first preferred one that can run.

    Beside it stands why it is no better one.

    Raises:
        FrameFolderError: it was not made for such frames.
    """
    given = name_given_system(
        systems, SystemTask.EXTRAPOLATE, weights=request.weights_file, model=request.model
    )
    name = request.system or given
    if name is None:
        system, passed_over = choose_default(
            source, systems, request.on_nonfinite, rendered, refuse=refuse
        )
        return system, describe_passed_over(source, passed_over, system)
    system = systems.load(name)
    if unfit := refuse(system):
        raise FrameFolderError(
            f"{source.reader.frames.root}: system '{system.name}' is {unfit}; leave --system out "
            "for one that takes them"
        )
    return system, ""


def describe_other_cadence(system: System, numbers: Sequence[int], rendered: frozenset[int]) -> str:
    """Say that frames are rendered in other distances than a system was made for; empty if not."""
    every = system.rendered_every
    if not every or measure_reach(numbers, rendered) < every:
        return ""
    return f"made for frames of which one in {every} is rendered"


def list_read(numbers: Sequence[int], selected: Collection[int], reach: int) -> frozenset[int]:
    """Return the frames that outputs depend on.

    Args:
        numbers: of all frames, ascending.
        selected: of the outputs.
        reach: frames that an output looks back.
    """
    places = {number: place for place, number in enumerate(numbers)}
    spans = ((max(0, places[number] - reach), places[number] + 1) for number in selected)
    return frozenset(n for start, end in spans for n in numbers[start:end])


def _check_rendered(source: PairSource, rendered: frozenset[int]) -> None:
    """Raise where frames that are to be rendered hold no radiance.

    Raises:
        FrameFolderError: names the folder, the frames, and what to say instead.
    """
    reader = source.reader
    without = reader.list_lacking(rendered, (Buffer.COLOR,)).get(Buffer.COLOR, ())
    if not without:
        return
    there = format_ranges(set(reader.cameras) - reader.unrendered).replace(", ", ",")
    raise FrameFolderError(
        f"{reader.frames.root}, {say_frames(without)}: buffer 'color' is missing, though "
        f"{'it counts' if len(without) == 1 else 'they count'} as rendered; render radiance there, "
        f"or name the frames that hold it with --rendered {there}"
    )
