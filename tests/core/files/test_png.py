from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.files.png import encode_png, write_png


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("size", [(1, 1), (2, 4), (37, 53)])
def test_another_reader_finds_the_pixels_that_were_given(
    tmp_path: Path, channels: int, size: tuple[int, int]
) -> None:
    shape = (*size, channels)
    pixels = np.random.default_rng(1).integers(0, 256, shape, dtype=np.uint8)
    # both kinds of rows: noise, and a smooth slope along each axis
    pixels[: size[0] // 2] = np.arange(size[1], dtype=np.uint8)[:, None]
    path = tmp_path / "p.png"
    write_png(path, pixels)
    stored = oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)
    np.testing.assert_array_equal(stored.reshape(shape), pixels)
    assert list(tmp_path.iterdir()) == [path]


def test_one_black_pixel_is_the_file_of_the_specification() -> None:
    # IHDR of a 1 x 1 RGB picture with its checksum, as every such file begins; IEND ends it
    data = encode_png(np.zeros((1, 1, 3), dtype=np.uint8))
    begin = "89504e470d0a1a0a0000000d49484452000000010000000108020000 00907753de"
    assert data.startswith(bytes.fromhex(begin))
    assert data.endswith(bytes.fromhex("0000000049454e44ae426082"))


def test_smooth_pictures_are_stored_small() -> None:
    slope = np.broadcast_to(np.arange(256, dtype=np.uint8)[:, None], (256, 256, 3)).copy()
    assert len(encode_png(slope)) < 2000
    assert len(encode_png(slope.transpose(1, 0, 2).copy())) < 2000


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match=r"p\.png: cannot be written"):
        write_png(tmp_path / "file" / "p.png", np.zeros((1, 1, 3), dtype=np.uint8))
