"""Running an upscaling system over a planned shot: read ahead, predict, write behind."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

import torch
from torch import nn

from rtsr_cli.core import tiling
from rtsr_cli.core.errors import (
    FrameFolderError,
    InputChangedError,
    OutputBlockedError,
    RtsrError,
)
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame, FrameSequence
from rtsr_cli.core.imaging.resampling import upsample_bicubic
from rtsr_cli.core.io.atomic import remove_leftovers
from rtsr_cli.core.io.exr import Plane, read_header
from rtsr_cli.core.io.outputs import PREVIEW_SUFFIX, OutputFrame
from rtsr_cli.core.io.pairs import FramePair
from rtsr_cli.core.io.provenance import color_tag, provenance
from rtsr_cli.core.io.streaming import BackgroundWriter, prefetch, read_ahead
from rtsr_cli.core.planning import ShotPlan, Stamps, UpscaleOptions
from rtsr_cli.core.precision import DTYPES
from rtsr_cli.core.shapes import Image
from rtsr_cli.core.system import Prediction, State, System, Window


class Status(StrEnum):
    """What became of a frame."""

    WRITTEN = "written"
    KEPT = "kept"
    FAILED = "failed"


@dataclass(frozen=True, kw_only=True)
class FrameEvent:
    """One output frame's end.

    Attributes:
        shot: path relative to IN.
        number: of the frame.
        status: written now, there already, or failed.
        path: of the output.
        message: why it failed.
        seconds: from reading's end to the writer's hands.
        nonfinite: NaN and Inf that were repaired in its inputs.
        stops: True if no other frame could be written either, so that the run ended.
    """

    shot: str
    number: int
    status: Status
    path: Path
    message: str = ""
    seconds: float = 0.0
    nonfinite: int = 0
    stops: bool = False


@dataclass(frozen=True)
class _Written:
    """What is known of a frame whose files are being written."""

    number: int
    seconds: float
    nonfinite: int


Predictor = Callable[[Window, State], Prediction]


@dataclass(frozen=True, kw_only=True)
class Made:
    """A predicted frame, and what is known of it when its files are made.

    Attributes:
        plan: of its shot.
        options: of the run.
        pair: what was read.
        window: what the system saw.
        prediction: what it made of it.
        stamp: of the output.
        passed: channels that are handed through.
    """

    plan: ShotPlan
    options: UpscaleOptions
    pair: FramePair
    window: Window
    prediction: Prediction
    stamp: str
    passed: Mapping[str, Plane]


Make = Callable[[Made], Callable[[], None]]
"""Turns a predicted frame into the call that writes its files.

Raises:
    RtsrError: it cannot; the frame fails alone.
