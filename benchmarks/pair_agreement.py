"""Which share of LR samples is unlike all HR pixels around, of right pairs and of wrong ones.

    python benchmarks/pair_agreement.py FOLDER ... [--scale 2 3 4]

A folder holds pairs (`rtsr synth OUT --size 192x96 --frames 1-3 --shots 4 --scale 4` writes some),
or captures, of which samples at a corner of each block are LR. A row is a frame: as it is, the best
of the ways in which HR may be turned; of depth alone, as it is and HR of the next frame; and of
base colour alone, as it is and the best of the ways in which its channels or encoding may differ.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.imaging.resampling import decimate
from rtsr_cli.core.pairs.opening import (
    ReadOptions,
    find_shots_of,
    open_pairs,
    open_set,
    open_shot,
)
from rtsr_cli.core.pairs.pair_agreement import (
    COMPARED,
    TURNED,
    flip,
    measure_readings,
    measure_strays,
    measure_strays_of,
)

Case = tuple[str, int, GBuffer, GBuffer, GBuffer]
"""Name, scale, LR, HR, HR of the next frame."""


def list_cases(folder: Path, scales: list[int]) -> Iterator[Case]:
    """The middle frame of every shot of a folder."""
    options = ReadOptions()
    if all(shot.hr is None for shot in find_shots_of(folder, options)):
        yield from _list_captures(folder, options, scales)
        return
    for name, source in open_pairs(folder, options):
        lr, hr = source.readers
        buffers = [b for b in COMPARED if b in lr.readable & hr.readable]
        first, second = _choose(lr.numbers)
        small, large, other = (
            reader.read(number, buffers).gbuffer
            for reader, number in ((lr, first), (hr, first), (hr, second))
        )
        yield f"{folder.name}/{name}", source.scale, small, large, other


def _list_captures(folder: Path, options: ReadOptions, scales: list[int]) -> Iterator[Case]:
    for shot in find_shots_of(folder, options):
        reader = open_set(shot.frames, open_shot(shot, folder, options), jittered=False)
        buffers = [b for b in COMPARED if b in reader.readable]
        first, second = _choose(reader.numbers)
        large, other = (reader.read(n, buffers).gbuffer for n in (first, second))
        for scale in scales:
            small = {b: decimate(image, scale, (scale - 1, 0)) for b, image in large.items()}
            yield f"{folder.name}/{shot.name}", scale, large.with_buffers(small), large, other


def _choose(numbers: tuple[int, ...]) -> tuple[int, int]:
    """The middle frame and the one after, or before the last."""
    middle = len(numbers) // 2
    return numbers[middle], numbers[middle + 1 if middle + 1 < len(numbers) else middle - 1]


def main() -> None:
    """Print a row a frame."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--scale", nargs="+", type=int, default=[2, 3, 4])
    asked = parser.parse_args()
    print(f"{'':32}  as it is    turned    depth     next   colour   others")
    for folder in asked.folders:
        for name, scale, lr, hr, other in list_cases(folder, asked.scale):
            depth = lr.only((Buffer.DEPTH,))
            turned = [measure_strays(lr, flip(hr, dims), scale) for dims in TURNED.values()]
            found = (measure_strays(lr, hr, scale), min(share or 0.0 for share in turned))
            moved = [measure_strays(depth, image, scale) for image in (hr, other)]
            shares = [share or 0.0 for share in (*found, *moved)]
            if Buffer.ALBEDO in lr:
                albedo = lr[Buffer.ALBEDO], hr[Buffer.ALBEDO]
                strays = measure_strays_of(Buffer.ALBEDO, *albedo, lr, scale)
                others = measure_readings(Buffer.ALBEDO, lr, hr, scale)
                shares += [strays or 0.0, min(others.values())]
            print(f"{name:28} {scale}x", *(f"{share:9.4f}" for share in shares), flush=True)


if __name__ == "__main__":
    main()
