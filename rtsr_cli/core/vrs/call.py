"""`predict-vrs`: from a request to the rate of every tile, event by event."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from rtsr_cli.core.devices import resolve_device
from rtsr_cli.core.files.ownership import list_foreign, refuse_foreign
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.pairs.auxiliary_radiance import AuxiliaryRadiance, find_auxiliary
from rtsr_cli.core.pairs.lacking_frames import leave_out_lacking, list_needed_inputs
from rtsr_cli.core.pairs.opening import open_single_sets
from rtsr_cli.core.pairs.sources import PairInputs, PairSource
from rtsr_cli.core.run.events import FrameDone, RunDone, RunStarted, ShotPlanned
from rtsr_cli.core.run.figures import SUMMARY, RunFigures, gather_figures, write_figures
from rtsr_cli.core.run.frame_pairs import FrameInTurn, PairJob, PairReading, read_options
from rtsr_cli.core.run.plan import ShotPlan, check_selection, plan_shot
from rtsr_cli.core.run.prediction import NetworkRun, Predictor
from rtsr_cli.core.run.shot_inputs import HistoryReach
from rtsr_cli.core.run.shot_runs import run_shots
from rtsr_cli.core.run.system_inputs import (
    SystemTable,
    check_inputs,
    check_system,
    resolve_system_inputs,
)
from rtsr_cli.core.shapes import TileMap
from rtsr_cli.core.vrs.captured_rates import CAPTURED_NAMES, list_captured_labels
from rtsr_cli.core.vrs.decision_files import (
    FACTS,
    OVERLAY_SUFFIX,
    Decide,
    RateChoice,
    summarise_figures,
)
from rtsr_cli.core.vrs.decisions import RateDecider, ReuseDecider
from rtsr_cli.core.vrs.estimate import VrsOptions
from rtsr_cli.core.vrs.predictor import (
    ANALYTIC_INPUTS,
    ChosenPredictor,
    choose_predictor,
    make_rate_options,
)
from rtsr_cli.core.vrs.request import PredictVrsRequest

COMMAND = "predict-vrs"

RATE_SUFFIX, REUSE_SUFFIX = ".rate.png", ".keep.png"
"""Of the images for engines."""


@dataclass(frozen=True, kw_only=True)
class RatesSummary(RunFigures):
    """Figures over every frame that is done, now or before.

    Attributes:
        options: how rates were decided.
    """

    options: VrsOptions


VrsEvent = ShotPlanned | RunStarted | FrameDone | RunDone | RatesSummary


def predict_rates(request: PredictVrsRequest, systems: SystemTable) -> Iterator[VrsEvent]:
    """Plan every shot, then choose the rates of frame after frame.

    Args:
        request: what is asked for.
        systems: that predict errors of tiles.

    Yields:
        A plan for every shot; unless it is a dry run, the start, an end for every frame, the end,
        and the figures of all that is done.

    Raises:
        RtsrError: before the first frame: an input is missing or wrong, an output is in the way;
            after the last event: nothing more can be written.
    """
    device = resolve_device(request.device)
    chosen = choose_predictor(request, systems, device)
    options = make_rate_options(request, chosen)
    opened = list(open_whole(request, chosen))
    captured = [find_captured(source, request) for _, source in opened]
    jobs = [
        plan_prediction(name, source, rates, request=request, chosen=chosen, options=options)
        for (name, source), rates in zip(opened, captured, strict=True)
    ]
    check_selection(request.selection, [job.plan.inputs for job in jobs])
    if not request.overwrite:
        refuse_foreign(list_foreign([request.out_folder / SUMMARY]), f"rtsr {COMMAND}")
    for job, rates in zip(jobs, captured, strict=True):
        yield job.plan.announcement(_describe_details(options, rates))
    if not request.dry_run:
        yield from run_shots(jobs, request)
        yield from write_summary(request.out_folder, [job.plan for job in jobs], options)


def open_whole(
    request: PredictVrsRequest, chosen: ChosenPredictor
) -> Iterable[tuple[str, PairSource]]:
    """Survey every shot, but for frames that lack what the predictor needs."""
    inputs, options = resolve_prediction_inputs(request, chosen), read_options(request)
    return leave_out_lacking(
        lambda needed: open_single_sets(request.in_folder, replace(options, needed=needed)),
        request.on_missing,
        lambda whole, without: list_needed_inputs(whole, without, inputs),
    )


def find_captured(source: PairSource, request: PredictVrsRequest) -> tuple[AuxiliaryRadiance, ...]:
    """Find captured rates, with which true errors are measured."""
    if request.no_compare or Buffer.COLOR not in source.reader.stored:
        return ()
    wanted = request.selection.of(source.reader.numbers)
    read, policy = read_options(request), request.on_nonfinite
    return find_auxiliary(source, CAPTURED_NAMES, wanted, read, policy)


def resolve_prediction_inputs(request: PredictVrsRequest, chosen: ChosenPredictor) -> PairInputs:
    """Return what is read of a frame."""
    inputs = resolve_system_inputs(chosen.system, request.on_nonfinite, chosen.loaded.config)
    if not chosen.analytic:
        return inputs
    return _read_for_analytic(inputs)


ANALYTIC_REMEDY = ", or choose --estimator analytic, which needs less"
"""Said where a network lacks something, and the analytic estimate does not."""


def _read_for_analytic(inputs: PairInputs) -> PairInputs:
    return replace(inputs, lr=ANALYTIC_INPUTS, lr_optional=(Buffer.OBJECT_ID, Buffer.ALPHA))


def plan_prediction(
    name: str,
    source: PairSource,
    captured: tuple[AuxiliaryRadiance, ...],
    *,
    request: PredictVrsRequest,
    chosen: ChosenPredictor,
    options: VrsOptions,
) -> PairJob:
    """Check one shot.

    Raises:
        RtsrError: an input is missing or wrong, an output is in the way.
    """
    system, weights = chosen.system, (asdict(chosen.loaded.config), chosen.loaded.digest)
    inputs = resolve_prediction_inputs(request, chosen)
    chosen.loaded.check_size(source.lr_size)
    if chosen.analytic:
        check_inputs(f"system '{chosen.name}'", source, inputs)
    else:
        instead = "" if source.missing(_read_for_analytic(inputs)) else ANALYTIC_REMEDY
        check_system(system, source, inputs, remedy=instead)
    reading = PairReading(source=source, inputs=inputs, passed=captured)
    plan = plan_shot(
        reading.of_shot(name),
        # images of codes are a pixel a tile: they do not count
        replace(
            reading.plan_outputs(request.out_folder / name, COMMAND, pictures=()),
            pictures=_list_picture_suffixes(source, chosen, overlays=request.overlays),
        ),
        settings=[chosen.name, asdict(options), *weights, request.on_nonfinite],
        selection=request.selection,
        overwrite=request.overwrite,
        history=HistoryReach(frames=system.history_frames),
    )
    device = resolve_device(request.device)
    work = RateChoice(
        system=chosen.name,
        predict=_bind_tile_errors(chosen, device),
        decide=make_decider(options, chosen),
        tile=options.error.tile,
        suffix=_name_codes_suffix(chosen),
        overlays=request.overlays,
    )
    return PairJob(plan, reading, work, history_frames=system.history_frames, device=device)


def _bind_tile_errors(chosen: ChosenPredictor, device: str) -> Any:
    """Return what gives a frame's predicted errors; None of the analytic estimate."""
    if chosen.analytic:
        return lambda moment: None
    run = NetworkRun(system=chosen.system, network=chosen.loaded.network, device=device)
    predictor = Predictor(run)

    def predict(moment: FrameInTurn) -> TileMap | None:
        prediction = predictor.predict_if_due(moment)
        return None if prediction is None else prediction.tiles

    return predict


