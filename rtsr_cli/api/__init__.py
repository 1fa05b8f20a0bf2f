"""The library as a notebook sees it: a request a task, and the call that takes it.

Nothing is imported before it is asked for. Calls yield what they did, frame by frame; they print
nothing and end no process, and what a user can cause is raised as an `RtsrError`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rtsr_cli.api.frame_calls import demodulate as demodulate
    from rtsr_cli.api.frame_calls import label as label
    from rtsr_cli.api.frame_calls import predict_vrs as predict_vrs
    from rtsr_cli.api.frame_calls import synth as synth
    from rtsr_cli.api.frame_calls import upscale as upscale
    from rtsr_cli.api.inspection_calls import inspect as inspect
    from rtsr_cli.api.system_calls import describe_systems as describe_systems
    from rtsr_cli.api.training_calls import train as train
    from rtsr_cli.core.demodulate.request import DemodulateRequest as DemodulateRequest
    from rtsr_cli.core.errors import RtsrError as RtsrError
    from rtsr_cli.core.evaluation.evaluation import evaluate as evaluate
    from rtsr_cli.core.evaluation.request import EvaluateRequest as EvaluateRequest
    from rtsr_cli.core.inspect.request import InspectRequest as InspectRequest
    from rtsr_cli.core.label.request import LabelRequest as LabelRequest
    from rtsr_cli.core.lut.request import PrecomputeLutRequest as PrecomputeLutRequest
    from rtsr_cli.core.lut.table_file import precompute_lut as precompute_lut
    from rtsr_cli.core.synth.request import SynthRequest as SynthRequest
    from rtsr_cli.core.training.request import TrainRequest as TrainRequest
    from rtsr_cli.core.upscale.request import UpscaleRequest as UpscaleRequest
    from rtsr_cli.core.vrs.request import PredictVrsRequest as PredictVrsRequest

PLACES = {
    "DemodulateRequest": "rtsr_cli.core.demodulate.request",
    "EvaluateRequest": "rtsr_cli.core.evaluation.request",
    "InspectRequest": "rtsr_cli.core.inspect.request",
    "LabelRequest": "rtsr_cli.core.label.request",
    "PrecomputeLutRequest": "rtsr_cli.core.lut.request",
    "PredictVrsRequest": "rtsr_cli.core.vrs.request",
    "RtsrError": "rtsr_cli.core.errors",
    "SynthRequest": "rtsr_cli.core.synth.request",
    "TrainRequest": "rtsr_cli.core.training.request",
    "UpscaleRequest": "rtsr_cli.core.upscale.request",
    "demodulate": "rtsr_cli.api.frame_calls",
    "describe_systems": "rtsr_cli.api.system_calls",
    "evaluate": "rtsr_cli.core.evaluation.evaluation",
    "inspect": "rtsr_cli.api.inspection_calls",
    "label": "rtsr_cli.api.frame_calls",
    "precompute_lut": "rtsr_cli.core.lut.table_file",
    "predict_vrs": "rtsr_cli.api.frame_calls",
    "synth": "rtsr_cli.api.frame_calls",
    "train": "rtsr_cli.api.training_calls",
    "upscale": "rtsr_cli.api.frame_calls",
}
"""Name -> module that defines it; a test holds both lists to each other."""

__all__ = [*PLACES]


def __getattr__(name: str) -> Any:
    """Import what is asked for.

    Raises:
        AttributeError: there is no such request or call.
    """
    if name not in PLACES:
        raise AttributeError(f"rtsr_cli.api has no '{name}' (there are: {', '.join(PLACES)})")
    return getattr(import_module(PLACES[name]), name)
