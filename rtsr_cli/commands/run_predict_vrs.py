"""`rtsr predict-vrs` after parsing: plans of every shot, one run, a summary."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch

from rtsr_cli.commands.basics import LOG, device_named
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
from rtsr_cli.core import planning, upscaling
from rtsr_cli.core.captured_rates import CAPTURED_NAMES, labels, told
from rtsr_cli.core.choices import Estimator, NonfinitePolicy, VrsMetric
from rtsr_cli.core.errors import CheckpointError, ConfigError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.io.atomic import check_writable, write_atomically
from rtsr_cli.core.io.beside import Beside, find_beside
from rtsr_cli.core.io.opening import ReadOptions, open_single
from rtsr_cli.core.io.pairs import Inputs, PairSource
from rtsr_cli.core.networks import Loaded, load_network, shipped_weights
from rtsr_cli.core.planning import ShotPlan, UpscaleOptions
from rtsr_cli.core.shading_files import OVERLAY_SUFFIX, Decide, Writer, figures_of, summary
from rtsr_cli.core.shading_rates import RateDecider, ReuseDecider
from rtsr_cli.core.shapes import TileMap
from rtsr_cli.core.system import NoNetwork, Prediction, System
from rtsr_cli.core.vrs.adaptive import AdaptiveConfig
from rtsr_cli.core.vrs.errors import ErrorConfig, amplitude
from rtsr_cli.core.vrs.estimating import VrsOptions
from rtsr_cli.core.weights import SHIPPED, read_weights
from rtsr_cli.models import load_system
from rtsr_cli.models.rt_percept.config import RtPerceptConfig
from rtsr_cli.models.rt_percept.transforms import restored, transformed

COMMAND = "predict-vrs"
SYSTEM = "rt-percept"

ANALYTIC_INPUTS = (Buffer.COLOR, Buffer.MOTION, Buffer.DEPTH, Buffer.NORMAL)
"""What the analytic estimate reads."""

SUMMARY = "summary.json"

RATE_SUFFIX, REUSE_SUFFIX = ".rate.png", ".keep.png"
"""Of the images for engines."""


def run_predict_vrs(chosen: Mapping[str, Any]) -> int:
    """Plan every shot, then run; return the exit code."""
    device = device_named(chosen["device"])
    system, loaded = _estimator(chosen, device)
    error = loaded.config.error
    options = VrsOptions(
        estimator=Estimator(chosen["estimator"]),
        error=error,
        threshold=chosen["threshold"] or loaded.config.limit,
        analytic=_analytic(chosen, error.tile),
        compare=not chosen["no_compare"],
        keep_edges=loaded.config.keep_edges,
    )
    _check_threshold(options, loaded)
    run = UpscaleOptions(
        device=device,
        jobs=chosen["jobs"],
        overwrite=chosen["overwrite"],
        selection=selection(chosen),
        command=COMMAND,
    )
    base = Inputs(lr=(), on_nonfinite=NonfinitePolicy(chosen["on_nonfinite"]))
    inputs = planning.system_inputs(system, base, loaded.config)
    read = read_options(chosen)
    policy = NonfinitePolicy(chosen["on_nonfinite"])
    opened = [
        (name, source, _captured(chosen, source, read, policy))
        for name, source in open_single(chosen["in_folder"], read)
    ]
    plans = [
        planning.plan_shot(
            name,
            source,
            system,
            inputs=inputs,
            folder=chosen["out_folder"] / name,
            options=_with_pictures(run, source, loaded.config, overlays=chosen["overlays"]),
            config=[
                asdict(options),
                asdict(loaded.config),
                loaded.digest,
                policy,
            ],
            beside=captured,
        )
        for name, source, captured in opened
    ]
    check_frames(chosen, [plan.source.reader for plan in plans])
    for plan, (_, _, captured) in zip(plans, opened, strict=True):
        _announce(chosen, plan, run, options, captured)
    if chosen["dry_run"]:
        return 0
    for plan in plans:
        check_writable(plan.folder)
    writer = Writer(
        decide=_decider(options, loaded),
        tile=error.tile,
        suffix=_codes_suffix(loaded.config),
        overlays=chosen["overlays"],
    )
    events = until_stopped(
        upscaling.run_shot(plan, loaded.network, run, writer.make) for plan in plans
    )
    with unwinding():
        code = follow(chosen, events, sum(len(plan.pending) for plan in plans))
    _summarise(chosen, plans, options)
    return code


def _codes_suffix(config: RtPerceptConfig) -> str:
    """Suffix of the images for engines."""
    return REUSE_SUFFIX if config.reuse else RATE_SUFFIX


def _with_pictures(
    run: UpscaleOptions, source: PairSource, config: RtPerceptConfig, *, overlays: bool
) -> UpscaleOptions:
    """Name the PNGs that each frame of a shot gets: overlays lie over its radiance."""
    shown = overlays and Buffer.COLOR in source.reader.stored
    pictures = (_codes_suffix(config), OVERLAY_SUFFIX) if shown else (_codes_suffix(config),)
    return replace(run, pictures=pictures)


def _analytic_alone(chosen: Mapping[str, Any], system: System) -> tuple[System, Loaded]:
    """Return a system that predicts nothing; frames need less for the analytic estimate."""
    error = ErrorConfig(
        metric=VrsMetric(chosen["metric"] or VrsMetric.JNFLIP), tile=chosen["tile"] or 16
    )
    for name in ("weights_file", "margin"):
        if chosen[name] is not None:
            option = name.removesuffix("_file")
            raise ConfigError(f"--{option}: the analytic estimate has none; leave it out")
    config = system.config(error=error)
    nothing = replace(
        system,
        name=Estimator.ANALYTIC.value,
        lr_inputs=ANALYTIC_INPUTS,
        lr_optional=(Buffer.OBJECT_ID,),
        predict=lambda network, window, state: Prediction(),
    )
    return nothing, Loaded(network=NoNetwork(config), config=config)


def _estimator(chosen: Mapping[str, Any], device: str) -> tuple[System, Loaded]:
    """Return the system and its network; the analytic estimate needs none."""
    system = load_system(SYSTEM)
    if chosen["reuse"] and chosen["estimator"] != Estimator.NETWORK:
        raise ConfigError(
            f"--reuse: only networks predict it; leave out --estimator {chosen['estimator']}"
        )
    if chosen["estimator"] == Estimator.ANALYTIC:
        return _analytic_alone(chosen, system)
    path = chosen["weights_file"] or _shipped(chosen)
    loaded = load_network(system, 1, device, path)
    error = loaded.config.error
    for name, value in (("metric", error.metric), ("tile", error.tile)):
        if chosen[name] is not None and chosen[name] != value:
            raise ConfigError(
                f"{path}: weights for --{name} {value}, not {chosen[name]}; leave --{name} out, or "
                "train others (rtsr train rt-percept)"
            )
    if loaded.config.reuse != chosen["reuse"]:
        raise ConfigError(
            f"{path}: weights for rates; leave --reuse out, or train others (rtsr train {SYSTEM} "
            "--set network.reuse=true)"
            if chosen["reuse"]
            else f"{path}: weights for reuse; add --reuse"
        )
    margin = chosen["margin"]
    if margin is None:
        margin = float(read_weights(path).about.get("validation", {}).get("under", 0.0))
    config = replace(loaded.config, margin=margin)
    loaded.network.config = config
    return system, replace(loaded, config=config)


def _captured(
    chosen: Mapping[str, Any], source: PairSource, read: ReadOptions, policy: NonfinitePolicy
) -> tuple[Beside, ...]:
    """Find captured rates, with which true errors are measured."""
    if chosen["no_compare"] or Buffer.COLOR not in source.reader.stored:
        return ()
    wanted = selection(chosen).of(source.reader.numbers)
    return find_beside(source, CAPTURED_NAMES, wanted, read, policy)


def _analytic(chosen: Mapping[str, Any], tile: int) -> AdaptiveConfig:
    """Settings of the analytic estimate.

    Raises:
        ConfigError: its threshold is given, but the network alone decides.
    """
    limit = chosen["analytic_threshold"]
    if limit is None:
        return AdaptiveConfig(tile=tile)
    if chosen["estimator"] == Estimator.NETWORK:
        raise ConfigError("--analytic-threshold: the network decides; add --estimator hybrid")
    return AdaptiveConfig(tile=tile, threshold=limit)


def _decider(options: VrsOptions, loaded: Loaded) -> Decide:
    """What is decided, with T of the weights; the analytic estimate has another unit."""
    config = loaded.config
    if options.estimator is Estimator.ANALYTIC:
        return RateDecider(options=options, rates=config.predicted, transform=None)
    mean = loaded.network.get_buffer("mean").cpu()

    def transform(errors: TileMap) -> TileMap:
        return transformed(errors.cpu(), mean, config)

    if config.reuse:
        return ReuseDecider(options=options, transform=transform)
    return RateDecider(options=options, rates=config.predicted, transform=transform)


def _check_threshold(options: VrsOptions, loaded: Loaded) -> None:
    """Refuse a threshold that no prediction can reach: every tile would get the cheapest rate.

    Raises:
        ConfigError: says what the weights can tell.
    """
    if options.estimator is Estimator.ANALYTIC:
        return
    mean = loaded.network.get_buffer("mean").cpu()
    worst = restored(torch.ones(1, 1, 1, 1), mean, loaded.config)
    metric = options.error.metric
    reach, asked = amplitude(worst, metric), amplitude(torch.tensor(options.threshold), metric)
    if float(asked) >= float(reach):
        raise ConfigError(
            f"--threshold {options.threshold:g}: these weights tell errors up to "
            f"{float(worst):.3g} ({metric}) apart; choose one below"
        )


def _shipped(chosen: Mapping[str, Any]) -> Path:
    metric, tile = chosen["metric"] or VrsMetric.JNFLIP.value, chosen["tile"] or 16
    error = ErrorConfig(metric=VrsMetric(metric), tile=tile)
    system = load_system(SYSTEM)
    path = shipped_weights(system, 1, system.config(error=error, reuse=chosen["reuse"]))
    if path is not None:
        return path
    there = sorted(p.stem.removeprefix(f"{SYSTEM}-") for p in SHIPPED.glob(f"{SYSTEM}-*"))
    raise CheckpointError(
        f"there are no weights for --metric {metric} --tile {tile}"
        f"{' --reuse' if chosen['reuse'] else ''} (there: "
        f"{', '.join(there) or 'none'}); train them (rtsr train {SYSTEM} DATA --out RUN --set "
        f"network.error.metric={metric} --set network.error.tile={tile}"
        f"{' --set network.reuse=true' if chosen['reuse'] else ''}) and give --weights "
        "RUN/best.safetensors, or use --estimator analytic"
    )


def _announce(
    chosen: Mapping[str, Any],
    plan: ShotPlan,
    run: UpscaleOptions,
    options: VrsOptions,
    captured: Sequence[Beside],
) -> None:
    facts = plan_facts(plan.name, plan.source.readers, plan.selected, plan.pending)
    facts |= {
        "estimator": options.estimator,
        "metric": options.error.metric,
        "tile": options.error.tile,
        "threshold": options.threshold,
        "analytic_threshold": options.analytic.threshold,
        "captured_rates": labels(captured),
        "read_bytes": plan.read_bytes,
        "write_bytes_at_most": plan.write_bytes(run),
    }
    side = "above" if options.error.metric is VrsMetric.PSNR else "below"
    limits = {
        Estimator.NETWORK: f"{options.error.metric} {side} {options.threshold:g}",
        Estimator.ANALYTIC: f"analytic estimate below {options.analytic.threshold:g}",
    }
    if options.estimator is Estimator.HYBRID:
        text = ", ".join(limits.values())
    else:
        text = limits[options.estimator]
    what = f", tiles of {options.error.tile}, {text}"
    if captured:
        what += f", {told(captured)}"
    announce(chosen, facts, plan.source.readers, plan.selected, what)


def _summarise(chosen: Mapping[str, Any], plans: list[ShotPlan], options: VrsOptions) -> None:
    """Write summary.json over every frame that is done, now or before."""
    shots = {}
    for plan in plans:
        # frames of earlier runs with the same settings count, too
        numbers = plan.source.reader.numbers
        known = {n: figures_of(plan.path(n), plan.config_hash) for n in numbers}
        shots[plan.name] = {str(n): facts for n, facts in known.items() if facts is not None}
    total = summary(facts for frames in shots.values() for facts in frames.values())
    text = json.dumps(
        {
            "options": json.loads(json.dumps(asdict(options), default=str)),
            "total": total,
            "shots": {
                name: {"total": summary(frames.values()), "frames": frames}
                for name, frames in shots.items()
            },
        },
        indent=1,
    )
    path = chosen["out_folder"] / SUMMARY
    write_atomically(path, lambda part: _write(part, text))
    if chosen["as_json"] or not total["frames"]:
        return
    shares = ", ".join(f"{name} {share:.1%}" for name, share in total["shares"].items() if share)
    LOG.info("shading invocations saved %.1f %% (%s)", 100 * total["invocations_saved"], shares)
    if "true_error" in total:
        LOG.info(
            "true error %.4f on average; %.2f %% of the tiles miss %s %g",
            total["true_error"],
            100 * total["missed"],
            options.error.metric,
            options.threshold,
        )
    if "r2" in total:
        LOG.info(
            "predicted against true errors: R2 %.3f, mean absolute error %.3f, under by %.3f",
            total["r2"],
            total["mae"],
            total["under"],
        )


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")
