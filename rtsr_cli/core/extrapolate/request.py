"""What `extrapolate` is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.choices import Precision, Runtime
from rtsr_cli.core.frames.cadence import Cadence, choose_cadence
from rtsr_cli.core.requests import check_runtime
from rtsr_cli.core.run.request import FramesRequest


@dataclass(frozen=True, kw_only=True)
class ExtrapolateRequest(FramesRequest):
    """Predict the frames of IN that were not rendered, from those before them and their G-buffers.

    Attributes:
        system: name; None = that of the weights, else the best that the inputs allow.
        weights_file: None = those that come with rtsr.
        every: the first frame is rendered, and every so many after it; None = 2.
        rendered: numbers of the rendered frames, in place of `every`.
        keep_rendered: also write the rendered frames, so that OUT is the whole sequence.
        passthrough: patterns of input channels, never radiance, that are copied to the output.
        previews: a PNG beside each EXR.
        device: torch device; auto = cuda where there is one.
        precision: number format of network layers.
        debug_buffers: also write what the system saw and decided.
        runtime: what computes the network's layers.
        model: folder of exported files, of `runtime` onnx.
    """

    system: str | None = None
    weights_file: Path | None = None
    every: int | None = None
    rendered: frozenset[int] | None = None
    keep_rendered: bool = False
    passthrough: tuple[str, ...] = ()
    previews: bool = False
    device: str = "auto"
    precision: Precision = Precision.AUTO
    debug_buffers: bool = False
    runtime: Runtime = Runtime.TORCH
    model: Path | None = None

    def __post_init__(self) -> None:
        """Check what goes together.

        Raises:
            RequestError: every frame would be rendered, or both ways to say which are given.
        """
        super().__post_init__()
        check_runtime(self)
        _ = self.cadence

    @property
    def cadence(self) -> Cadence:
        """Which frames are rendered."""
        return choose_cadence(self.every, self.rendered)
