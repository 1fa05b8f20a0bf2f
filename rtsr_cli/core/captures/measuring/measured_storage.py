"""What was measured of a few frames: motion, camera, jitter, depth, position unit, normals."""

from __future__ import annotations

from dataclasses import dataclass, field

from rtsr_cli.core.captures.measuring.camera_check import CameraFinding
from rtsr_cli.core.captures.measuring.empty_buffers import BufferFault
from rtsr_cli.core.captures.measuring.geometry_finder import DepthFinding
from rtsr_cli.core.captures.measuring.jitter_finder import JitterFinding
from rtsr_cli.core.captures.measuring.motion_finding import MotionCandidate, MotionFinding
from rtsr_cli.core.captures.measuring.normal_axes import NormalAxes
from rtsr_cli.core.captures.measuring.normal_evidence import NormalEvidence
from rtsr_cli.core.captures.measuring.normal_finder import NormalFinding
from rtsr_cli.core.captures.measuring.sky_finder import SkyFinding


@dataclass(frozen=True, kw_only=True)
class StorageMeasurement:
    """What was measured; a part is empty where the files do not tell.

    Attributes:
        motion: ranked readings of the vectors, None without motion, pictures or two frames.
        repeated: frames with the picture of the frame before them, and vectors that move.
        resting: such frames whose vectors rest, as they should.
        samples_rest: whether things at rest show that samples lie where they lay, in all frames.
        by_geometry: the reading that world positions prove, or the tied one that camera and depth
            single out.
        geometry: which of them it was.
        camera: whether the matrices hold; None where there are none.
        jitter: whether vectors contain it.
        depth: ranked readings.
        median_depth: stored value that half of the surfaces lie below, None without depth.
        position_unit_m: metres in a unit of the position buffer.
        normal: packing and axes.
        sky: what is sky, None where neither depth nor normals tell.
        faults: buffers that say nothing, or what no surface is.
        frames: numbers that were read.
    """

    motion: MotionFinding | None = None
    repeated: tuple[int, ...] = ()
    resting: tuple[int, ...] = ()
    samples_rest: bool = False
    by_geometry: MotionCandidate | None = None
    geometry: str = "camera and depth"
    camera: CameraFinding | None = None
    jitter: JitterFinding | None = None
    depth: DepthFinding = field(default_factory=DepthFinding)
    median_depth: float | None = None
    position_unit_m: float | None = None
    normal: NormalFinding | None = None
    normal_axes: tuple[NormalAxes, ...] = ()
    sky: SkyFinding | None = None
    faults: tuple[BufferFault, ...] = ()
    frames: tuple[int, ...] = ()

    @property
    def proves_normals(self) -> bool:
        """Tell whether the axes of normals are measured: by what faces the camera, or by depth."""
        if self.normal is not None and self.normal.space is not None:
            return True
        return self.camera is not None and NormalEvidence.name in self.camera.proofs

    @property
    def best(self) -> MotionCandidate | None:
        """The reading of motion that stands alone, None where several tie or none is good."""
        if self.by_geometry is not None:
            return self.by_geometry
        if self.motion is None or self.motion.best is None:
            return None
        return self.motion.best if len(self.motion.ties) == 1 else None
