"""One frame, and the order of many."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, TypeVar

import torch

from rtsr_cli.core.frames.buffers import GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.shapes import Color, Size

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One moment at one resolution; low and high resolution are two frames.

    Attributes:
        number: frame number of the files.
        gbuffer: the buffers.
        camera: matrices, jitter (pixels of this frame's resolution), exposure.
        view: which part of the image plane the buffers show.
        lighting_scale: k of the whole frame, `exp(mean(log(lighting + 1e-3)))` over divided
            pixels; 1 where there is no lighting. Crops and tiles keep the frame's value.
        filter_width_px: standard deviation of the pixel filter that went over the radiance and not
            over the other buffers, pixels; 0 = radiance is point-sampled like these.
        beside: further radiance of the moment by name, at a reduced rate for example; there where
            it is what training compares with.
    """

    number: int
    gbuffer: GBuffer
    camera: CameraMetadata
    view: View
    lighting_scale: float = 1.0
    filter_width_px: float = 0.0
    beside: Mapping[str, Color] = field(default_factory=dict)
    _known: dict[Callable[[Frame], Any], Any] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @property
    def size(self) -> Size:
        """(height, width) of the buffers."""
        return self.gbuffer.size

    def compute_once(self, function: Callable[[Frame], T]) -> T:
        """Return what a function gives for this frame; it is called the first time alone.

        For what several windows need of a frame that is history of each of them.
        """
        if function not in self._known:
            self._known[function] = function(self)
        value: T = self._known[function]
        return value

    def crop(self, top: int, left: int, size: Size) -> Frame:
        """Return a window of the frame; camera and lighting scale stay the whole frame's."""
        view = replace(self.view, top=self.view.top + top, left=self.view.left + left)
        return replace(self, gbuffer=self.gbuffer.crop(top, left, size), view=view)

    def to(self, device: torch.device | str) -> Frame:
        """Return the same frame on another device."""
        return replace(self, gbuffer=self.gbuffer.to(device))


@dataclass(frozen=True, kw_only=True)
class FrameSequence:
    """Order of the frames of one resolution, and where temporal history ends.

    Attributes:
        numbers: the frame numbers, ascending.
        step: difference of two numbers that one motion vector spans.
        cuts: numbers before which history ends.
    """

    numbers: Sequence[int]
    step: int = 1
    cuts: frozenset[int] = frozenset()

    def follows(self, number: int, previous: int | None) -> bool:
        """Tell whether history of `previous` is valid for `number`: adjacent, and no cut."""
        return previous is not None and number - previous == self.step and number not in self.cuts

    def runs(self) -> list[tuple[int, ...]]:
        """Split the numbers where temporal history resets."""
        numbers = tuple(self.numbers)
        pairs = enumerate(pairwise(numbers), 1)
        ends = [i for i, (before, number) in pairs if not self.follows(number, before)]
        return [numbers[a:b] for a, b in pairwise([0, *ends, len(numbers)])] if numbers else []
