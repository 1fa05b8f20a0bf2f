"""Two examples a command, which end its `--help`: the one table of them."""

from __future__ import annotations

from collections.abc import Mapping

GROUP = ""
"""Stands for `rtsr` itself."""

EXAMPLES: Mapping[str, tuple[str, str]] = {
    GROUP: (
        "rtsr inspect my_frames",
        "rtsr upscale my_frames out --scale 2 --preview",
    ),
    "inspect": (
        "rtsr inspect my_frames",
        "rtsr inspect my_frames --write --overwrite",
    ),
    "precompute-lut": (
        "rtsr precompute-lut lut.exr --preview",
        "rtsr precompute-lut lut.exr --size 256 --convention seed",
    ),
    "demodulate": (
        "rtsr demodulate my_frames parts",
        "rtsr demodulate parts frames_again --inverse",
    ),
    "label": (
        "rtsr label my_frames labels --kind vrs --preview",
        "rtsr label my_frames holes --kind holes --every 2 --preview",
    ),
    "train": (
        "rtsr train fusesr-fast my_captures --scale 4 --out runs/mine",
        "rtsr train nsrd my_captures --out runs/short --set training.steps=5000",
    ),
    "upscale": (
        "rtsr upscale my_shot out --preview",
        "rtsr upscale my_capture out --simulate-lr 4 --jitter halton --frames 1-20",
    ),
    "extrapolate": (
        "rtsr extrapolate my_frames between --preview",
        "rtsr extrapolate my_frames whole --every 3 --keep-rendered",
    ),
    "predict-vrs": (
        "rtsr predict-vrs my_frames rates --overlay",
        "rtsr predict-vrs my_frames rates --estimator analytic --tile 8",
    ),
    "evaluate": (
        "rtsr evaluate out/a out/b --ref my_reference --output report.html",
        "rtsr evaluate out/a my_reference --metric psnr,flip --fail-under 'psnr>30'",
    ),
    "farm": (
        "rtsr farm emit --engine openjd --output job.json -- upscale my_shots out",
        "rtsr farm emit --engine slurm --tasks 32 -- predict-vrs my_shots rates",
    ),
    "synth": (
        "rtsr synth captures --shots 4 --frames 1-16",
        "rtsr synth shots --scale 4 --layout blender --size 480x288",
    ),
    "export": (
        "rtsr export fusesr-fast my_model --scale 4",
        "rtsr export runs/mine/best.safetensors my_model --precision fp16 --size 480x270",
    ),
    "systems": (
        "rtsr systems",
        "rtsr systems --card gather",
    ),
}
"""Command -> its examples; a test runs each through the command's parser."""


def format_examples(command: str) -> str:
    """Return the end of a command's help, as lines that click leaves alone."""
    return "\n".join(["\b", "Examples:", *(f"  {line}" for line in EXAMPLES[command])])
