"""Changes of a training sample that leave it a picture some renderer could have made.

Geometry: an image is transposed and mirrored; motion and jitter go along, and the world turns with
it. Any rotation of the world leaves a frame what it is, and a mirrored picture is that of a world
mirrored in any plane; so normals take a signed permutation of the axes whose determinant is that of
the image's change; those in the camera's space turn with the picture. Light: radiance takes a gain
a channel. Material: albedo takes a permutation and a gain, F follows, lighting stays.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.choices import MATERIAL_EPSILON
from rtsr_cli.core.frames.buffers import NORMAL_BUFFERS, VECTOR_BUFFERS, Buffer
from rtsr_cli.core.frames.camera import View
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.pairs.simulation import Offset
from rtsr_cli.core.settings import check_numbers
from rtsr_cli.core.shapes import Image, Size
from rtsr_cli.core.training.clips import MATERIAL_GAIN

VECTORS = frozenset(b.value for b in VECTOR_BUFFERS)
NORMALS = frozenset(b.value for b in NORMAL_BUFFERS)
LIGHTS = frozenset({Buffer.COLOR.value, Buffer.EMISSION.value, Buffer.LIGHTING.value})

SWAP_PLANES = frozenset(
    {
        Buffer.ALBEDO.value,
        Buffer.MATERIAL.value,
        Buffer.COLOR.value,
        Buffer.EMISSION.value,
        MATERIAL_GAIN,
    }
)
"""What a change of material reads."""


MOST_STOPS = 16.0
"""Radiance is half float: a larger change leaves nothing of it."""


@dataclass(frozen=True, kw_only=True)
class AugmentationConfig:
    """What may happen to a sample.

    Attributes:
        turns: flips and quarter turns.
        exposure_stops: largest exposure change to each side.
        tint_stops: largest change of a channel's light against the others.
        material_share: share of the samples whose materials are swapped.
        material_stops: largest change of albedo, a channel.
        filtered_share: share of the samples whose LR radiance is filtered, not point-sampled.
        still_share: share of the samples of captures in which nothing moves: one frame, again and
            again; networks that see what came before learn from it to keep what is settled. None of
            systems whose frames are prepared whole.
    """

    turns: bool = True
    exposure_stops: float = 3.0
    tint_stops: float = 0.5
    material_share: float = 0.3
    material_stops: float = 1.5
    filtered_share: float = 0.3
    still_share: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ConfigError: one is below 0, or far too large.
        """
        stops = dict.fromkeys(("exposure_stops", "tint_stops", "material_stops"), MOST_STOPS)
        shares = dict.fromkeys(("material_share", "filtered_share", "still_share"), 1.0)
        check_numbers(
            self, "training.augmentation", dict.fromkeys(stops | shares, 0.0), stops | shares
        )


NO_AUGMENTATION = AugmentationConfig(
    turns=False,
    exposure_stops=0.0,
    tint_stops=0.0,
    material_share=0.0,
    filtered_share=0.0,
)


@dataclass(frozen=True, kw_only=True)
class PictureTurn:
    """Transpose first if `transposed`, then mirror left-right and top-bottom.

    Attributes:
        transposed: rows become columns.
        mirror_x: left and right change places.
        mirror_y: top and bottom do.
        axes: world axis that each component of a normal is taken from.
        signs: its sign then.
    """

    transposed: bool = False
    mirror_x: bool = False
    mirror_y: bool = False
    axes: tuple[int, int, int] = (0, 1, 2)
    signs: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def image(self, image: Image) -> Image:
        """Turn pixels."""
        if self.transposed:
            image = image.transpose(-1, -2)
        mirrored = [-1] * self.mirror_x + [-2] * self.mirror_y
        return image.flip(mirrored) if mirrored else image.contiguous()

    def plane(self, name: str, image: Image) -> Image:
        """Turn the pixels of a buffer, and its directions."""
        turned = self.image(image)
        if name in VECTORS:
            signs = turned.new_tensor([-1.0 if m else 1.0 for m in (self.mirror_x, self.mirror_y)])
            turned = turned.flip(1) if self.transposed else turned
            return turned * signs.view(1, 2, 1, 1)
        if name == Buffer.VIEW_NORMAL.value:
            return self._view_normal(turned)
        if name in NORMALS:
            return turned[:, list(self.axes)] * turned.new_tensor(self.signs).view(1, 3, 1, 1)
        return turned

    def _view_normal(self, normal: Image) -> Image:
        """x right, y up: transposing the picture exchanges x and -y."""
        x, y, z = (normal[:, i : i + 1] for i in range(3))
        if self.transposed:
            x, y = -y, -x
        return torch.cat([-x if self.mirror_x else x, -y if self.mirror_y else y, z], dim=1)

    def jitter(self, jitter_px: Jitter) -> Jitter:
        """Turn an offset."""
        x, y = reversed(jitter_px) if self.transposed else jitter_px
        return (-x if self.mirror_x else x, -y if self.mirror_y else y)

    def size(self, size: Size) -> Size:
        """(height, width) after the turn."""
        return (size[1], size[0]) if self.transposed else size

    def view(self, view: View, size: Size) -> View:
        """Where a part of an image of (height, width) `size` lies after the turn of the whole."""
        (rows, columns), (height, width) = self.size(view.display), self.size(size)
        top, left = (view.left, view.top) if self.transposed else (view.top, view.left)
        return View(
            display=(rows, columns),
            top=rows - top - height if self.mirror_y else top,
            left=columns - left - width if self.mirror_x else left,
        )

    def source_offset(self, offset: Offset, block: int) -> Offset:
        """Sample (x, y) of each block that lies at `offset` after the turn."""
        x, y = offset
        x = block - 1 - x if self.mirror_x else x
        y = block - 1 - y if self.mirror_y else y
        return (y, x) if self.transposed else (x, y)