"""


def run_shot(
    plan: ShotPlan, network: nn.Module, options: UpscaleOptions, make: Make | None = None
) -> Iterator[FrameEvent]:
    """Compute and write what is pending; yield an event for every selected frame.

    `make` says what is written of a prediction: a picture where there is none.

    A frame whose pixels turn out to be bad, or whose input is not what it was, fails alone:
    history restarts after it. A disk that is full ends the run with the event that `stops`.
    """
    for number in plan.selected:
        if number not in plan.pending:
            yield _event(plan, number, Status.KEPT)
    if not plan.order:
        return
    remove_leftovers(plan.folder)
    with BackgroundWriter[_Written](options.jobs) as writer:
        for event in _stream(plan, network, options, writer, make or picture):
            yield event
            if event.stops:
                return


def _stream(
    plan: ShotPlan,
    network: nn.Module,
    options: UpscaleOptions,
    writer: BackgroundWriter[_Written],
    make: Make,
) -> Iterator[FrameEvent]:
    """Predict the frames in order and queue the pending ones for writing."""
    stamps = Stamps(plan)
    history = History(plan.sequence, plan.system, plan.source.scale)
    predict = _predictor(plan.system, network, options)

    def load(number: int) -> tuple[FramePair, Mapping[str, Plane]]:
        return _load(plan, stamps, number, options.device)

    ahead = read_ahead(options.jobs, plan.source.frame_bytes)
    for number, future in prefetch(load, plan.order, ahead):
        started = time.perf_counter()
        try:
            pair, passed = future.result()
            prediction = history.advance(pair, predict)
            if number in plan.pending:
                made = Made(
                    plan=plan,
                    options=options,
                    pair=pair,
                    window=history.window(pair),
                    prediction=prediction,
                    stamp=stamps.of(number),
                    passed=passed,
                )
                write = make(made)
        except RtsrError as error:
            history.reset()
            if isinstance(error, InputChangedError):
                stamps.spoil(number)
            yield replace(_event(plan, number, Status.FAILED), message=str(error))
            continue
        if number in plan.pending:
            seconds = time.perf_counter() - started
            writer.submit(_Written(number, seconds, pair.fixed), write)
        yield from _written(plan, writer, wait=False)
    yield from _written(plan, writer, wait=True)


def _load(
    plan: ShotPlan, stamps: Stamps, number: int, device: str
) -> tuple[FramePair, Mapping[str, Plane]]:
    """Read a frame, and see to it that what was hashed is what was read.

    Raises:
        InputChangedError: a file is not the one that the run was planned with.
        RtsrError: it cannot be read.
    """
    with plan.digests.unchanged(plan.files(number)):
        stamps.input_digest(number)
        pair = plan.source.load(number, plan.inputs).to(device)
        passed = {
            name: plane
            for part in plan.passed
            for name, plane in part.read(number, plan.output_size).items()
        }
    return pair, passed


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

    def window(self, pair: FramePair) -> Window:
        """Return the newest frame with what goes before it."""
        return Window(lr=tuple(self._past), hr=pair.hr, scale=self._scale)

    def advance(self, pair: FramePair, predict: Predictor) -> Prediction:
        """Predict the next frame from what is remembered, and remember it."""
        number = pair.lr.number
        if not self._sequence.follows(number, self._previous):
            self.reset()
        self._past.appendleft(pair.lr)
        prediction = predict(self.window(pair), self._state)
        self._state = prediction.state
        self._previous = number
        return prediction


def requested_tile(*, tile: int | None, debug: bool) -> int | None:
    """Return the tiles that were asked for; a tile has no debug picture of the whole."""
    return 0 if debug else tile


def _predictor(system: System, network: nn.Module, options: UpscaleOptions) -> Predictor:
    has_weights = any(True for _ in network.parameters())
    cast = DTYPES.get(options.precision) if has_weights else None
    device = torch.device(options.device)

    def predict(window: Window, state: State) -> Prediction:
        requested = requested_tile(tile=options.tile, debug=options.debug)
        side = tiling.tile_side(system, window.current.size, window.scale, requested)
        with torch.inference_mode(), torch.autocast(device.type, cast, enabled=cast is not None):
            return tiling.predict(system, network, window, state, side)

    return predict


def picture(made: Made) -> Callable[[], None]:
    """Write the predicted radiance."""
    plan, pair, prediction = made.plan, made.pair, made.prediction
    number, scale = pair.lr.number, plan.source.scale
    source = plan.source.reader.path(number)
    if prediction.image is None:
        raise FrameFolderError(f"{source}: system '{plan.system.name}' gave no image")
    alpha = pair.lr.gbuffer.buffers.get(Buffer.ALPHA)
    if alpha is not None:
        alpha = upsample_bicubic(alpha, scale, pair.lr.camera.jitter_px).clamp(0.0, 1.0)
    known = provenance(
        command=made.options.command,
        config_hash=plan.config_hash,
        source=source,
        stamp=made.stamp,
        extra={
            "rtsr:system": plan.system.name,
            "rtsr:nonfinite": pair.fixed,
            **color_tag(plan.source.reader.conventions),
        },
    )
    frame = OutputFrame(
        path=plan.path(number),
        color=prediction.image,
        alpha=alpha,
        attributes={**read_header(source).attributes, **known},
        windows=plan.source.output_window,
        colorspace=plan.source.reader.conventions.colorspace,
        passed=made.passed,
        previews=PREVIEW_SUFFIX in made.options.pictures,
        debug=_debug(pair, prediction) if made.options.debug else None,
    )
    return frame.write


def _debug(pair: FramePair, prediction: Prediction) -> Mapping[str, Image]:
    """Pictures for `--debug-buffers`: the system's; of one that has none, what it saw."""
    return prediction.debug or {b.value: image for b, image in pair.lr.gbuffer.items()}


def _written(
    plan: ShotPlan, writer: BackgroundWriter[_Written], *, wait: bool
) -> Iterator[FrameEvent]:
    """Events of finished writes; after one that blocks all others, only of those that went well."""
    for done, error in writer.done(wait=wait):
        if error is None:
            yield _success(plan, done)
            continue
        if not isinstance(error, RtsrError):
            raise error
        failure = replace(_event(plan, done.number, Status.FAILED), message=str(error))
        if not isinstance(error, OutputBlockedError):
            yield failure
            continue
        yield from (_success(plan, late) for late, worse in writer.drop() if worse is None)
        yield replace(failure, stops=True)
        return


def _success(plan: ShotPlan, done: _Written) -> FrameEvent:
    event = _event(plan, done.number, Status.WRITTEN)
    return replace(event, seconds=done.seconds, nonfinite=done.nonfinite)


def _event(plan: ShotPlan, number: int, status: Status) -> FrameEvent:
    return FrameEvent(shot=plan.name, number=number, status=status, path=plan.path(number))
