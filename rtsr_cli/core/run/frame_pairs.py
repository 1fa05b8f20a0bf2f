"""Going through a shot's LR/HR pairs: what every run over frames in order shares.

A run is a `Work`, called with each frame in its turn; reading, history, stamps, failures and events
are the same whatever it does with them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from torch import Tensor

from rtsr_cli.core.captures.regions import OutputWindows
from rtsr_cli.core.errors import InputChangedError, RtsrError
from rtsr_cli.core.files.exr import Plane, read_header
from rtsr_cli.core.files.provenance import describe_provenance
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.pairs.opening import ReadOptions
from rtsr_cli.core.pairs.passthrough import PassedChannels, join_attributes
from rtsr_cli.core.pairs.sources import FramePair, PairInputs, PairSource
from rtsr_cli.core.run.loop import Product
from rtsr_cli.core.run.outputs import FLOAT_BYTES, HALF_BYTES, HEADER_BYTES, check_output
from rtsr_cli.core.run.plan import FrameOutputs, ShotPlan
from rtsr_cli.core.run.request import FramesRequest
from rtsr_cli.core.run.shot_inputs import ShotInputs
from rtsr_cli.core.run.shot_runs import (
    AS_FLOAT,
    NEGATIVE,
    NO_MATERIAL,
    NO_MATERIAL_WHY,
    NONFINITE,
    STAGES,
    ShotJob,
)
from rtsr_cli.core.run.sliding_window import SlidingWindow
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.system import FrameWindow


def read_options(request: FramesRequest, *, unrendered: bool = False) -> ReadOptions:
    """Return how the frames of a request are read; `unrendered` ones may hold no radiance."""
    return ReadOptions(
        layout=request.layout,
        layer=request.layer,
        view=request.view,
        capture=request.capture_file,
        on_missing=request.on_missing,
        output=request.out_folder,
        sharded=request.shard is not None,
        selection=request.selection,
        unrendered=unrendered,
    )


@dataclass(frozen=True, kw_only=True)
class PairReading:
    """How the pairs of a shot are read.

    Attributes:
        source: of the pairs.
        inputs: buffers that are wanted of them.
        passed: channels that are only handed through.
        unshaded: what is wanted of frames in place of `inputs`, by number: of those that were not
            rendered.
    """

    source: PairSource
    inputs: PairInputs
    passed: tuple[PassedChannels, ...] = ()
    unshaded: Mapping[int, PairInputs] = field(default_factory=dict)

    def inputs_of(self, number: int) -> PairInputs:
        """Return the buffers that are wanted of a frame."""
        return self.unshaded.get(number, self.inputs)

    @property
    def output_size(self) -> Size:
        """(height, width) at the target size."""
        height, width = self.source.lr_size
        return height * self.source.scale, width * self.source.scale

    def _count_output_bytes(self, *, pictures: int) -> int:
        """Size of a picture at the target size with what is handed through, uncompressed."""
        height, width = self.output_size
        layers = len("RGBA" if Buffer.ALPHA in self.source.reader.stored else "RGB")
        passed = sum(len(part.channels) for part in self.passed)
        a_pixel = layers * HALF_BYTES + passed * FLOAT_BYTES + pictures * len("RGB")
        return height * width * a_pixel + HEADER_BYTES

    def plan_outputs(
        self, folder: Path, command: str, *, pictures: tuple[str, ...], debug: bool = False
    ) -> FrameOutputs:
        """Return what a command writes of pairs that are read so; arguments as its fields."""
        return FrameOutputs(
            folder=folder,
            command=command,
            pictures=pictures,
            debug=debug,
            frame_bytes=self._count_output_bytes(pictures=len(pictures)),
        )

    def of_shot(self, name: str) -> ShotInputs:
        """Return what a run reads of the shot."""

        @cache
        def files(number: int) -> tuple[Path, ...]:
            passed = (path for part in self.passed for path in part.files(number))
            return tuple(
                dict.fromkeys((*self.source.files(number, self.inputs_of(number)), *passed))
            )

        return ShotInputs(
            name=name, reader=self.source.reader, readers=self.source.readers, files=files
        )


@dataclass(frozen=True, kw_only=True)
class FrameInTurn:
    """A frame in its turn.

    Attributes:
        plan: of its shot.
        pair: what was read.
        window: the same, with the frames that are its history.
        passed: channels that are handed through, by name.
        source: the file that names the frame.
        attributes: of its header.
        windows: where the output's pixels lie.
        begins: True where there is no history: at the start, after a cut, a gap or a failure.
        wanted: True if an output is to be made; else the frame is history of others.
    """

    plan: ShotPlan
    pair: FramePair
    window: FrameWindow
    passed: Mapping[str, Plane]
    source: Path
    attributes: Mapping[str, Any]
    windows: OutputWindows
    begins: bool
    wanted: bool

    @property
    def number(self) -> int:
        """Of the frame."""
        return self.pair.lr.number

    @property
    def path(self) -> Path:
        """The output's."""
        return self.plan.paths[self.number]

    def provenance(self, extra: Mapping[str, Any]) -> dict[str, Any]:
        """Header attributes of the output; `extra` are those of the kind of run."""
        stamps = self.plan.stamps
        return describe_provenance(
            command=self.plan.outputs.command,
            config_hash=stamps.config_hash,
            source=self.source,
            stamp=stamps.of_output(self.number),
            extra={"rtsr:nonfinite": self.pair.fixed, **extra},
        )

    def product(
        self,
        write: Callable[[], None],
        *,
        as_float: bool = False,
        no_material: float = 0.0,
        no_material_why: Mapping[str, str] | None = None,
        stages: Mapping[str, float] | None = None,
    ) -> Product:
        """What was made of the frame.

        Args:
            write: writes it.
            as_float: whether it is float.
            no_material: share of its pixels whose radiance was enlarged for want of a material.
            no_material_why: causes of that -> where.
            stages: seconds of a prediction's parts.
        """
        facts = {
            NONFINITE: self.pair.fixed,
            NEGATIVE: self.pair.negative,
            AS_FLOAT: as_float,
            NO_MATERIAL: no_material,
            NO_MATERIAL_WHY: dict(no_material_why or {}),
            STAGES: {name: round(seconds, 4) for name, seconds in (stages or {}).items()},
        }
        return Product(write=write, facts=facts)

    def check_output(self, made: Tensor, maker: str) -> float:
        """Refuse an output that holds NaN or Inf; return its largest magnitude.

        Args:
            made: pixels or tiles.
            maker: what made it, for the message.

        Raises:
            NonfiniteError: says how many; the frame fails, and nothing is written of it.
        """
        return check_output(made, f"{self.source}: {maker}", "other weights or another --system")


