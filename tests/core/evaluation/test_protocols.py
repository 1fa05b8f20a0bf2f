"""What each protocol shows to the metrics, by hand."""

from __future__ import annotations

import pytest
import torch

from rtsr_cli.core.evaluation.protocols import PROTOCOLS, ShownPicture, encode_rounded_srgb
from rtsr_cli.core.imaging.color import decode_srgb


def grey(*values: float) -> torch.Tensor:
    """One row of pixels, each value in all three channels."""
    return torch.tensor(values).view(1, 1, 1, -1).expand(1, 3, 1, -1)


def test_every_8_bit_code_survives_decoding_encoding_and_rounding() -> None:
    codes = (torch.arange(256.0) / 255.0).view(1, 1, 1, -1)
    torch.testing.assert_close(encode_rounded_srgb(decode_srgb(codes)), codes)


@pytest.mark.parametrize(
    ("name", "psnr", "ssim", "display"),
    # of radiance 1 and 3: sRGB(0.5) = 0.735357, sRGB(0.75) = 0.880825; the ACES fit gives
    # 2.54 / 3.16 and 3 * 7.56 / (3 * 7.88 + 0.14), and 1.055 y^(1/2.4) - 0.055 of them
    [
        ("rtsr", (0.5, 0.75), (0.735357, 0.880825), (0.735357, 0.880825)),
        ("nsrd", (1.0, 1.0), (1.0, 1.0), (1.0, 1.0)),
        ("fusesr", (0.803797, 0.953743), (1.0, 3.0), (0.908230, 0.979385)),
        ("extranet", (1.0, 1.0), (1.0, 1.0), (1.0, 1.0)),
    ],
)
def test_a_protocol_shows_radiance_as_its_paper_does(
    name: str, psnr: tuple[float, ...], ssim: tuple[float, ...], display: tuple[float, ...]
) -> None:
    radiance, protocol = grey(1.0, 3.0), PROTOCOLS[name]
    for transfer, expected in (
        (protocol.psnr, psnr),
        (protocol.ssim, ssim),
        (protocol.structure, display),
    ):
        assert transfer(radiance)[0, 1, 0].tolist() == pytest.approx(expected, abs=2e-6)


def test_truncating_protocols_drop_the_fraction_that_rounding_ones_raise() -> None:
    # sRGB(0.18) = 0.46135613, times 255 = 117.6458
    radiance = grey(0.18)
    assert float(PROTOCOLS["nsrd"].ssim(radiance)[0, 0]) * 255 == pytest.approx(117)
    assert float(PROTOCOLS["extranet"].ssim(radiance)[0, 0]) * 255 == pytest.approx(118)


def test_what_is_displayed_lies_between_0_and_1_whatever_the_radiance() -> None:
    radiance = grey(-3.0, 0.0, 1e-6, 0.3, 7.0, 65504.0)
    for protocol in PROTOCOLS.values():
        shown = protocol.structure(radiance)
        assert float(shown.min()) == 0.0
        assert float(shown.max()) <= 1.0


def test_only_extranet_asks_for_predicted_frames() -> None:
    assert [p.name for p in PROTOCOLS.values() if p.predicted_only] == ["extranet"]


def test_bytes_are_the_rounded_structure() -> None:
    shown = ShownPicture(grey(0.0, 1.0, 1e9), PROTOCOLS["rtsr"])
    # sRGB(1/2) = 0.735357 -> 187.5 of 255 rounds to 188
    assert shown.eight_bit()[0, :, 0].tolist() == [0, 188, 255]
