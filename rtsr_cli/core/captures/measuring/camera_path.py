"""Camera matrices of every frame: their form, and whether they go on from frame to frame.

What a few frames show is held against pixels by `camera_check`; of all others the numbers alone are
looked at, which takes milliseconds for thousands.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rtsr_cli.core.captures.measuring.camera_structure import (
    Flags,
    Matrices,
    are_affine,
    are_mirrored,
    are_projections,
    are_rigid,
    measure_reach,
)
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.camera_needs import say_frames

STRAY = 8.0
"""A frame lies off the path where moving it there leaves so many times smaller bends, and so many
times farther than most frames of the shot, of which a hand may hold the camera."""

STRAY_TURN = 5e-3
"""Smallest difference between entries of rotations, and of lenses, that counts."""

STRAY_WAY = 1e-3
"""Smallest step aside that counts, a share of the distance from the origin, and of a unit."""

NEIGHBOURS = 5
"""Frames in a row that tell whether the middle one lies on their path."""


@dataclass(frozen=True, kw_only=True)
class CameraRun:
    """Matrices of the frames of a shot that have both.

    Attributes:
        numbers: of the frames.
        views: world to camera.
        ndcs: world to clip space.
    """

    numbers: NDArray[np.int64]
    views: Matrices
    ndcs: Matrices

    @property
    def projections(self) -> Matrices:
        """Camera to clip space; the survey has refused matrices without an inverse."""
        return np.asarray(np.linalg.inv(self.views) @ self.ndcs)

    def say(self, frames: Flags) -> str:
        """Write frame 7 or frames 1-3 of some frames."""
        return say_frames(self.numbers[frames].tolist())


def gather_run(cameras: Mapping[int, CameraMetadata]) -> CameraRun | None:
    """Gather the matrices of the surveyed frames; None where no frame has any."""
    held = [
        (number, camera.world_to_camera.numpy(), camera.world_to_ndc.numpy())
        for number, camera in cameras.items()
        if camera.world_to_camera is not None and camera.world_to_ndc is not None
    ]
    if not held:
        return None
    numbers, views, ndcs = zip(*held, strict=True)
    return CameraRun(numbers=np.array(numbers), views=np.stack(views), ndcs=np.stack(ndcs))


LENS_APART = 0.02
"""Share by which focal lengths of one frame differ between two sizes at most: sides are rounded."""


def find_apart(run: CameraRun, other: CameraRun) -> list[int]:
    """Numbers of frames whose cameras differ between two sets of one shot; jitter is no matter."""
    _, own, its = np.intersect1d(run.numbers, other.numbers, return_indices=True)
    ours, theirs = run.views[own], other.views[its]
    far = STRAY_WAY * (1.0 + measure_reach(ours))
    turned = np.abs(ours[:, :3, :3] - theirs[:, :3, :3]).max((1, 2)) > STRAY_TURN
    moved = np.abs(ours[:, 3, :3] - theirs[:, 3, :3]).max(1) > far
    lens, lens_there = (r.projections[i][:, (0, 1), (0, 1)] for r, i in ((run, own), (other, its)))
    zoomed = np.abs(lens - lens_there).max(1) > LENS_APART * np.abs(lens).max(1)
    apart: list[int] = run.numbers[own][turned | moved | zoomed].tolist()
    return apart


def find_form_fault(run: CameraRun, *, mirrored: bool) -> str:
    """Say which frames' matrices cannot be a camera like the others'; empty if all can.

    Args:
        run: of all frames.
        mirrored: handedness of the frames that were looked at.
    """
    affine, rigid = are_affine(run.views), are_rigid(run.views)
    fits = are_projections(run.projections, measure_reach(run.views))
    faults = {
        "worldToCamera has a last column other than 0, 0, 0, 1 (transposed?)": ~affine,
        "worldToCamera shears: its first three rows are not at right angles and of one length": (
            affine & ~rigid
        ),
        "worldToNDC is not worldToCamera times a projection of a camera that looks along -z": (
            affine & rigid & ~fits
        ),
        "worldToCamera is of another handedness than in the other frames (an axis flipped?)": (
            affine & rigid & fits & (are_mirrored(run.views) != mirrored)
        ),
    }
    found = [f"of {run.say(where)}, {why}" for why, where in faults.items() if where.any()]
    if not found:
        return ""
    return (
        f"the camera matrices are not used: {'; '.join(found)}; write those frames' matrices like "
        "the others' (docs/frames.md)"
    )


def find_strays(run: CameraRun, runs: Iterable[Sequence[int]]) -> str:
    """Say which frames' cameras lie off the path of the frames around them; empty if none do.

    Args:
        run: of all frames.
        runs: numbers of some of them in a row, between cuts.
    """
    index = {number: i for i, number in enumerate(run.numbers.tolist())}
    eyes = np.asarray(np.linalg.inv(run.views)[:, 3, :3], dtype=np.float64)
    turns = run.views[:, :3, :3].reshape(-1, 9)
    lenses = run.projections[:, (0, 1, 2, 2), (0, 1, 0, 1)]
    far = STRAY_WAY * (1.0 + measure_reach(run.views))
    off = np.zeros(len(run.numbers), dtype=bool)
    for numbers in runs:
        if len(numbers) < NEIGHBOURS:
            continue
        part = np.array([index[n] for n in numbers], dtype=np.int64)
        inner = part[2:-2]
        off[inner] |= _leave_path(eyes[part], far[inner])
        off[inner] |= _leave_path(turns[part], STRAY_TURN)
        off[inner] |= _leave_path(lenses[part], STRAY_TURN)
    if not off.any():
        return ""
    return (
        f"the camera of {run.say(off)} lies off the path of the frames around: "
        "matrices of another frame? They are used as they are; correct them, or declare "
        "camera_cuts where the picture does jump"
    )


def _leave_path(places: NDArray[np.float64], least: NDArray[np.float64] | float) -> Flags:
    """Tell which places lie far from where the two before and the two after them lead.

        p = (-p[-2] + 4 p[-1] + 4 p[+1] - p[+2]) / 6,   the cubic through the four

    One that is wrong lies far from it, and with it in its place nothing bends; where a camera
    starts, stops, cuts or shakes, the bends are there either way.
    """
    a, b, own, c, d = (places[i : len(places) - 4 + i] for i in range(NEIGHBOURS))
    led = (4.0 * (b + c) - a - d) / 6.0
    bends = (a - 2.0 * b + led, b - 2.0 * led + c, led - 2.0 * c + d)
    bend = np.max([np.linalg.norm(part, axis=1) for part in bends], axis=0)
    apart = np.linalg.norm(own - led, axis=1)
    return np.asarray((apart > least) & (apart > STRAY * np.maximum(bend, np.median(apart))))
