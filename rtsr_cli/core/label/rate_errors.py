"""Labels of `--kind vrs`: the true errors of shading rates, tile by tile."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import torch
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.files.pixel_window import PixelWindow as ExrWindow
from rtsr_cli.core.files.png import write_png
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.label.labelling import Labelling
from rtsr_cli.core.label.request import LabelRequest
from rtsr_cli.core.metrics.heat_map import heat_map
from rtsr_cli.core.pairs.auxiliary_radiance import find_auxiliary, join_planes
from rtsr_cli.core.pairs.sources import PairInputs, PairSource
from rtsr_cli.core.run.frame_pairs import FrameInTurn, read_options
from rtsr_cli.core.run.loop import Product
from rtsr_cli.core.run.outputs import PREVIEW_SUFFIX
from rtsr_cli.core.shapes import TileMap
from rtsr_cli.core.vrs.captured_rates import (
    CAPTURED_NAMES,
    list_captured_labels,
    measure_true_errors,
)
from rtsr_cli.core.vrs.decisions import name_error_channels
from rtsr_cli.core.vrs.rates import ShadingRate
from rtsr_cli.core.vrs.shading_error import ErrorConfig, to_amplitude

RATE_BUFFERS = (Buffer.COLOR,)
"""What cannot be done without."""


@dataclass(frozen=True, kw_only=True)
class LabelConfig:
    """What labels are made of.

    Attributes:
        error: metric and tiles.
        keep_edges: emulated rates keep pixels of other objects than the sample's.
    """

    error: ErrorConfig
    keep_edges: bool = False


@dataclass(frozen=True, kw_only=True)
class RateErrors:
    """Measures the errors of a frame's rates, and writes them.

    Attributes:
        config: what they are made of.
        previews: also a picture of the largest error of each tile.
    """

    config: LabelConfig
    previews: bool = False

    def __call__(self, moment: FrameInTurn) -> Product | None:
        """Measure; return what writes the labels.

        Raises:
            NonfiniteError: an error is NaN or Inf; the frame fails.
        """
        frame = moment.pair.lr
        color = frame.gbuffer[Buffer.COLOR]
        ids = frame.gbuffer.buffers.get(Buffer.OBJECT_ID) if self.config.keep_edges else None
        captured = join_planes(moment.passed, CAPTURED_NAMES)
        errors = measure_true_errors(color, self.config.error, captured=captured, object_id=ids)
        for rate, values in errors.items():
            moment.check_output(values, f"the error of rate {rate.label}")
        label = json.dumps(asdict(self.config), default=str)
        known = moment.provenance({"rtsr:label": label})
        channels = name_error_channels({rate.label: values for rate, values in errors.items()})
        path = moment.path
        picture = self._picture(errors) if self.previews else None

        def write() -> None:
            if picture is not None:
                write_png(path.with_suffix(PREVIEW_SUFFIX), picture)
            height, width = next(iter(channels.values())).shape
            area = ExrWindow(left=0, top=0, width=width, height=height)
            write_exr(path, channels, attributes=known, data_window=area, display_window=area)

        return moment.product(write)

    def _picture(self, errors: Mapping[ShadingRate, TileMap]) -> NDArray[Any]:
        """Heat of every rate's errors, side by side, a tile as wide as it is."""
        metric, tile = self.config.error.metric, self.config.error.tile
        maps = [to_amplitude(values, metric)[:, 0] for values in errors.values()]
        largest = max(float(values.quantile(0.99)) for values in maps) or 1.0
        heats = torch.cat([heat_map(values, largest) for values in maps], dim=-1)
        large = heats.repeat_interleave(tile, -2).repeat_interleave(tile, -1)
        pixels: NDArray[Any] = (large[0] * 255.0).round().byte().permute(1, 2, 0).cpu().numpy()
        return pixels


def declare_rate_labels(source: PairSource, request: LabelRequest) -> Labelling:
    """Return how the errors of rates of a shot are labelled.

    Raises:
        RtsrError: captured rates do not fit.
    """
    config, policy = label_config(request), request.on_nonfinite
    numbers = request.selection.of(source.reader.numbers)
    captured = find_auxiliary(source, CAPTURED_NAMES, numbers, read_options(request), policy)
    return Labelling(
        name="system 'vrs-labels'",
        inputs=PairInputs(
            lr=RATE_BUFFERS, lr_optional=(Buffer.OBJECT_ID, Buffer.ALPHA), on_nonfinite=policy
        ),
        work=RateErrors(config=config, previews=request.previews),
        settings=[asdict(config), policy],
        passed=captured,
        details={"captured_rates": list_captured_labels(captured)},
    )


def label_config(request: LabelRequest) -> LabelConfig:
    """Return what labels of a request are made of."""
    error = ErrorConfig(
        metric=request.metric,
        tile=request.tile,
        pool=request.pool,
        env_luminance=request.env_luminance,
    )
    if request.ppd is not None:
        error = replace(error, ppd=request.ppd)
    return LabelConfig(error=error, keep_edges=request.keep_edges)