Work = Callable[[FrameInTurn], Product | None]
"""What a run does with a frame; None where no output is wanted.

Raises:
    RtsrError: it cannot; the frame fails alone, and is no history of the next one.
"""


@dataclass(frozen=True)
class _Loaded:
    pair: FramePair
    passed: Mapping[str, Plane]
    source: Path
    attributes: Mapping[str, Any]
    windows: OutputWindows


class PairJob(ShotJob[_Loaded]):
    """A shot's pairs and what is done with them, for the frame loop."""

    def __init__(
        self,
        plan: ShotPlan,
        reading: PairReading,
        work: Work,
        *,
        history_frames: int = 0,
        device: str = "cpu",
        release_every: int = 1,
    ) -> None:
        """Start without history.

        Args:
            plan: of the shot.
            reading: of its pairs.
            work: what is done with a frame.
            history_frames: predecessors in the window.
            device: torch device of the frames.
            release_every: as `Pace` has it.
        """
        super().__init__(plan, frame_bytes=reading.source.frame_bytes, release_every=release_every)
        self._reading, self._work, self._device = reading, work, device
        self._window = SlidingWindow(
            plan.sequence, history_frames=history_frames, scale=reading.source.scale
        )

    def load(self, key: int) -> _Loaded:
        """Read a frame, and see to it that what was hashed is what is read.

        Raises:
            InputChangedError: a file is not the one that the run was planned with.
            RtsrError: it cannot be read.
        """
        plan, reading = self.plan, self._reading
        size = reading.output_size
        with plan.digests.hold_unchanged(plan.inputs.files(key)):
            plan.stamps.of_input(key)
            pair = reading.source.load(key, reading.inputs_of(key)).to(self._device)
            passed = {
                name: plane
                for part in reading.passed
                for name, plane in part.read(key, size).items()
            }
            source = plan.inputs.reader.path(key)
            header = read_header(source)
            attributes = join_attributes(header.attributes, reading.passed, key)
        windows = reading.source.place_output(header)
        return _Loaded(pair, passed, source, attributes, windows)

    def compute(self, key: int, loaded: _Loaded) -> Product | None:
        """Do the work on a frame."""
        begins = not self._window.follows(key)
        window = self._window.slide(loaded.pair)
        moment = FrameInTurn(
            plan=self.plan,
            pair=loaded.pair,
            window=window,
            passed=loaded.passed,
            source=loaded.source,
            attributes=loaded.attributes,
            windows=loaded.windows,
            begins=begins,
            wanted=key in self.plan.pending,
        )
        return self._work(moment)

    def fail(self, key: int, error: RtsrError) -> None:
        """Let history restart after a frame that failed."""
        self._window.forget()
        if isinstance(error, InputChangedError):
            self.plan.stamps.spoil(key)
