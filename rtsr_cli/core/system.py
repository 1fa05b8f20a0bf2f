"""What a reconstruction system declares, so that loader, checks and loops follow from it.

A system is a module or folder of `models/`. Core runs any `System` and knows none by name.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.graphs import DescribeGraphs
from rtsr_cli.core.imaging.derivation import DerivationConfig
from rtsr_cli.core.shapes import Color, Image, TileMap

T = TypeVar("T")

State = Any
"""What a recurrent system carries from frame to frame; opaque to core, None at a reset."""


@dataclass(frozen=True, kw_only=True)
class FrameWindow:
    """What a system sees of one moment.

    Attributes:
        lr: the frame and its predecessors, newest first; shorter than `history_frames + 1`
            where history is missing (start, cut, gap), so that a system decides what stands in.
            Of frames that were not rendered it holds no radiance.
        hr: the current frame's G-buffer at the target size, without radiance; None if not asked.
        scale: output pixels per LR pixel.
        captures: where `TrainingRecipe.samples` asks for them, every sample of this frame's pixels
            and, if it is known, of those of the frame before, newest first.
    """

    lr: tuple[Frame, ...]
    hr: Frame | None = None
    scale: int = 1
    captures: tuple[Frame, ...] = ()
    _known: dict[Callable[[FrameWindow], Any], Any] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    @property
    def current(self) -> Frame:
        """The frame to reconstruct."""
        return self.lr[0]

    def require_hr(self) -> Frame:
        """Return the HR frame of a system that declares HR inputs."""
        if self.hr is None:
            raise AssertionError("plans check that a system with HR inputs gets an HR frame")
        return self.hr

    def compute_once(self, function: Callable[[FrameWindow], T]) -> T:
        """Return what a function gives for this window; it is called the first time alone.

        For what both a prediction and a decision upon it need, and neither should do again.
        """
        if function not in self._known:
            self._known[function] = function(self)
        value: T = self._known[function]
        return value


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """What a system gives back.

    Attributes:
        image: linear HDR radiance at the target size (upscaling, extrapolation).
        tiles: one value a tile and rate (variable-rate shading).
        state: carried to the next frame.
        debug: named pictures of what the system saw and decided.
        seconds: that its parts took, by name.
    """

    image: Color | None = None
    tiles: TileMap | None = None
    state: State = None
    debug: Mapping[str, Image] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)


Predict = Callable[[nn.Module, FrameWindow, State], Prediction]
"""`predict(network, window, state)`; `state` is None at a reset and for systems without one."""

Tensors = Mapping[str, Tensor]
"""Named tensors, batch first, so that those of several windows can be stacked."""

Prepare = Callable[[Any, FrameWindow], Tensors]
"""`prepare(config, window)`: a network's inputs, and what its loss needs of the window."""

Compose = Callable[[Any, FrameWindow, Tensors, Tensors], Prediction]
"""`compose(config, window, inputs, outputs)`: a picture from what a network gave."""


IMAGE_PROTOCOL = (
    "PSNR after c / (1 + c), SSIM and FLIP after sRGB on top of it; a border of 16 px is left out"
)
"""How pictures are judged where a recipe names no judge of its own."""


@dataclass(frozen=True, kw_only=True)
class FrameJudge:
    """How validation judges a frame.

    Attributes:
        names: of the scores; weights are kept by the first, of which more is better.
        scores: (config, window, prediction, reference frame) -> each of them.
        panels: (the same) -> pictures to look at, linear radiance.
        protocol: what the scores measure, in words.
    """

    names: tuple[str, ...]
    scores: Callable[[Any, FrameWindow, Prediction, Frame], Mapping[str, float]]
    panels: Callable[[Any, FrameWindow, Prediction, Frame], Mapping[str, Color]]
    protocol: str


@dataclass(frozen=True, kw_only=True)
class WholeFrames:
    """Of a system that only whole frames can be prepared for, as its pixels come from far away.

    Frames are prepared once, as captured; samples are crops of what was prepared.

    Attributes:
        change: (config, inputs, goal, choices, NumPy's generator) -> inputs and goal of a crop as
            another renderer could have given them: turned, relit.
        sought: name of the input, n 1 h w, around whose ones half of the crops are drawn.
    """

    change: Callable[[Any, Tensors, Tensors, Any, Any], tuple[Tensors, Tensors]]
    sought: str


@dataclass(frozen=True, kw_only=True)
class TrainingRecipe:
    """How a system is trained.

    Attributes:
        prepare: a window -> inputs.
        reference: buffers of the captured frame at the target size that `goal` reads, radiance
            among them.
        reference_optional: buffers that `goal` reads where they are there.
        goal: (config, window, reference frame) -> what outputs are held against.
        loss: (config, inputs, outputs, goal) -> its terms, weighted, each averaged over a batch;
            their sum is minimised.
        unroll: successive frames of a training sample, state carried from one to the next.
        beside: names of further radiance that `goal` reads where it was captured.
        samples: whether `goal` reads every sample of a pixel, in the window's `captures`, beside
            the reference, which holds their means.
        judge: of whole frames; None judges a picture by PSNR, SSIM and FLIP.
        measured: statistics of the network that are of its labels: weights to start from may have
            been trained on others, so that these begin anew.
        keep_goals: keep the goals of samples that come again unchanged: small, and slow to make.
        whole: of a system that only whole frames can be prepared for; None prepares crops.
        defaults: settings of the training that differ from `TrainingConfig`'s.
    """

    prepare: Prepare
    reference: tuple[Buffer, ...]
    reference_optional: tuple[Buffer, ...] = ()
    goal: Callable[[Any, FrameWindow, Frame], Tensors]
    loss: Callable[[Any, Tensors, Tensors, Tensors], Tensors]
    unroll: int = 1
    beside: tuple[str, ...] = ()
    samples: bool = False
    judge: FrameJudge | None = None
    measured: tuple[str, ...] = ()
    keep_goals: bool = False
    whole: WholeFrames | None = None
    defaults: Mapping[str, Any] = field(default_factory=dict)

    @property
    def protocol(self) -> str:
        """What the scores of a validation measure."""
        return IMAGE_PROTOCOL if self.judge is None else self.judge.protocol


