"""Twice the frames at twice the size: extrapolate first, or upscale first?

    python benchmarks/extrapolation_pipelines.py CAPTURE [--frames 1-8] [--keep FOLDER]
        [--upscaler demod-guided] [--extrapolator warp-guided]

CAPTURE is one sequence of radiance and G-buffer. Of it LR frames are kept by decimation at 2x,
every second one with radiance, and the G-buffers of all at both sizes. Both ways are commands:

    rtsr extrapolate shot/lr lr2 --keep-rendered --passthrough "*"
    rtsr upscale lr2 out --hr shot/hr --capture shot/capture.toml

    rtsr upscale rendered up --on-missing skip --passthrough "*"
    cp -n shot/hr/*.exr up/
    rtsr extrapolate up out

where `rendered` holds the rendered frames of shot/lr and shot/hr. Predicted frames are judged by
`rtsr evaluate`; beside them stands what the upscaler makes of LR frames that were all rendered.
"""

from __future__ import annotations

import json
import shutil
import tempfile
import time
from pathlib import Path

import click
import numpy as np
from results import rtsr

from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.imaging.resampling import sample_jitter

SCALE = 2
EVERY = 2
RADIANCE = ("R", "G", "B")
CAPTURE_TEXT = """layout = "rtsr"
scale = {scale}
jitter_px = [{jitter}, {jitter}]

[motion]
unit = "pixels"
direction = "previous-minus-current"
y_axis = "down"
jittered = false
"""
METRICS = ("psnr", "flip")


def split_capture(capture: Path, shot: Path, last: int) -> None:
    """Write `lr`, `hr` and `reference`; LR radiance of the rendered frames alone."""
    for place, path in enumerate(sorted(capture.glob("*.exr"))[:last]):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        small = {name: p[SCALE // 2 :: SCALE, SCALE // 2 :: SCALE] for name, p in planes.items()}
        for name in ("motion.X", "motion.Y"):
            small[name] = (small[name] / SCALE).astype(np.float32)
        radiance = {c: planes.pop(c) for c in RADIANCE}
        write_exr(shot / "all" / "lr" / path.name, small, attributes=header.attributes)
        if place % EVERY:
            small = {name: plane for name, plane in small.items() if name not in RADIANCE}
        for folder, channels in (("lr", small), ("hr", planes), ("reference", radiance)):
            write_exr(shot / folder / path.name, channels, attributes=header.attributes)
    text = CAPTURE_TEXT.format(scale=SCALE, jitter=sample_jitter(SCALE // 2, SCALE))
    for folder in (shot, shot / "all"):
        (folder / "capture.toml").write_text(text, encoding="utf-8")


def link_rendered(shot: Path, rendered: Path) -> None:
    """A shot of the rendered frames alone, as a renderer would leave it."""
    for folder in ("lr", "hr"):
        (rendered / folder).mkdir(parents=True)
        for path in sorted((shot / folder).glob("*.exr"))[::EVERY]:
            shutil.copyfile(path, rendered / folder / path.name)
    shutil.copy(shot / "capture.toml", rendered)


def extrapolate_first(shot: Path, work: Path, upscaler: str, extrapolator: str) -> None:
    """LR frames between, then everything enlarged."""
    rtsr(
        "extrapolate", shot / "lr", work / "lr2", "--system", extrapolator, "--keep-rendered",
        "--passthrough", "*", "-q",
    )  # fmt: skip
    rtsr(
        "upscale", work / "lr2", work / "extrapolate-first", "--hr", shot / "hr", "--system",
        upscaler, "--capture", shot / "capture.toml", "-q",
    )  # fmt: skip


def upscale_first(shot: Path, work: Path, upscaler: str, extrapolator: str) -> None:
    """Rendered frames enlarged, then those between at the target size."""
    rtsr(
        "upscale", work / "rendered", work / "up", "--system", upscaler, "--on-missing", "skip",
        "--passthrough", "*", "-q",
    )  # fmt: skip
    for path in (shot / "hr").glob("*.exr"):
        if not (work / "up" / path.name).exists():
            shutil.copyfile(path, work / "up" / path.name)
    rtsr("extrapolate", work / "up", work / "upscale-first", "--system", extrapolator, "-q")


@click.command()
@click.argument("capture", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--frames", "count", default=8, show_default=True, help="First ones of CAPTURE.")
@click.option("--upscaler", default="demod-guided", show_default=True)
@click.option("--extrapolator", default="warp-guided", show_default=True)
@click.option("--keep", type=click.Path(path_type=Path), help="Keep the frames in this folder.")
def main(*, capture: Path, count: int, upscaler: str, extrapolator: str, keep: Path | None) -> None:
    """Print a table of both ways."""
    with tempfile.TemporaryDirectory() as folder:
        work = keep or Path(folder)
        shot = work / "shot"
        split_capture(capture, shot, count)
        link_rendered(shot, work / "rendered")
        seconds = {}
        for title, run in (
            ("extrapolate-first", extrapolate_first),
            ("upscale-first", upscale_first),
        ):
            begin = time.process_time()
            run(shot, work, upscaler, extrapolator)
            seconds[title] = time.process_time() - begin
        rtsr(
            "upscale", shot / "all" / "lr", work / "all-rendered", "--hr", shot / "hr",
            "--system", upscaler, "--capture", shot / "capture.toml", "-q",
        )  # fmt: skip
        outputs = [work / name for name in (*seconds, "all-rendered")]
        report = work / "report.json"
        rtsr(
            "evaluate", *outputs, "--ref", shot, "--metric", ",".join(METRICS), "--output", report,
            "-q",
        )  # fmt: skip
        tests = json.loads(report.read_text(encoding="utf-8"))["tests"]
    print("| | PSNR dB | FLIP | disoccluded dB | CPU s |")
    print("|---|---:|---:|---:|---:|")
    for path in outputs:
        mean, regions = tests[path.name]["mean"], tests[path.name]["regions"]
        hidden = (regions.get("disoccluded") or {}).get("psnr")
        cells = (
            f"{mean['psnr']:.2f}", f"{mean['flip']:.4f}",
            "-" if hidden is None else f"{hidden:.2f}",
            f"{seconds[path.name]:.0f}" if path.name in seconds else "-",
        )  # fmt: skip
        print(f"| {path.name} |", " | ".join(cells), "|")


if __name__ == "__main__":
    main()
