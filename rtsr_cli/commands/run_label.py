"""`rtsr label` after parsing: plans of every shot, one run, a summary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

from rtsr_cli.commands.basics import LOG
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
from rtsr_cli.core.choices import NonfinitePolicy, Pool, VrsMetric
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.io.atomic import check_writable
from rtsr_cli.core.io.beside import find_beside
from rtsr_cli.core.io.opening import open_single
from rtsr_cli.core.io.outputs import PREVIEW_SUFFIX
from rtsr_cli.core.io.pairs import Inputs
from rtsr_cli.core.labelling import VRS_LABELS, LabelConfig, Labeller
from rtsr_cli.core.planning import UpscaleOptions
from rtsr_cli.core.system import NoNetwork
from rtsr_cli.core.vrs.errors import ErrorConfig


def run_label(chosen: Mapping[str, Any]) -> int:
    """Plan every shot, then run; return the exit code."""
    error = ErrorConfig(
        metric=VrsMetric(chosen["metric"]),
        tile=chosen["tile"],
        pool=Pool(chosen["pool"]),
        env_luminance=chosen["env_luminance"],
    )
    if chosen["ppd"] is not None:
        error = replace(error, ppd=chosen["ppd"])
    config = LabelConfig(error=error, keep_edges=chosen["keep_edges"])
    options = UpscaleOptions(
        jobs=chosen["jobs"],
        overwrite=chosen["overwrite"],
        selection=selection(chosen),
        command="label",
        pictures=(PREVIEW_SUFFIX,) if chosen["previews"] else (),
    )
    base = Inputs(lr=(), on_nonfinite=NonfinitePolicy(chosen["on_nonfinite"]))
    inputs = planning.system_inputs(VRS_LABELS, base, config)
    read = read_options(chosen)
    policy = NonfinitePolicy(chosen["on_nonfinite"])
    opened = []
    for name, source in open_single(chosen["in_folder"], read):
        numbers = selection(chosen).of(source.reader.numbers)
        captured = find_beside(source, CAPTURED_NAMES, numbers, read, policy)
        opened.append((name, source, captured))
    plans = [
        planning.plan_shot(
            name,
            source,
            VRS_LABELS,
            inputs=inputs,
            folder=chosen["out_folder"] / name,
            options=options,
            config=[asdict(config), policy],
            beside=captured,
        )
        for name, source, captured in opened
    ]
    check_frames(chosen, [plan.source.reader for plan in plans])
    for plan, (_, source, captured) in zip(plans, opened, strict=True):
        if config.keep_edges and Buffer.OBJECT_ID not in source.reader.stored:
            LOG.warning("Warning: %s: no object ids, so that no edges are kept", plan.name)
        facts = plan_facts(plan.name, plan.source.readers, plan.selected, plan.pending)
        facts |= {
            "read_bytes": plan.read_bytes,
            "write_bytes_at_most": plan.write_bytes(options),
        }
        facts["captured_rates"] = labels(captured)
        what = f", {error.metric}, tiles of {error.tile}, {told(captured)}"
        announce(chosen, facts, plan.source.readers, plan.selected, what)
    if chosen["dry_run"]:
        return 0
    for plan in plans:
        check_writable(plan.folder)
    labeller = Labeller(config=config, previews=chosen["previews"])
    network = NoNetwork(config)
    events = until_stopped(
        upscaling.run_shot(plan, network, options, labeller.make) for plan in plans
    )
    with unwinding():
        return follow(chosen, events, sum(len(plan.pending) for plan in plans))
