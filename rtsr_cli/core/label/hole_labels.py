"""Labels of `--kind holes`: what each past frame does not show, test by test."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.files.png import write_png
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.cadence import measure_reach
from rtsr_cli.core.frames.storage import split_image
from rtsr_cli.core.imaging.derivation import CAMERA
from rtsr_cli.core.imaging.holes import HoleConfig, Holes, HoleTest, find_holes, list_tests
from rtsr_cli.core.label.hole_pictures import draw_holes
from rtsr_cli.core.label.labelling import Labelling
from rtsr_cli.core.label.request import LabelRequest
from rtsr_cli.core.pairs.sources import PairInputs, PairSource
from rtsr_cli.core.run.frame_pairs import FrameInTurn
from rtsr_cli.core.run.loop import Product
from rtsr_cli.core.run.outputs import PREVIEW_SUFFIX
from rtsr_cli.core.run.rendered_frames import split_by_cadence
from rtsr_cli.core.shapes import Mask, Plane
from rtsr_cli.core.system import FrameWindow

SHARES = "rtsr:holes"
"""Header attribute: shares of the frame's pixels, as JSON."""

STEPS = (1, 3, 5)
"""How many frames back the past ones lie where every frame is rendered, as ExtraNet has them."""

OUTSIDE, ALL = "outside", "holes"
"""Channels beside those of the tests: outside of the past frame, and no valid history at all."""

HOLE_BUFFERS = (Buffer.MOTION, Buffer.DEPTH)
"""What cannot be done without."""

OPTIONAL = (Buffer.NORMAL, Buffer.OBJECT_ID, Buffer.POSITION, Buffer.NOV)
"""What is used where it is there."""


@dataclass(frozen=True, kw_only=True)
class HoleLabels:
    """Finds a frame's holes, and writes them.

    Attributes:
        config: how they are found.
        tests: that are made, a channel each.
        rendered: numbers of the frames that are history; None = those of `STEPS`.
        previews: also a picture of the tests.
    """

    config: HoleConfig
    tests: tuple[HoleTest, ...]
    rendered: frozenset[int] | None = None
    previews: bool = False

    def __call__(self, moment: FrameInTurn) -> Product | None:
        """Find holes; return what writes them; None where the frame is only history."""
        if not moment.wanted:
            return None
        window = moment.window
        steps = self._list_steps(window)
        found = [
            None if step is None else find_holes(window.lr[: step + 1], self.config)
            for step in steps
        ]
        masks = self._list_masks(found, window.current.gbuffer[Buffer.DEPTH])
        shares = {
            name: {"step": step, **measure_shares(parts)}
            for (name, parts), step in zip(masks.items(), steps, strict=True)
        }
        known = {**moment.attributes, **moment.provenance({SHARES: json.dumps(shares)})}
        planes = {f"{past}.{name}": m for past, parts in masks.items() for name, m in parts.items()}
        planes[ALL] = planes[f"past1.{ALL}"]
        channels: dict[str, Any] = {}
        for name, mask in planes.items():
            channels |= split_image(name, mask, "")
        path, windows = moment.path, moment.windows
        panels = draw_holes(masks.values(), window.current) if self.previews else []
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

    def _list_steps(self, window: FrameWindow) -> list[int | None]:
        """How many frames back each past frame lies; None where there is none."""
        there = range(1, len(window.lr))
        if self.rendered is None:
            return [step if step in there else None for step in STEPS]
        before = [step for step in there if window.lr[step].number in self.rendered]
        return [before[i] if i < len(before) else None for i in range(len(STEPS))]

    def _list_masks(self, found: Iterable[Holes | None], size: Plane) -> dict[str, dict[str, Mask]]:
        """Past frame -> channel -> mask; where there is no past frame, all of it is a hole."""
        nothing = torch.zeros_like(size)
        masks = {}
        for rank, holes in enumerate(found, start=1):
            tests = {} if holes is None else holes.tests
            masks[f"past{rank}"] = {
                **{test.value: tests.get(test, nothing) for test in self.tests},
                OUTSIDE: nothing if holes is None else holes.outside,
                ALL: nothing + 1.0 if holes is None else holes.union,
            }
        return masks


def hole_config(request: LabelRequest) -> HoleConfig:
    """Return how holes of a request are found."""
    return HoleConfig(paper=request.paper, compat=request.compat)


def describe_config(request: LabelRequest) -> dict[str, bool]:
    """Return the same as plain values."""
    return asdict(hole_config(request))


def declare_hole_labels(source: PairSource, request: LabelRequest) -> Labelling:
    """Return how the holes of a shot are labelled.

    Raises:
        FrameFolderError: nothing is rendered, or nothing is left to label.
    """
    reader, config = source.reader, hole_config(request)
    numbers = reader.numbers
    rendered = labelled = None
    history = max(STEPS)
    if request.cadence is not None:
        rendered, labelled = split_by_cadence(reader, request.cadence)
        history = measure_reach(numbers, rendered, past_frames=len(STEPS))
    tests, lacking = choose_tests(reader, config)
    return Labelling(
        name="label --kind holes",
        inputs=PairInputs(
            lr=HOLE_BUFFERS,
            lr_optional=OPTIONAL,
            on_nonfinite=request.on_nonfinite,
        ),
        work=HoleLabels(config=config, tests=tests, rendered=rendered, previews=request.previews),
        settings=[asdict(config), sorted(rendered or ()), request.on_nonfinite],
        history_frames=history,
        outputs_of=labelled,
        details={
            "tests": [test.value for test in tests],
            "lacking": list(lacking),
            "rendered": None if rendered is None else len(rendered),
        },
    )


def choose_tests(
    reader: FrameReader, config: HoleConfig
) -> tuple[tuple[HoleTest, ...], tuple[str, ...]]:
    """Return the tests that frames allow, and what the depth along motion stands in for."""
    there = reader.readable
    ids, normals = Buffer.OBJECT_ID in there, Buffer.NORMAL in there
    positions = Buffer.POSITION in there or reader.has_camera
    known = {"object ids": ids, "normals": normals, CAMERA: reader.has_camera}
    tests = list_tests(
        ids=ids,
        normals=normals,
        positions=positions,
        tells_motion=reader.has_camera,
        paper=config.paper,
    )
    stands_in = HoleTest.DEPTH in tests
    return tests, tuple(name for name, held in known.items() if stands_in and not held)


def measure_shares(parts: Mapping[str, Mask]) -> dict[str, float]:
    """Share of the pixels that each mask marks."""
    return {name: round(float(mask.mean()), 6) for name, mask in parts.items()}


def summarise_shares(frames: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Means over frames, of each past frame over those that have one."""
    known = list(frames)
    total: dict[str, Any] = {"frames": len(known)}
    for past in known[0] if known else ():
        there = [frame[past] for frame in known if frame[past]["step"] is not None]
        total[past] = {"frames": len(there)}
        for name in there[0] if there else ():
            if name != "step":
                total[past][name] = sum(shares[name] for shares in there) / len(there)
    return total
