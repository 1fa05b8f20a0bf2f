"""`inspect` with the systems that there are."""

from __future__ import annotations

from collections.abc import Iterator

from rtsr_cli.core.inspect import inspection
from rtsr_cli.core.inspect.events import InspectEvent
from rtsr_cli.core.inspect.request import InspectRequest
from rtsr_cli.models import list_system_names, load_system


def inspect(request: InspectRequest) -> Iterator[InspectEvent]:
    """Inspect every shot of a folder; the last event is `InspectionDone`.

    Raises:
        RtsrError: no shots can be found. What is wrong with the frames of a shot is part of its
            inspection, and raises nothing.
    """
    yield from inspection.inspect(request, [load_system(name) for name in list_system_names()])
