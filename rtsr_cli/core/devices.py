"""Which device a run computes on."""

from __future__ import annotations

import torch

from rtsr_cli.core.errors import ConfigError


def resolve_device(name: str) -> str:
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
