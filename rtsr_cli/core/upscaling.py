"""Running an upscaling system over a planned shot: read ahead, predict, write behind."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

import torch
from torch import nn

from rtsr_cli.core import tiling
from rtsr_cli.core.errors import FrameFolderError, RtsrError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame, FrameSequence
from rtsr_cli.core.imaging.resampling import upsample_bicubic
from rtsr_cli.core.io.atomic import remove_leftovers
from rtsr_cli.core.io.exr import read_header
from rtsr_cli.core.io.outputs import OutputFrame
from rtsr_cli.core.io.pairs import FramePair
from rtsr_cli.core.io.provenance import color_tag, provenance
from rtsr_cli.core.io.streaming import BackgroundWriter, prefetch, read_ahead
from rtsr_cli.core.planning import AUTOCAST, COMMAND, ShotPlan, Stamps, UpscaleOptions
from rtsr_cli.core.system import Prediction, State, System, Window


class Status(StrEnum):
    """What became of a frame."""

    WRITTEN = "written"
    KEPT = "kept"
    FAILED = "failed"


@dataclass(frozen=True, kw_only=True)
class FrameEvent:
    """One output frame's end."""

    shot: str
    number: int
    status: Status
    path: Path
    message: str = ""
    seconds: float = 0.0


Predictor = Callable[[Window, State], Prediction]


def run_shot(plan: ShotPlan, network: nn.Module, options: UpscaleOptions) -> Iterator[FrameEvent]:
    """Compute and write what is pending; yield an event for every selected frame.

    A frame whose pixels turn out to be bad fails alone: history restarts after it.
    """
    for number in plan.selected:
        if number not in plan.pending:
            yield _event(plan, number, Status.KEPT)
    if not plan.order:
        return
    remove_leftovers(plan.folder)
    with BackgroundWriter[tuple[int, float]](options.jobs) as writer:
        yield from _stream(plan, network, options, writer)
        yield from _written(plan, writer, wait=True)


def _stream(
    plan: ShotPlan,
    network: nn.Module,
    options: UpscaleOptions,
    writer: BackgroundWriter[tuple[int, float]],
) -> Iterator[FrameEvent]:
    """Predict the frames in order and queue the pending ones for writing."""
    stamps = Stamps(plan)
    history = History(plan.sequence, plan.system, plan.source.scale)
    predict = _predictor(plan.system, network, options)

    def load(number: int) -> FramePair:
        stamps.input_digest(number)
        return plan.source.load(number, plan.inputs).to(options.device)

    ahead = read_ahead(options.jobs, plan.source.frame_bytes)
    for number, future in prefetch(load, plan.order, ahead):
        started = time.perf_counter()
        try:
            pair = future.result()
            prediction = history.advance(pair, predict)
        except RtsrError as error:
            history.reset()
            yield _event(plan, number, Status.FAILED, str(error))
            continue
        if number in plan.pending:
            frame = _output(plan, pair, prediction, stamps.of(number))
            frame = replace(frame, previews=options.previews)
            debug = prediction.debug if options.debug else None
            writer.submit(
                (number, time.perf_counter() - started), replace(frame, debug=debug).write
            )
        yield from _written(plan, writer, wait=False)


class History:
    """The window of past LR frames and the state of a recurrent system."""

    def __init__(self, sequence: FrameSequence, system: System, scale: int) -> None:
        """Start without any."""
        self._sequence = sequence
        self._scale = scale
        self._past: deque[Frame] = deque(maxlen=system.history_frames + 1)
        self._state: State = None
        self._previous: int | None = None

    def reset(self) -> None:
        """Forget everything."""
        self._past.clear()
        self._state = None
        self._previous = None

    def advance(self, pair: FramePair, predict: Predictor) -> Prediction:
        """Predict the next frame from what is remembered, and remember it."""
        number = pair.lr.number
        if not self._sequence.follows(number, self._previous):
            self.reset()
        self._past.appendleft(pair.lr)
        window = Window(lr=tuple(self._past), hr=pair.hr, scale=self._scale)
        prediction = predict(window, self._state)
        self._state = prediction.state
        self._previous = number
        return prediction


def _predictor(system: System, network: nn.Module, options: UpscaleOptions) -> Predictor:
    has_weights = any(True for _ in network.parameters())
    cast = AUTOCAST.get(options.precision) if has_weights else None
    device = torch.device(options.device)

    def predict(window: Window, state: State) -> Prediction:
        # a tile has no debug picture of the whole
        requested = 0 if options.debug else options.tile
        side = tiling.tile_side(system, window.current.size, window.scale, requested)
        with torch.inference_mode(), torch.autocast(device.type, cast, enabled=cast is not None):
            return tiling.predict(system, network, window, state, side)

    return predict


def _output(plan: ShotPlan, pair: FramePair, prediction: Prediction, stamp: str) -> OutputFrame:
    number, scale = pair.lr.number, plan.source.scale
    source = plan.source.reader.path(number)
    if prediction.image is None:
        raise FrameFolderError(f"{source}: system '{plan.system.name}' gave no image")
    alpha = pair.lr.gbuffer.buffers.get(Buffer.ALPHA)
    if alpha is not None:
        alpha = upsample_bicubic(alpha, scale, pair.lr.camera.jitter_px).clamp(0.0, 1.0)
    known = provenance(
        command=COMMAND,
        config_hash=plan.config_hash,
        source=source,
        stamp=stamp,
        extra={
            "rtsr:system": plan.system.name,
            "rtsr:nonfinite": pair.fixed,
            **color_tag(plan.source.reader.conventions),
        },
    )
    return OutputFrame(
        path=plan.path(number),
        color=prediction.image,
        alpha=alpha,
        attributes={**read_header(source).attributes, **known},
        windows=plan.source.output_window,
        colorspace=plan.source.reader.conventions.colorspace,
    )


def _written(
    plan: ShotPlan, writer: BackgroundWriter[tuple[int, float]], *, wait: bool
) -> Iterator[FrameEvent]:
    for (number, seconds), error in writer.done(wait=wait):
        if error is not None:
            raise error
        yield replace(_event(plan, number, Status.WRITTEN), seconds=seconds)


def _event(plan: ShotPlan, number: int, status: Status, message: str = "") -> FrameEvent:
    return FrameEvent(
        shot=plan.name, number=number, status=status, path=plan.path(number), message=message
    )
