"""A tiny synthetic shot in memory, at both resolutions, with every buffer that files can hold."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
import torch.nn.functional as F

from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.derivation import derive
from rtsr_cli.core.system import FrameWindow, System

LR_SIZE = (16, 24)


@pytest.fixture(autouse=True, scope="session")
def _one_thread() -> None:
    """Tensors of a few pixels are slower in threads, much so on a busy machine."""
    torch.set_num_threads(1)


def stored_frame(number: int, height: int, width: int, jitter_px: tuple[float, float]) -> Frame:
    """A pattern that moves one LR pixel to the left a frame, a strip of sky on top."""
    y, x = torch.meshgrid(
        (torch.arange(height) + 0.5) / height * LR_SIZE[0],
        (torch.arange(width) + 0.5) / width * LR_SIZE[1],
        indexing="ij",
    )
    x = x + number
    waves = torch.stack([torch.sin(0.5 * x), torch.cos(0.4 * y), torch.sin(0.3 * (x + y))])[None]
    sky = (y < 3)[None, None]
    surface = (~sky).float()
    albedo = (0.5 + 0.4 * waves) * surface
    material = (0.9 * albedo + 0.03) * surface
    emission = (waves[:, :1] > 0.9).float() * torch.tensor([2.0, 1.0, 0.0]).view(1, 3, 1, 1)
    emission = emission * surface
    scale = width / LR_SIZE[1]
    motion = torch.zeros(1, 2, height, width)
    motion[:, 0] = scale
    plane = 0.5 + 0.4 * waves[:, :1]
    buffers = {
        Buffer.COLOR: material * (1.5 + waves[:, 1:2]) + emission + 0.8 * sky,
        Buffer.ALPHA: surface,
        Buffer.MATERIAL: material,
        Buffer.ALBEDO: albedo,
        Buffer.SPECULAR: 0.04 + 0.1 * albedo,
        Buffer.NORMAL: F.normalize(waves + torch.tensor([0.0, 0.0, 2.0]).view(1, 3, 1, 1))
        * surface,
        Buffer.DEPTH: torch.where(sky, torch.tensor(SKY_DEPTH_M), 3.0 + waves[:, 1:2]),
        Buffer.ROUGHNESS: plane,
        Buffer.METALLIC: (waves[:, 2:] > 0).float(),
        Buffer.MOTION: motion,
        Buffer.FORWARD: -motion,
        Buffer.EMISSION: emission,
        Buffer.OBJECT_ID: ((x / 6).to(torch.int32) + 1)[None, None] * ~sky,
        Buffer.POSITION: torch.stack([x, y, 3.0 + waves[0, 1]])[None],
        Buffer.NOV: plane,
        Buffer.VIEW_NORMAL: F.normalize(waves + torch.tensor([0.0, 0.0, 3.0]).view(1, 3, 1, 1))
        * surface,
        Buffer.REACTIVE: (waves[:, :1] > 0.8).float(),
    }
    gbuffer = GBuffer(buffers, f"synthetic, frame {number}")
    camera = CameraMetadata(jitter_px=jitter_px)
    return Frame(number=number, gbuffer=gbuffer, camera=camera, view=View(display=gbuffer.size))


@pytest.fixture
def make_windows() -> Callable[..., list[FrameWindow]]:
    """Windows of successive frames as the loop hands them over, with the declared inputs only."""

    def make(
        system: System, scale: int, *, count: int = 3, optional: bool = False
    ) -> list[FrameWindow]:
        lr_inputs, hr_inputs = set(system.lr_inputs), set(system.hr_inputs)
        unshaded = set(system.unshaded_inputs)
        if optional:
            lr_inputs |= set(system.lr_optional)
            hr_inputs |= set(system.hr_optional)
            unshaded |= set(system.unshaded_optional)
        height, width = LR_SIZE
        jitter_px = (0.5 - (scale - scale // 2 - 0.5) / scale, 0.25)

        def make_frames(buffers: set[Buffer], first: int, factor: int) -> list[Frame]:
            jitter = jitter_px if factor == 1 else (0.0, 0.0)
            size = (height * factor, width * factor)
            derivation = system.derivation(system.config())
            return [
                derive(stored_frame(n, *size, jitter), buffers, derivation)
                for n in range(first, count + 1)
            ]

        # what extrapolates always has a rendered frame before the one that it predicts
        earlier = 1 if unshaded else 0
        lr = make_frames(lr_inputs, 1 - earlier, 1)
        others = make_frames(unshaded, 1 - earlier, 1) if unshaded else lr
        hr = make_frames(hr_inputs, 1, scale)

        def make_window(target: int) -> FrameWindow:
            reach = min(target, system.history_frames)
            frames = [
                (lr if system.is_rendered(age) else others)[target - age]
                for age in range(reach + 1)
            ]
            at = target - earlier
            return FrameWindow(lr=tuple(frames), hr=hr[at] if hr_inputs else None, scale=scale)

        return [make_window(earlier + i) for i in range(count)]

    return make
