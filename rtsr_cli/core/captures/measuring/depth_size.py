"""Whether depth read by a layout's unit is of a size that frames have."""

from __future__ import annotations

from dataclasses import replace

from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.measuring.measured_reader import (
    MeasuredReader,
    add_warning,
    take_measurement,
)
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import DepthKind

FAR_M = 1000.0
"""Half of the surfaces farther than this: hardly a scene, rather another unit."""


def check_depth_size(settled: MeasuredReader, capture: CaptureDeclaration) -> MeasuredReader:
    """Warn of a median of kilometres; a unit that the layout is met with as well is read instead.

    Args:
        settled: so far; what cameras have measured holds.
        capture: what the user declares, which holds as well.
    """
    reader, median = settled.reader, settled.measured.median_depth
    depth = reader.conventions.depth
    if median is None or depth.kind is DepthKind.DEVICE or settled.measured.depth.best is not None:
        return settled
    size_m = median * depth.unit_m
    if Buffer.DEPTH not in reader.stored or size_m < FAR_M:
        return settled
    said = f"half of the depth is above {size_m / 1000.0:.3g} km at {depth.unit_m:g} m a unit"
    others = [unit for unit in reader.layout.other_depth_units if median * unit < FAR_M]
    if capture.depth.unit is not None or not others:
        return add_warning(settled, f"{said}; check [depth] unit in capture.toml")
    warned = add_warning(
        settled,
        f"{said}, as layout '{reader.layout.name}' has it: read as {others[0]:g} m a unit; declare "
        "[depth] unit in capture.toml if that is wrong",
    )
    changed = replace(depth, unit_m=others[0])
    note = f"depth measured: {others[0]:g} m a unit, by its size alone"
    return take_measurement(warned, "depth", note, depth=changed)
