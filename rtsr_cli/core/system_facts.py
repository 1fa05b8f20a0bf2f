"""What there is to say of a system: its inputs, scales, weights, and what its networks cost."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.network.cost import count_macs, count_parameters
from rtsr_cli.core.network.load import find_shipped_weights
from rtsr_cli.core.system import System

OUTPUT_SIZE = (1080, 1920)
"""(height, width) that multiply-accumulates are counted for."""

GIGA = 1e9

NONE = "-"
"""Stands where there is nothing to name."""


@dataclass(frozen=True, kw_only=True)
class NetworkCost:
    """What one network of a system costs.

    Attributes:
        variant: name of its config.
        scale: S.
        lr_size: (width, height) of the LR frame that is counted for.
        parameters: how many there are.
        gmac: multiply-accumulates of its convolutions, in 1e9 a frame.
    """

    variant: str
    scale: int
    lr_size: tuple[int, int]
    parameters: int
    gmac: float


@dataclass(frozen=True, kw_only=True)
class SystemFacts:
    """A system's declaration, in words.

    Attributes:
        name: of the system.
        summary: what it does.
        citation: where it is published.
        task: what it makes of frames.
        needs: buffers that it must have, "lr" or "hr" before each, "unshaded" before those of
            frames that were not rendered.
        uses: buffers that it uses where they are there.
        scales: that it is made for.
        history: frames before the current one that it reads.
        weights: scales that it comes with weights for.
        parameters: scale -> parameters of its default network; empty if it has none.
        networks: what each of its networks costs; None where that was not asked for.
    """

    name: str
    summary: str
    citation: str
    task: str
    needs: str
    uses: str
    scales: str
    history: str
    weights: str
    parameters: Mapping[str, int] = field(default_factory=dict)
    networks: tuple[NetworkCost, ...] | None = None


def describe_systems(systems: Iterable[System], *, flops: bool = False) -> Iterator[SystemFacts]:
    """Describe one system after the other.

    Args:
        systems: to describe.
        flops: also count what their networks cost.
    """
    for system in systems:
        yield describe_system(system, flops=flops)


def describe_system(system: System, *, flops: bool = False) -> SystemFacts:
    """Return the facts of a declaration."""
    needs = _list_inputs(system.lr_inputs, system.hr_inputs, system.unshaded_inputs)
    uses = _list_inputs(system.lr_optional, system.hr_optional, system.unshaded_optional)
    weights = [f"{s}x" for s in system.scales if find_shipped_weights(system, s) is not None]
    return SystemFacts(
        name=system.name,
        summary=system.summary,
        citation=system.citation,
        task=system.task.value,
        needs=", ".join(needs),
        uses=", ".join(uses) or NONE,
        scales=", ".join(f"{s}x" for s in system.scales) or "any",
        history="recurrent" if system.recurrent else f"{system.history_frames} frames",
        weights=", ".join(weights) or NONE,
        parameters=default_parameters(system),
        networks=measure_network_costs(system) if flops else None,
    )


def _list_inputs(
    lr: Iterable[Buffer], hr: Iterable[Buffer], unshaded: Iterable[Buffer]
) -> list[str]:
    sizes = {"lr": lr, "hr": hr, "unshaded": unshaded}
    return [f"{size} {b}" for size, buffers in sizes.items() for b in buffers]


def list_network_scales(system: System) -> tuple[int, ...]:
    """Scales that a system has a network for; none if it has no network."""
    if system.learning is None:
        return ()
    return system.scales if system.task is SystemTask.UPSCALE else (1,)


def default_parameters(system: System) -> dict[str, int]:
    """Parameters of the default network by scale."""
    config = system.config()
    return {
        f"{scale}x": count_parameters(system.build(config, scale))
        for scale in list_network_scales(system)
    }


def measure_network_costs(system: System) -> tuple[NetworkCost, ...]:
    """What every network of a system costs: the default one, and others that it names."""
    variants = system.variants or {"default": system.config()}
    return tuple(
        measure_network_cost(system, variant, config, scale)
        for variant, config in variants.items()
        for scale in list_network_scales(system)
    )


def measure_network_cost(system: System, variant: str, config: Any, scale: int) -> NetworkCost:
    """Parameters and multiply-accumulates of one network."""
    height, width = (side // scale for side in OUTPUT_SIZE)
    return NetworkCost(
        variant=variant,
        scale=scale,
        lr_size=(width, height),
        parameters=count_parameters(system.build(config, scale)),
        gmac=count_macs(system, config, scale, (height, width)) / GIGA,
    )
