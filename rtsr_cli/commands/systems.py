"""`rtsr systems`: what there is, what it needs, what it comes with."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from rtsr_cli.commands import options as opt
from rtsr_cli.commands.log import show

if TYPE_CHECKING:
    from rtsr_cli.core.system_facts import SystemFacts

SHOWN = ("citation", "task", "needs", "uses", "scales", "history", "weights")
"""Facts that a person reads below a system's name, in this order."""


@click.command("systems")
@click.option(
    "--flops",
    is_flag=True,
    help="Also the multiply-accumulates of every network's convolutions, for a 1920x1080 output.",
)
@click.option(
    "--card",
    "subject",
    metavar="NAME|FILE",
    help="Print the card, as Markdown, of a system with its weights, or of a file of weights.",
)
@opt.as_json
def command(*, flops: bool, subject: str | None, as_json: bool) -> None:
    """List the systems: inputs, scales, parameters, weights."""
    from rtsr_cli.api import describe_systems, write_card

    if subject is not None:
        if flops or as_json:
            raise click.UsageError("--card is a page of text: give neither --json nor --flops")
        for line in write_card(subject).splitlines():
            show(line)
        return
    for facts in describe_systems(flops=flops):
        if as_json:
            opt.emit(encode_facts(facts))
        else:
            for line in list_text_lines(facts):
                show(line)


def encode_facts(facts: SystemFacts) -> dict[str, Any]:
    """Return the facts as plain values; costs only where they were counted."""
    plain = asdict(facts)
    return {name: value for name, value in plain.items() if value is not None}


def list_text_lines(facts: SystemFacts) -> list[str]:
    """Return lines for a person."""
    counts = ", ".join(f"{count:,} ({scale})" for scale, count in facts.parameters.items())
    shown = {name: getattr(facts, name) for name in SHOWN} | {"parameters": counts or "-"}
    lines = [f"{facts.name}: {facts.summary}"]
    lines += [f"    {name:<11}{value}" for name, value in shown.items()]
    for network in facts.networks or ():
        width, height = network.lr_size
        lines.append(
            f"    {network.variant} {network.scale}x from {width}x{height}: "
            f"{network.parameters:,} parameters, {network.gmac:.3f} GMAC"
        )
    return lines
