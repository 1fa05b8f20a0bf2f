"""`export` with the systems that there are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rtsr_cli.models import load_system

if TYPE_CHECKING:
    from rtsr_cli.core.export.call import ExportEvent
    from rtsr_cli.core.export.request import ExportRequest


def export(request: ExportRequest) -> Iterator[ExportEvent]:
    """Write a network as ONNX files and a manifest; see `export_network`."""
    from rtsr_cli.core.export.call import export_network

    return export_network(request, load_system)
