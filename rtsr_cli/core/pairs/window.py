"""What a system sees of a moment, made from stored buffers: the same for `upscale` and `train`.

Tensor code only: frames come from files or from packed crops. Of each resolution `resolve_reads`
says which stored buffers are needed; frames of just those become the LR frame, the HR frame and, to
train on, the reference.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from itertools import islice

from rtsr_cli.core.frames.buffers import RADIANCE_BUFFERS, Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.derivation import (
    DerivationConfig,
    derive,
    divide_radiance,
    resolve_needs,
)
from rtsr_cli.core.pairs.simulation import average_samples
from rtsr_cli.core.system import FrameWindow

QUOTIENT = frozenset({Buffer.LIGHTING, Buffer.LIGHTING_MASK})
"""What dividing radiance gives."""


@dataclass(frozen=True, kw_only=True)
class Reads:
    """Buffers of one resolution, resolved against those that are stored.

    Attributes:
        stored: stored buffers to read.
        used: buffers that the frame holds in the end, those a system must have first.
        missing: names of what required buffers lack; empty if nothing.
    """

    stored: frozenset[Buffer]
    used: tuple[Buffer, ...]
    missing: tuple[str, ...] = ()


def resolve_reads(
    required: Collection[Buffer],
    optional: Collection[Buffer],
    stored: Collection[Buffer],
    *,
    has_camera: bool,
    derivation: DerivationConfig,
) -> Reads:
    """Resolve required buffers, and those optional ones that can be had.

    Args:
        required: buffers that a system must have, stored or derived.
        optional: buffers that it uses where they can be had.
        stored: buffers that are there.
        has_camera: whether every frame has camera matrices.
        derivation: what divides radiance.
    """

    def missing(buffer: Buffer) -> bool:
        return bool(
            resolve_needs((buffer,), stored, has_camera=has_camera, config=derivation).missing
        )

    used = (*required, *(b for b in optional if not missing(b)))
    resolved = resolve_needs(used, stored, has_camera=has_camera, config=derivation)
    return Reads(stored=resolved.read, used=used, missing=resolved.missing)


def build_lr(
    frame: Frame, reads: Reads, derivation: DerivationConfig, *, lighting_scale: float | None = None
) -> Frame:
    """Make the LR frame from stored buffers at the rendered size.

    Args:
        frame: stored buffers, jitter and exposure.
        reads: of LR frames.
        derivation: what divides radiance.
        lighting_scale: k of the whole frame where `frame` is a part of it, else measured.
    """
    return derive(frame, reads.used, derivation, lighting_scale=lighting_scale)


def select_hr(full: Frame, reads: Reads) -> Frame:
    """Keep what the HR frame is made of: radiance never is."""
    return replace(full, gbuffer=full.gbuffer.only(reads.stored - RADIANCE_BUFFERS))


def build_hr(
    selected: Frame, reads: Reads, derivation: DerivationConfig, samples_per_pixel: int = 1
) -> Frame:
    """Make the HR frame from stored buffers, K x K samples a pixel, of `select_hr`."""
    return average_samples(derive(selected, reads.used, derivation), samples_per_pixel)


def build_reference(
    full: Frame,
    reads: Reads,
    derivation: DerivationConfig,
    *,
    samples_per_pixel: int,
    lighting_scale: float,
) -> Frame:
    """Make what training compares with: radiance of an output pixel is the mean of its samples.

    Its lighting is that mean over the mean material term, which the HR frame holds: a network's
    lighting is multiplied by just that.

    Args:
        full: stored buffers, and further radiance beside them.
        reads: of the reference.
        derivation: what divides radiance.
        samples_per_pixel: K.
        lighting_scale: k of the whole frame.
    """
    if samples_per_pixel == 1 or not QUOTIENT & set(reads.used):
        derived = derive(full, reads.used, derivation, lighting_scale=lighting_scale)
        return average_samples(derived, samples_per_pixel)
    parts = {Buffer.COLOR, Buffer.EMISSION, Buffer.MATERIAL, Buffer.SKY, *reads.used} - QUOTIENT
    pixels = average_samples(derive(full, parts, derivation), samples_per_pixel)
    gbuffer = pixels.gbuffer
    divided = divide_radiance(gbuffer, gbuffer[Buffer.MATERIAL], gbuffer[Buffer.SKY], derivation)
    quotient = {Buffer.LIGHTING: divided.lighting, Buffer.LIGHTING_MASK: divided.mask}
    return replace(
        pixels,
        gbuffer=gbuffer.with_buffers(quotient).only(reads.used),
        lighting_scale=lighting_scale,
    )


def join_window(
    frames: Iterable[Frame], hr: Frame | None, *, scale: int, history: int
) -> FrameWindow:
    """Join what a system sees of a moment.

    Args:
        frames: LR frames of one unbroken run, newest first; as far as they go.
        hr: the newest frame's G-buffer at the target size, None if the system reads none.
        scale: output pixels per LR pixel.
        history: predecessors that the system sees at most.
    """
    return FrameWindow(lr=tuple(islice(frames, history + 1)), hr=hr, scale=scale)