def draw_turn(rng: np.random.Generator) -> PictureTurn:
    """One of the 8 turns of the picture, with one of the 24 of the world that fit it."""
    transposed, mirror_x, mirror_y = (bool(bit) for bit in rng.integers(0, 2, 3))
    axes = rng.permutation(3)
    signs = rng.choice([-1.0, 1.0], 3)
    determinant = np.linalg.det(np.eye(3)[axes]) * signs.prod()
    wanted = -1.0 if (transposed + mirror_x + mirror_y) % 2 else 1.0
    if determinant * wanted < 0:
        signs = -signs
    return PictureTurn(
        transposed=transposed,
        mirror_x=mirror_x,
        mirror_y=mirror_y,
        axes=(int(axes[0]), int(axes[1]), int(axes[2])),
        signs=(float(signs[0]), float(signs[1]), float(signs[2])),
    )


@dataclass(frozen=True, kw_only=True)
class AlbedoSwap:
    """c' = c[permutation] * gain, clipped to 0..1."""

    permutation: tuple[int, int, int]
    gain: tuple[float, float, float]

    def albedo(self, albedo: Image) -> Image:
        """Change an albedo."""
        gain = albedo.new_tensor(self.gain).view(1, 3, 1, 1)
        return (albedo[:, list(self.permutation)] * gain).clamp(0.0, 1.0)


def draw_swap(config: AugmentationConfig, rng: np.random.Generator) -> AlbedoSwap:
    """Any order of the channels, each with a gain."""
    order = rng.permutation(3)
    gain = 2.0 ** rng.uniform(-config.material_stops, config.material_stops, 3)
    return AlbedoSwap(
        permutation=(int(order[0]), int(order[1]), int(order[2])),
        gain=(float(gain[0]), float(gain[1]), float(gain[2])),
    )


def draw_gain(config: AugmentationConfig, rng: np.random.Generator) -> tuple[float, ...]:
    """Gain of the light, a channel."""
    exposure = rng.uniform(-config.exposure_stops, config.exposure_stops)
    tint = rng.uniform(-config.tint_stops, config.tint_stops, 3)
    return tuple(float(g) for g in 2.0 ** (exposure + tint))


def relight_planes(
    planes: Mapping[str, Tensor],
    gain: tuple[float, ...],
    *,
    beside: frozenset[str] = frozenset(),
) -> dict[str, Tensor]:
    """Multiply all light, planes named by `beside` included."""
    lights = LIGHTS | beside
    return {
        name: plane * plane.new_tensor(gain).view(1, 3, 1, 1) if name in lights else plane
        for name, plane in planes.items()
    }


def swap_albedo(planes: Mapping[str, Tensor], swap: AlbedoSwap) -> dict[str, Tensor]:
    """Change albedo and what follows from it; where F is too small to divide by, nothing.

        F' = F + dF/dc (c' - c),   radiance' = (radiance - emission) F' / F + emission

    Planes without albedo, or without its gain, stay as they are.
    """
    needed = (Buffer.ALBEDO.value, Buffer.MATERIAL.value, Buffer.COLOR.value, MATERIAL_GAIN)
    if any(name not in planes for name in needed):
        return dict(planes)
    albedo, material, color, gain = (planes[name] for name in needed)
    changed = swap.albedo(albedo)
    divisible = (material > MATERIAL_EPSILON).all(1, keepdim=True)
    new_material = torch.where(
        divisible, torch.addcmul(material, gain, changed - albedo), material
    ).clamp(min=0.0)
    ratio = torch.where(divisible, new_material / material.clamp(min=MATERIAL_EPSILON), 1.0)
    emission = planes.get(Buffer.EMISSION.value)
    if emission is None:
        new_color = color * ratio
    else:
        own = torch.minimum(emission, color)
        new_color = torch.addcmul(own, color - own, ratio)
    return {
        **planes,
        Buffer.ALBEDO.value: torch.where(divisible, changed, albedo),
        Buffer.MATERIAL.value: new_material,
        Buffer.COLOR.value: new_color,
    }
