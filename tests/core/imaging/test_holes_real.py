"""Holes of rendered sequences: what they leave is the same surface, what they mark is another."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from rtsr_cli.core.choices import LabelKind
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.frame_motion import find_occlusion_motion
from rtsr_cli.core.imaging.holes import find_holes
from rtsr_cli.core.imaging.warping import backward_warp
from rtsr_cli.core.label.request import LabelRequest
from rtsr_cli.core.pairs.opening import open_single_sets
from rtsr_cli.core.pairs.sources import PairInputs
from rtsr_cli.core.run.frame_pairs import read_options

READ = (Buffer.MOTION, Buffer.DEPTH, Buffer.NORMAL, Buffer.OBJECT_ID, Buffer.ALBEDO)


def read_frames(folder: Path, numbers: range) -> list[Frame]:
    request = LabelRequest(in_folder=folder, out_folder=Path("none"), kind=LabelKind.HOLES)
    ((_, source),) = open_single_sets(folder, read_options(request))
    return [source.load(number, PairInputs(lr=READ)).lr for number in numbers]


@pytest.mark.slow
@pytest.mark.parametrize("shot", ["hangar/run", "stairs/climb"])
def test_holes_are_where_past_textures_are_wrong(data_root: Path, shot: str) -> None:
    """Albedo is of no test: along vectors it agrees where there is no hole, and not in holes."""
    frames = read_frames(data_root / shot, range(6, 2, -1))
    errors = {}
    for steps in (1, 3):
        holes = find_holes(frames[: steps + 1])
        now, past = (f.gbuffer[Buffer.ALBEDO] for f in (frames[0], frames[steps]))
        wrong = (backward_warp(past, holes.motion_px)[0] - now).abs().amax(1, keepdim=True)
        hole, seen = holes.disoccluded > 0, holes.union == 0
        errors[steps] = [float(wrong[part].square().mean()) for part in (hole, seen)]
        assert 0.5 < seen.float().mean() < 0.99
    assert all(inside > 3.0 * outside for inside, outside in errors.values())


@pytest.mark.slow
@pytest.mark.parametrize("shot", ["hangar/run", "stairs/climb"])
def test_occlusion_vectors_fill_holes_better_than_vectors_do(data_root: Path, shot: str) -> None:
    frames = read_frames(data_root / shot, range(6, 4, -1))
    holes = find_holes(frames)
    now, past = (f.gbuffer[Buffer.ALBEDO] for f in frames)
    hole = (holes.disoccluded > 0).expand_as(now)
    vectors = (holes.motion_px, find_occlusion_motion(frames, holes.motion_px))
    plain, occlusion = (
        float((backward_warp(past, v)[0] - now)[hole].square().mean()) for v in vectors
    )
    assert torch.isfinite(vectors[1]).all()
    assert occlusion < plain
