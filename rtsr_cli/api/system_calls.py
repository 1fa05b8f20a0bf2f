"""The systems that there are, described."""

from __future__ import annotations

from collections.abc import Iterator

from rtsr_cli.core import system_facts
from rtsr_cli.core.system_facts import SystemFacts
from rtsr_cli.models import list_system_names, load_system


def describe_systems(*, flops: bool = False) -> Iterator[SystemFacts]:
    """Describe one system after the other.

    Args:
        flops: also count the multiply-accumulates of every network's convolutions, for an output
            of 1920 x 1080.
    """
    systems = (load_system(name) for name in list_system_names())
    yield from system_facts.describe_systems(systems, flops=flops)
