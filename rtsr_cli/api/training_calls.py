"""`train` with the systems that there are."""

from __future__ import annotations

from collections.abc import Iterator

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.training import training
from rtsr_cli.core.training.events import TrainEvent
from rtsr_cli.core.training.request import TrainRequest
from rtsr_cli.models import load_system

BASELINES = {SystemTask.EXTRAPOLATE: "warp-guided"}
BASELINE = "demod-bicubic"
"""What pictures and validation show beside the network, for a task and for the others."""


def train(request: TrainRequest) -> Iterator[TrainEvent]:
    """Train, or pack crops; the last event is `TrainingDone` or `ClipsPacked`.

    Raises:
        RtsrError: a setting, an input or the weights to start from are refused, a loss is not
            finite, or nothing can be written.
    """
    system = load_system(request.system)
    baseline = BASELINES.get(system.task, BASELINE)
    yield from training.train(request, system, lambda: load_system(baseline))
