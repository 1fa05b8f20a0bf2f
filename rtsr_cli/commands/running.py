"""What commands that read frames share after parsing; imported when they run, as it needs torch."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any

import torch

from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.io.opening import ReadOptions
from rtsr_cli.core.io.reading import FrameReader
from rtsr_cli.core.io.selection import Selection, Shard, ranges
from rtsr_cli.core.io.survey import MissingPolicy

LOG = logging.getLogger("rtsr")
"""What is said to a person; `-q` and `-v` set its level, `--json` takes its place."""

FAILED = 1
"""Exit code where some frames failed and the rest are done."""


def read_options(chosen: Mapping[str, Any]) -> ReadOptions:
    """Options of `reads_frames` as the library takes them."""
    return ReadOptions(
        layout=chosen["layout"],
        capture=chosen["capture_file"],
        on_missing=MissingPolicy(chosen["on_missing"]),
        output=chosen["out_folder"],
        sharded=chosen["shard"] is not None,
    )


def selection(chosen: Mapping[str, Any]) -> Selection:
    """`--frames` and `--shard`."""
    part = chosen["shard"]
    return Selection(
        frames=chosen["frames"], shard=Shard(index=part[0], count=part[1]) if part else None
    )


def device_named(name: str) -> str:
    """Resolve `auto`, and refuse a device that is not there.

    Raises:
        ConfigError: torch has no such device.
    """
    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    try:
        torch.empty(1, device=name)
    except (RuntimeError, AssertionError) as error:
        raise ConfigError(
            f"device '{name}' cannot be used ({str(error).splitlines()[0]}); choose --device cpu"
        ) from error
    return name


def warn_if_nothing(reader: FrameReader, selected: Sequence[int]) -> None:
    """Say so where `--frames` and `--shard` leave nothing of a shot; farms may overshoot."""
    if not selected:
        LOG.warning(
            "%s: nothing selected, its frames are %s", reader.frames.root, ranges(reader.numbers)
        )


def log_findings(reader: FrameReader) -> None:
    """Say what measurement contradicts, and what it decided."""
    for text in reader.warnings:
        LOG.warning("Warning: %s: %s", reader.frames.root, text)
    for text in reader.notes:
        LOG.info("    %s", text)


def log_binding(reader: FrameReader) -> None:
    """Say which channel of which file sequence is which buffer (`-v`)."""
    for buffer, components in reader.binding.items():
        places = ", ".join(
            f"{c.stream}: {c.channel}" if c.stream else c.channel for c in components
        )
        LOG.debug("    %s = %s", buffer, places)
