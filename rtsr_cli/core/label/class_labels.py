"""Labels of `--kind cgts`: ghosting and aliasing pixels, told by all samples of a pixel."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.files.png import write_png
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.storage import split_image
from rtsr_cli.core.imaging.derivation import CAMERA
from rtsr_cli.core.imaging.pixel_classes import (
    AliasingConfig,
    ClassConfig,
    GhostingConfig,
    PixelClasses,
    classify_pixels,
)
from rtsr_cli.core.label.class_pictures import draw_classes
from rtsr_cli.core.label.labelling import Labelling
from rtsr_cli.core.label.request import LabelRequest
from rtsr_cli.core.pairs.sampled_frames import SampleArrangement, SampledFrames
from rtsr_cli.core.pairs.sources import PairInputs, PairSource
from rtsr_cli.core.run.frame_pairs import FrameInTurn
from rtsr_cli.core.run.loop import Product
from rtsr_cli.core.run.outputs import PREVIEW_SUFFIX

CLASSES = "rtsr:classes"
"""Header attribute: shares of the frame's pixels, as JSON."""

CLASS_BUFFERS = (Buffer.COLOR, Buffer.DEPTH, Buffer.MOTION)
"""What cannot be done without."""

OPTIONAL = (Buffer.NORMAL, Buffer.GEONORMAL, Buffer.OBJECT_ID, Buffer.POSITION)
"""What is used where it is there."""

GHOSTING, ALIASING = ("visibility", "outside", "shading"), ("geometry", "texture")
"""Masks of which shares are told: those that need a frame before, and the others."""


@dataclass(frozen=True, kw_only=True)
class ClassLabels:
    """Tells the classes of a frame's pixels, and writes them.

    Attributes:
        samples: of a pixel.
        config: thresholds.
        previews: also a picture of the classes.
    """

    samples: SampleArrangement
    config: ClassConfig
    previews: bool = False

    def __call__(self, moment: FrameInTurn) -> Product | None:
        """Classify; return what writes the labels; None where the frame is only history."""
        if not moment.wanted:
            return None
        frames, k = moment.window.lr[:2], self.samples.side
        classes = classify_pixels(frames, k, self.config, on_grid=self.samples.on_grid)
        shares = measure_shares(classes, history=len(frames) > 1)
        known = {**moment.attributes, **moment.provenance({CLASSES: json.dumps(shares)})}
        channels = {
            **split_image("ghosting", classes.ghosting, ""),
            **split_image("aliasing", classes.aliasing, ""),
        }
        path, windows = moment.path, moment.windows
        color = frames[0].gbuffer[Buffer.COLOR]
        panels = draw_classes(classes, color, k) if self.previews else []
        panels = [windows.blacken(panel) for panel in panels]

        def write() -> None:
            if panels:
                write_png(path.with_suffix(PREVIEW_SUFFIX), np.concatenate(panels, axis=1))
            write_exr(
                path,
                windows.crop(channels),
                attributes=known,
                data_window=windows.kept,
                display_window=windows.display,
            )

        return moment.product(write)


def class_config(request: LabelRequest) -> ClassConfig:
    """Return the thresholds of a request."""
    ghosting = GhostingConfig(
        color=request.least_change, overlap=request.most_overlap, depth_only=request.depth_only
    )
    return ClassConfig(ghosting=ghosting, aliasing=AliasingConfig(planes=not request.paper))


def describe_classes(request: LabelRequest) -> dict[str, Any]:
    """Return how labels of a request are made, as plain values."""
    return {"samples_per_pixel": request.samples_per_pixel, **asdict(class_config(request))}


def declare_class_labels(source: PairSource, request: LabelRequest) -> Labelling:
    """Return how the classes of a shot are labelled.

    Args:
        source: of `open_sampled_frames`.
        request: that it is of.
    """
    assert isinstance(source, SampledFrames), "the request's kind is opened as such"
    samples, config, held = source.arrangement, class_config(request), source.buffers
    return Labelling(
        name="label --kind cgts",
        inputs=PairInputs(
            lr=CLASS_BUFFERS, lr_optional=OPTIONAL, on_nonfinite=request.on_nonfinite
        ),
        work=ClassLabels(samples=samples, config=config, previews=request.previews),
        settings=[describe_classes(request), request.on_nonfinite],
        history_frames=1,
        details={
            "samples_per_pixel": samples.side if samples.on_grid else None,
            "samples": samples.count,
            "geometry": _list_geometry(held, paper=request.paper),
            "lacking": _list_lacking(held, camera=source.reader.has_camera),
        },
    )


def _list_geometry(held: Collection[Buffer], *, paper: bool) -> list[str]:
    """What tells geometry aliasing."""
    depth = "depth" if paper else "depth beyond a plane's"
    if Buffer.GEONORMAL in held:
        return [depth, "normals without normal map"]
    return [depth, "object ids"] if Buffer.OBJECT_ID in held else [depth]


def _list_lacking(held: Collection[Buffer], *, camera: bool) -> list[str]:
    """What is missing, so that labels are coarser."""
    lacking = [] if Buffer.NORMAL in held else ["normals"]
    return lacking if camera else [*lacking, CAMERA]


def measure_shares(classes: PixelClasses, *, history: bool) -> dict[str, Any]:
    """Share of the pixels that each mask marks, and whether there was a frame before."""
    named = {name: getattr(classes, name) for name in (*GHOSTING, *ALIASING)}
    shares = {name: round(float(mask.mean()), 6) for name, mask in named.items()}
    return {"history": history, **shares}


def summarise_classes(frames: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Means over frames; of ghosting over those that have a frame before."""
    known = list(frames)
    followed = [frame for frame in known if frame["history"]]
    parts = {"ghosting": (GHOSTING, followed), "aliasing": (ALIASING, known)}
    total: dict[str, Any] = {"frames": len(known)}
    for part, (names, there) in parts.items():
        means = {name: sum(f[name] for f in there) / len(there) for name in names if there}
        total[part] = {"frames": len(there), **means}
    return total
