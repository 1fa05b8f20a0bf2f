"""Training samples: from a clip to what a network sees and is held against.

Sample `i` of a run is a function of the run's seed and `i` alone, whatever thread makes it, so that
a run that was cut off goes on with exactly the samples it would have seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.derive import DerivationConfig, derive, needs
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import VECTOR_BUFFERS, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.resampling import decimate_filtered, sample_jitter
from rtsr_cli.core.learning.augmentation import (
    SWAP_PLANES,
    AugmentationConfig,
    Turn,
    random_gain,
    random_swap,
    random_turn,
    relit,
    swapped,
)
from rtsr_cli.core.learning.clips import DERIVED, MATERIAL_GAIN, Clip
from rtsr_cli.core.shapes import Image, Size
from rtsr_cli.core.system import Learning, System, Tensors, Window

FILTERS = ("blackman-harris", "box")
"""Pixel filters that LR radiance may have."""

FILTER_REACH = 2
"""LR pixels around a crop that a filter sees."""


@dataclass(frozen=True, kw_only=True)
class Region:
    """Where a sample lies in a clip, in LR pixels of the size that is cropped, and when.

    Attributes:
        position: of the first target frame in the clip.
        top, left: first HR pixel.
        size: (height, width) of the LR crop.
    """

    position: int
    top: int
    left: int
    size: Size


@dataclass(frozen=True, kw_only=True)
class Choices:
    """What augmentation drew for a sample; the defaults leave a sample as it was captured."""

    turn: Turn = field(default_factory=Turn)
    gain: tuple[float, ...] = (1.0, 1.0, 1.0)
    swap: Any = None
    lr_filter: str = "none"

    @property
    def mean_gain(self) -> float:
        """Geometric mean: what k grows by."""
        return float(np.exp(np.mean(np.log(self.gain))))


@dataclass(frozen=True, kw_only=True)
class Task:
    """What samples are made for.

    Attributes:
        system: whose they are.
        config: its settings.
        scale: S.
    """

    system: System
    config: Any
    scale: int

    @property
    def learning(self) -> Learning:
        """How the system is trained."""
        if self.system.learning is None:
            raise FrameFolderError(f"system '{self.system.name}' has nothing to train")
        return self.system.learning


@dataclass(frozen=True)
class Step:
    """One frame of a sample: what the network gets, and what it is held against."""

    inputs: Tensors
    goal: Tensors


def random_region(clip: Clip, size: Size, *, scale: int, unroll: int, rng: Any) -> Region:
    """Draw a place and a moment; real LR frames are cropped at whole LR pixels."""
    positions = clip.target_positions[: len(clip.target_positions) - unroll + 1]
    position = int(rng.choice(positions if len(positions) else clip.target_positions[:1]))
    height, width = (min(s, extent // scale) for s, extent in zip(size, clip.size, strict=True))
    grid = clip.facts.lr_scale or 1
    top, left = (
        int(rng.integers(0, (extent - s * scale) // grid + 1)) * grid
        for extent, s in zip(clip.size, (height, width), strict=True)
    )
    return Region(position=position, top=top, left=left, size=(height, width))


def whole_region(clip: Clip, position: int, scale: int) -> Region:
    """The whole of a frame."""
    height, width = clip.size
    return Region(position=position, top=0, left=0, size=(height // scale, width // scale))


def random_choices(config: AugmentationConfig, rng: np.random.Generator) -> Choices:
    """Draw what happens to a sample."""
    turn = random_turn(rng) if config.turns else Turn()
    gain = random_gain(config, rng)
    swap = random_swap(config, rng) if rng.random() < config.material_share else None
    filtered = rng.random() < config.filtered_share
    lr_filter = str(rng.choice(FILTERS)) if filtered else "none"
    return Choices(turn=turn, gain=gain, swap=swap, lr_filter=lr_filter)


def sample_steps(
    clip: Clip,
    region: Region,
    choices: Choices,
    task: Task,
    goals: Sequence[Tensors] | None = None,
) -> list[Step]:
    """Make the steps of a sample: `unroll` successive targets, each with its history.

    `goals` are those of the same sample, if it was made before.
    """
    maker = _Maker(clip, region, choices, task)
    last = min(region.position + task.learning.unroll, len(clip.facts.numbers))
    positions = range(region.position, last)
    if goals is None:
        return [maker.step(position) for position in positions]
    return [Step(maker.inputs(p), goal) for p, goal in zip(positions, goals, strict=True)]


def whole_window(clip: Clip, position: int, task: Task, lr_filter: str) -> tuple[Window, Frame]:
    """Window and reference of a whole frame as captured, for validation."""
    region = whole_region(clip, position, task.scale)
    maker = _Maker(clip, region, Choices(lr_filter=lr_filter), task)
    return maker.window(position), maker.reference(position)


class _Maker:
    """Cuts, changes and derives the frames of one sample; each LR frame is made once."""

    def __init__(self, clip: Clip, region: Region, choices: Choices, task: Task) -> None:
        self._beside = frozenset(task.learning.beside) & clip.hr.keys()
        if self._beside or (clip.facts.lr_scale and MATERIAL_GAIN not in clip.lr):
            # all that a sample holds changes its materials, or nothing does
            choices = replace(choices, swap=None)
        self._clip, self._region, self._choices, self._task = clip, region, choices, task
        self._lr: dict[int, Frame] = {}
        self._hr: dict[int, dict[str, Tensor]] = {}
        self._derivation = task.system.derivation(task.config)
        self._read_lr, self._read_hr = self._names()

    def _names(self) -> tuple[frozenset[str], frozenset[str]]:
        """Planes that the sample needs: what its buffers follow from, and what a swap changes."""
        system, clip = self._task.system, self._clip
        lr = (*system.lr_inputs, *system.lr_optional)
        hr = (*system.hr_inputs, *system.hr_optional, *self._task.learning.reference)
        swap = SWAP_PLANES if self._choices.swap is not None else frozenset()
        return (
            _stored(lr, clip.lr if clip.facts.lr_scale else clip.hr, self._derivation) | swap,
            _stored(hr, clip.hr, self._derivation) | swap | self._beside,
        )

    def step(self, position: int) -> Step:
        learning, config = self._task.learning, self._task.config
        window = self.window(position)
        goal = learning.goal(config, window, self.reference(position))
        return Step(learning.prepare(config, window), goal)

    def inputs(self, position: int) -> Tensors:
        """Inputs alone: what a goal costs may be known already."""
        return self._task.learning.prepare(self._task.config, self.window(position))

    def window(self, position: int) -> Window:
        oldest = max(0, position - self._task.system.history_frames)
        lr = tuple(self._lr_frame(p) for p in range(position, oldest - 1, -1))
        return Window(lr=lr, hr=self._hr_frame(position), scale=self._task.scale)

    def reference(self, position: int) -> Frame:
        planes = self._hr_planes(position)
        frame = self._derived(planes, self._task.learning.reference, position)
        return replace(frame, beside={name: planes[name] for name in self._beside})

    def _hr_frame(self, position: int) -> Frame:
        system = self._task.system
        planes = self._hr_planes(position)
        there = tuple(b for b in system.hr_optional if b.value in planes)
        return self._derived(planes, (*system.hr_inputs, *there), position)

    def _lr_frame(self, position: int) -> Frame:
        if position not in self._lr:
            system = self._task.system
            planes = self._lr_planes(position)
            there = tuple(b for b in system.lr_optional if b.value in planes)
            self._lr[position] = self._derived(
                planes, (*system.lr_inputs, *there), position, scale=self._task.scale
            )
        return self._lr[position]

    def _derived(
        self,
        planes: Mapping[str, Tensor],
        wanted: Sequence[Buffer],
        position: int,
        *,
        scale: int = 1,
    ) -> Frame:
        facts, choices = self._clip.facts, self._choices
        buffers = {Buffer(name): plane for name, plane in planes.items() if name in BUFFERS}
        height, width = choices.turn.size(facts.display)
        frame = Frame(
            number=facts.numbers[position],
            gbuffer=GBuffer(buffers, f"{facts.name}, frame {facts.numbers[position]}"),
            camera=CameraMetadata(
                jitter_px=self._jitter(position) if scale > 1 else (0.0, 0.0),
                pre_exposure=facts.pre_exposures[position] if facts.pre_exposures else 1.0,
            ),
            view=View(display=(height // scale, width // scale)),
        )
        k = facts.lighting_scales[position] * choices.mean_gain
        return derive(frame, wanted, self._derivation, lighting_scale=k)

    def _jitter(self, position: int) -> Jitter:
        scale, facts = self._task.scale, self._clip.facts
        if facts.lr_scale:
            return self._choices.turn.jitter(facts.jitters_px[position])
        return sample_jitter(scale // 2, scale), sample_jitter(scale // 2, scale)

    def _hr_planes(self, position: int) -> dict[str, Tensor]:
        if position not in self._hr:
            self._hr[position] = self._cut_hr(position)
        return self._hr[position]

    def _cut_hr(self, position: int) -> dict[str, Tensor]:
        height, width = (side * self._task.scale for side in self._region.size)
        rows = slice(self._region.top, self._region.top + height)
        columns = slice(self._region.left, self._region.left + width)
        return self._changed(
            {
                name: plane[position, None, :, rows, columns]
                for name, plane in self._clip.hr.items()
                if name in self._read_hr
            }
        )

    def _lr_planes(self, position: int) -> dict[str, Tensor]:
        if self._clip.facts.lr_scale:
            scale, (height, width) = self._task.scale, self._region.size
            top, left = self._region.top // scale, self._region.left // scale
            rows, columns = slice(top, top + height), slice(left, left + width)
            return self._changed(
                {
                    name: plane[position, None, :, rows, columns]
                    for name, plane in self._clip.lr.items()
                    if name in self._read_lr
                }
            )
        return self._decimated(position)

    def _decimated(self, position: int) -> dict[str, Tensor]:
        """Keep the sample of each block that is S//2 after the turn."""
        scale, region = self._task.scale, self._region
        x, y = self._choices.turn.source_phase(scale)
        rows = slice(region.top + y, region.top + region.size[0] * scale, scale)
        columns = slice(region.left + x, region.left + region.size[1] * scale, scale)
        planes = {
            name: plane[position, None, :, rows, columns]
            for name, plane in self._clip.hr.items()
            if name in self._read_lr
        }
        color = Buffer.COLOR.value
        if self._choices.lr_filter != "none" and color in planes and scale > 1:
            planes[color] = self._filtered(self._clip.hr[color][position, None], (x, y))
        for name in VECTOR_NAMES & planes.keys():
            planes[name] = planes[name].float() / scale
        return self._changed(planes)

    def _filtered(self, color: Image, phase: tuple[int, int]) -> Image:
        """Filter the crop and what the filter sees around it, then decimate."""
        scale, region, reach = self._task.scale, self._region, FILTER_REACH * self._task.scale
        top, left = max(0, region.top - reach), max(0, region.left - reach)
        bottom = region.top + region.size[0] * scale + reach
        right = region.left + region.size[1] * scale + reach
        around = color[..., top:bottom, left:right].float()
        x, y = phase[0] + region.left - left, phase[1] + region.top - top
        # the margin is whole blocks wide, and less at a border of the clip
        skipped = (x // scale, y // scale)
        filtered = decimate_filtered(around, self._choices.lr_filter, scale, (x % scale, y % scale))
        height, width = region.size
        return filtered[..., skipped[1] : skipped[1] + height, skipped[0] : skipped[0] + width]

    def _changed(self, planes: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Turn, relight and swap materials; pixels move as halves, and change as floats."""
        choices = self._choices
        changed = {name: choices.turn.plane(name, plane).float() for name, plane in planes.items()}
        changed = relit(changed, choices.gain, beside=self._beside)
        return changed if choices.swap is None else swapped(changed, choices.swap)


def _stored(
    wanted: Sequence[Buffer], planes: Mapping[str, Tensor], derivation: DerivationConfig
) -> frozenset[str]:
    """Names of the planes that buffers follow from, as far as they are there."""
    held = frozenset(Buffer(name) for name in planes if name in BUFFERS)
    there = [b for b in wanted if b in held or b in DERIVED]
    read = needs(there, held, has_camera=False, config=derivation).read
    return frozenset(buffer.value for buffer in read)


BUFFERS = frozenset(b.value for b in Buffer)
VECTOR_NAMES = frozenset(b.value for b in VECTOR_BUFFERS)


def stacked(samples: Sequence[Sequence[Step]]) -> list[Step]:
    """Make a batch: step by step, tensor by tensor."""
    length = min(len(steps) for steps in samples)
    return [
        Step(
            _stack([steps[i].inputs for steps in samples]),
            _stack([steps[i].goal for steps in samples]),
        )
        for i in range(length)
    ]


def _stack(parts: Sequence[Tensors]) -> dict[str, Tensor]:
    return {name: torch.cat([part[name] for part in parts]) for name in parts[0]}


def moved(step: Step, device: torch.device, memory_format: torch.memory_format) -> Step:
    """Bring a step to the device that trains."""
    return replace(
        step, inputs=_to(step.inputs, device, memory_format), goal=_to(step.goal, device)
    )


def _to(
    tensors: Tensors,
    device: torch.device,
    memory_format: torch.memory_format = torch.preserve_format,
) -> dict[str, Tensor]:
    return {
        name: tensor.to(device, non_blocking=True, memory_format=memory_format)
        for name, tensor in tensors.items()
    }
