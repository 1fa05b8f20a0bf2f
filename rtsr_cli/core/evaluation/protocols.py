"""How linear HDR frames are shown to metrics: published protocols by name.

Tone mapping, transfer, quantisation and SSIM's convention are part of a figure's name: figures of
two protocols are not comparable.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch

from rtsr_cli.core.choices import SsimConvention
from rtsr_cli.core.imaging.color import encode_aces, encode_reinhard, encode_srgb
from rtsr_cli.core.shapes import Color

Display = Callable[[Color], Color]
"""Linear radiance to what a metric compares."""

LEVELS = 255.0
"""Steps of an 8-bit picture."""


def encode_reinhard_srgb(linear: Color) -> Color:
    """c / (1 + c), then the sRGB curve."""
    return encode_srgb(encode_reinhard(linear))


def encode_aces_srgb(linear: Color) -> Color:
    """ACES fit, then the sRGB curve."""
    return encode_srgb(encode_aces(linear))


def encode_truncated_srgb(linear: Color) -> Color:
    """SRGB curve clipped to 0..1, times 255 without its fraction, as NSRD's code does."""
    return (encode_srgb(linear) * LEVELS).floor() / LEVELS


def encode_rounded_srgb(linear: Color) -> Color:
    """SRGB curve clipped to 0..1 in 8 bits: what a PNG holds."""
    return (encode_srgb(linear) * LEVELS).round() / LEVELS


def show_radiance(linear: Color) -> Color:
    """Radiance as it is."""
    return linear


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """One way of judging.

    Attributes:
        name: as users type it.
        description: for the report.
        psnr: what PSNR, tPSNR and the temporal metrics compare.
        structure: what FLIP, LPIPS and VMAF compare.
        ssim: what SSIM and MS-SSIM compare.
        ssim_convention: window, border and covariance.
        predicted_only: judge frames stamped `rtsr:predicted` only.
    """

    name: str
    description: str
    psnr: Display
    structure: Display
    ssim: Display
    ssim_convention: SsimConvention = SsimConvention.WANG
    predicted_only: bool = False


PROTOCOLS = {
    p.name: p
    for p in (
        Protocol(
            name="rtsr",
            description="PSNR on c/(1+c); SSIM, FLIP, LPIPS and VMAF on c/(1+c) then sRGB",
            psnr=encode_reinhard,
            structure=encode_reinhard_srgb,
            ssim=encode_reinhard_srgb,
        ),
        Protocol(
            name="nsrd",
            description="everything on sRGB, clipped, truncated to 8 bit",
            psnr=encode_truncated_srgb,
            structure=encode_truncated_srgb,
            ssim=encode_truncated_srgb,
            ssim_convention=SsimConvention.SKIMAGE11,
        ),
        Protocol(
            name="fusesr",
            description="PSNR on the ACES fit without exposure or gamma; SSIM on linear radiance; "
            "FLIP, LPIPS and VMAF on the ACES fit then sRGB",
            psnr=encode_aces,
            structure=encode_aces_srgb,
            ssim=show_radiance,
            ssim_convention=SsimConvention.ZERO_PAD,
        ),
        Protocol(
            name="extranet",
            description="everything on 8-bit sRGB; frames stamped rtsr:predicted only",
            psnr=encode_rounded_srgb,
            structure=encode_rounded_srgb,
            ssim=encode_rounded_srgb,
            ssim_convention=SsimConvention.SKIMAGE7,
            predicted_only=True,
        ),
    )
}
"""Protocols by name."""


def show_signed(display: Display, linear: Color) -> Color:
    """Show radiance by a protocol, and -c / (1 - c) of what is below 0, which displays clip.

    Black and a value below it, or two of these, are then as different as they are.
    """
    return display(linear.clamp(min=0.0)) - encode_reinhard(-linear)


@dataclass(frozen=True)
class ShownPicture:
    """One picture as the metrics of a protocol see it, each form made when it is asked for.

    `signed` pictures hold radiance below 0, or are compared with such: PSNR then tells it apart.
    """

    linear: Color
    protocol: Protocol
    signed: bool = False

    @cached_property
    def psnr(self) -> Color:
        """What PSNR compares."""
        if self.signed:
            return show_signed(self.protocol.psnr, self.linear)
        return self.protocol.psnr(self.linear)

    @cached_property
    def structure(self) -> Color:
        """What FLIP, LPIPS and VMAF compare."""
        return self.protocol.structure(self.linear)

    @cached_property
    def ssim(self) -> Color:
        """What SSIM compares."""
        same = self.protocol.ssim is self.protocol.structure
        return self.structure if same else self.protocol.ssim(self.linear)

    def eight_bit(self) -> torch.Tensor:
        """h x w x 3 bytes of `structure`, rounded."""
        pixels = (self.structure[0].clamp(0.0, 1.0) * LEVELS).round().to(torch.uint8)
        return pixels.permute(1, 2, 0).contiguous()
