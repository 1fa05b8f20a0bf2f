"""Samples of systems that only whole frames can be prepared for: prepared once, cropped after.

What is prepared is kept as halves, up to `MOST_BYTES` of it; frames that have to go are prepared
again when they are drawn again, so that a sample does not depend on what was kept.
"""

from __future__ import annotations

from collections import OrderedDict
from threading import Lock

import numpy as np
from torch import Tensor

from rtsr_cli.core.frames.storage import round_to_half
from rtsr_cli.core.shapes import Mask, Size
from rtsr_cli.core.system import Tensors, WholeFrames
from rtsr_cli.core.training.clips import Clip
from rtsr_cli.core.training.sample_steps import SampleStep, build_whole_window
from rtsr_cli.core.training.samples import SampleChoices, SampleRegion, SampleTask

MOST_BYTES = 8 << 30
"""Prepared frames that are kept."""

SOUGHT_SHARE = 0.5
"""Share of the crops that are drawn around a pixel that is sought."""


class PreparedFrames:
    """Whole frames as a network sees them, and what it is held against; safe in threads."""

    def __init__(self, task: SampleTask, most_bytes: int = MOST_BYTES) -> None:
        """Start empty.

        Args:
            task: whose they are.
            most_bytes: that are kept.
        """
        self._task, self._most = task, most_bytes
        self._kept: OrderedDict[tuple[int, int], SampleStep] = OrderedDict()
        self._bytes, self._lock = 0, Lock()

    def prepare(self, clip: Clip, position: int) -> SampleStep:
        """Prepare a frame of a clip, or find it prepared."""
        key = (id(clip), position)
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        task = self._task
        window, reference = build_whole_window(clip, position, task)
        made = SampleStep(
            _keep_halves(task.learning.prepare(task.config, window)),
            _keep_halves(task.learning.goal(task.config, window, reference)),
        )
        self._keep(key, made)
        return made

    def _keep(self, key: tuple[int, int], made: SampleStep) -> None:
        with self._lock:
            if key in self._kept:
                return
            self._kept[key] = made
            self._bytes += _count_bytes(made)
            while self._bytes > self._most and len(self._kept) > 1:
                _, gone = self._kept.popitem(last=False)
                self._bytes -= _count_bytes(gone)


def _keep_halves(tensors: Tensors) -> dict[str, Tensor]:
    return {name: round_to_half(tensor) for name, tensor in tensors.items()}


def _count_bytes(step: SampleStep) -> int:
    return sum(t.nbytes for part in (step.inputs, step.goal) for t in part.values())


def draw_crop(sought: Mask, position: int, size: Size, rng: np.random.Generator) -> SampleRegion:
    """Draw a crop, some of them so that they hold a pixel that is sought.

    Args:
        sought: 1 where pixels are.
        position: of the frame in its clip.
        size: (height, width).
        rng: NumPy's generator.
    """
    frame = (sought.shape[2], sought.shape[3])
    most = [max(0, extent - side) for extent, side in zip(frame, size, strict=True)]
    corner = [int(rng.integers(0, m + 1)) for m in most]
    places = sought[0, 0].flatten().nonzero()[:, 0]
    if len(places) and rng.random() < SOUGHT_SHARE:
        chosen = int(places[int(rng.integers(len(places)))])
        pixel = divmod(chosen, frame[1])
        before = [int(rng.integers(0, side)) for side in size]
        corner = [min(max(0, p - b), m) for p, b, m in zip(pixel, before, most, strict=True)]
    return SampleRegion(position=position, top=corner[0], left=corner[1], size=size)


def crop_prepared(
    made: SampleStep,
    region: SampleRegion,
    *,
    whole: WholeFrames,
    choices: SampleChoices,
    task: SampleTask,
    rng: np.random.Generator,
) -> SampleStep:
    """Cut a crop out of a prepared frame, and change it."""
    rows = slice(region.top, region.top + region.size[0])
    columns = slice(region.left, region.left + region.size[1])

    def cut(tensors: Tensors) -> dict[str, Tensor]:
        return {name: tensor[..., rows, columns].float() for name, tensor in tensors.items()}

    return SampleStep(*whole.change(task.config, cut(made.inputs), cut(made.goal), choices, rng))
