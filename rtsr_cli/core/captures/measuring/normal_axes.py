"""In which axes normals stand on the surfaces that depth shows: the world's, the camera's, others.

Where cameras are proven, of each reading the share of the normals is known that do not stand on
their surfaces. Bumps and edges have their part in it whatever is read, and only the right reading
has nothing else: another one that leaves far fewer is the right one. Readings that leave as many
are a few degrees apart, as the world and the view of a camera that hardly turns; then all normals
together lean from their surfaces in the wrong one, and not in the right one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray

from rtsr_cli.core.captures.measuring.camera_hypotheses import Cameras
from rtsr_cli.core.captures.measuring.camera_structure import SIGNED_AXES, Matrix4
from rtsr_cli.core.captures.measuring.normal_evidence import NormalEvidence
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import NormalSpace

LEAST_LEAN, LEANS_MORE = 0.5, 4.0
"""Normals are wrong that lean by so many degrees as a whole, and so many times as far as others."""


@dataclass(frozen=True, kw_only=True)
class NormalAxes:
    """How many normals of a buffer do not stand on their surfaces, per cent, by reading.

    Attributes:
        buffer: normals or geometric normals.
        apart: by the space they are read in.
        turned: in the world whose axes fit best among all others.
        axes: A of that world, n . A.
        lean: by the space, how far all normals together lean from their surfaces, degrees.
        turned_lean: the same in that other world.
        lines: what `[buffers]` would have to say of the buffer then; empty where nothing does.
    """

    buffer: Buffer
    apart: dict[NormalSpace, float]
    turned: float
    axes: Matrix4
    lean: dict[NormalSpace, float] = field(default_factory=dict)
    turned_lean: float = math.inf
    lines: tuple[str, ...] = ()

    def find_other(self, space: NormalSpace) -> NormalSpace | NDArray[np.float64] | None:
        """The reading that is right in the place of one; None where nothing says so.

        Args:
            space: that they are read in.
        """
        own, slack = self.apart[space], NormalEvidence.slack
        other = next(s for s in NormalSpace if s is not space)
        best = min(self.apart[other], self.turned)
        if best > NormalEvidence.limit:
            return None
        if best + slack >= own:
            close = abs(self.apart[other] - own) < slack
            return other if close and self._lean_less(self.lean.get(other), space) else None
        # of the camera's axes the world's are others wherever a camera looks along one of them
        return other if self.apart[other] < best + slack else self.axes

    def is_nearly(self, space: NormalSpace) -> bool:
        """Tell whether a space is near the other world's axes, and those are what is right."""
        near = self.apart[space] < self.turned + NormalEvidence.slack
        return near and self._lean_less(self.turned_lean, space)

    @property
    def is_mirrored(self) -> bool:
        """Tell whether the other world is of the other handedness than the matrices'."""
        return float(np.linalg.det(self.axes[:3, :3])) < 0.0

    def _lean_less(self, lean: float | None, space: NormalSpace) -> bool:
        """Tell whether normals that lean so far are right, and those of a space are not."""
        own = self.lean.get(space)
        if lean is None or own is None:
            return False
        return own >= LEAST_LEAN and own > LEANS_MORE * lean


def describe_axes(axes: Matrix4) -> str:
    """Write n . A by its parts: x, z, -y."""
    columns = axes[:3, :3].T
    rows = [int(np.abs(column).argmax()) for column in columns]
    return ", ".join(
        f"{'-' if column[row] < 0.0 else ''}{'xyz'[row]}"
        for column, row in zip(columns, rows, strict=True)
    )


def measure_axes(evidence: NormalEvidence, cameras: Cameras, buffer: Buffer) -> NormalAxes | None:
    """Try every reading of normals; None where nothing can be compared.

    Args:
        evidence: the normals, unpacked, with their depths.
        cameras: proven.
        buffer: that they are.
    """
    likely = replace(evidence, depths=evidence.depths[:1])
    first = _try_axes(likely, cameras, buffer)
    if first is not None and any(first.find_other(space) is None for space in NormalSpace):
        return first
    return _try_axes(evidence, cameras, buffer)


def _try_axes(evidence: NormalEvidence, cameras: Cameras, buffer: Buffer) -> NormalAxes | None:
    worlds = torch.from_numpy(np.stack(SIGNED_AXES)[:, :3, :3])
    found = evidence.measure_axes(cameras, torch.cat([worlds, worlds[:1]]))
    if found is None:
        return None
    best = 1 + int(found[1:-1].argmin())
    leans = evidence.measure_lean(cameras, worlds[[0, best, 0]])
    spaces = (NormalSpace.WORLD, NormalSpace.VIEW)
    return NormalAxes(
        buffer=buffer,
        apart=dict(zip(spaces, found[[0, -1]].tolist(), strict=True)),
        turned=float(found[best]),
        axes=SIGNED_AXES[best],
        lean={} if leans is None else dict(zip(spaces, leans[[0, -1]].tolist(), strict=True)),
        turned_lean=math.inf if leans is None else float(leans[1]),
    )
