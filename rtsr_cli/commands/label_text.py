"""What a person reads of labels."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
        LabelKind.CGTS: lambda plan: _describe_classes(plan.details),
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


def _describe_classes(details: Mapping[str, Any]) -> str:
    k = details["samples_per_pixel"]
    samples = f"{details['samples']} samples" if k is None else f"{k} x {k} samples"
    told = f", {samples} a pixel, geometry by {' and '.join(details['geometry'])}"
    told += "".join(f" (no {name}: {LACKING[name]})" for name in details["lacking"])
    return told


LACKING: Mapping[str, str] = {
    "normals": "colour alone tells texture aliasing",
    "camera": "surfaces are taken to keep their depth",
}
"""What is not there -> what that means for classes."""


def show_figures(request: LabelRequest) -> Callable[[object], None]:
    """Return what says which share of the pixels has which label."""
    show = {LabelKind.HOLES: _show_holes, LabelKind.CGTS: _show_classes}.get(request.kind)

    def conclude(event: object) -> None:
        if isinstance(event, RunFigures) and show is not None:
            show(event.total)

    return conclude


def _show_holes(total: Mapping[str, Any]) -> None:
    for past, shares in total.items():
        if isinstance(shares, Mapping) and shares["frames"]:
            parts = _list_shares(shares, WHOLE)
            LOG.info("%s: holes %.1f %% (%s)", past, 100 * shares["holes"], parts)


def _show_classes(total: Mapping[str, Any]) -> None:
    for part in ("ghosting", "aliasing"):
        shares = total[part]
        if shares["frames"]:
            LOG.info("%s: %s", part, _list_shares(shares, WHOLE))


def _list_shares(shares: Mapping[str, float], left_out: Sequence[str]) -> str:
    return ", ".join(
        f"{name} {share:.1%}" for name, share in shares.items() if name not in left_out
    )


WHOLE = ("frames", "holes")
"""Figures of a past frame that are no part of its holes."""
