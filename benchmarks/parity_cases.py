"""What `benchmarks/parity.py` runs: inputs that the revision before makes, and a table of cases.

In command lines `{data}` is the folder of rendered sequences, `{made}` what `INPUTS` and
`make_inputs` wrote. A command runs in an empty folder of its own and writes to `out`, so that
what it says names no other path.
"""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR

GUIDED = 1e-3
"""Tolerance of what rests on the guided enlargement: log(1 + x), relative and absolute."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One command line, run on both revisions.

    Attributes:
        name: unique; `--only` takes its beginning.
        line: the command's arguments.
        first: command lines that run before it in the same folder.
        copy: folder that is copied to `in` beside `out` first; empty: none.
        code: exit code that the revision before gives.
        within: tolerance in log(1 + x); None: bit for bit.
        quick: part of `--quick`.
        files: patterns of the files that are compared.
        wish: setting that is added where the revision knows it (`--set KEY=VALUE`).
    """

    name: str
    line: str
    first: tuple[str, ...] = ()
    copy: str = ""
    code: int = 0
    within: float | None = None
    quick: bool = False
    files: tuple[str, ...] = ("**/*",)
    wish: str = ""


SHOTS = {
    "sample": ("{made}/sample_data", "", "1-3"),
    "fly": ("{data}/court/fly", "--simulate-lr 4", "1-3"),
    "climb": ("{data}/stairs/climb", "--simulate-lr 4 --jitter halton", "9-11"),
    "standard": ("{data}/dumps/standard", "--simulate-lr 4", "5-7"),
    "blender": ("{data}/dumps/multilayer", "--simulate-lr 4", "5-7"),
    "folders": ("{data}/dumps/folders", "--simulate-lr 4", "5-7"),
    "synth": ("{made}/synth", "", "1-3"),
    "synth-blender": ("{made}/synth-blender", "--simulate-lr 4", "1-3"),
}
"""IN of `upscale` by name, how LR frames come about, and the frames."""

GUIDED_SYSTEMS = ("demod-guided", "fusesr", "fusesr-fast", "nsrd")
SYSTEMS = ("bicubic", "demod-bicubic", "taau", *GUIDED_SYSTEMS)

INPUTS = (
    "synth {made}/synth --size 192x128 --scale 4 --jitter halton --samples 2 --frames 1-4 --seed 3",
    "synth {made}/synth-blender --size 192x128 --layout blender --frames 1-4 --seed 5",
    "synth {made}/synth-folders --size 192x128 --layout extranet --frames 1-4 --seed 6",
    "demodulate {data}/sample {made}/divided --frames 1-3",
    "upscale {made}/sample_data {made}/results/bicubic --system bicubic",
    "upscale {made}/sample_data {made}/results/taau --system taau",
    "train fusesr-direct {data}/court --out {made}/direct --scale 4 --set training.steps=2 "
    "--set training.batch=1 --set training.crop=16",
    "train nsrd {data}/court --out {made}/nsrd2 --scale 2 --set training.steps=2 "
    "--set training.batch=1 --set training.crop=16",
)
"""Command lines of the revision before whose outputs are inputs of cases."""


def _upscale() -> Iterator[Case]:
    for system in SYSTEMS:
        within = GUIDED if system in GUIDED_SYSTEMS else None
        for shot, (folder, how, frames) in SHOTS.items():
            dump = shot in ("standard", "blender", "folders")
            if dump and system in ("fusesr", "demod-bicubic"):
                continue
            yield Case(
                name=f"upscale-{system}-{shot}",
                line=f"upscale {folder} out --system {system} {how} --frames {frames} --json",
                within=within,
                quick=shot == "sample",
            )


