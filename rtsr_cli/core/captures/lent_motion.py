"""HR motion from LR motion, for frames whose renderer writes vectors at one resolution alone."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.imaging.resampling import BILINEAR, upsample
from rtsr_cli.core.imaging.warping import dilate_motion
from rtsr_cli.core.shapes import MotionPx

LENT = "motion is that of {}, enlarged {} times: there is none of this size"
"""Said wherever such vectors are read."""


@dataclass(frozen=True, kw_only=True)
class LentMotion:
    """Vectors of LR frames in place of those that the HR frames beside them lack.

    Attributes:
        lr: the frames that have some.
        scale: HR pixels per LR pixel.
    """

    lr: FrameReader
    scale: int

    @property
    def note(self) -> str:
        """Say where the vectors come from."""
        return LENT.format(self.lr.frames.root, self.scale)

    def files(self, number: int) -> Iterable[Path]:
        """Files that a frame's vectors are read from."""
        return self.lr.files(number, self._read_buffers)

    def read(self, number: int) -> MotionPx:
        """Read a frame's vectors: silhouettes move with the nearer surface, lengths grow.

            v_hr = scale * bilinear(dilate(v_lr)),   jitter of the LR samples compensated

        Raises:
            FrameFolderError: a file is damaged, or has changed since the survey.
        """
        frame = self.lr.read(number, self._read_buffers)
        motion = frame.gbuffer[Buffer.MOTION]
        if Buffer.DEPTH in frame.gbuffer:
            motion = dilate_motion(motion, frame.gbuffer[Buffer.DEPTH])
        return upsample(motion, self.scale, frame.camera.jitter_px, kernel=BILINEAR) * self.scale

    @property
    def _read_buffers(self) -> tuple[Buffer, ...]:
        depth = (Buffer.DEPTH,) if Buffer.DEPTH in self.lr.readable else ()
        return (Buffer.MOTION, *depth)


def lend_motion(hr: FrameReader, lr: FrameReader) -> FrameReader:
    """Return HR frames that take motion from LR ones, if they lack it and the others fit.

    Args:
        hr: frames of the target size.
        lr: frames of the same shot at a whole fraction of it.
    """
    scale = hr.size[0] // lr.size[0]
    fits = lr.view.at_scale(scale) == hr.view and scale > 1 and lr.step == hr.step
    if Buffer.MOTION in hr.binding or Buffer.MOTION not in lr.readable or not fits:
        return hr
    if not set(hr.numbers) <= set(lr.numbers) - set(lr.held):
        return hr
    lent = LentMotion(lr=lr, scale=scale)
    return replace(hr, lent_motion=lent, cuts=hr.cuts | lr.resets, notes=(*hr.notes, lent.note))
