"""`export` with the systems that there are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from rtsr_cli.api.frame_calls import extrapolate, predict_vrs, upscale
from rtsr_cli.core.captures.shots import LR_FOLDER
from rtsr_cli.core.choices import JitterMode, Precision, Runtime, SystemTask
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.models import load_system

if TYPE_CHECKING:
    from rtsr_cli.core.export.call import ExportEvent
    from rtsr_cli.core.export.frame_proof import FrameRun
    from rtsr_cli.core.export.request import ExportRequest


def export(request: ExportRequest) -> Iterator[ExportEvent]:
    """Write a network as ONNX files and a manifest; see `export_network`."""
    from rtsr_cli.core.export.call import export_network

    return export_network(request, load_system, run_frames)


def run_frames(run: FrameRun) -> None:
    """Run the command of a task on frames, on the processor in single precision.

    Frames of one size are decimated by the system's scale, with jitter; those of pairs are taken as
    they are.

    Args:
        run: what is run.

    Raises:
        RtsrError: an input is wrong.
        FrameFolderError: a frame failed; says why.
    """
    given: dict[str, Any] = {
        "in_folder": run.in_folder,
        "out_folder": run.out_folder,
        "frames": run.frames,
        "system": run.system,
        "device": "cpu",
    }
    if run.model is None:
        given |= {"weights_file": run.weights}
    else:
        given |= {"runtime": Runtime.ONNX, "model": run.model}
    for event in _call(run, given):
        if message := getattr(event, "message", ""):
            raise FrameFolderError(message)


def _call(run: FrameRun, given: dict[str, Any]) -> Iterator[Any]:
    if run.task is SystemTask.PREDICT_VRS:
        from rtsr_cli.core.vrs.request import PredictVrsRequest

        return predict_vrs(PredictVrsRequest(no_compare=True, **given))
    if run.model is None:
        given |= {"precision": Precision.FP32}
    if run.task is SystemTask.EXTRAPOLATE:
        from rtsr_cli.core.extrapolate.request import ExtrapolateRequest

        return extrapolate(ExtrapolateRequest(**given))
    from rtsr_cli.core.upscale.request import UpscaleRequest

    if not any(run.in_folder.rglob(f"{LR_FOLDER}/")):
        given |= {"simulate_lr": run.scale, "jitter": JitterMode.HALTON}
    return upscale(UpscaleRequest(**given))
