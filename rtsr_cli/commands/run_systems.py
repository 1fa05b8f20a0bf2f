"""`rtsr systems` after parsing: facts of every declaration, as text or JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click

from rtsr_cli.commands.options import emit
from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.complexity import count_macs, count_parameters
from rtsr_cli.core.networks import shipped_weights
from rtsr_cli.core.system import System
from rtsr_cli.models import load_system, system_names

OUTPUT_SIZE = (1080, 1920)
"""(height, width) that multiply-accumulates are counted for."""

GIGA = 1e9


def run_systems(*, flops: bool, as_json: bool) -> None:
    """Print one system after the other."""
    for name in system_names():
        system = load_system(name)
        facts = describe(system)
        if flops:
            facts["networks"] = networks(system)
        if as_json:
            emit(facts)
        else:
            click.echo("\n".join(text(facts)))


def describe(system: System) -> dict[str, Any]:
    """Return the facts of a declaration as plain values."""
    scales = system.scales or ("any",)
    history = "recurrent" if system.recurrent else f"{system.history_frames} frames"
    needs = [f"lr {b}" for b in system.lr_inputs] + [f"hr {b}" for b in system.hr_inputs]
    uses = [f"lr {b}" for b in system.lr_optional] + [f"hr {b}" for b in system.hr_optional]
    weights = [f"{s}x" for s in system.scales if shipped_weights(system, s) is not None]
    return {
        "name": system.name,
        "summary": system.summary,
        "citation": system.citation,
        "task": system.task.value,
        "needs": ", ".join(needs),
        "uses": ", ".join(uses) or "-",
        "scales": ", ".join(f"{s}x" if s != "any" else "any" for s in scales),
        "history": history,
        "weights": ", ".join(weights) or "-",
        "parameters": parameters(system),
    }


def network_scales(system: System) -> tuple[int, ...]:
    """Scales that a system has a network for; none if it has no network."""
    if system.learning is None:
        return ()
    return system.scales if system.task is SystemTask.UPSCALE else (1,)


def parameters(system: System) -> dict[str, int]:
    """Parameters of the default network by scale."""
    config = system.config()
    return {
        f"{scale}x": count_parameters(system.build(config, scale))
        for scale in network_scales(system)
    }


def networks(system: System) -> list[dict[str, Any]]:
    """What every network of a system costs: the default one, and others that it names."""
    variants = system.variants or {"default": system.config()}
    return [
        cost(system, variant, config, scale)
        for variant, config in variants.items()
        for scale in network_scales(system)
    ]


def cost(system: System, variant: str, config: Any, scale: int) -> dict[str, Any]:
    """Parameters and multiply-accumulates of one network."""
    height, width = (side // scale for side in OUTPUT_SIZE)
    return {
        "variant": variant,
        "scale": scale,
        "lr_size": [width, height],
        "parameters": count_parameters(system.build(config, scale)),
        "gmac": count_macs(system, config, scale, (height, width)) / GIGA,
    }


def text(facts: Mapping[str, Any]) -> list[str]:
    """Lines for people."""
    counts = ", ".join(f"{count:,} ({scale})" for scale, count in facts["parameters"].items())
    shown = {**facts, "parameters": counts or "-"}
    keys = ("citation", "task", "needs", "uses", "scales", "history", "weights", "parameters")
    lines = [f"{facts['name']}: {facts['summary']}"]
    lines += [f"    {key:<11}{shown[key]}" for key in keys]
    for network in facts.get("networks", ()):
        width, height = network["lr_size"]
        lines.append(
            f"    {network['variant']} {network['scale']}x from {width}x{height}: "
            f"{network['parameters']:,} parameters, {network['gmac']:.3f} GMAC"
        )
    return lines
