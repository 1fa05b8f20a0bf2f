"""Files of predicted shading rates: EXR, shading-rate image, overlay, and figures of the run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.io.exr import Window as ExrWindow
from rtsr_cli.core.io.exr import read_header, write_exr
from rtsr_cli.core.io.outputs import image_channels
from rtsr_cli.core.io.png import write_png
from rtsr_cli.core.io.provenance import provenance
from rtsr_cli.core.shapes import Color, TileMap
from rtsr_cli.core.upscaling import Made
from rtsr_cli.core.vrs.errors import amplitude
from rtsr_cli.core.vrs.estimating import (
    Estimate,
    VrsOptions,
    chosen_errors,
    estimate,
    rate_shares,
    true_errors,
)
from rtsr_cli.core.vrs.rates import Rate, shaded_share
from rtsr_cli.core.vrs.reprojection import displayed

FACTS = "rtsr:vrs"
"""Header attribute: the figures of the frame, as JSON."""

RATE_SUFFIX, OVERLAY_SUFFIX = ".rate.png", ".overlay.png"

COLORS: Mapping[Rate, tuple[int, int, int]] = {
    Rate.FULL: (220, 50, 47),
    Rate.HALF_Y: (230, 140, 30),
    Rate.HALF_X: (220, 200, 40),
    Rate.HALF: (90, 180, 60),
    Rate.QUARTER_Y: (40, 170, 170),
    Rate.QUARTER_X: (50, 110, 210),
    Rate.QUARTER: (110, 60, 180),
}
"""Of the overlay: red is full rate, violet the cheapest."""

OVERLAY = 0.45
"""Opacity of the overlay."""


def error_channels(errors: Mapping[Rate, TileMap]) -> dict[str, NDArray[Any]]:
    """`error.<AxB>`, float."""
    return {
        f"error.{rate.label}": image_channels("e", values, "", full=True)["e"]
        for rate, values in errors.items()
    }


def overlay(color: Color, codes: TileMap, tile: int) -> NDArray[np.uint8]:
    """A frame with the colour of each tile's rate over it."""
    tint = torch.zeros(1, 3, *codes.shape[-2:])
    for rate, rgb in COLORS.items():
        value = torch.tensor(rgb).view(1, 3, 1, 1) / 255.0
        tint = torch.where(codes.cpu() == rate.code, value, tint)
    large = tint.repeat_interleave(tile, -2).repeat_interleave(tile, -1)
    shown = displayed(color).cpu()
    mixed = torch.lerp(shown, large[..., : shown.shape[-2], : shown.shape[-1]], OVERLAY)
    pixels: NDArray[np.uint8] = (mixed[0] * 255.0).round().byte().permute(1, 2, 0).numpy()
    return pixels


def figures(found: Estimate, color: Color | None, options: VrsOptions) -> dict[str, Any]:
    """What a frame's rates save, and what they cost."""
    metric = options.error.metric
    facts: dict[str, Any] = {
        "rates": rate_shares(found.codes),
        "shaded": shaded_share(found.codes),
        "seen": float(found.seen.mean()),
    }
    if color is None or not options.compare:
        return facts
    true = true_errors(color, options.error)
    worst = chosen_errors(true, found.codes, metric)
    limit = float(amplitude(torch.tensor(options.threshold), metric))
    facts |= {
        "true_error": float(worst.mean()),
        "missed": float((worst >= limit).float().mean()),
    }
    return facts


@dataclass(frozen=True, kw_only=True)
class Writer:
    """Makes the files of a frame.

    Attributes:
        options: how rates are decided.
        rates: that the network predicts.
        overlays: also a picture of the frame under its rates.
    """

    options: VrsOptions
    rates: tuple[Rate, ...]
    overlays: bool

    def make(self, made: Made) -> Callable[[], None]:
        """Decide, and return the call that writes."""
        plan, frame = made.plan, made.pair.lr
        window = made.window
        found = estimate(window, made.prediction.tiles, self.rates, self.options)
        color = frame.gbuffer.buffers.get(Buffer.COLOR)
        facts = figures(found, color, self.options)
        source = plan.source.reader.path(frame.number)
        known = provenance(
            command=made.options.command,
            config_hash=plan.config_hash,
            source=source,
            stamp=made.stamp,
            extra={
                "rtsr:system": plan.system.name,
                "rtsr:nonfinite": made.pair.fixed,
                FACTS: json.dumps(facts),
            },
        )
        channels = error_channels(found.errors) | image_channels("rate", found.codes, "")
        codes = found.codes[0].permute(1, 2, 0).cpu().to(torch.uint8).numpy()
        path = plan.path(frame.number)
        picture = None
        if self.overlays and color is not None:
            picture = overlay(color, found.codes, self.options.error.tile)

        def write() -> None:
            write_png(path.with_suffix(RATE_SUFFIX), codes)
            if picture is not None:
                write_png(path.with_suffix(OVERLAY_SUFFIX), picture)
            height, width, _ = codes.shape
            area = ExrWindow(left=0, top=0, width=width, height=height)
            write_exr(path, channels, attributes=known, data_window=area, display_window=area)

        return write


def figures_of(path: Path) -> dict[str, Any] | None:
    """Figures that an output's header holds, None if it is not there or holds none."""
    try:
        stored = read_header(path).attributes.get(FACTS)
        return None if stored is None else dict(json.loads(str(stored)))
    except (RtsrError, ValueError):
        return None


def summary(frames: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Means over frames; of what only some know, over those."""
    known = list(frames)
    found: dict[str, Any] = {"frames": len(known)}
    if not known:
        return found
    found["rates"] = {
        rate.label: sum(f["rates"][rate.label] for f in known) / len(known) for rate in Rate
    }
    for name in ("shaded", "seen", "true_error", "missed"):
        values = [f[name] for f in known if name in f]
        if values:
            found[name] = sum(values) / len(values)
    found["invocations_saved"] = 1.0 - found["shaded"]
    return found
