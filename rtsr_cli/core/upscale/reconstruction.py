"""What `upscale` does with a frame: predict it, and write the picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import nn

from rtsr_cli.core.choices import Precision
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.resampling import upsample_bicubic
from rtsr_cli.core.io.outputs import OutputFrame
from rtsr_cli.core.io.pairs import PairSource
from rtsr_cli.core.io.provenance import color_tag
from rtsr_cli.core.precision import DTYPES
from rtsr_cli.core.run.frames import Moment
from rtsr_cli.core.run.loop import Product
from rtsr_cli.core.shapes import Image
from rtsr_cli.core.system import Prediction, State, System
from rtsr_cli.core.tiling import predict, tile_side


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

    def predict(self, moment: Moment) -> Prediction:
        """Predict a frame; where history begins, without a state."""
        run, window = self._run, moment.window
        state = None if moment.begins else self._state
        side = tile_side(run.system, window.current.size, window.scale, run.tile)
        computes = any(True for _ in run.network.parameters())
        cast = DTYPES.get(run.precision) if computes else None
        device = torch.device(run.device)
        with torch.inference_mode(), torch.autocast(device.type, cast, enabled=cast is not None):
            prediction = predict(run.system, run.network, window, state, side)
        self._state = prediction.state
        return prediction

    def predict_if_due(self, moment: Moment) -> Prediction | None:
        """Predict a frame that is wanted, or whose state the next one may go on with."""
        due = moment.wanted or self._run.system.carries_history
        return self.predict(moment) if due else None


class Reconstruction:
    """Predicts a shot's frames, and writes those that are wanted."""

    def __init__(self, run: NetworkRun, source: PairSource, *, previews: bool, debug: bool) -> None:
        """Start a shot.

        Args:
            run: how the network is run.
            source: of the pairs.
            previews: a PNG beside each EXR.
            debug: an EXR of what the system saw and decided.
        """
        self._predictor = Predictor(run)
        self._system, self._windows = run.system, source.output_window
        self._colorspace = source.reader.conventions.colorspace
        self._tag = color_tag(source.reader.conventions)
        self._previews, self._debug = previews, debug

    def __call__(self, moment: Moment) -> Product | None:
        """Predict a frame; return what writes it."""
        prediction = self._predictor.predict_if_due(moment)
        if not moment.wanted or prediction is None:
            return None
        return moment.product(self._picture(moment, prediction).write)

    def _picture(self, moment: Moment, prediction: Prediction) -> OutputFrame:
        """Return the output of a prediction.

        Raises:
            FrameFolderError: the system gave no image.
        """
        if prediction.image is None:
            raise FrameFolderError(f"{moment.source}: system '{self._system.name}' gave no image")
        known = moment.provenance({"rtsr:system": self._system.name, **self._tag})
        return OutputFrame(
            path=moment.path,
            color=prediction.image,
            alpha=enlarged_alpha(moment),
            attributes={**moment.attributes, **known},
            windows=self._windows,
            colorspace=self._colorspace,
            passed=moment.passed,
            previews=self._previews,
            debug=debug_pictures(moment, prediction) if self._debug else None,
        )


def enlarged_alpha(moment: Moment) -> Image | None:
    """Coverage at the target size, None where the frames hold none."""
    frame = moment.pair.lr
    alpha = frame.gbuffer.buffers.get(Buffer.ALPHA)
    if alpha is None:
        return None
    return upsample_bicubic(alpha, moment.window.scale, frame.camera.jitter_px).clamp(0.0, 1.0)


def debug_pictures(moment: Moment, prediction: Prediction) -> Mapping[str, Image]:
    """Pictures for `--debug-buffers`: the system's; of one that has none, what it saw."""
    return prediction.debug or {b.value: image for b, image in moment.pair.lr.gbuffer.items()}