STAGES = ("prepare", "network", "compose")
"""Parts of a network's prediction; on a GPU, which computes behind, the later ones wait for it."""


def neural_predict(prepare: Prepare, compose: Compose) -> Predict:
    """Return the `predict` of a network: prepare the window, run it, compose a picture.

    The network takes (inputs, state) and gives (outputs, state); its `config` is the system's.
    """

    def predict(network: nn.Module, window: FrameWindow, state: State) -> Prediction:
        config, kind = network.config, window.current.gbuffer.device.type
        times = [time.perf_counter()]
        # half precision is for layers: where points of a camera lie takes all digits
        with torch.autocast(kind, enabled=False):
            inputs = prepare(config, window)
        times.append(time.perf_counter())
        outputs, kept = network(inputs, state)
        times.append(time.perf_counter())
        with torch.autocast(kind, enabled=False):
            made = compose(config, window, inputs, outputs)
        times.append(time.perf_counter())
        took = [after - before for before, after in pairwise(times)]
        return replace(made, state=kept, seconds=dict(zip(STAGES, took, strict=True)))

    return predict


def default_derivation(config: Any) -> DerivationConfig:
    """`System.derivation` of whoever divides by the default material term."""
    del config
    return DerivationConfig()


@dataclass(frozen=True, kw_only=True)
class System:
    """The declaration of a system.

    Attributes:
        name: what users type.
        summary: one line.
        citation: the publication, or what the method is known by.
        task: what it predicts.
        lr_inputs: buffers of the frame at the rendered size that it cannot do without; of a system
            that extrapolates, of the frames that were rendered.
        lr_optional: buffers it uses where they are there.
        unshaded_inputs: buffers of frames that were not rendered, radiance not among them; the
            newest of the window is the one to predict.
        unshaded_optional: the same, optional.
        rendered_every: of a system that extrapolates, the one distance of rendered frames that it
            was made for; 0 = any.
        hr_inputs: buffers of the current frame at the target size.
        hr_optional: the same, optional.
        scales: factors it was made for; empty = any whole factor.
        history_frames: predecessors in the window.
        recurrent: True if it carries state.
        preroll_frames: frames that a shard replays before its first output.
        halo_px: LR pixels that one output pixel depends on to each side; None = all of them,
            so that the frame cannot be tiled.
        matches_filter: whether it has to know the pixel filter that went over LR radiance.
        derivation: what divides radiance; of a config, where a config decides.
        config: frozen dataclass of its settings; the defaults are used where weights name none.
        variants: configs of the published networks by name, where there are several.
        build: makes the network from a config and a scale.
        predict: runs it.
        learning: how it is trained, None if there is nothing to train.
        tiles: of a system that predicts errors of tiles, the `TilePredictor` that reads them.
        graphs: what is exported of its network, by config; None if nothing can be.
        weights: file name below `rtsr_cli/weights/`, with `{scale}` and fields of the `{config}`;
            None if it has none.
        measured_by: commands that print figures of sequences that it was not trained on -> the page
            that has them.
    """

    name: str
    summary: str
    citation: str
    task: SystemTask = SystemTask.UPSCALE
    lr_inputs: tuple[Buffer, ...]
    lr_optional: tuple[Buffer, ...] = ()
    unshaded_inputs: tuple[Buffer, ...] = ()
    unshaded_optional: tuple[Buffer, ...] = ()
    rendered_every: int = 0
    hr_inputs: tuple[Buffer, ...] = ()
    hr_optional: tuple[Buffer, ...] = ()
    scales: tuple[int, ...] = ()
    history_frames: int = 0
    recurrent: bool = False
    preroll_frames: int = 0
    halo_px: int | None = 0
    matches_filter: bool = False
    derivation: Callable[[Any], DerivationConfig] = default_derivation
    config: type[Any]
    variants: Mapping[str, Any] = field(default_factory=dict)
    build: Callable[[Any, int], nn.Module]
    predict: Predict
    learning: TrainingRecipe | None = None
    tiles: Any = None
    graphs: DescribeGraphs | None = None
    weights: str | None = None
    measured_by: Mapping[str, str] = field(default_factory=dict)

    def is_rendered(self, age: int) -> bool:
        """Tell whether the frame so many before the current one holds radiance.

        Of a system that extrapolates the current one does not, the one before it does, and so do
        those that lie a multiple of `rendered_every` before that.
        """
        if not self.unshaded_inputs:
            return True
        return age > 0 and (age - 1) % (self.rendered_every or 1) == 0

    @property
    def sees_straight(self) -> bool:
        """Tell whether it sees the colour of what covers a pixel: its pictures are covered again.

        Systems of shading rates see the frame as it is shown.
        """
        return self.task is not SystemTask.PREDICT_VRS

    @property
    def carries_history(self) -> bool:
        """Tell whether an output depends on other frames than its own."""
        return self.recurrent or self.history_frames > 0


class NoNetwork(nn.Module):
    """The network of a baseline: holds its config and no parameters."""

    config: Any

    def __init__(self, config: Any) -> None:
        """Keep the config."""
        super().__init__()
        self.config = config


def build_baseline(config: Any, scale: int) -> nn.Module:
    """`System.build` of a method without weights; any scale."""
    del scale
    return NoNetwork(config)
