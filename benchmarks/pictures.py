"""Put the same frame of several result folders side by side, with a zoomed crop below.

    python benchmarks/pictures.py OUT.png --frame 4 --crop 200,90,120,72 \\
        "LR=lr/" "bicubic=out_bicubic/" "reference=reference/"

Each argument is LABEL=FOLDER; smaller frames are enlarged by repeating pixels.
"""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
import OpenImageIO as oiio  # noqa: N813
import torch
from numpy.typing import NDArray

from rtsr_cli.core.files.exr import read_channels
from rtsr_cli.core.files.png import write_png
from rtsr_cli.core.imaging.preview import encode_preview
from rtsr_cli.core.imaging.resampling import upsample_nearest

GAP_PX = 4
LABEL_PX = 18


def picture(folder: Path, frame: int, width: int | None) -> NDArray[np.uint8]:
    """Load a frame by number and bring it to display values at `width`."""
    [path] = [p for p in folder.glob("*.exr") if int(p.stem.split(".")[-1]) == frame]
    planes = read_channels(path, "RGB")
    color = torch.stack([torch.from_numpy(planes[c].astype(np.float32)) for c in "RGB"])[None]
    factor = 1 if width is None else max(1, width // color.shape[-1])
    return encode_preview(upsample_nearest(color, factor))


def labelled(image: NDArray[np.uint8], text: str) -> NDArray[np.uint8]:
    """Add a line of text above a picture."""
    height, width, _ = image.shape
    canvas = np.full((height + LABEL_PX, width, 3), 255, np.uint8)
    canvas[LABEL_PX:] = image
    buffer = oiio.ImageBuf(canvas)
    oiio.ImageBufAlgo.render_text(buffer, 2, LABEL_PX - 4, text, 13, "", (0.0, 0.0, 0.0))
    pixels: NDArray[np.uint8] = buffer.get_pixels(oiio.UINT8)
    return pixels


def side_by_side(images: list[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Join pictures of one height with a white gap."""
    gap = np.full((images[0].shape[0], GAP_PX, 3), 255, np.uint8)
    joined = [part for image in images for part in (image, gap)]
    return np.concatenate(joined[:-1], axis=1)


def parse_crop(value: str) -> tuple[int, int, int, int]:
    """Left, top, width, height."""
    left, top, width, height = (int(v) for v in value.split(","))
    return left, top, width, height


@click.command()
@click.argument("out", type=click.Path(path_type=Path))
@click.argument("labels", nargs=-1, required=True)
@click.option("--frame", type=int, required=True)
@click.option("--crop", required=True, help="left,top,width,height in target pixels")
@click.option("--zoom", type=int, default=3, show_default=True)
def main(out: Path, labels: tuple[str, ...], frame: int, crop: str, zoom: int) -> None:
    """Write OUT: one zoomed crop of the frame for each LABEL=FOLDER."""
    folders = dict(item.split("=", 1) for item in labels)
    width = max(picture(Path(f), frame, None).shape[1] for f in folders.values())
    left, top, w, h = parse_crop(crop)
    tiles = []
    for label, folder in folders.items():
        image = picture(Path(folder), frame, width)[top : top + h, left : left + w]
        tiles.append(labelled(image.repeat(zoom, axis=0).repeat(zoom, axis=1), label))
    write_png(out, side_by_side(tiles))


if __name__ == "__main__":
    main()
