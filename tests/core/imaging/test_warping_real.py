"""The stored motion of rendered sequences must bring frame t-1 onto frame t."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from rtsr_cli.core.imaging.disocclusion import SurfaceBuffers, disocclusion_mask
from rtsr_cli.core.imaging.warping import backward_warp

DATA = Path(__file__).resolve().parents[4] / "shared" / "data"
SEQUENCES = ("atrium/walk", "hangar", "lounge", "stairs", "yard")

pytestmark = pytest.mark.skipif(
    not (DATA / "manifest.json").is_file(), reason=f"no rendered sequences at {DATA.name}/"
)


def read_frame(path: Path) -> dict[str, torch.Tensor]:
    openexr = pytest.importorskip("OpenEXR")
    with openexr.File(str(path), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}

    def stack(*names: str) -> torch.Tensor:
        planes = [channels[name].astype(np.float32) for name in names]
        return torch.from_numpy(np.stack(planes)).unsqueeze(0)

    return {
        "radiance": stack("R", "G", "B"),
        "albedo": stack("albedo.R", "albedo.G", "albedo.B"),
        "motion": stack("motion.X", "motion.Y"),
        "depth": stack("depth.Z"),
        "id": stack("objectid").to(torch.int32),
    }


def frame_pair(sequence: str) -> tuple[dict[str, torch.Tensor], dict[str, torch.Tensor]]:
    paths = sorted((DATA / sequence).rglob("frame.*.exr"))
    return read_frame(paths[2]), read_frame(paths[3])


def tonemapped(image: torch.Tensor) -> torch.Tensor:
    return image / (1 + image)


@pytest.mark.parametrize("sequence", SEQUENCES)
@pytest.mark.parametrize("buffer", ["albedo", "radiance"])
def test_warping_the_previous_frame_beats_leaving_it(sequence, buffer):
    previous, current = frame_pair(sequence)
    mask = disocclusion_mask(
        current["motion"],
        current=SurfaceBuffers(depth_m=current["depth"], object_id=current["id"]),
        previous=SurfaceBuffers(depth_m=previous["depth"], object_id=previous["id"]),
    )
    assert 0.5 < (mask == 0).float().mean().item() < 1
    warped, _ = backward_warp(previous[buffer], current["motion"])
    seen = (mask == 0).expand_as(warped)
    target = tonemapped(current[buffer])
    warped_error = (tonemapped(warped) - target)[seen].square().mean().item()
    unwarped_error = (tonemapped(previous[buffer]) - target)[seen].square().mean().item()
    assert warped_error < 0.4 * unwarped_error


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_the_opposite_motion_is_worse_than_none(sequence):
    previous, current = frame_pair(sequence)
    target = current["albedo"]

    def error(motion: torch.Tensor) -> float:
        warped, inside_mask = backward_warp(previous["albedo"], motion)
        return ((warped - target).square() * inside_mask).mean().item()

    right, opposite = error(current["motion"]), error(-current["motion"])
    assert right < 0.5 * opposite
