"""What both sizes of a shot say of their cameras, and lines that turn normals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from rtsr_cli.core.captures.bound_channels import BoundBuffer, BoundChannel, bind_channels
from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.measuring.camera_decision import share_verdicts
from rtsr_cli.core.captures.measuring.camera_measurement import write_turned
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.shots import collect_frame_set
from rtsr_cli.core.captures.survey import open_frames
from rtsr_cli.core.files.exr import write_exr

DOUBT = "the camera matrices are unverified: what the frames show does not agree with them"


@pytest.fixture
def reader(tmp_path: Path) -> FrameReader:
    for number in (1, 2):
        planes = {n: np.ones((4, 6), np.float32) for n in ("R", "G", "B")}
        write_exr(tmp_path / f"f.{number:04d}.exr", planes)
    frames = collect_frame_set(tmp_path)
    assert frames is not None
    return open_frames(frames, layout=None, capture=CaptureDeclaration(), side_car={})


def share(lr: FrameReader, hr: FrameReader) -> tuple[str, ...]:
    return share_verdicts(lr, hr, lambda: "")[1].warnings


@pytest.mark.parametrize(
    ("certain", "why"), [(True, "agree with theirs"), (False, "LR frames do not tell")]
)
def test_cameras_that_hr_frames_alone_dispute_are_said_with_the_reason(
    reader: FrameReader, certain: bool, why: str
) -> None:
    said = share(replace(reader, camera_certain=certain), replace(reader, camera_doubt=DOUBT))
    assert said[0] == DOUBT
    assert why in said[1]


def test_cameras_that_hr_frames_prove_and_lr_frames_dispute_are_said(reader: FrameReader) -> None:
    disputed = replace(reader, camera_doubt=DOUBT)
    (said,) = share(disputed, replace(reader, camera_certain=True))
    assert "though the HR frames agree" in said
    # both say the same: nothing is to be explained
    assert not share(disputed, disputed)
    assert not share(reader, replace(reader, camera_certain=True))


AXES = np.eye(4)
AXES[:3, :3] = ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
"""n . A = (-y, z, x)."""


@pytest.mark.parametrize(("packed", "negated"), [(False, '"-1 * f:n.Y"'), (True, '"1 - f:n.Y"')])
def test_lines_that_turn_normals_name_their_channels(packed: bool, negated: str) -> None:
    chooser = torch.Generator().manual_seed(3)
    normal = torch.randn(1, 3, 12, 16, generator=chooser)
    normal = normal / normal.norm(dim=1, keepdim=True)
    stored = 0.5 + 0.5 * normal if packed else normal
    bound = bind_channels(*(BoundChannel(stream="f", channel=f"n.{a}") for a in "XYZ"))
    assert write_turned(bound, AXES, stored) == [negated, '"f:n.Z"', '"f:n.X"']
    # of what is computed no line is written
    assert write_turned(bound.multiplied(2.0, -1.0), AXES, stored) == []
    assert write_turned(BoundBuffer(bound.components[:1]), AXES, stored) == []
