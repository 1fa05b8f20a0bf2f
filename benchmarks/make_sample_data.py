"""Make `sample_data/` from a folder of captures: LR by decimation, HR G-buffers, reference.

    python benchmarks/make_sample_data.py CAPTURES sample_data

Radiance goes to `lr/` (one sample of each 4 x 4 block) and to `reference/`; `hr/` has none, as
an engine that renders at low resolution would leave it.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import click
import numpy as np

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.imaging.resampling import sample_jitter

SCALE = 4
RADIANCE = ("R", "G", "B")
CAPTURE = """\
# What the frames beside this file hold; every field is optional, see docs/frames.md.
layout = "rtsr"
scale = {scale}
# one sample of each {scale} x {scale} block was kept: right of and below the LR pixel's centre
jitter_px = [{jitter}, {jitter}]

[motion]
unit = "pixels"
direction = "{direction}"
y_axis = "down"
jittered = false
"""


def make_frame(source: Path, out: Path) -> None:
    """Write the three files of one frame."""
    header = read_header(source)
    planes = read_channels(source, header.channels)
    offset = SCALE // 2
    small = {name: plane[offset::SCALE, offset::SCALE] for name, plane in planes.items()}
    for name in ("motion.X", "motion.Y"):
        small[name] = (small[name] / SCALE).astype(np.float32)
    radiance = {name: planes.pop(name) for name in RADIANCE}
    for folder, channels in (("lr", small), ("hr", planes), ("reference", radiance)):
        write_exr(out / folder / source.name, channels, attributes=header.attributes)


@click.command()
@click.argument("captures", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.argument("out", type=click.Path(path_type=Path, file_okay=False))
def main(captures: Path, out: Path) -> None:
    """Write OUT/lr, OUT/hr, OUT/reference, capture.toml and wrong-sign.toml."""
    for source in sorted(captures.glob("*.exr")):
        make_frame(source, out)
    jitter = sample_jitter(SCALE // 2, SCALE)
    for name, direction in (
        ("capture.toml", "previous-minus-current"),
        ("wrong-sign.toml", "current-minus-previous"),
    ):
        text = CAPTURE.format(scale=SCALE, jitter=jitter, direction=direction)
        (out / name).write_text(text, encoding="utf-8")
    for extra in captures.glob("*.json"):
        shutil.copy(extra, out / extra.name)


if __name__ == "__main__":
    main()
