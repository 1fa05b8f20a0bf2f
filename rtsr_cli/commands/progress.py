"""Following a run over frames: plans, progress, failures, a summary, the exit code."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import ExitStack
from typing import Any

from tqdm import tqdm

from rtsr_cli.commands.exit_codes import FAILED
from rtsr_cli.commands.failures_text import Failures
from rtsr_cli.commands.interrupts import unwind_on_signals
from rtsr_cli.commands.log import LOG
from rtsr_cli.commands.options import emit
from rtsr_cli.commands.plan_text import log_pixel_findings, log_plan
from rtsr_cli.core.run.events import FrameDone, RunDone, RunStarted, ShotPlanned, Status
from rtsr_cli.core.run.figures import RunFigures
from rtsr_cli.core.run.request import FramesRequest


class Progress:
    """Shows a run's events, as text or as JSON, and knows its exit code."""

    def __init__(self, request: FramesRequest, *, as_json: bool) -> None:
        """Start.

        Args:
            request: of the run.
            as_json: print events as JSON, in place of what is said.
        """
        self._dry_run, self._as_json = request.dry_run, as_json
        self._bar: Any = None
        self._failures = Failures()
        self.code = 0

    def follow(
        self,
        events: Iterable[object],
        describe: Callable[[ShotPlanned], str] = lambda plan: "",
        conclude: Callable[[object], None] = lambda event: None,
    ) -> int:
        """Show every event; return the exit code.

        Args:
            events: of the run.
            describe: what is said of a plan between its frames and its counts.
            conclude: says more of a run's end; not called where events are printed as JSON.
        """
        with ExitStack() as running:
            # said of a run that is interrupted, too
            running.callback(self._show_repeats)
            for event in events:
                match event:
                    case ShotPlanned():
                        self._show_plan(event, describe)
                    case RunStarted():
                        running.enter_context(unwind_on_signals())
                        bar = tqdm(total=event.pending, unit="frame", disable=None)
                        self._bar = running.enter_context(bar)
                    case FrameDone():
                        self._show_frame(event)
                    case RunDone():
                        self._bar.close()
                        self._show_summary(event)
                    case RunFigures() if self._as_json:
                        emit({"event": "figures", **event.facts})
                if not self._as_json:
                    conclude(event)
        return self.code

    def _show_plan(self, plan: ShotPlanned, describe: Callable[[ShotPlanned], str]) -> None:
        if self._as_json:
            emit({"event": "plan", **plan.facts})
        else:
            log_plan(plan, describe(plan), estimate=self._dry_run)

    def _show_frame(self, frame: FrameDone) -> None:
        if frame.status is not Status.KEPT:
            self._bar.update()
        if self._as_json:
            emit({"event": "frame", **frame.facts})
            return
        failed = frame.status is Status.FAILED and not frame.stops
        if failed and self._failures.add(frame.shot, frame.number, frame.message):
            LOG.error("Failed: %s", frame.message)

    def _show_repeats(self) -> None:
        """Say of which other frames causes are that were said of one; once."""
        for line in self._failures.list_repeats():
            LOG.error("Failed: %s", line)
        self._failures = Failures()

    def _show_summary(self, done: RunDone) -> None:
        self.code = FAILED if done.failed else 0
        if self._as_json:
            emit({"event": "done", **done.facts})
            return
        self._show_repeats()
        listed = [f"{count} {status}" for status, count in done.counts.items()]
        took = [] if done.seconds is None else [f"{done.seconds:.1f} s"]
        LOG.info("%s: %s", done.folder, ", ".join([*listed, *took]))
        log_pixel_findings(done)
