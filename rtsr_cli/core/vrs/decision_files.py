"""Files of what was decided for a frame's tiles: EXR, codes, overlay, and figures of a run."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.files.pixel_window import PixelWindow as ExrWindow
from rtsr_cli.core.files.png import write_png
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.run.frame_pairs import FrameInTurn
from rtsr_cli.core.run.loop import Product
from rtsr_cli.core.shapes import Color, TileMap
from rtsr_cli.core.vrs.accuracy import average_accuracy, join_tallies, tallies_from_plain
from rtsr_cli.core.vrs.reprojection import encode_display

FACTS = "rtsr:vrs"
"""Header attribute: the figures of the frame, as JSON."""

TALLIES = "tallies"
"""Key of sums from which R^2 and mean errors of many frames follow."""

OVERLAY_SUFFIX = ".overlay.png"
OPACITY = 0.45
"""Of the overlay's colours."""

Transform = Callable[[TileMap], TileMap]
"""Errors to the space in which predicted and true ones are compared."""


@dataclass(frozen=True, kw_only=True)
class TileDecision:
    """What was decided for a frame.

    Attributes:
        channels: of the EXR, a pixel a tile.
        codes: 8-bit image for an engine, a pixel a tile.
        colors: of the overlay, 0..1, n 3 tiles-down tiles-across.
        facts: figures of the frame, plain values.
    """

    channels: Mapping[str, NDArray[Any]]
    codes: TileMap
    colors: TileMap
    facts: Mapping[str, Any]


Decide = Callable[[FrameInTurn, TileMap | None], TileDecision]


@dataclass(frozen=True, kw_only=True)
class RateChoice:
    """Chooses a frame's rates, and writes them.

    Attributes:
        system: name of what predicts.
        predict: a frame's errors, None where none are predicted.
        decide: what is written.
        tile: side of a tile, pixels.
        suffix: of the code image.
        overlays: also a picture of the frame under its decisions.
    """

    system: str
    predict: Callable[[FrameInTurn], TileMap | None]
    decide: Decide
    tile: int
    suffix: str
    overlays: bool

    def __call__(self, moment: FrameInTurn) -> Product | None:
        """Predict and decide; return what writes the decisions."""
        predicted = self.predict(moment)
        if predicted is not None:
            moment.check_output(predicted, f"system '{self.system}'")
        if not moment.wanted:
            return None
        frame = moment.pair.lr
        decision = self.decide(moment, predicted)
        for name, plane in decision.channels.items():
            moment.check_output(torch.from_numpy(plane), f"system '{self.system}', '{name}',")
        facts = {"rtsr:system": self.system, FACTS: json.dumps(decision.facts)}
        known = moment.provenance(facts)
        codes = decision.codes[0].permute(1, 2, 0).cpu().to(torch.uint8).numpy()
        path = moment.path
        color = frame.gbuffer.buffers.get(Buffer.COLOR)
        picture = None
        if self.overlays and color is not None:
            picture = draw_overlay(color, decision.colors, self.tile)

        def write() -> None:
            write_png(path.with_suffix(self.suffix), codes)
            if picture is not None:
                write_png(path.with_suffix(OVERLAY_SUFFIX), picture)
            height, width, _ = codes.shape
            area = ExrWindow(left=0, top=0, width=width, height=height)
            write_exr(
                path, decision.channels, attributes=known, data_window=area, display_window=area
            )

        return moment.product(write)


def draw_overlay(color: Color, colors: TileMap, tile: int) -> NDArray[np.uint8]:
    """A frame with a colour over each tile."""
    large = colors.cpu().repeat_interleave(tile, -2).repeat_interleave(tile, -1)
    shown = encode_display(color).cpu()
    mixed = torch.lerp(shown, large[..., : shown.shape[-2], : shown.shape[-1]], OPACITY)
    pixels: NDArray[np.uint8] = (mixed[0] * 255.0).round().byte().permute(1, 2, 0).numpy()
    return pixels


def summarise_figures(frames: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Means over frames; of what only some know, over those."""
    known = list(frames)
    means: dict[str, Any] = {"frames": len(known)}
    if not known:
        return means
    shares = [f["shares"] for f in known]
    means["shares"] = {
        name: sum(each.get(name, 0.0) for each in shares) / len(known) for name in shares[0]
    }
    for name in ("shaded", "seen", "predicted_error", "true_error", "missed"):
        values = [f[name] for f in known if name in f]
        if values:
            means[name] = sum(values) / len(values)
    means["invocations_saved"] = 1.0 - means["shaded"]
    return means | average_accuracy(
        join_tallies(tallies_from_plain(f[TALLIES]) for f in known if TALLIES in f)
    )
