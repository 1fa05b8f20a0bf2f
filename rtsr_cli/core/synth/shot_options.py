"""What a run of `rtsr synth` makes of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from rtsr_cli.core.captures.capture_file import JitterSequence
from rtsr_cli.core.captures.layouts import Layout
from rtsr_cli.core.captures.presets import LAYOUTS
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.shapes import Size

JITTER_PERIOD = 8
"""Length of the jitter sequence: 8 scale^2 frames, as FSR2 has it."""


class FileRole(StrEnum):
    """What a file of a shot is; the value is its folder, `frames` lie in the shot itself."""

    FRAMES = "frames"
    LR = "lr"
    HR = "hr"
    REFERENCE = "reference"


@dataclass(frozen=True, kw_only=True)
class SynthOptions:
    """What is made of a scene; everything here decides bytes.

    Attributes:
        size: (height, width) of the output.
        scale: write a pair, LR of size / scale and HR; None writes one resolution.
        jitter: of the samples, None or the name of a sequence.
        samples: K: of a single resolution, K x K samples of each output pixel are stored; of a
            pair, the reference is their mean.
        layout: channel layout.
        static_camera: the camera stays where it is at frame 1.
    """

    size: Size
    scale: int | None = None
    jitter: str | None = None
    samples: int = 1
    layout: str = "rtsr"
    static_camera: bool = False

    @property
    def roles(self) -> tuple[FileRole, ...]:
        """Files of a frame; a data set with folders of its own keeps the reference in HR."""
        if self.scale is None:
            return (FileRole.FRAMES,)
        pair = (FileRole.LR, FileRole.HR)
        return pair if self.file_layout.tree is not None else (*pair, FileRole.REFERENCE)

    @property
    def file_layout(self) -> Layout:
        """The layout that the files are written in."""
        return LAYOUTS[self.layout]

    @property
    def period(self) -> int:
        """Length of the jitter sequence."""
        return JITTER_PERIOD * (self.scale or 1) ** 2

    def jitter_px(self, number: int) -> Jitter:
        """Jitter of a frame, in pixels of the resolution that is jittered."""
        if self.jitter is None:
            return 0.0, 0.0
        return JitterSequence(period=self.period, first_frame=1).at(number)

    def role_size(self, role: FileRole) -> Size:
        """(height, width) of a role's files."""
        height, width = self.size
        if role is FileRole.LR:
            assert self.scale is not None
            return height // self.scale, width // self.scale
        if role is FileRole.FRAMES:
            return height * self.samples, width * self.samples
        return height, width
