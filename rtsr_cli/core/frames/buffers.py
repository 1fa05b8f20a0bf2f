"""What a frame is made of: the named buffers of one resolution, and what each of them means."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType

import torch
from torch import Tensor

from rtsr_cli.core.errors import MissingBufferError, ShapeMismatchError
from rtsr_cli.core.shapes import Image, Mask, Plane, Size

SKY_DEPTH_M = 65504.0
"""Depth of a sky pixel in memory: the largest half, which is what G-buffers clear to."""


class Buffer(StrEnum):
    """Every buffer that rtsr knows, by the name users see."""

    COLOR = "color"
    LIGHTING = "lighting"
    LIGHTING_MASK = "lighting_mask"
    SKY = "sky"
    MATERIAL = "material"
    ALBEDO = "albedo"
    SPECULAR = "specular"
    NORMAL = "normal"
    GEONORMAL = "geonormal"
    DEPTH = "depth"
    ROUGHNESS = "roughness"
    METALLIC = "metallic"
    MOTION = "motion"
    FORWARD = "forward"
    EMISSION = "emission"
    OBJECT_ID = "object_id"
    POSITION = "position"
    NOV = "nov"
    VIEW_NORMAL = "view_normal"
    ALPHA = "alpha"
    REACTIVE = "reactive"


class Resampling(StrEnum):
    """How a buffer may change its resolution when K x K samples make one pixel."""

    MEAN = "mean"
    SAMPLE = "sample"


@dataclass(frozen=True, kw_only=True)
class BufferSpec:
    """Number of channels, unit in memory, and how samples of one pixel combine."""

    channels: int
    unit: str
    resampling: Resampling = Resampling.MEAN
    components: str = ""
    radiance: bool = False

    @property
    def component_names(self) -> tuple[str, ...]:
        """Suffix of each channel, e.g. ("R", "G", "B"); ("",) for a single one."""
        return tuple(self.components) or ("",)


BUFFER_SPECS: Mapping[Buffer, BufferSpec] = MappingProxyType(
    {
        Buffer.COLOR: BufferSpec(
            channels=3, unit="linear radiance", components="RGB", radiance=True
        ),
        Buffer.LIGHTING: BufferSpec(
            channels=3, unit="radiance / material", components="RGB", radiance=True
        ),
        Buffer.LIGHTING_MASK: BufferSpec(
            channels=1, unit="1 = divided", resampling=Resampling.SAMPLE
        ),
        Buffer.SKY: BufferSpec(channels=1, unit="1 = sky", resampling=Resampling.SAMPLE),
        Buffer.MATERIAL: BufferSpec(channels=3, unit="F, 0..1", components="RGB"),
        Buffer.ALBEDO: BufferSpec(channels=3, unit="linear, 0..1", components="RGB"),
        Buffer.SPECULAR: BufferSpec(channels=3, unit="F0, 0..1", components="RGB"),
        Buffer.NORMAL: BufferSpec(channels=3, unit="world space, unit length", components="XYZ"),
        Buffer.GEONORMAL: BufferSpec(
            channels=3, unit="world space, unit length, without normal map", components="XYZ"
        ),
        Buffer.DEPTH: BufferSpec(
            channels=1, unit="planar view distance, m", resampling=Resampling.SAMPLE
        ),
        Buffer.ROUGHNESS: BufferSpec(channels=1, unit="perceptual, 0..1"),
        Buffer.METALLIC: BufferSpec(channels=1, unit="0..1"),
        Buffer.MOTION: BufferSpec(
            channels=2, unit="px, previous - current", resampling=Resampling.SAMPLE, components="XY"
        ),
        Buffer.FORWARD: BufferSpec(
            channels=2, unit="px, next - current", resampling=Resampling.SAMPLE, components="XY"
        ),
        Buffer.EMISSION: BufferSpec(channels=3, unit="linear radiance", components="RGB"),
        Buffer.OBJECT_ID: BufferSpec(
            channels=1, unit="number, 0 = sky", resampling=Resampling.SAMPLE
        ),
        Buffer.POSITION: BufferSpec(
            channels=3, unit="world space, m", resampling=Resampling.SAMPLE, components="XYZ"
        ),
        Buffer.NOV: BufferSpec(channels=1, unit="cosine of view and normal, 0..1"),
        Buffer.VIEW_NORMAL: BufferSpec(
            channels=3, unit="camera space, x right, y up, z towards it", components="XYZ"
        ),
        Buffer.ALPHA: BufferSpec(channels=1, unit="coverage, 0..1", radiance=True),
        Buffer.REACTIVE: BufferSpec(channels=1, unit="0..1, 1 = history is not to be trusted"),
    }
)

CONSTANTS: Mapping[Buffer, tuple[float, float]] = MappingProxyType(
    dict.fromkeys(
        (Buffer.ROUGHNESS, Buffer.METALLIC, Buffer.NOV, Buffer.ALPHA, Buffer.REACTIVE), (0.0, 1.0)
    )
    | dict.fromkeys((Buffer.ALBEDO, Buffer.SPECULAR, Buffer.MATERIAL), (0.0, 2.0))
    | dict.fromkeys((Buffer.EMISSION, Buffer.DEPTH, Buffer.OBJECT_ID), (0.0, math.inf))
    | dict.fromkeys((Buffer.NORMAL, Buffer.GEONORMAL), (-1.0, 1.0))
)
"""Least and largest value that may be declared for all pixels; colours of surfaces go a little
beyond 1."""

VECTOR_BUFFERS = (Buffer.MOTION, Buffer.FORWARD)
"""Buffers measured in pixels of their own resolution: they change value when it changes."""

NORMAL_BUFFERS = frozenset({Buffer.NORMAL, Buffer.GEONORMAL})
"""Buffers of unit vectors: a mean of several is brought back to length 1."""

RADIANCE_BUFFERS = frozenset(b for b, spec in BUFFER_SPECS.items() if spec.radiance)
"""What `upscale` must never read at high resolution."""


def sky_mask(depth_m: Plane) -> Mask:
    """1 where the ray left the scene: by the depth that memory gives every sky, however stored."""
    return torch.ge(depth_m, SKY_DEPTH_M, out=torch.empty_like(depth_m))


@dataclass(frozen=True)
class GBuffer(Mapping[Buffer, Tensor]):
    """Immutable buffers of **one** resolution, each NCHW with batch 1; `where` names their origin.

    Raises:
        MissingBufferError: on access to a buffer that is not there; the message says where.
        ShapeMismatchError: on construction, if two buffers differ in size.
    """

    buffers: Mapping[Buffer, Tensor]
    where: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        """Freeze the mapping and hold every buffer to its channel count and one size."""
        object.__setattr__(self, "buffers", MappingProxyType(dict(self.buffers)))
        sizes: dict[Size, Buffer] = {}
        for buffer, tensor in self.buffers.items():
            if tensor.shape[1] != BUFFER_SPECS[buffer].channels:
                raise ShapeMismatchError(
                    f"{self.where}: buffer '{buffer}' has {tensor.shape[1]} channels, "
                    f"expected {BUFFER_SPECS[buffer].channels}"
                )
            sizes.setdefault((tensor.shape[-2], tensor.shape[-1]), buffer)
        if len(sizes) > 1:
            listed = ", ".join(f"'{b}' is {w} x {h}" for (h, w), b in sizes.items())
            raise ShapeMismatchError(f"{self.where}: buffers differ in size: {listed}")

    def __getitem__(self, buffer: Buffer) -> Tensor:
        """Return the tensor of a buffer."""
        try:
            return self.buffers[buffer]
        except KeyError:
            held = ", ".join(self.buffers) or "nothing"
            raise MissingBufferError(
                f"{self.where}: buffer '{buffer}' is missing (there: {held})"
            ) from None

    def __iter__(self) -> Iterator[Buffer]:
        """Iterate over the buffers' names."""
        return iter(self.buffers)

    def __len__(self) -> int:
        """Return the number of buffers."""
        return len(self.buffers)

    def __contains__(self, buffer: object) -> bool:
        """Tell whether a buffer is there."""
        return buffer in self.buffers

    @property
    def size(self) -> Size:
        """(height, width) of every buffer."""
        first = next(iter(self.buffers.values()))
        return first.shape[-2], first.shape[-1]

    @property
    def device(self) -> torch.device:
        """Where the buffers lie."""
        return next(iter(self.buffers.values())).device

    def stack(self, buffers: Iterable[Buffer]) -> Image:
        """Concatenate the named buffers along the channels, in the order given."""
        return torch.cat([self[buffer] for buffer in buffers], dim=1)

    def crop(self, top: int, left: int, size: Size) -> GBuffer:
        """Return the window of (height, width) `size` whose first pixel is (`top`, `left`)."""
        rows, columns = slice(top, top + size[0]), slice(left, left + size[1])
        return self.map(lambda _, tensor: tensor[..., rows, columns])

    def to(self, device: torch.device | str) -> GBuffer:
        """Return the same buffers on another device."""
        return self.map(lambda _, tensor: tensor.to(device))

    def map(self, change: Callable[[Buffer, Tensor], Tensor]) -> GBuffer:
        """Return new buffers, each `change(buffer, tensor)`."""
        return GBuffer({b: change(b, t) for b, t in self.buffers.items()}, self.where)

    def with_buffers(self, added: Mapping[Buffer, Tensor]) -> GBuffer:
        """Return these buffers plus (or replaced by) the added ones."""
        return GBuffer({**self.buffers, **added}, self.where)

    def only(self, buffers: Iterable[Buffer]) -> GBuffer:
        """Return those of the named buffers that are there."""
        wanted = set(buffers)
        return GBuffer({b: t for b, t in self.buffers.items() if b in wanted}, self.where)