SAMPLE = "upscale {made}/sample_data out --frames 1-3"
SIMULATED = "upscale {data}/court/fly out --frames 2-4 --json"
TRAIN = (
    "--json --set training.steps=20 --set training.batch=2 --set training.log_every=1 "
    "--set training.save_every=1000 --set training.validate_every=1000"
)
OPTIONS = (
    Case(name="upscale-default", line=f"{SAMPLE} -v", within=GUIDED),
    Case(
        name="upscale-direct",
        line=f"{SAMPLE} --weights {{made}}/direct/best.safetensors --json",
        within=GUIDED,
    ),
    Case(
        name="upscale-nsrd-2x",
        line=f"{SIMULATED} --simulate-lr 2 --weights {{made}}/nsrd2/best.safetensors",
        within=GUIDED,
    ),
    Case(
        name="upscale-fast-2x",
        line=f"{SIMULATED} --simulate-lr 2 --system fusesr-fast",
        within=GUIDED,
    ),
    *(
        Case(
            name=f"upscale-{system}-{lr_filter}-samples",
            line=f"{SIMULATED} --simulate-lr 2 --jitter halton --lr-filter {lr_filter} "
            f"--samples-per-pixel 2 --system {system}",
            within=GUIDED if system == "fusesr-fast" else None,
            quick=system == "taau",
        )
        for system, lr_filter in (
            ("taau", "box"),
            ("bicubic", "blackman-harris"),
            ("fusesr-fast", "box"),
        )
    ),
    Case(
        name="upscale-nsrd-samples",
        line=f"{SIMULATED} --simulate-lr 4 --jitter halton --samples-per-pixel 2 --system nsrd",
        within=GUIDED,
    ),
    Case(name="upscale-preview", line=f"{SAMPLE} --system bicubic --preview", quick=True),
    Case(
        name="upscale-passthrough",
        line=f"{SAMPLE} --system taau --passthrough 'albedo.*' --passthrough depth.Z --json",
        quick=True,
    ),
    Case(
        name="upscale-passthrough-unknown",
        line=f"{SAMPLE} --system bicubic --passthrough nothing.*",
        code=3,
    ),
    Case(name="upscale-debug-taau", line=f"{SAMPLE} --system taau --debug-buffers"),
    Case(name="upscale-debug-bicubic", line=f"{SAMPLE} --system bicubic --debug-buffers"),
    Case(name="upscale-debug-nsrd", line=f"{SAMPLE} --system nsrd --debug-buffers", within=GUIDED),
    Case(
        name="upscale-debug-fast",
        line=f"{SAMPLE} --system fusesr-fast --debug-buffers",
        within=GUIDED,
    ),
    *(
        Case(
            name=f"upscale-{system}-tiles",
            line=f"{SAMPLE} --system {system} --tile 64 --json",
            within=GUIDED if system in GUIDED_SYSTEMS else None,
            quick=system == "nsrd",
        )
        for system in ("fusesr-fast", "fusesr", "nsrd", "taau", "bicubic")
    ),
    Case(name="upscale-bf16", line=f"{SAMPLE} --system nsrd --precision bf16", within=2e-2),
    Case(
        name="upscale-no-hr",
        line="upscale {made}/sample_data/lr out --scale 3 --frames 2-4 --json",
    ),
    Case(
        name="upscale-hr-elsewhere",
        line="upscale {made}/sample_data/lr out --hr {made}/sample_data/hr "
        "--system demod-bicubic --frames 2-3 --json",
    ),
    Case(
        name="upscale-tree",
        line="upscale {data}/dumps out --simulate-lr 4 --system bicubic --frames 5-6 --json",
    ),
    Case(
        name="upscale-kept",
        first=("upscale {made}/sample_data out --system taau --frames 1-2",),
        line="upscale {made}/sample_data out --system taau --frames 1-4 --json",
        quick=True,
    ),
    Case(
        name="upscale-replayed",
        first=("upscale {made}/sample_data out --system nsrd --frames 1-2",),
        line="upscale {made}/sample_data out --system nsrd --frames 2-3 --json",
        within=GUIDED,
    ),
    Case(
        name="upscale-stale",
        first=("upscale {made}/sample_data out --system taau --frames 1-2",),
        line="upscale {made}/sample_data out --system bicubic --frames 1-4 --json",
        code=3,
    ),
    Case(
        name="upscale-overwrite",
        first=("upscale {made}/sample_data out --system taau --frames 1-2",),
        line="upscale {made}/sample_data out --system bicubic --frames 1-3 --overwrite --json",
    ),
    Case(
        name="upscale-foreign",
        line="upscale {made}/sample_data in --system bicubic --json",
        copy="{data}/sample",
        code=3,
        quick=True,
    ),
    Case(name="upscale-dry", line=f"{SAMPLE} --system fusesr --dry-run --json", quick=True),
    Case(name="upscale-dry-text", line="upscale {data}/dumps out --simulate-lr 4 --dry-run -v"),
    *(
        Case(
            name=f"upscale-{system}-shard",
            line=f"upscale {{made}}/sample_data out --system {system} --shard 2/2 --json",
            within=GUIDED if system == "nsrd" else None,
        )
        for system in ("taau", "nsrd", "bicubic")
    ),
    Case(
        name="upscale-shard-measured",
        line="upscale {data}/dumps/folders out --simulate-lr 4 --system taau --shard 1/2",
        code=3,
    ),
    Case(
        name="upscale-nothing",
        line="upscale {made}/sample_data out --frames 900-950",
        code=3,
        quick=True,
    ),
    Case(name="upscale-missing-folder", line="upscale nowhere out", code=3, quick=True),
    Case(name="upscale-missing-json", line="upscale nowhere out --json", code=3),
    Case(
        name="upscale-wrong-scale",
        line="upscale {made}/sample_data out --scale 3 --json",
        code=3,
    ),
    Case(
        name="upscale-no-scale",
        line="upscale {made}/sample_data/lr out --system nsrd --scale 5",
        code=3,
    ),
    Case(name="upscale-unknown-layout", line="upscale {made}/unknown out --scale 2", code=3),
    Case(
        name="upscale-wrong-weights",
        line="upscale {made}/sample_data out --system fusesr "
        "--weights {made}/nsrd2/best.safetensors",
        code=3,
    ),
    Case(
        name="upscale-scale-of-weights",
        line="upscale {made}/sample_data out --weights {made}/nsrd2/best.safetensors",
        code=3,
    ),
    Case(
        name="upscale-no-weights",
        line="upscale {made}/sample_data out --system fusesr-direct --json",
        code=3,
    ),
    Case(
        name="upscale-lacking",
        line="upscale {made}/sample_data/reference out --scale 2 --system taau",
        code=3,
    ),
    Case(
        name="upscale-wrong-system", line="upscale {made}/sample_data out --system rtp", code=2
    ),
    Case(name="upscale-vrs-system", line="upscale {data}/sample out --system rt-percept", code=2),
    Case(
        name="upscale-usage",
        line="upscale {made}/sample_data out --simulate-lr 2 --hr {made}/sample_data/hr",
        code=2,
    ),
    Case(
        name="upscale-wrong-sign",
        line="upscale {made}/sample_data out --system taau --capture "
        "{made}/sample_data/wrong-sign.toml --frames 1-3",
    ),
    *(
        Case(
            name=f"upscale-{system}-gap-{policy}",
            line=f"upscale {{made}}/gap out --simulate-lr 4 --system {system} --frames 1-5 "
            f"--on-missing {policy} --json",
            code=3 if policy == "error" else 0,
            within=GUIDED if system == "nsrd" else None,
            quick=policy == "error",
        )
        for system in ("taau", "nsrd")
        for policy in ("error", "skip", "hold")
    ),
    *(
        Case(
            name=f"upscale-nan-{policy}",
            line=f"upscale {{made}}/nan out --simulate-lr 4 --system taau --frames 1-4 "
            f"--on-nonfinite {policy} --json",
            code=1 if policy == "error" else 0,
            quick=policy == "error",
        )
        for policy in ("error", "zero", "inpaint")
    ),
    Case(
        name="upscale-damaged",
        line="upscale {made}/damaged out --simulate-lr 4 --system taau --frames 1-4 --json",
        code=1,
    ),
    *(
        Case(
            name=f"demodulate-{mode}-{shot}",
            line=f"demodulate {folder} out --mode {mode} --frames {frames} --json",
            quick=mode == "brdf" and shot == "sample",
        )
        for shot, folder, frames in (
            ("sample", "{data}/sample", "1-3"),
            ("climb", "{data}/stairs/climb", "1-2"),
            ("blender", "{data}/dumps/multilayer", "5-6"),
            ("folders", "{data}/dumps/folders", "5-6"),
            ("synth", "{made}/synth-folders", "1-2"),
        )
        for mode in ("brdf", "softplus", "albedo", "glossy-albedo")
        if mode == "brdf" or shot == "sample"
    ),
    Case(
        name="demodulate-float",
        line="demodulate {data}/sample out --float --convention seed --epsilon 0.01 --frames 1-2",
    ),
    Case(name="demodulate-inverse", line="demodulate --inverse {made}/divided out --json"),
    Case(
        name="demodulate-inverse-float",
        line="demodulate --inverse {made}/divided out --float --frames 1-2",
        quick=True,
    ),
    Case(name="demodulate-not-divided", line="demodulate --inverse {data}/sample out", code=3),
    Case(name="demodulate-lacking", line="demodulate {made}/sample_data/reference out", code=3),
    Case(name="demodulate-nan", line="demodulate {made}/nan out --frames 1-3 --json", code=1),
    Case(
        name="demodulate-nan-zero",
        line="demodulate {made}/nan out --frames 1-3 --on-nonfinite zero --json",
    ),
    Case(name="demodulate-gap", line="demodulate {made}/gap out --on-missing skip --json"),
    Case(name="demodulate-shard", line="demodulate {data}/sample out --shard 2/3 --json"),
    Case(name="demodulate-dry", line="demodulate {data}/sample out --dry-run --json"),
    Case(name="demodulate-nothing", line="demodulate {data}/sample out --frames 90", code=3),
    Case(
        name="demodulate-kept",
        first=("demodulate {data}/sample out --frames 1",),
        line="demodulate {data}/sample out --frames 1-2 --json",
    ),
    Case(
        name="demodulate-stale",
        first=("demodulate {data}/sample out --frames 1",),
        line="demodulate {data}/sample out --frames 1-2 --mode albedo --json",
        code=3,
    ),
    Case(
        name="label-sample",
        line="label --kind vrs {data}/sample out --frames 1-2 --json --preview",
        quick=True,
    ),
    Case(name="label-climb", line="label --kind vrs {data}/stairs/climb out --frames 1-2 --json"),
    Case(
        name="label-blender", line="label --kind vrs {data}/dumps/multilayer out --frames 5-6 -v"
    ),
    Case(name="label-folders", line="label --kind vrs {data}/dumps/folders out --frames 5-6"),
    Case(name="label-rates", line="label --kind vrs {made}/rates out --json"),
    *(
        Case(
            name=f"label-{metric}",
            line=f"label --kind vrs {{data}}/sample out --frames 2 --metric {metric} "
            "--pool mean --tile 8 --keep-edges --json",
        )
        for metric in ("flip", "jnyang", "psnr", "jnflip")
    ),
    Case(name="label-shard", line="label --kind vrs {data}/sample out --shard 1/3 --json"),
    Case(name="label-dry", line="label --kind vrs {data}/sample out --dry-run --json"),
    Case(name="label-nan", line="label --kind vrs {made}/nan out --frames 1-3 --json", code=1),
    Case(name="label-lacking", line="label --kind vrs {made}/sample_data/hr out", code=3),
    *(
        Case(
            name=f"predict-vrs-{estimator}-{shot}",
            line=f"predict-vrs {folder} out --estimator {estimator} --frames {frames} --json",
            quick=shot == "sample",
        )
        for estimator in ("network", "analytic", "hybrid")
        for shot, folder, frames in (
            ("sample", "{data}/sample", "1-3"),
            ("climb", "{data}/stairs/climb", "9-11"),
            ("fly", "{data}/court/fly", "1-3"),
            ("blender", "{data}/dumps/multilayer", "5-7"),
            ("folders", "{data}/dumps/folders", "5-7"),
            ("synth", "{made}/synth-blender", "1-3"),
        )
    ),
    Case(name="predict-vrs-rates", line="predict-vrs {made}/rates out --json --overlay"),
    Case(
        name="predict-vrs-analytic-rates",
        line="predict-vrs {made}/rates out --estimator analytic --metric jnyang --overlay",
    ),
    Case(
        name="predict-vrs-options",
        line="predict-vrs {data}/sample out --frames 2-4 --threshold 0.1 --margin 0.05 "
        "--no-compare --overlay",
    ),
    Case(
        name="predict-vrs-reuse",
        line="predict-vrs {data}/sample out --reuse --estimator analytic --frames 1-3 --json",
    ),
    Case(name="predict-vrs-reuse-network", line="predict-vrs {data}/sample out --reuse", code=3),
    Case(name="predict-vrs-tile", line="predict-vrs {data}/sample out --tile 8", code=3),
    Case(
        name="predict-vrs-metric",
        line="predict-vrs {data}/sample out --metric psnr --estimator analytic --threshold 30 "
        "--frames 1-2 --json",
    ),
    Case(
        name="predict-vrs-wrong-weights",
        line="predict-vrs {data}/sample out --weights {made}/nsrd2/best.safetensors",
        code=3,
    ),
    Case(name="predict-vrs-shard", line="predict-vrs {data}/sample out --shard 2/2 --json"),
    Case(name="predict-vrs-gap", line="predict-vrs {made}/gap out --on-missing skip --json"),
    Case(name="predict-vrs-dry", line="predict-vrs {data}/sample out --dry-run --json"),
    Case(name="predict-vrs-nan", line="predict-vrs {made}/nan out --json", code=1),
    Case(
        name="evaluate-all",
        line="evaluate {made}/results/bicubic {made}/results/taau "
        "--ref {made}/sample_data/reference "
        "--gbuffer {made}/sample_data/hr --json --output out/a.json --output out/a.csv "
        "--metric psnr,ssim,ms-ssim,flip,hdr-flip,tpsnr,temporal,warped --frames 1-4",
        quick=True,
    ),
    Case(
        name="evaluate-html",
        line="evaluate {made}/results/bicubic {made}/sample_data/reference --output out/a.html "
        "--frames 1-3 --skip-first 1 --border 8",
    ),
    *(
        Case(
            name=f"evaluate-{protocol}",
            line="evaluate {made}/results/bicubic {made}/sample_data/reference "
            f"--protocol {protocol} --frames 1-3 --json",
        )
        for protocol in ("rtsr", "nsrd", "fusesr", "extranet")
    ),
    Case(
        name="evaluate-fail",
        line="evaluate {made}/results/bicubic {made}/sample_data/reference --frames 1-2 "
        "--fail-under 'psnr>60' --gbuffer {made}/sample_data/hr -v",
        code=1,
    ),
    Case(
        name="evaluate-merge",
        first=(
            "evaluate {made}/results/taau {made}/sample_data/reference --shard 1/2 --output 1.json",
            "evaluate {made}/results/taau {made}/sample_data/reference --shard 2/2 --output 2.json",
        ),
        line="evaluate --merge 1.json 2.json --json --output out/m.csv",
    ),
    Case(
        name="evaluate-samples",
        line="evaluate {made}/synth/reference {made}/synth/reference --json",
    ),
    Case(
        name="evaluate-gap",
        line="evaluate {made}/gap {data}/sample --on-missing skip --metric psnr,temporal --json",
    ),
    Case(
        name="evaluate-gap-error",
        line="evaluate {made}/gap {data}/sample --metric psnr",
        code=3,
    ),
    Case(
        name="evaluate-sizes",
        line="evaluate {made}/sample_data/lr {made}/sample_data/reference --json",
        code=3,
    ),
    Case(name="evaluate-nan", line="evaluate {made}/nan {data}/sample --metric psnr --json"),
    Case(name="evaluate-one", line="evaluate {data}/sample", code=2),
    Case(
        name="evaluate-dry",
        line="evaluate {made}/results/bicubic {made}/sample_data/reference --dry-run --json",
    ),
    *(
        Case(name=f"inspect-{name}", line=f"inspect {folder} --json", code=code, quick=quick)
        for name, folder, code, quick in (
            ("sample", "{made}/sample_data", 0, True),
            ("court", "{data}/court", 0, False),
            ("climb", "{data}/stairs/climb", 0, False),
            ("dumps", "{data}/dumps", 0, False),
            ("synth", "{made}/synth", 0, False),
            ("synth-blender", "{made}/synth-blender", 0, False),
            ("synth-folders", "{made}/synth-folders", 0, False),
            ("divided", "{made}/divided", 0, False),
            ("gap", "{made}/gap", 3, False),
            ("nan", "{made}/nan", 1, False),
            ("damaged", "{made}/damaged", 1, False),
            ("unknown", "{made}/unknown", 3, True),
            ("nowhere", "nowhere", 3, True),
        )
    ),
    Case(name="inspect-text", line="inspect {data}/dumps -v"),
    Case(name="inspect-text-sample", line="inspect {made}/sample_data --all", quick=True),
    Case(name="inspect-write", line="inspect in --write --json", copy="{data}/dumps/folders"),
    Case(
        name="synth-pair",
        line="synth out --size 128x96 --scale 2 --jitter halton --samples 2 --frames 1-3 --json",
        quick=True,
    ),
    Case(
        name="synth-layout",
        line="synth out --size 96x64 --layout extranet --frames 1-2 --shots 2 --seed 9",
    ),
    Case(name="synth-nsrd", line="synth out --size 96x64 --layout nsrd --scale 2 --frames 1-2"),
    Case(name="synth-static", line="synth out --size 96x64 --static-camera --frames 3-4 --json"),
    Case(
        name="synth-kept",
        first=("synth out --size 96x64 --frames 1-2",),
        line="synth out --size 96x64 --frames 1-3 --json",
    ),
    Case(
        name="synth-stale",
        first=("synth out --size 96x64 --frames 1-2",),
        line="synth out --size 96x64 --frames 1-3 --seed 4 --json",
        code=3,
    ),
    *(
        Case(
            name=f"train-{system}",
            line=f"train {system} {{data}}/court --out out {TRAIN} --set training.crop={crop}",
            within=GUIDED if system in GUIDED_SYSTEMS else None,
            files=("log.csv",),
            wish="training.jitter=none",
            quick=system == "fusesr-fast",
        )
        for system, crop in (
            ("fusesr-fast", 24),
            ("fusesr", 16),
            ("fusesr-direct", 16),
            ("nsrd", 16),
            ("rt-percept", 48),
        )
    ),
    Case(name="train-nothing", line="train nsrd {made}/unknown --out out", code=3),
    Case(
        name="train-no-color", line="train fusesr-fast {made}/sample_data/hr --out out", code=3
    ),
    Case(
        name="train-wrong-setting",
        line="train nsrd {data}/court --out out --set training.stepps=2",
        code=3,
    ),
    Case(name="lut", line="precompute-lut out.exr --size 64 --samples 64 --preview"),
    Case(name="systems", line="systems --json --flops", quick=True),
    Case(name="systems-text", line="systems"),
    Case(name="help", line="--help", quick=True),
    *(
        Case(name=f"help-{command}", line=f"{command} --help")
        for command in (
            "inspect", "precompute-lut", "demodulate", "label", "train", "upscale", "predict-vrs",
            "evaluate", "synth", "systems",
        )
    ),
)  # fmt: skip

