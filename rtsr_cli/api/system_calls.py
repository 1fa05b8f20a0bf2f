"""The systems that there are, described."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rtsr_cli.core import system_facts
from rtsr_cli.core.cards import card
from rtsr_cli.core.errors import ConfigError, did_you_mean
from rtsr_cli.core.files.folders import is_file, is_folder
from rtsr_cli.core.network.weights import list_shipped, read_weights
from rtsr_cli.core.system_facts import SystemFacts
from rtsr_cli.models import list_system_names, load_system


def write_card(subject: str) -> str:
    """Write the card of a system with the weights that come along, or of a file of weights.

    Args:
        subject: name of a system, or path of weights.

    Returns:
        Markdown.

    Raises:
        ConfigError: there is neither such a system nor such a file; a folder is named as one.
        CheckpointError: the file holds no weights.
    """
    if subject in list_system_names():
        shipped = [read_weights(path) for path in list_shipped(subject)]
        return card.write_card(load_system(subject), shipped)
    path = Path(subject)
    if is_folder(path):
        raise ConfigError(
            f"{path}: a folder; a card is of a system or of a file of weights, such as "
            f"{path / 'best.safetensors'}"
        )
    if not is_file(path):
        hint = did_you_mean(subject, list_system_names())
        raise ConfigError(f"no system is called '{subject}'{hint}, and there is no such file")
    weights = read_weights(path)
    return card.write_card(load_system(weights.system), [weights])


def describe_systems(*, flops: bool = False) -> Iterator[SystemFacts]:
    """Describe one system after the other.

    Args:
        flops: also count the multiply-accumulates of every network's convolutions, for an output
            of 1920 x 1080.
    """
    systems = (load_system(name) for name in list_system_names())
    yield from system_facts.describe_systems(systems, flops=flops)
