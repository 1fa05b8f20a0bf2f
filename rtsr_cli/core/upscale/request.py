"""What `upscale` is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.choices import JitterMode, PixelFilter, Precision, Runtime
from rtsr_cli.core.errors import RequestError
from rtsr_cli.core.requests import check_ranges, check_runtime
from rtsr_cli.core.run.request import FramesRequest

SCALES, SIMULATED_SCALES, SAMPLES = (1, 16), (2, 16), (1, 16)
"""Least and most of `scale`, `simulate_lr` and `samples_per_pixel`."""


@dataclass(frozen=True, kw_only=True)
class UpscaleRequest(FramesRequest):
    """Reconstruct the frames of IN at a higher resolution.

    Attributes:
        system: name; None = that of the weights, else the best that the inputs allow.
        weights_file: None = those that come with rtsr.
        scale: output pixels per LR pixel; None = by the sizes of the frames.
        hr_folder: HR G-buffers of IN; None = `hr/` beside `lr/`.
        simulate_lr: S: IN is an HR capture, and LR frames are made from it by decimation.
        samples_per_pixel: K: the capture holds K x K samples of each output pixel; None = 1.
        jitter: which sample of a block is kept; None = the middle one.
        lr_filter: pixel filter of the simulated LR radiance; None = none.
        previews: a PNG beside each EXR.
        tile: side of tiles in LR pixels; 0 = never, None = by the frame's size.
        passthrough: patterns of input channels that are copied to the output.
        device: torch device; auto = cuda where there is one.
        precision: number format of network layers.
        debug_buffers: also write what the system saw and decided.
        runtime: what computes the network's layers.
        model: folder of exported files, of `runtime` onnx.
    """

    system: str | None = None
    weights_file: Path | None = None
    scale: int | None = None
    hr_folder: Path | None = None
    simulate_lr: int | None = None
    samples_per_pixel: int | None = None
    jitter: JitterMode | None = None
    lr_filter: PixelFilter | None = None
    previews: bool = False
    tile: int | None = None
    passthrough: tuple[str, ...] = ()
    device: str = "auto"
    precision: Precision = Precision.AUTO
    debug_buffers: bool = False
    runtime: Runtime = Runtime.TORCH
    model: Path | None = None

    def __post_init__(self) -> None:
        """Check what goes together.

        Raises:
            RequestError: a value is not among those that it may be, or the simulation is described,
                but not asked for.
        """
        super().__post_init__()
        check_runtime(self)
        check_ranges(self, scale=SCALES, simulate_lr=SIMULATED_SCALES, samples_per_pixel=SAMPLES)
        if self.simulate_lr is not None:
            return
        for name in ("samples_per_pixel", "jitter", "lr_filter"):
            if getattr(self, name) is not None:
                raise RequestError(f"--{name.replace('_', '-')} needs --simulate-lr")
