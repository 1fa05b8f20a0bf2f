"""Which buffers cannot be brought to memory's convention without a frame's camera, known before."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from rtsr_cli.core.frames.buffers import NORMAL_BUFFERS, Buffer
from rtsr_cli.core.frames.camera import GIVE_CAMERAS, CameraMetadata
from rtsr_cli.core.frames.conventions import Conventions, DepthKind, NormalSpace
from rtsr_cli.core.frames.selection import format_ranges

DEPTH_NAMES = {DepthKind.RAY: "ray distance", DepthKind.DEVICE: "device depth"}
"""Kinds of depth that become planar with a camera alone."""


@dataclass(frozen=True, kw_only=True)
class CameraNeed:
    """What converting a buffer asks of the camera of every frame.

    Attributes:
        stored_as: how files hold the buffer, in words.
        matrices: that are needed, in words.
        is_met: whether a camera has them.
    """

    stored_as: str
    matrices: str
    is_met: Callable[[CameraMetadata], bool]


def list_camera_needs(conventions: Conventions) -> dict[Buffer, CameraNeed]:
    """Return the buffers whose conversion needs a camera: the rule of `to_memory`."""
    needs: dict[Buffer, CameraNeed] = {}
    if conventions.depth.kind in DEPTH_NAMES:
        needs[Buffer.DEPTH] = CameraNeed(
            stored_as=DEPTH_NAMES[conventions.depth.kind],
            matrices="worldToCamera and worldToNDC",
            is_met=lambda camera: camera.has_matrices,
        )
    if conventions.normal.space is NormalSpace.VIEW:
        need = CameraNeed(
            stored_as="view-space normals",
            matrices="worldToCamera",
            is_met=lambda camera: camera.world_to_camera is not None,
        )
        needs |= dict.fromkeys(NORMAL_BUFFERS, need)
    return needs


@dataclass(frozen=True, kw_only=True)
class UnmetNeed:
    """A buffer that cannot be read in every frame.

    Attributes:
        need: what is asked for.
        lacking: frames whose camera has it not.
        everywhere: whether no frame has it.
    """

    need: CameraNeed
    lacking: tuple[int, ...]
    everywhere: bool

    @property
    def frames(self) -> str:
        """The frames, behind a word: nothing where none has a camera, else " of frame 7"."""
        return name_lacking(self.lacking, everywhere=self.everywhere)

    def describe(self, buffer: Buffer) -> str:
        """Say why a buffer is not read, and the remedy."""
        whose = "no frame has them" if self.everywhere else f"{say_frames(self.lacking)} without"
        return (
            f"{buffer} is not read: it is {self.need.stored_as}, which needs the camera matrices "
            f"{self.need.matrices} ({whose}); {GIVE_CAMERAS}"
        )


def find_unmet_needs(
    conventions: Conventions, stored: Collection[Buffer], cameras: Mapping[int, CameraMetadata]
) -> dict[Buffer, UnmetNeed]:
    """Return the stored buffers that lack a camera in some frame."""
    unmet: dict[Buffer, UnmetNeed] = {}
    for buffer, need in list_camera_needs(conventions).items():
        lacking = tuple(n for n, camera in cameras.items() if not need.is_met(camera))
        if buffer in stored and lacking:
            every = len(lacking) == len(cameras)
            unmet[buffer] = UnmetNeed(need=need, lacking=lacking, everywhere=every)
    return unmet


def describe_faults(cameras: Mapping[int, CameraMetadata]) -> str:
    """Say in which frames files hold matrices that are none, and why; empty if in none."""
    found: dict[str, list[int]] = {}
    for number, camera in cameras.items():
        if camera.fault:
            found.setdefault(camera.fault, []).append(number)
    return "; ".join(f"{say_frames(numbers)}: {fault}" for fault, numbers in found.items())


def name_lacking(numbers: Collection[int], *, everywhere: bool) -> str:
    """Return " of frame 7" or " of frames 1-3"; nothing where all frames are meant."""
    return "" if everywhere or not numbers else f" of {say_frames(numbers)}"


def say_frames(numbers: Collection[int]) -> str:
    """Write frame 7 or frames 1-3."""
    return f"frame{'' if len(numbers) == 1 else 's'} {format_ranges(numbers)}"
