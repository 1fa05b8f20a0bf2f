"""`label`: from a request to labels of rendered frames, event by event."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from rtsr_cli.core.choices import LabelKind
from rtsr_cli.core.files.ownership import list_foreign, refuse_foreign
from rtsr_cli.core.frames.buffers import RADIANCE_BUFFERS, Buffer
from rtsr_cli.core.label.class_labels import CLASS_BUFFERS
from rtsr_cli.core.label.kinds import KINDS, FigureKind
from rtsr_cli.core.label.request import LabelRequest
from rtsr_cli.core.pairs.lacking_frames import leave_out_lacking, list_needed_inputs
from rtsr_cli.core.pairs.opening import open_single_sets
from rtsr_cli.core.pairs.sampled_frames import open_sampled_frames
from rtsr_cli.core.pairs.sources import PairInputs, PairSource
from rtsr_cli.core.run.events import FrameDone, RunDone, RunStarted, ShotPlanned
from rtsr_cli.core.run.figures import SUMMARY, RunFigures, gather_figures, write_figures
from rtsr_cli.core.run.frame_pairs import PairJob, PairReading, read_options
from rtsr_cli.core.run.outputs import PREVIEW_SUFFIX
from rtsr_cli.core.run.plan import ShotPlan, check_selection, plan_shot
from rtsr_cli.core.run.shot_inputs import HistoryReach
from rtsr_cli.core.run.shot_runs import run_shots
from rtsr_cli.core.run.system_inputs import check_inputs

COMMAND = "label"

LabelEvent = ShotPlanned | RunStarted | FrameDone | RunDone | RunFigures


@dataclass(frozen=True, kw_only=True)
class LabelJob:
    """A planned shot, and what is told of it."""

    job: PairJob
    details: Mapping[str, Any]


def label_frames(
    request: LabelRequest,
) -> Iterator[LabelEvent]:
    """Plan every shot, then label frame after frame.

    Yields:
        A plan for every shot; unless it is a dry run, the start, an end for every frame, the end,
        and figures of all that is done where the kind of labels has any.

    Raises:
        RtsrError: before the first frame: an input is missing or wrong, an output is in the way;
            after the last event: nothing more can be written.
    """
    opened = open_whole(request)
    planned = [plan_labelling(name, source, request) for name, source in opened]
    plans = [each.job.plan for each in planned]
    check_selection(request.selection, [plan.inputs for plan in plans])
    figures = KINDS[request.kind].figures
    if figures is not None and not request.overwrite:
        refuse_foreign(list_foreign([request.out_folder / SUMMARY]), f"rtsr {COMMAND}")
    for each in planned:
        yield each.job.plan.announcement(each.details)
    if request.dry_run:
        return
    yield from run_shots([each.job for each in planned], request)
    if figures is not None:
        yield from _write_summary(request, figures, plans)


def open_whole(request: LabelRequest) -> Iterable[tuple[str, PairSource]]:
    """Survey every shot, but for frames that lack what labels are made of."""
    inputs = PairInputs(lr=KINDS[request.kind].buffers)
    return leave_out_lacking(
        lambda needed: open_shots(request, needed),
        request.on_missing,
        lambda whole, without: list_needed_inputs(whole, without, inputs),
    )


def open_shots(
    request: LabelRequest, needed: frozenset[Buffer] = frozenset()
) -> Iterator[tuple[str, PairSource]]:
    """Survey every shot of IN, as captures where a pixel has several samples.

    Args:
        request: what is asked for.
        needed: buffers without which frames are left out.
    """
    # labels that follow from G-buffers need no frame to be rendered
    unrendered = RADIANCE_BUFFERS.isdisjoint(KINDS[request.kind].buffers)
    options = replace(read_options(request, unrendered=unrendered), needed=needed)
    if request.kind is not LabelKind.CGTS:
        return open_single_sets(request.in_folder, options)
    return open_sampled_frames(request.in_folder, options, CLASS_BUFFERS, request.samples_per_pixel)


def plan_labelling(name: str, source: PairSource, request: LabelRequest) -> LabelJob:
    """Check one shot.

    Raises:
        RtsrError: an input is missing or wrong, an output is in the way.
    """
    made = KINDS[request.kind].declare(source, request)
    check_inputs(made.name, source, made.inputs)
    reading = PairReading(source=source, inputs=made.inputs, passed=made.passed)
    pictures = (PREVIEW_SUFFIX,) if request.previews else ()
    plan = plan_shot(
        reading.of_shot(name),
        reading.plan_outputs(request.out_folder / name, COMMAND, pictures=pictures),
        settings=made.settings,
        selection=request.selection,
        overwrite=request.overwrite,
        history=HistoryReach(frames=made.history_frames),
        outputs_of=made.outputs_of,
    )
    job = PairJob(plan, reading, made.work, history_frames=made.history_frames)
    return LabelJob(job=job, details=made.details)


def _write_summary(
    request: LabelRequest, kind: FigureKind, plans: list[ShotPlan]
) -> Iterator[RunFigures]:
    """Write summary.json over every frame that is done; none over none.

    Raises:
        OutputError: it cannot be written.
    """
    path = request.out_folder / SUMMARY
    shots = gather_figures(plans, kind.attribute)
    if any(shots.values()):
        total = write_figures(path, kind.options(request), shots, kind.summarise)
        yield RunFigures(path=path, total=total)
