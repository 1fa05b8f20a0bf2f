"""Running a system's network over the frames of a shot, in order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import nn

from rtsr_cli.core.choices import Precision
from rtsr_cli.core.network.precision import DTYPES
from rtsr_cli.core.network.tiling import choose_tile_side, predict_in_tiles
from rtsr_cli.core.run.frame_pairs import FrameInTurn
from rtsr_cli.core.shapes import Image
from rtsr_cli.core.system import Prediction, State, System


@dataclass(frozen=True, kw_only=True)
class NetworkRun:
    """How a system's network is run.

    Attributes:
        system: whose it is.
        network: on its device.
        device: torch device.
        precision: of the layers; baselines have none.
        tile: side of tiles in LR pixels; 0 = never, None = by the frame's size.
    """

    system: System
    network: nn.Module
    device: str = "cpu"
    precision: Precision = Precision.FP32
    tile: int | None = None


class Predictor:
    """Predicts the frames of a shot in order, and carries what the system keeps of them."""

    def __init__(self, run: NetworkRun) -> None:
        """Start without a state."""
        self._run = run
        self._state: State = None

    def predict(self, moment: FrameInTurn) -> Prediction:
        """Predict a frame; where history begins, without a state."""
        run, window = self._run, moment.window
        state = None if moment.begins else self._state
        side = choose_tile_side(run.system, window.current.size, window.scale, run.tile)
        computes = any(True for _ in run.network.parameters())
        cast = DTYPES.get(run.precision) if computes else None
        device = torch.device(run.device)
        with torch.inference_mode(), torch.autocast(device.type, cast, enabled=cast is not None):
            prediction = predict_in_tiles(run.system, run.network, window, state, side)
        self._state = prediction.state
        return prediction

    def predict_if_due(self, moment: FrameInTurn) -> Prediction | None:
        """Predict a frame that is wanted, or whose state the next one may go on with."""
        due = moment.wanted or self._run.system.carries_history
        return self.predict(moment) if due else None


def list_debug_pictures(moment: FrameInTurn, prediction: Prediction) -> Mapping[str, Image]:
    """Pictures for `--debug-buffers`: the system's; of one that has none, what it saw."""
    return prediction.debug or {b.value: image for b, image in moment.pair.lr.gbuffer.items()}
