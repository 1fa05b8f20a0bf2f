"""What a person reads of a rendering run."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import ExitStack
from typing import Any

from tqdm import tqdm

from rtsr_cli.commands.interrupts import unwind_on_signals
from rtsr_cli.commands.log import LOG
from rtsr_cli.commands.options import emit
from rtsr_cli.core.frames.selection import format_ranges
from rtsr_cli.core.run.events import RunStarted
from rtsr_cli.core.synth.call import FileDone, SynthDone, SynthEvent, SynthPlanned


def follow_synthesis(events: Iterable[SynthEvent], *, as_json: bool) -> None:
    """Show plans, progress and the summary, as text or as JSON."""
    bar: Any = None
    with ExitStack() as running:
        for event in events:
            match event:
                case RunStarted():
                    running.enter_context(unwind_on_signals())
                    bar = tqdm(total=event.pending, unit="file", disable=None)
                    running.enter_context(bar)
                case FileDone():
                    bar.update(not event.kept)
                case SynthDone():
                    bar.close()
            if as_json:
                show_facts(event)
            else:
                show_text(event)


def show_facts(event: SynthEvent) -> None:
    """Print an event as JSON."""
    match event:
        case SynthPlanned():
            emit({"event": "plan", **event.facts})
        case FileDone():
            emit({"event": "file", **event.facts})
        case SynthDone():
            emit({"event": "done", **event.facts})


def show_text(event: SynthEvent) -> None:
    """Say what a person wants to know of an event."""
    match event:
        case SynthPlanned(plan=plan):
            height, width = plan.options.size
            LOG.info(
                "%s: seed %d, frames %s, %d x %d, %s; %d files to write, %d done already",
                plan.folder,
                plan.seed,
                format_ranges(plan.numbers),
                width,
                height,
                " ".join(plan.options.roles),
                len(plan.pending),
                event.files - len(plan.pending),
            )
        case SynthDone():
            LOG.info(
                "%s: %d written, %d kept, %.1f s",
                event.folder,
                event.written,
                event.kept,
                event.seconds,
            )
