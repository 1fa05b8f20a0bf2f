"""What commands that still run in `run_*.py` speak through and run on."""

from __future__ import annotations

from rtsr_cli.commands.log import LOG as LOG
from rtsr_cli.core.devices import resolve_device as device_named

__all__ = ["LOG", "device_named"]
