"""What both sizes of a shot say of their cameras, and lines that turn normals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rtsr_cli.core.captures.bound_channels import BoundBuffer, BoundChannel, bind_channels
from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.measuring.camera_decision import REFUSED, share_verdicts
from rtsr_cli.core.captures.measuring.camera_measurement import write_turned
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.shots import collect_frame_set
from rtsr_cli.core.captures.survey import open_frames
from rtsr_cli.core.captures.surveyed import SurveyedValues
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.frames.camera import CameraMetadata

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


def with_cameras(reader: FrameReader, *places: float, **known: Any) -> FrameReader:
    """A reader of cameras at places along x, one a frame."""
    cameras = {}
    for number, place in enumerate(places, start=1):
        view = torch.eye(4, dtype=torch.float64)
        view[3, 0] = -place
        lens = torch.diag(torch.tensor([1.0, 1.0, 0.0, 0.0], dtype=torch.float64))
        lens[2, 3], lens[3, 2] = -1.0, 0.05
        cameras[number] = CameraMetadata(
            world_to_camera=view, world_to_ndc=view @ lens, jitter_px=(0.1 * number, 0.0)
        )
    return replace(reader, cameras=SurveyedValues(cameras, (), cameras.__getitem__), **known)


def list_places(reader: FrameReader) -> list[float | None]:
    found = (camera.world_to_camera for camera in reader.cameras.values())
    return [None if view is None else -float(view[3, 0]) for view in found]


@pytest.mark.parametrize("size", ["LR", "HR"])
@pytest.mark.parametrize("certain", [True, False])
def test_proven_matrices_serve_the_size_that_single_frames_cost_its_own(
    reader: FrameReader, size: str, certain: bool
) -> None:
    """What is made of a camera at one size and without it at the other is not alike."""
    why = "the camera matrices are not used: frame 2"
    right = with_cameras(reader, 1.0, 2.0, camera_certain=certain)
    wrong = with_cameras(reader, 1.0, 7.0, warnings=(f"{why}; {REFUSED}",)).without_matrices(why)
    wrong = replace(wrong, camera_unfit_singly=True)
    pair = (wrong, right) if size == "LR" else (right, wrong)
    pair = share_verdicts(*pair, lambda: "")
    mended = pair[0 if size == "LR" else 1]
    assert [list_places(one) for one in pair] == [[1.0, 2.0] if certain else [None, None]] * 2
    assert bool(mended.camera_unfit) is not certain
    assert (REFUSED in mended.warnings[0]) is not certain
    assert ("in their place" in mended.warnings[0]) is certain
    assert mended.cameras[2].jitter_px == (0.2, 0.0)


@pytest.mark.parametrize("proven", ["LR", "HR", "both", "none"])
def test_of_matrices_that_differ_the_proven_ones_are_used_at_both_sizes(
    reader: FrameReader, proven: str
) -> None:
    lr = with_cameras(reader, 1.0, 2.0, camera_certain=proven in ("LR", "both"))
    hr = with_cameras(reader, 1.0, 7.0, camera_certain=proven in ("HR", "both"))
    lr, hr = share_verdicts(lr, hr, lambda: "")
    used = {"LR": (2.0, 2.0), "HR": (7.0, 7.0)}.get(proven, (2.0, 7.0))
    assert (list_places(lr)[1], list_places(hr)[1]) == used
    (said,) = hr.warnings
    assert "of frame 2 are not those of the LR frames" in said
    kept = "Both are used as they are" if used == (2.0, 7.0) else f"The {proven} frames'"
    assert kept in said


def test_frames_without_matrices_take_those_of_the_other_size(reader: FrameReader) -> None:
    lr = with_cameras(reader, 1.0, 2.0, camera_certain=True)
    hr = with_cameras(reader, 1.0, 2.0)
    bare = replace(hr.cameras[2], world_to_camera=None, world_to_ndc=None)
    hr = replace(hr, cameras={1: hr.cameras[1], 2: bare})
    shared = share_verdicts(lr, hr, lambda: "")[1]
    assert list_places(shared) == [1.0, 2.0]
    assert "of frame 2 are those of the LR frames" in shared.notes[-1]
    # what nothing proves is not handed on
    unproven = share_verdicts(replace(lr, camera_certain=False), hr, lambda: "")[1]
    assert list_places(unproven) == [1.0, None]


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
