"""What a person reads of labels."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rtsr_cli.commands.log import LOG
from rtsr_cli.commands.options import describe_rates
from rtsr_cli.core.choices import LabelKind
from rtsr_cli.core.label.request import LabelRequest
from rtsr_cli.core.run.events import ShotPlanned
from rtsr_cli.core.run.figures import RunFigures


def describe_plan(request: LabelRequest) -> Callable[[ShotPlanned], str]:
    """Return what is said of a plan of a request."""
    return {
        LabelKind.VRS: lambda plan: _describe_rate_errors(request, plan.details),
        LabelKind.HOLES: lambda plan: _describe_holes(plan.details),
    }[request.kind]


def _describe_rate_errors(request: LabelRequest, details: Mapping[str, Any]) -> str:
    rates = describe_rates(details["captured_rates"])
    return f", {request.metric}, tiles of {request.tile}, {rates}"


def _describe_holes(details: Mapping[str, Any]) -> str:
    cadence = "" if details["rendered"] is None else f", {details['rendered']} rendered"
    told = f"{cadence}, holes by {', '.join(details['tests'])}"
    if not details["lacking"]:
        return told
    lacking = " and no ".join(details["lacking"])
    return f"{told} (no {lacking}: the depth along motion stands in)"


def show_figures(event: object) -> None:
    """Say which share of the pixels past frames do not show."""
    if not isinstance(event, RunFigures):
        return
    for past, shares in event.total.items():
        if isinstance(shares, Mapping) and shares["frames"]:
            parts = ", ".join(
                f"{name} {share:.1%}" for name, share in shares.items() if name not in WHOLE
            )
            LOG.info("%s: holes %.1f %% (%s)", past, 100 * shares["holes"], parts)


WHOLE = ("frames", "holes")
"""Figures of a past frame that are no part of its holes."""
