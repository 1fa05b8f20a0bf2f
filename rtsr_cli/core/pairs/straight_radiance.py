"""Radiance as systems see it: the colour of what covers a pixel, without its coverage."""

from __future__ import annotations

from dataclasses import replace

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.coverage import CoveredColor, divide_coverage


def take_coverage_out(frame: Frame) -> tuple[Frame, CoveredColor | None]:
    """Take premultiplied radiance apart; the frame itself, and None, where nothing is to do.

    Args:
        frame: finite radiance, and alpha if the files hold any.
    """
    buffers = frame.gbuffer.buffers
    if Buffer.COLOR not in buffers or Buffer.ALPHA not in buffers:
        return frame, None
    covered = divide_coverage(buffers[Buffer.COLOR], buffers[Buffer.ALPHA])
    if covered is None:
        return frame, None
    straight = frame.gbuffer.with_buffers({Buffer.COLOR: covered.color})
    return replace(frame, gbuffer=straight), covered
