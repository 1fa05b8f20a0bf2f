"""In which axes normals stand on the surfaces that depth shows: the world's, the camera's, others.

Where cameras are proven, of each reading the share of the normals is known that do not stand on
their surfaces. Bumps and edges have their part in it whatever is read, and only the right reading
has nothing else: another one that leaves far fewer is the right one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from rtsr_cli.core.captures.measuring.camera_evidence import NormalEvidence
from rtsr_cli.core.captures.measuring.camera_hypotheses import Cameras
from rtsr_cli.core.captures.measuring.camera_structure import SIGNED_AXES, Matrix4
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.conventions import NormalSpace


@dataclass(frozen=True, kw_only=True)
class NormalAxes:
    """How many normals of a buffer do not stand on their surfaces, per cent, by reading.

    Attributes:
        buffer: normals or geometric normals.
        apart: by the space they are read in.
        turned: in the world whose axes fit best among all others.
        axes: A of that world, n . A.
        lines: what `[buffers]` would have to say of the buffer then; empty where nothing does.
    """

    buffer: Buffer
    apart: dict[NormalSpace, float]
    turned: float
    axes: Matrix4
    lines: tuple[str, ...] = ()

    def find_other(self, space: NormalSpace) -> NormalSpace | NDArray[np.float64] | None:
        """The reading that is right in the place of one; None where nothing says so.

        Args:
            space: that they are read in.
        """
        own, slack = self.apart[space], NormalEvidence.slack
        other = next(s for s in NormalSpace if s is not space)
        best = min(self.apart[other], self.turned)
        if best > NormalEvidence.limit or best + slack >= own:
            return None
        # of the camera's axes the world's are others wherever a camera looks along one of them
        return other if self.apart[other] < best + slack else self.axes


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
    return NormalAxes(
        buffer=buffer,
        apart={NormalSpace.WORLD: float(found[0]), NormalSpace.VIEW: float(found[-1])},
        turned=float(found[best]),
        axes=SIGNED_AXES[best],
    )
