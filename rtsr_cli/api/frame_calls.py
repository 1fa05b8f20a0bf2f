"""Calls that go through folders of frames; each imports the task that it is, and no other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.run.system_inputs import SystemTable
from rtsr_cli.models import (
    CONDITIONS,
    PREFERENCE,
    list_preferred_names,
    list_rate_predictor_names,
    load_system,
)

if TYPE_CHECKING:
    from rtsr_cli.core.demodulate.request import DemodulateRequest
    from rtsr_cli.core.extrapolate.request import ExtrapolateRequest
    from rtsr_cli.core.label.call import LabelEvent
    from rtsr_cli.core.label.request import LabelRequest
    from rtsr_cli.core.run.events import FrameDone, RunDone, RunStarted, ShotPlanned
    from rtsr_cli.core.synth.call import SynthEvent
    from rtsr_cli.core.synth.request import SynthRequest
    from rtsr_cli.core.upscale.request import UpscaleRequest
    from rtsr_cli.core.vrs.call import VrsEvent
    from rtsr_cli.core.vrs.request import PredictVrsRequest

EXTRAPOLATORS = SystemTable(
    load=load_system, preferred=list_preferred_names(SystemTask.EXTRAPOLATE)
)
UPSCALERS = SystemTable(load=load_system, preferred=PREFERENCE, when=CONDITIONS)
RATE_PREDICTORS = SystemTable(load=load_system, preferred=list_rate_predictor_names())


def upscale(request: UpscaleRequest) -> Iterator[ShotPlanned | RunStarted | FrameDone | RunDone]:
    """Reconstruct frames at a higher resolution; see `upscale_frames`."""
    from rtsr_cli.core.upscale.call import upscale_frames

    return upscale_frames(request, UPSCALERS)


def extrapolate(
    request: ExtrapolateRequest,
) -> Iterator[ShotPlanned | RunStarted | FrameDone | RunDone]:
    """Predict frames that were not rendered; see `extrapolate_frames`."""
    from rtsr_cli.core.extrapolate.call import extrapolate_frames

    return extrapolate_frames(request, EXTRAPOLATORS)


def label(request: LabelRequest) -> Iterator[LabelEvent]:
    """Make training labels of rendered frames; see `label_frames`."""
    from rtsr_cli.core.label.call import label_frames

    return label_frames(request)


def demodulate(
    request: DemodulateRequest,
) -> Iterator[ShotPlanned | RunStarted | FrameDone | RunDone]:
    """Divide radiance by its material term, or multiply back; see `demodulate_frames`."""
    from rtsr_cli.core.demodulate.call import demodulate_frames

    return demodulate_frames(request)


def synth(request: SynthRequest) -> Iterator[SynthEvent]:
    """Render random analytic scenes; see `synthesize_frames`."""
    from rtsr_cli.core.synth.call import synthesize_frames

    return synthesize_frames(request)


def predict_vrs(request: PredictVrsRequest) -> Iterator[VrsEvent]:
    """Choose the shading rate of every tile; see `predict_rates`."""
    from rtsr_cli.core.vrs.call import predict_rates

    return predict_rates(request, RATE_PREDICTORS)
