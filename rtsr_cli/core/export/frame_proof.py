"""Proving exported files on whole frames: what comes out with them, beside what torch makes.

PSNR is that of the frames written, after c / (1 + c) where they are radiance; each runtime has the
state that it makes itself.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.errors import CheckpointError, FrameFolderError
from rtsr_cli.core.export.followed_graphs import GraphsSeen, MeasureGraph, follow_graphs
from rtsr_cli.core.files.exr import read_channels, read_header
from rtsr_cli.core.frames.storage import MAX_HALF
from rtsr_cli.core.network.exported import observe_networks
from rtsr_cli.core.network.load import LoadedNetwork
from rtsr_cli.core.network.manifest import read_manifest

LEAST_DB = {False: 60.0, True: 55.0}
"""Least PSNR of a frame, of files of single and of half precision."""

MOST_DB = 200.0
"""Stands for frames that are equal."""

OURS = "exported"


@dataclass(frozen=True, kw_only=True)
class FrameRun:
    """What is run: a task's command.

    Attributes:
        task: of the system.
        system: name.
        scale: S.
        in_folder: frames.
        out_folder: where outputs go.
        frames: their numbers, None = all.
        weights: file, for torch.
        model: folder of exported files, for onnxruntime.
    """

    task: SystemTask
    system: str
    scale: int
    in_folder: Path
    out_folder: Path
    frames: frozenset[int] | None
    weights: Path | None = None
    model: Path | None = None


RunFrames = Callable[[FrameRun], None]
"""Runs the command of a task.

Raises:
    RtsrError: an input is wrong, or a frame failed.
"""


@dataclass(frozen=True, kw_only=True)
class FrameProof:
    """How far files are from the network on whole frames.

    Attributes:
        frames: that were compared.
        least_db: PSNR of the worst.
        difference: largest of a graph's outputs, the same inputs given.
        largest: absolute value inside, in single precision.
    """

    frames: int
    least_db: float
    difference: float
    largest: float


def prove_on_frames(
    run: RunFrames, given: FrameRun, measures: Mapping[str, MeasureGraph], *, half: bool
) -> FrameProof:
    """Run frames by torch and by exported files, and compare.

    Args:
        run: the command.
        given: frames, weights and exported files; where outputs go is chosen here.
        measures: method of each graph -> what measures its tensors.
        half: whether the files are of half precision.

    Raises:
        RtsrError: frames cannot be read, or there are none.
        CheckpointError: the files are too far from torch, or half does not hold what is inside.
    """
    assert given.model is not None
    files = {file.method: file.path for file in read_manifest(given.model).files}
    seen = GraphsSeen()

    def follow(loaded: LoadedNetwork) -> None:
        follow_graphs(loaded, {OURS: files}, measures, seen)

    with tempfile.TemporaryDirectory() as scratch:
        expected, found = Path(scratch) / "torch", Path(scratch) / "onnx"
        facts = {**vars(given), "model": None, "out_folder": expected}
        with observe_networks(follow):
            run(FrameRun(**facts))
        run(FrameRun(**{**vars(given), "weights": None, "out_folder": found}))
        shown = given.task is not SystemTask.PREDICT_VRS
        values = compare_outputs(expected, found, shown=shown)
    if not values:
        raise FrameFolderError(
            f"{given.in_folder}: no frame of it was run; name others (--proof-frames)"
        )
    proof = FrameProof(
        frames=len(values),
        least_db=min(MOST_DB, *values),
        difference=seen.difference[OURS],
        largest=seen.largest,
    )
    _check(proof, half=half)
    return proof


def _check(proof: FrameProof, *, half: bool) -> None:
    require_half_holds(proof.largest, half=half, where="on these frames")
    # not a number is worse than any
    if not proof.least_db >= LEAST_DB[half]:
        raise CheckpointError(
            f"frames by the exported files are {proof.least_db:.1f} dB from torch's, less than "
            f"{LEAST_DB[half]:g}; "
            + ("--precision fp32 has the digits" if half else "please report it")
        )


def require_half_holds(largest: float, *, half: bool, where: str) -> None:
    """Hold values inside a graph to what half precision holds.

    Raises:
        CheckpointError: half does not hold them; says what to do.
    """
    if half and not largest <= MAX_HALF:
        raise CheckpointError(
            f"values inside the network reach {largest:.3g} {where}, and half precision holds "
            f"{MAX_HALF:g}; export --precision fp32"
        )


def read_frame(path: Path, *, shown: bool) -> NDArray[np.float64]:
    """Channels of a file, after c / (1 + c) where they are radiance."""
    channels = sorted(c for c in read_header(path).channels if c in "RGB" or c.startswith("error"))
    planes = read_channels(path, channels)
    image = np.stack([planes[c].astype(np.float64) for c in channels])
    return image / (1.0 + image) if shown else image


def compare_outputs(expected: Path, found: Path, *, shown: bool) -> Sequence[float]:
    """PSNR of every frame written, the others in its place being torch's."""
    values = []
    for path in sorted(expected.rglob("*.exr")):
        a, b = (read_frame(p, shown=shown) for p in (path, found / path.relative_to(expected)))
        error = float(np.mean((a - b) ** 2))
        values.append(math.inf if error == 0 else -10.0 * math.log10(error))
    return values
