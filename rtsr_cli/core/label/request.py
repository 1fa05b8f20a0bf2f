"""What `label` is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

from rtsr_cli.core.choices import LabelKind, Pool, VrsMetric
from rtsr_cli.core.errors import RequestError
from rtsr_cli.core.frames.cadence import Cadence, choose_cadence
from rtsr_cli.core.requests import check_ranges
from rtsr_cli.core.run.request import FramesRequest

SETTINGS: Mapping[LabelKind, tuple[str, ...]] = {
    LabelKind.VRS: ("tile", "metric", "pool", "env_luminance", "ppd", "keep_edges"),
    LabelKind.HOLES: ("every", "rendered", "paper", "compat"),
    LabelKind.CGTS: (
        "samples_per_pixel",
        "depth_only",
        "least_change",
        "most_overlap",
        "paper",
    ),
}
"""Fields that not every kind of labels knows."""

SAMPLES = (2, 16)
"""Least and most of `samples_per_pixel`."""


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
        paper: holes are the plain union of all tests; slanted floors are geometry aliasing.
        compat: vectors are composed in the order of ExtraNet's published code.
        samples_per_pixel: K: frames hold K x K samples of each pixel that is labelled, row by row;
            None where their channels hold one each, anywhere in the pixel.
        depth_only: hidden surfaces are told by depth, however little they move.
        least_change: of colour, c / (1 + c), that is a change of light.
        most_overlap: of a pixel's colours with those it had, where light changed.
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
    samples_per_pixel: int | None = None
    depth_only: bool = False
    least_change: float = 0.05
    most_overlap: float = 0.10
    previews: bool = False

    def __post_init__(self) -> None:
        """Check what goes together.

        Raises:
            RequestError: a setting is of another kind or out of range, or of the cadence something
                is wrong.
        """
        super().__post_init__()
        _ = self.cadence
        check_ranges(
            self, samples_per_pixel=SAMPLES, least_change=(0.0, 1.0), most_overlap=(0.0, 1.0)
        )
        defaults = {field.name: field.default for field in fields(self)}
        for name in dict.fromkeys(name for names in SETTINGS.values() for name in names):
            owners = [kind for kind, names in SETTINGS.items() if name in names]
            if self.kind not in owners and getattr(self, name) != defaults[name]:
                option, those = name.replace("_", "-"), " and ".join(owners)
                raise RequestError(f"--{option} is of --kind {those}, not of --kind {self.kind}")

    @property
    def cadence(self) -> Cadence | None:
        """Which frames are rendered, and the others labelled; None = every one is both."""
        if self.every is None and self.rendered is None:
            return None
        return choose_cadence(self.every, self.rendered)
