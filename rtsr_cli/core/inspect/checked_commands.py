"""Commands whose readiness is told, as rows: what each of their systems or parts reads, and how."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.choices import NonfinitePolicy, SystemTask
from rtsr_cli.core.frames.buffers import RADIANCE_BUFFERS, Buffer
from rtsr_cli.core.inspect.readiness import (
    InputDemand,
    ShotProblem,
    Sources,
    SystemReadiness,
    judge_demand,
    list_timed_sources,
    make_demand,
)
from rtsr_cli.core.pairs.real_pairs import RealPairs
from rtsr_cli.core.pairs.simulated_pairs import SimulatedPairs
from rtsr_cli.core.pairs.simulation import Simulation
from rtsr_cli.core.pairs.sources import PairInputs
from rtsr_cli.core.system import System
from rtsr_cli.core.training.clip_recording import list_recorded_inputs


class FrameUse(StrEnum):
    """How a command takes the frames of a shot."""

    ENLARGED = "enlarged"
    """LR frames with HR ones, with a scale, or made from HR ones."""

    ALONE = "alone"
    """Frames of one size; what lies beside them is not read."""

    IN_TIME = "in time"
    """The same, where some frames were not rendered."""

    LEARNT = "learnt"
    """HR captures with radiance, or LR frames with HR ones and a reference."""


@dataclass(frozen=True, kw_only=True)
class CheckedCommand:
    """A command, and what it reads of frames.

    Attributes:
        name: as users type it.
        use: how it takes the frames of a shot.
        demands: of each of its systems, or parts.
    """

    name: str
    use: FrameUse
    demands: tuple[InputDemand, ...]


@dataclass(frozen=True, kw_only=True)
class ShotSources:
    """Where the frames of a shot come from.

    Attributes:
        main: its frames, None if they cannot be read.
        in_time: its frames, read as such that some of hold no radiance; None if all do.
        hr: the HR frames beside them, None if there are none, or they cannot be read.
        enlarged: ways to upscale them, the one that asks least first.
        referenced: whether radiance of the target size lies beside them.
    """

    main: FrameReader | None
    hr: FrameReader | None
    enlarged: Sources
    referenced: bool = False
    in_time: FrameReader | None = None

    def of(self, use: FrameUse) -> Sources:
        """Ways in which a use of frames reads them; none where it cannot."""
        if use is FrameUse.ENLARGED or self.main is None:
            return self.enlarged
        if use is FrameUse.IN_TIME:
            return list_timed_sources(self.in_time or self.main)
        if use is FrameUse.LEARNT and self.hr is not None:
            return self.enlarged
        if use is FrameUse.LEARNT:
            return [("", SimulatedPairs(capture=self.main, simulation=Simulation(scale=2)))]
        return [("", RealPairs(lr=self.main, hr=None, scale=1))]


def judge_commands(
    commands: Iterable[CheckedCommand], sources: ShotSources, problems: Collection[ShotProblem]
) -> dict[str, Mapping[str, SystemReadiness]]:
    """Tell, command by command, which systems or parts of it can run."""
    lasting = [p for p in problems if not p.radiance]
    return {
        command.name: {
            demand.name: judge_demand(
                _lighten(demand, command.use, sources),
                sources.of(command.use),
                lasting if command.use is FrameUse.IN_TIME else list(problems),
            )
            for demand in command.demands
        }
        for command in commands
    }


def _lighten(demand: InputDemand, use: FrameUse, sources: ShotSources) -> InputDemand:
    """Leave out of what is learnt the radiance of HR frames where a reference holds it."""
    if use is not FrameUse.LEARNT or not sources.referenced:
        return demand
    hr = tuple(b for b in demand.inputs.hr if b not in _OF_RADIANCE)
    return replace(demand, inputs=replace(demand.inputs, hr=hr))


_OF_RADIANCE = RADIANCE_BUFFERS | {Buffer.LIGHTING_MASK}


def list_upscale_demands(systems: Iterable[System]) -> tuple[InputDemand, ...]:
    """What the systems of a task read."""
    return tuple(make_demand(system) for system in systems)


def list_training_demands(systems: Iterable[System]) -> tuple[InputDemand, ...]:
    """What training reads, of systems that have something to train."""
    demands = []
    for system in systems:
        if system.learning is None:
            continue
        scale = system.scales[0] if system.scales else 1
        read = list_recorded_inputs(system, system.config(), scale)
        alone = system.task is not SystemTask.UPSCALE
        lr = dict.fromkeys((*read.lr, *(read.hr if alone else ())))
        inputs = PairInputs(
            lr=tuple(lr),
            hr=() if alone else read.hr,
            derivation=read.derivation,
            on_nonfinite=NonfinitePolicy.ERROR,
        )
        demands.append(InputDemand(name=system.name, inputs=inputs, scales=system.scales))
    return tuple(demands)


def demand_buffers(name: str, *buffers: Buffer) -> InputDemand:
    """What a part of a command reads that is no system."""
    return InputDemand(name=name, inputs=PairInputs(lr=buffers))
