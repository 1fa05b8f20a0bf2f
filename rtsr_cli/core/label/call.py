"""`label`: from a request to labels of rendered frames, event by event."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.label.rate_errors import LabelConfig, RateErrors
from rtsr_cli.core.label.request import LabelRequest
from rtsr_cli.core.pairs.auxiliary_radiance import find_auxiliary
from rtsr_cli.core.pairs.opening import open_single_sets
from rtsr_cli.core.pairs.sources import PairInputs, PairSource
from rtsr_cli.core.run.events import FrameDone, RunDone, RunStarted, ShotPlanned
from rtsr_cli.core.run.frame_pairs import PairJob, PairReading, read_options
from rtsr_cli.core.run.outputs import PREVIEW_SUFFIX
from rtsr_cli.core.run.plan import check_selection, plan_shot
from rtsr_cli.core.run.shot_runs import run_shots
from rtsr_cli.core.run.system_inputs import check_inputs
from rtsr_cli.core.vrs.captured_rates import CAPTURED_NAMES, list_captured_labels
from rtsr_cli.core.vrs.shading_error import ErrorConfig

COMMAND = "label"


def label_frames(
    request: LabelRequest,
) -> Iterator[ShotPlanned | RunStarted | FrameDone | RunDone]:
    """Plan every shot, then label frame after frame.

    Yields:
        A plan for every shot; unless it is a dry run, the start, an end for every frame, the end.

    Raises:
        RtsrError: before the first frame: an input is missing or wrong, an output is in the way;
            after the last event: nothing more can be written.
    """
    opened = open_single_sets(request.in_folder, read_options(request))
    jobs = [plan_labelling(name, source, request) for name, source in opened]
    check_selection(request.selection, [job.plan.inputs for job, _ in jobs])
    for job, details in jobs:
        yield job.plan.announcement(details)
    if not request.dry_run:
        yield from run_shots([job for job, _ in jobs], request)


def label_config(request: LabelRequest) -> LabelConfig:
    """Return what labels of a request are made of."""
    error = ErrorConfig(
        metric=request.metric,
        tile=request.tile,
        pool=request.pool,
        env_luminance=request.env_luminance,
    )
    if request.ppd is not None:
        error = replace(error, ppd=request.ppd)
    return LabelConfig(error=error, keep_edges=request.keep_edges)


def plan_labelling(
    name: str, source: PairSource, request: LabelRequest
) -> tuple[PairJob, dict[str, object]]:
    """Check one shot; return its job, and what is told of it.

    Raises:
        RtsrError: an input is missing or wrong, an output is in the way.
    """
    config, policy = label_config(request), request.on_nonfinite
    inputs = PairInputs(
        lr=(Buffer.COLOR,), lr_optional=(Buffer.OBJECT_ID, Buffer.ALPHA), on_nonfinite=policy
    )
    numbers = request.selection.of(source.reader.numbers)
    captured = find_auxiliary(source, CAPTURED_NAMES, numbers, read_options(request), policy)
    check_inputs("system 'vrs-labels'", source, inputs)
    reading = PairReading(source=source, inputs=inputs, passed=captured)
    pictures = (PREVIEW_SUFFIX,) if request.previews else ()
    plan = plan_shot(
        reading.of_shot(name),
        reading.plan_outputs(request.out_folder / name, COMMAND, pictures=pictures),
        settings=[asdict(config), policy],
        selection=request.selection,
        overwrite=request.overwrite,
    )
    job = PairJob(plan, reading, RateErrors(config=config, previews=request.previews))
    return job, {"captured_rates": list_captured_labels(captured)}
