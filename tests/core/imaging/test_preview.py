from __future__ import annotations

import torch

from rtsr_cli.core.frames.conventions import ColorSpace
from rtsr_cli.core.imaging.preview import encode_preview


def test_mid_grey_goes_through_reinhard_and_srgb() -> None:
    # 1 / (1 + 1) = 0.5, and sRGB encodes 0.5 as 0.7354 [IEC 61966-2-1]
    assert encode_preview(torch.ones(1, 3, 1, 1)).tolist() == [[[188, 188, 188]]]


def test_non_finite_pixels_are_magenta() -> None:
    color = torch.zeros(1, 3, 1, 2)
    color[0, 1, 0, 1] = torch.nan
    assert encode_preview(color).tolist() == [[[0, 0, 0], [255, 0, 255]]]


def test_wide_primaries_are_brought_to_rec709() -> None:
    # BT.2020 red is above 1 in Rec.709 red and negative in the others
    red = torch.tensor([1.0, 0.0, 0.0]).view(1, 3, 1, 1)
    shown = encode_preview(red, ColorSpace.REC2020)[0, 0].tolist()
    assert shown[0] > encode_preview(red)[0, 0, 0]
    assert shown[1:] == [0, 0]
