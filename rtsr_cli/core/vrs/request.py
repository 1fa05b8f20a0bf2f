"""What `predict-vrs` is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.choices import Estimator, Runtime, VrsMetric
from rtsr_cli.core.requests import check_runtime
from rtsr_cli.core.run.request import FramesRequest


@dataclass(frozen=True, kw_only=True)
class PredictVrsRequest(FramesRequest):
    """Predict the error of each shading rate in each tile of IN's frames, and choose rates.

    Attributes:
        system: that predicts errors; None = the first that does.
        tile: side of a tile, pixels; None = 16.
        metric: of errors; None = JNFLIP.
        threshold: error that a rate must stay below, in the metric's unit; None = the weights'.
        analytic_threshold: the same for the analytic estimate, in its own unit.
        estimator: what decides.
        weights_file: None = those that come with rtsr.
        margin: added to predictions, 0..1; None = the underestimation on validation.
        reuse: decide which tiles may keep the frame before, in place of rates.
        overlays: a PNG of the frame under its rates.
        no_compare: do not measure the true errors.
        device: torch device; auto = cuda where there is one.
        runtime: what computes the network's layers.
        model: folder of exported files, of `runtime` onnx.
    """

    system: str | None = None
    tile: int | None = None
    metric: VrsMetric | None = None
    threshold: float | None = None
    analytic_threshold: float | None = None
    estimator: Estimator = Estimator.NETWORK
    weights_file: Path | None = None
    margin: float | None = None
    reuse: bool = False
    overlays: bool = False
    no_compare: bool = False
    device: str = "auto"
    runtime: Runtime = Runtime.TORCH
    model: Path | None = None

    def __post_init__(self) -> None:
        """Check what goes together.

        Raises:
            RequestError: a value is not among those that it may be, or exported files are named
                that nothing reads.
        """
        super().__post_init__()
        check_runtime(self)