def make_decider(options: VrsOptions, chosen: ChosenPredictor) -> Decide:
    """What is decided, with T of the weights; the analytic estimate has another unit."""
    config, tiles, network = chosen.loaded.config, chosen.tiles, chosen.loaded.network
    if chosen.analytic:
        return RateDecider(options=options, rates=tiles.rates(config), transform=None)

    def transform(errors: TileMap) -> TileMap:
        return tiles.encode(errors.cpu(), network)

    if chosen.reuses:
        return ReuseDecider(options=options, transform=transform)
    return RateDecider(options=options, rates=tiles.rates(config), transform=transform)


def _name_codes_suffix(chosen: ChosenPredictor) -> str:
    """Suffix of the images for engines."""
    return REUSE_SUFFIX if chosen.reuses else RATE_SUFFIX


def _list_picture_suffixes(
    source: PairSource, chosen: ChosenPredictor, *, overlays: bool
) -> tuple[str, ...]:
    """PNGs that each frame of a shot gets: overlays lie over its radiance."""
    shown = overlays and Buffer.COLOR in source.reader.stored
    return (_name_codes_suffix(chosen), OVERLAY_SUFFIX) if shown else (_name_codes_suffix(chosen),)


def _describe_details(options: VrsOptions, captured: Sequence[AuxiliaryRadiance]) -> dict[str, Any]:
    return {
        "estimator": options.estimator,
        "metric": options.error.metric,
        "tile": options.error.tile,
        "threshold": options.threshold,
        "analytic_threshold": options.analytic.threshold,
        "captured_rates": list_captured_labels(captured),
    }


def write_summary(
    folder: Path, plans: Sequence[ShotPlan], options: VrsOptions
) -> Iterator[RatesSummary]:
    """Write summary.json over every frame that is done, now or before; none over none.

    Raises:
        OutputError: it cannot be written.
    """
    path, shots = folder / SUMMARY, gather_figures(plans, FACTS)
    if any(shots.values()):
        total = write_figures(path, asdict(options), shots, summarise_figures)
        yield RatesSummary(path=path, options=options, total=total)
