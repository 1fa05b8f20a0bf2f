"""`inspect` with the commands and systems that there are."""

from __future__ import annotations

from collections.abc import Iterator

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.inspect import inspection
from rtsr_cli.core.inspect.checked_commands import (
    CheckedCommand,
    FrameUse,
    demand_buffers,
    list_training_demands,
    list_upscale_demands,
)
from rtsr_cli.core.inspect.events import InspectEvent
from rtsr_cli.core.inspect.request import InspectRequest
from rtsr_cli.core.label.call import COMMAND
from rtsr_cli.core.label.kinds import KINDS
from rtsr_cli.core.system import System
from rtsr_cli.core.vrs.predictor import ANALYTIC_INPUTS
from rtsr_cli.models import list_system_names, list_trainable_names, load_system


def inspect(request: InspectRequest) -> Iterator[InspectEvent]:
    """Inspect every shot of a folder; the last event is `InspectionDone`.

    Raises:
        RtsrError: no shots can be found. What is wrong with the frames of a shot is part of its
            inspection, and raises nothing.
    """
    yield from inspection.inspect(request, list_checked_commands())


def list_checked_commands() -> tuple[CheckedCommand, ...]:
    """Commands whose readiness is told, a row each."""
    return (
        CheckedCommand(
            name=SystemTask.UPSCALE.value,
            use=FrameUse.ENLARGED,
            demands=list_upscale_demands(_load_systems(SystemTask.UPSCALE)),
        ),
        CheckedCommand(
            name=SystemTask.EXTRAPOLATE.value,
            use=FrameUse.IN_TIME,
            demands=list_upscale_demands(_load_systems(SystemTask.EXTRAPOLATE)),
        ),
        CheckedCommand(
            name=SystemTask.PREDICT_VRS.value,
            use=FrameUse.ALONE,
            demands=(
                *list_upscale_demands(_load_systems(SystemTask.PREDICT_VRS)),
                demand_buffers("analytic", *ANALYTIC_INPUTS),
            ),
        ),
        CheckedCommand(
            name=COMMAND,
            use=FrameUse.ALONE,
            demands=tuple(demand_buffers(kind, *row.buffers) for kind, row in KINDS.items()),
        ),
        CheckedCommand(
            name="train",
            use=FrameUse.LEARNT,
            demands=list_training_demands(load_system(name) for name in list_trainable_names()),
        ),
        CheckedCommand(
            name="evaluate",
            use=FrameUse.ALONE,
            demands=(
                demand_buffers("pictures", Buffer.COLOR),
                demand_buffers("along motion", Buffer.COLOR, Buffer.MOTION),
                demand_buffers(
                    "by region", Buffer.COLOR, Buffer.DEPTH, Buffer.NORMAL, Buffer.MOTION
                ),
            ),
        ),
    )


def _load_systems(task: SystemTask) -> list[System]:
    return [load_system(name) for name in list_system_names(task)]