CASES = (*_upscale(), *OPTIONS)


def make_inputs(before: Path, data: Path, made: Path) -> None:
    """Write the inputs that no command makes: broken ones, and frames with captured rates."""
    shutil.copytree(before / "sample_data", made / "sample_data")
    for name in ("gap", "nan", "damaged"):
        shutil.copytree(data / "sample", made / name, copy_function=shutil.copyfile)
        (made / name).chmod(0o755)
    (made / "gap" / "frame.0003.exr").unlink()
    damaged = made / "damaged" / "frame.0002.exr"
    damaged.write_bytes(damaged.read_bytes()[:100_000])
    nan = made / "nan" / "frame.0002.exr"
    _rewrite(nan, nan, _with_nan)
    for number in (1, 2):
        frame = f"frame.{number:04d}.exr"
        _rewrite(data / "sample" / frame, made / "rates" / frame, _with_rates)
        _rewrite(data / "sample" / frame, made / "unknown" / frame, _renamed)


Planes = dict[str, np.ndarray]


def _rewrite(source: Path, target: Path, change: object) -> None:
    """Write a frame's channels, changed, with its attributes."""
    part = OpenEXR.File(str(source), separate_channels=True).parts[0]
    planes = {name: channel.pixels.copy() for name, channel in part.channels.items()}
    header = {k: v for k, v in part.header.items() if k != "channels"}
    target.parent.mkdir(parents=True, exist_ok=True)
    assert callable(change)
    OpenEXR.File(header, change(planes)).write(str(target))


def _with_nan(planes: Planes) -> Planes:
    planes["R"][3:9, 5:7] = np.nan
    planes["G"][100, 200] = np.inf
    return planes


def _with_rates(planes: Planes) -> Planes:
    """Add radiance at 2x2: the mean of each block."""
    for channel in "RGB":
        plane = planes[channel].astype(np.float32)
        height, width = plane.shape
        blocks = plane.reshape(height // 2, 2, width // 2, 2).mean((1, 3))
        planes[f"output_2x2.{channel}"] = blocks.repeat(2, 0).repeat(2, 1).astype(np.float16)
    return planes


def _renamed(planes: Planes) -> Planes:
    return {f"thing.{index:02d}": planes[name] for index, name in enumerate(sorted(planes))}


def arguments(line: str, data: Path, made: Path) -> list[str]:
    """Return a command line's arguments."""
    return [part.format(data=data, made=made) for part in shlex.split(line)]
