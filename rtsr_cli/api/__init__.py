"""The library as a notebook sees it: a request a task, the call that takes it, and choices.

Nothing is imported before it is asked for. Calls yield what they did, frame by frame; they print
nothing and end no process, and what a user can cause is raised as an `RtsrError`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rtsr_cli.api.export_calls import export as export
    from rtsr_cli.api.frame_calls import demodulate as demodulate
    from rtsr_cli.api.frame_calls import extrapolate as extrapolate
    from rtsr_cli.api.frame_calls import label as label
    from rtsr_cli.api.frame_calls import predict_vrs as predict_vrs
    from rtsr_cli.api.frame_calls import synth as synth
    from rtsr_cli.api.frame_calls import upscale as upscale
    from rtsr_cli.api.inspection_calls import inspect as inspect
    from rtsr_cli.api.system_calls import describe_systems as describe_systems
    from rtsr_cli.api.system_calls import write_card as write_card
    from rtsr_cli.api.training_calls import train as train
    from rtsr_cli.core.choices import DemodulationMode as DemodulationMode
    from rtsr_cli.core.choices import Estimator as Estimator
    from rtsr_cli.core.choices import JitterMode as JitterMode
    from rtsr_cli.core.choices import LabelKind as LabelKind
    from rtsr_cli.core.choices import LutConvention as LutConvention
    from rtsr_cli.core.choices import MetricName as MetricName
    from rtsr_cli.core.choices import MissingPolicy as MissingPolicy
    from rtsr_cli.core.choices import NonfinitePolicy as NonfinitePolicy
    from rtsr_cli.core.choices import PixelFilter as PixelFilter
    from rtsr_cli.core.choices import Pool as Pool
    from rtsr_cli.core.choices import Precision as Precision
    from rtsr_cli.core.choices import ProtocolName as ProtocolName
    from rtsr_cli.core.choices import Runtime as Runtime
    from rtsr_cli.core.choices import SsimConvention as SsimConvention
    from rtsr_cli.core.choices import VrsMetric as VrsMetric
    from rtsr_cli.core.demodulate.request import DemodulateRequest as DemodulateRequest
    from rtsr_cli.core.errors import RtsrError as RtsrError
    from rtsr_cli.core.evaluation.evaluation import evaluate as evaluate
    from rtsr_cli.core.evaluation.request import EvaluateRequest as EvaluateRequest
    from rtsr_cli.core.export.request import ExportRequest as ExportRequest
    from rtsr_cli.core.extrapolate.request import ExtrapolateRequest as ExtrapolateRequest
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
    "DemodulationMode": "rtsr_cli.core.choices",
    "Estimator": "rtsr_cli.core.choices",
    "EvaluateRequest": "rtsr_cli.core.evaluation.request",
    "ExportRequest": "rtsr_cli.core.export.request",
    "ExtrapolateRequest": "rtsr_cli.core.extrapolate.request",
    "InspectRequest": "rtsr_cli.core.inspect.request",
    "JitterMode": "rtsr_cli.core.choices",
    "LabelKind": "rtsr_cli.core.choices",
    "LabelRequest": "rtsr_cli.core.label.request",
    "LutConvention": "rtsr_cli.core.choices",
    "MetricName": "rtsr_cli.core.choices",
    "MissingPolicy": "rtsr_cli.core.choices",
    "NonfinitePolicy": "rtsr_cli.core.choices",
    "PixelFilter": "rtsr_cli.core.choices",
    "Pool": "rtsr_cli.core.choices",
    "Precision": "rtsr_cli.core.choices",
    "PrecomputeLutRequest": "rtsr_cli.core.lut.request",
    "PredictVrsRequest": "rtsr_cli.core.vrs.request",
    "ProtocolName": "rtsr_cli.core.choices",
    "Runtime": "rtsr_cli.core.choices",
    "RtsrError": "rtsr_cli.core.errors",
    "SsimConvention": "rtsr_cli.core.choices",
    "SynthRequest": "rtsr_cli.core.synth.request",
    "TrainRequest": "rtsr_cli.core.training.request",
    "UpscaleRequest": "rtsr_cli.core.upscale.request",
    "VrsMetric": "rtsr_cli.core.choices",
    "demodulate": "rtsr_cli.api.frame_calls",
    "describe_systems": "rtsr_cli.api.system_calls",
    "evaluate": "rtsr_cli.core.evaluation.evaluation",
    "export": "rtsr_cli.api.export_calls",
    "extrapolate": "rtsr_cli.api.frame_calls",
    "inspect": "rtsr_cli.api.inspection_calls",
    "label": "rtsr_cli.api.frame_calls",
    "precompute_lut": "rtsr_cli.core.lut.table_file",
    "predict_vrs": "rtsr_cli.api.frame_calls",
    "synth": "rtsr_cli.api.frame_calls",
    "train": "rtsr_cli.api.training_calls",
    "upscale": "rtsr_cli.api.frame_calls",
    "write_card": "rtsr_cli.api.system_calls",
}
"""Name -> module that defines it; a test holds both lists to each other."""

__all__ = [*PLACES]


def __getattr__(name: str) -> Any:
    """Import what is asked for.

    Raises:
        AttributeError: there is no such request, call or choice.
    """
    if name not in PLACES:
        raise AttributeError(f"rtsr_cli.api has no '{name}' (there are: {', '.join(PLACES)})")
    return getattr(import_module(PLACES[name]), name)
