"""`rtsr systems`: what there is, what it needs, what it comes with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from rtsr_cli.commands.options import as_json, emit
from rtsr_cli.models import system_names

if TYPE_CHECKING:
    from rtsr_cli.core.system import System


@click.command("systems")
@as_json
def command(*, as_json: bool) -> None:
    """List the systems: inputs, scales, parameters, weights."""
    from rtsr_cli.models import load_system

    for name in system_names():
        facts = describe(load_system(name))
        if as_json:
            emit(facts)
            continue
        click.echo(f"{facts['name']}: {facts['summary']}")
        for key in ("citation", "task", "needs", "uses", "scales", "history", "parameters"):
            click.echo(f"    {key:<11}{facts[key]}")


def describe(system: System) -> dict[str, object]:
    """Return the facts of a declaration as plain values."""
    scales = system.scales or ("any",)
    network = system.build(system.config(), system.scales[0] if system.scales else 4)
    history = "recurrent" if system.recurrent else f"{system.history_frames} frames"
    needs = [f"lr {b}" for b in system.lr_inputs] + [f"hr {b}" for b in system.hr_inputs]
    uses = [f"lr {b}" for b in system.lr_optional] + [f"hr {b}" for b in system.hr_optional]
    return {
        "name": system.name,
        "summary": system.summary,
        "citation": system.citation,
        "task": system.task.value,
        "needs": ", ".join(needs),
        "uses": ", ".join(uses) or "-",
        "scales": ", ".join(f"{s}x" if s != "any" else "any" for s in scales),
        "history": history,
        "parameters": sum(p.numel() for p in network.parameters()),
    }
