"""What `label` is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

from rtsr_cli.core.choices import LabelKind, Pool, VrsMetric
from rtsr_cli.core.errors import RequestError
from rtsr_cli.core.frames.cadence import Cadence, choose_cadence
from rtsr_cli.core.run.request import FramesRequest

SETTINGS: Mapping[LabelKind, tuple[str, ...]] = {
    LabelKind.VRS: ("tile", "metric", "pool", "env_luminance", "ppd", "keep_edges"),
    LabelKind.HOLES: ("every", "rendered", "paper", "compat"),
}
"""Fields that only one kind of labels knows."""


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
        every: the first frame is rendered, and every so many after it; None = see `cadence`.
        rendered: numbers of the rendered frames, in place of `every`.
        paper: holes are the plain union of all tests.
        compat: vectors are composed in the order of ExtraNet's published code.
        previews: a PNG of the labels beside each EXR.
    """

    kind: LabelKind = LabelKind.VRS
    tile: int = 16
    metric: VrsMetric = VrsMetric.JNFLIP
    pool: Pool = Pool.MAX
    env_luminance: float = 1e-10
    ppd: float | None = None
    keep_edges: bool = False
    every: int | None = None
    rendered: frozenset[int] | None = None
    paper: bool = False
    compat: bool = False
    previews: bool = False

    def __post_init__(self) -> None:
        """Check what goes together.

        Raises:
            RequestError: a setting is of another kind, or of the cadence something is wrong.
        """
        super().__post_init__()
        _ = self.cadence
        defaults = {field.name: field.default for field in fields(self)}
        for kind, names in SETTINGS.items():
            changed = [n for n in names if getattr(self, n) != defaults[n]]
            if kind is not self.kind and changed:
                option = changed[0].replace("_", "-")
                raise RequestError(f"--{option} is of --kind {kind}, not of --kind {self.kind}")

    @property
    def cadence(self) -> Cadence | None:
        """Which frames are rendered, and the others labelled; None = every one is both."""
        if self.every is None and self.rendered is None:
            return None
        return choose_cadence(self.every, self.rendered)
