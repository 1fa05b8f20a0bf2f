"""What is wrong with a shot, what that means for commands, and which systems can run on it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.shots import HR_FOLDER, LR_FOLDER
from rtsr_cli.core.choices import NonfinitePolicy, SystemTask
from rtsr_cli.core.errors import RtsrError
from rtsr_cli.core.frames.cadence import Cadence
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.frames.selection import format_ranges
from rtsr_cli.core.network.load import has_weights
from rtsr_cli.core.pairs.real_pairs import RealPairs, open_real_pairs
from rtsr_cli.core.pairs.simulated_pairs import SimulatedPairs
from rtsr_cli.core.pairs.simulation import Simulation
from rtsr_cli.core.pairs.sources import PairInputs, PairSource, name_once
from rtsr_cli.core.run.system_inputs import resolve_system_inputs, resolve_unshaded_inputs
from rtsr_cli.core.system import System

ANY_SCALE = 2
"""Stands for the scale where readiness does not depend on it."""

SKIP = "--on-missing skip"

ONE_SIZE = 1
"""Scale of systems that enlarge nothing."""


class Severity(IntEnum):
    """What a command with default options does about a problem, the least first."""

    REMARK = 0
    """It runs."""
    PIXELS = 1
    """It leaves some frames out as failed."""
    HOLES = 2
    """It refuses, unless it may skip frames."""
    REFUSED = 3
    """It refuses."""


@dataclass(frozen=True, kw_only=True)
class ShotProblem:
    """Something that is wrong.

    Attributes:
        text: what, where, and the remedy.
        gravity: what it leads to.
        lacks: what is missing for every system, where commands refuse.
        radiance: whether it stops only what reads radiance of every frame.
    """

    text: str
    gravity: Severity = Severity.REMARK
    lacks: str = "readable frames"
    radiance: bool = False


@dataclass(frozen=True, kw_only=True)
class SystemReadiness:
    """Whether a system can run.

    Attributes:
        ready: it can, in the way that `how` says.
        missing: what it lacks for that.
        how: options that it needs ("--simulate-lr S", "--on-missing skip"); empty if none.
    """

    ready: bool
    missing: tuple[str, ...]
    how: str = ""


Sources = Sequence[tuple[str, PairSource]]
"""Ways to run: options, and where frames then come from."""


def match_resolutions(
    main: FrameReader, hr: FrameReader, scale: int | None, there: Collection[int] = ()
) -> tuple[Sources, list[ShotProblem]]:
    """Match LR and HR as `upscale` does; say what does not match.

    Args:
        main, hr: the readable frames.
        scale: as declared.
        there: HR frames with files, readable or not: those are no holes that a command skips.
    """
    problems = []
    try:
        every = replace(hr, numbers=tuple(sorted({*hr.numbers, *there})))
        open_real_pairs(main, every, scale)
    except RtsrError as error:
        problems = [ShotProblem(text=str(error), gravity=Severity.HOLES)]
    try:
        source = open_real_pairs(main, hr, scale, skip_missing=True)
    except RtsrError as error:
        lacks = "HR frames that match"
        return [], [ShotProblem(text=str(error), gravity=Severity.REFUSED, lacks=lacks)]
    return [("", source)], problems


def list_single_sources(main: FrameReader, scale: int | None) -> Sources:
    """Ways to run on frames that have no HR ones beside them."""
    return [
        ("" if scale else "--scale S", RealPairs(lr=main, hr=None, scale=scale or ANY_SCALE)),
        (
            "--simulate-lr S",
            SimulatedPairs(capture=main, simulation=Simulation(scale=ANY_SCALE)),
        ),
    ]


def judge_readiness(
    system: System, sources: Sources, problems: Sequence[ShotProblem]
) -> SystemReadiness:
    """Tell whether and how a system can run; see `judge_demand`."""
    return judge_demand(make_demand(system), sources, problems)


def lacks_radiance(reader: FrameReader) -> str:
    """Say which frames of a sequence hold no radiance, as what is missing."""
    return f"color of {say_frames(reader.unrendered)}"


def list_timed_sources(main: FrameReader) -> Sources:
    """The way to run on frames some of which were not rendered: those with radiance are."""
    source = RealPairs(lr=main, hr=None, scale=1)
    rendered = frozenset(main.numbers) - main.unrendered
    if not main.unrendered or Cadence().list_rendered(main.numbers, main.step) <= rendered:
        return [("", source)]
    return [(f"--rendered {format_ranges(rendered).replace(', ', ',')}", source)]


@dataclass(frozen=True, kw_only=True)
class InputDemand:
    """What a system, or a part of a command, reads of frames.

    Attributes:
        name: of the system or part.
        inputs: what is read of a pair.
        scales: factors that it is made for; empty = any.
        weights: scales that it comes with weights for; None if it needs none.
        unshaded: what is read of frames that were not rendered; None where that is no difference.
    """

    name: str
    inputs: PairInputs
    scales: tuple[int, ...] = ()
    weights: tuple[int, ...] | None = None
    unshaded: PairInputs | None = None


def make_demand(system: System) -> InputDemand:
    """What a system reads to run."""
    weighted = system.learning is not None and system.task is SystemTask.UPSCALE
    policy = NonfinitePolicy.ERROR
    return InputDemand(
        name=system.name,
        inputs=resolve_system_inputs(system, policy),
        unshaded=resolve_unshaded_inputs(system, policy) if system.unshaded_inputs else None,
        scales=system.scales,
        weights=tuple(s for s in system.scales if has_weights(system, s)) if weighted else None,
    )


def judge_demand(
    demand: InputDemand, sources: Sources, problems: Sequence[ShotProblem]
) -> SystemReadiness:
    """Tell whether and how what is demanded can be had.

    Args:
        demand: to judge.
        sources: the ways to try, the one that asks least first.
        problems: of all frames that it would read.
    """
    refused = [p.lacks for p in problems if p.gravity is Severity.REFUSED]
    if refused or not sources:
        return SystemReadiness(ready=False, missing=tuple(dict.fromkeys(refused)))
    skip = [SKIP] if any(p.gravity is Severity.HOLES for p in problems) else []
    ways = [
        SystemReadiness(
            ready=not missing, missing=missing, how=" ".join([*([how] if how else []), *skip])
        )
        for how, source in sources
        for missing in [_list_missing(demand, source)]
    ]
    return min(ways, key=lambda way: len(way.missing))


def _say_other_scale(scales: Sequence[int], scale: int) -> str:
    """Say which sizes would do: a pair is of its ratio, whatever system is chosen."""
    if tuple(scales) == (ONE_SIZE,):
        return f"frames of one size: name the folder {LR_FOLDER} or {HR_FOLDER} alone"
    factors = " or ".join(f"{s}x" for s in scales)
    return f"HR frames of {factors} the size of LR's (these are {scale}x)"


def _list_missing(demand: InputDemand, source: PairSource) -> tuple[str, ...]:
    """What the files lack, and the scale and weights where they are known not to fit."""
    known, scale = len(source.readers) > 1, source.scale
    fits = not known or not demand.scales or scale in demand.scales
    reader = source.reader
    if demand.unshaded is None:
        lacking = list(source.missing(demand.inputs))
    else:
        rendered = set(reader.numbers) - reader.unrendered
        of_both = (
            *source.missing(demand.inputs, rendered),
            *source.missing(demand.unshaded, reader.unrendered),
        )
        lacking = list(name_once(of_both))
    if not fits:
        lacking.append(_say_other_scale(demand.scales, scale))
    elif demand.weights is not None and not (scale in demand.weights if known else demand.weights):
        lacking.append(f"weights{f' for {scale}x' if known else ''} (rtsr train makes them)")
    return tuple(lacking)
