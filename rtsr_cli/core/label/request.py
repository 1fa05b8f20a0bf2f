"""What `label` is asked for."""

from __future__ import annotations

from dataclasses import dataclass

from rtsr_cli.core.choices import LabelKind, Pool, VrsMetric
from rtsr_cli.core.run.request import FramesRequest


@dataclass(frozen=True, kw_only=True)
class LabelRequest(FramesRequest):
    """Make training labels of the frames of IN.

    Attributes:
        kind: of labels.
        tile: side of a tile, pixels.
        metric: of errors.
        pool: of a tile's pixels.
        env_luminance: of the surroundings, in Weber's law.
        ppd: pixels per degree, for FLIP; 0 = by the image's width, None = the metric's default.
        keep_edges: emulated rates stop at other objects.
        previews: a PNG of the errors beside each EXR.
    """

    kind: LabelKind
    tile: int = 16
    metric: VrsMetric = VrsMetric.JNFLIP
    pool: Pool = Pool.MAX
    env_luminance: float = 1e-10
    ppd: float | None = None
    keep_edges: bool = False
    previews: bool = False
