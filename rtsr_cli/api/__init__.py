"""The library as a notebook sees it: a request a task, and the call that takes it.

Nothing is imported before it is asked for. Calls yield what they did, frame by frame; they print
nothing and end no process, and what a user can cause is raised as an `RtsrError`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rtsr_cli.core.errors import RtsrError as RtsrError
    from rtsr_cli.core.evaluation.evaluation import evaluate as evaluate
    from rtsr_cli.core.evaluation.request import EvaluateRequest as EvaluateRequest

PLACES = {
    "EvaluateRequest": "rtsr_cli.core.evaluation.request",
    "RtsrError": "rtsr_cli.core.errors",
    "evaluate": "rtsr_cli.core.evaluation.evaluation",
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
