"""Figures of a run's frames: kept in each output's header, gathered in one file of OUT.

Frames of earlier runs with the same settings count, too, so that a run that was cut off, run
again, ends in the same file.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtsr_cli.core.documents import parse_json
from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.files.atomic_write import write_text_atomically
from rtsr_cli.core.files.exr import read_header
from rtsr_cli.core.marks import MARKED
from rtsr_cli.core.run.plan import ShotPlan
from rtsr_cli.core.visible_text import make_all_visible

Figures = Mapping[str, Any]
Summarise = Callable[[Iterable[Figures]], dict[str, Any]]

SUMMARY = "summary.json"
"""File in OUT: figures of every frame that is done."""


@dataclass(frozen=True, kw_only=True)
class RunFigures:
    """Figures over every frame that is done, now or before.

    Attributes:
        path: of the file that holds them.
        total: means over all frames, by name.
    """

    path: Path
    total: Figures

    @property
    def facts(self) -> dict[str, Any]:
        """The figures as plain values."""
        return {"path": str(self.path), "total": dict(self.total)}


def read_figures(path: Path, attribute: str, config_hash: str) -> dict[str, Any] | None:
    """Figures that an output's header holds, None if it is not there or of other settings."""
    try:
        attributes = read_header(path).attributes
        if attributes.get("rtsr:configHash") != config_hash or attribute not in attributes:
            return None
        return dict(parse_json(str(attributes[attribute])))
    except (RtsrError, ValueError, TypeError):
        return None


def gather_figures(plans: Sequence[ShotPlan], attribute: str) -> dict[str, dict[str, Figures]]:
    """Shot -> number -> figures of every frame that is done.

    Args:
        plans: of the shots.
        attribute: of the header that holds them, as JSON.
    """
    shots: dict[str, dict[str, Figures]] = {}
    for plan in plans:
        config_hash = plan.stamps.config_hash
        known = {
            n: read_figures(plan.path(n), attribute, config_hash) for n in plan.sequence.numbers
        }
        shots[plan.inputs.name] = {str(n): facts for n, facts in known.items() if facts is not None}
    return shots


def write_figures(
    path: Path, options: Any, shots: Mapping[str, Mapping[str, Figures]], summarise: Summarise
) -> dict[str, Any]:
    """Write figures of all frames, with those of shots and of everything; return the latter.

    Args:
        path: of the file.
        options: plain values, how the figures were come by.
        shots: of `gather_figures`.
        summarise: figures of frames -> those of all of them.

    Raises:
        OutputError: it cannot be written.
    """
    total = summarise(facts for frames in shots.values() for facts in frames.values())
    content = {
        **MARKED,
        "options": json.loads(json.dumps(options, default=str)),
        "total": total,
        "shots": {
            name: {"total": summarise(frames.values()), "frames": frames}
            for name, frames in shots.items()
        },
    }
    write_text_atomically(path, json.dumps(make_all_visible(content), indent=1))
    return total
