"""The library as a notebook sees it: a request a task, and the call that takes it.

Nothing is imported before it is asked for. Calls yield what they did, frame by frame; they print
nothing and end no process, and what a user can cause is raised as an `RtsrError`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rtsr_cli.api.inspection import inspect as inspect
    from rtsr_cli.api.systems import describe_systems as describe_systems
    from rtsr_cli.api.training import train as train
    from rtsr_cli.core.errors import RtsrError as RtsrError
    from rtsr_cli.core.evaluation.evaluation import evaluate as evaluate
    from rtsr_cli.core.evaluation.request import EvaluateRequest as EvaluateRequest
    from rtsr_cli.core.inspect.request import InspectRequest as InspectRequest
    from rtsr_cli.core.lut.request import PrecomputeLutRequest as PrecomputeLutRequest
    from rtsr_cli.core.lut.table_file import precompute_lut as precompute_lut
    from rtsr_cli.core.training.request import TrainRequest as TrainRequest

PLACES = {
    "EvaluateRequest": "rtsr_cli.core.evaluation.request",
    "InspectRequest": "rtsr_cli.core.inspect.request",
    "PrecomputeLutRequest": "rtsr_cli.core.lut.request",
    "RtsrError": "rtsr_cli.core.errors",
    "TrainRequest": "rtsr_cli.core.training.request",
    "describe_systems": "rtsr_cli.api.systems",
    "evaluate": "rtsr_cli.core.evaluation.evaluation",
    "inspect": "rtsr_cli.api.inspection",
    "precompute_lut": "rtsr_cli.core.lut.table_file",
    "train": "rtsr_cli.api.training",
}
"""Name -> module that defines it; a test holds both lists to each other."""

__all__ = [*PLACES]


def __getattr__(name: str) -> Any:
    """Import what is asked for.

    Raises:
        AttributeError: there is no such request or call.
    """
    if name not in PLACES:
        raise AttributeError(f"rtsr_cli.api has no '{name}' (there are: {', '.join(PLACES)})")
    return getattr(import_module(PLACES[name]), name)
