"""The solids of a scene at one frame, with the poses of the frames beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rtsr_cli.core.synth.scene import Body, Matrix, Part, Scene, Shape


@dataclass(frozen=True, kw_only=True)
class PlacedPart:
    """A part of a body in world space.

    Attributes:
        part, body: what it is.
        pose: local to world at this frame.
        previous, following: the same at the frames before and after.
    """

    part: Part
    body: Body
    pose: Matrix
    previous: Matrix
    following: Matrix

    @property
    def axes(self) -> NDArray[np.float64]:
        """World directions of the local axes, one a row."""
        axes: NDArray[np.float64] = self.pose[:3, :3]
        return axes

    @property
    def centre(self) -> NDArray[np.float64]:
        """World position of the local origin."""
        centre: NDArray[np.float64] = self.pose[3, :3]
        return centre

    def corners(self) -> NDArray[np.float64]:
        """The eight world corners of the local bounding box, x slowest."""
        signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        corners: NDArray[np.float64] = signs * np.array(self.part.half_m) @ self.axes + self.centre
        return corners

    @property
    def bounded(self) -> bool:
        """Tell whether it has corners."""
        return self.part.shape is not Shape.PLANE


def place_parts(scene: Scene, number: int) -> tuple[PlacedPart, ...]:
    """Place every part of every body at a frame."""
    placed = []
    for body in scene.bodies:
        poses = [body.motion.pose(number + step) for step in (0, -1, 1)]
        for part in body.parts:
            local = part.pose
            now, previous, following = (local @ pose for pose in poses)
            if not body.motion.moving:
                previous = following = now
            placed.append(
                PlacedPart(part=part, body=body, pose=now, previous=previous, following=following)
            )
    return tuple(placed)
