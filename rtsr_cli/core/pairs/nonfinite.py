"""Numbers that no light has, in an input: NaN and Inf, refused or repaired; values below 0."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from rtsr_cli.core.choices import NonfinitePolicy
from rtsr_cli.core.errors import NonfiniteError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.resampling import grow_valid
from rtsr_cli.core.wording import say_count, say_verb

INPAINT_STEPS = 16
"""Non-finite regions are filled from their rim this many pixels deep, then with 0."""


def apply_policy(frame: Frame, policy: NonfinitePolicy) -> tuple[Frame, int]:
    """Apply the policy for NaN and Inf; return the frame and the number of bad values.

    Raises:
        NonfiniteError: policy `error` and a bad value; names folder, frame and buffer.
    """
    # a sum that is finite has finite terms only, and costs one fast pass
    suspects = [
        buffer
        for buffer, tensor in frame.gbuffer.items()
        if tensor.is_floating_point() and not bool(torch.isfinite(tensor.sum()))
    ]
    counts = {b: int((~torch.isfinite(frame.gbuffer[b])).sum()) for b in suspects}
    bad = {buffer: count for buffer, count in counts.items() if count}
    if not bad:
        return frame, 0
    if policy is NonfinitePolicy.ERROR:
        listed = ", ".join(f"{say_count(count, 'value')} of '{b}'" for b, count in bad.items())
        count = sum(bad.values())
        raise NonfiniteError(
            f"{frame.gbuffer.where}: {listed} {say_verb(count)} NaN or Inf; render the frame "
            "again, or choose --on-nonfinite zero|inpaint",
            count,
        )
    fixed = {
        b: _repair_ids(frame.gbuffer[b])
        if b is Buffer.OBJECT_ID
        else _repair_image(frame.gbuffer[b], policy)
        for b in bad
    }
    return replace(frame, gbuffer=frame.gbuffer.with_buffers(fixed)), sum(bad.values())


def count_negative(frame: Frame) -> int:
    """Count the values of radiance below 0, which no light is."""
    held = frame.gbuffer.buffers
    radiance = [held[b] for b in (Buffer.COLOR, Buffer.LIGHTING, Buffer.EMISSION) if b in held]
    # most frames are told by one fast pass
    return sum(int((image < 0).sum()) for image in radiance if float(image.amin()) < 0)


def _repair_ids(ids: Tensor) -> Tensor:
    """Whole object numbers; what is none becomes 0, no object, as no neighbour can tell it."""
    return torch.where(torch.isfinite(ids), ids, torch.zeros_like(ids)).round().to(torch.int32)


def _repair_image(image: Tensor, policy: NonfinitePolicy) -> Tensor:
    finite = torch.isfinite(image).all(1, keepdim=True)
    zeroed = torch.where(torch.isfinite(image), image, torch.zeros_like(image))
    if policy is NonfinitePolicy.ZERO:
        return zeroed
    filled, _ = grow_valid(zeroed, finite.to(image.dtype), INPAINT_STEPS)
    return filled
