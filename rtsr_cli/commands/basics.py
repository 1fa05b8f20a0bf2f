"""What every command speaks through and runs on; imports nothing that reads frames."""

from __future__ import annotations

import logging

import torch

from rtsr_cli.core.errors import ConfigError

LOG = logging.getLogger("rtsr")
"""What is said to a person; `-q` and `-v` set its level, `--json` takes its place."""


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
