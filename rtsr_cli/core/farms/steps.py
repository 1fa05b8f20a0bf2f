"""From commands to the steps of a job: conventions pinned, work divided, parts put together.

`--shard` wants what is measured to be declared, so that all parts agree: a step before the first
that reads a folder does that (`rtsr farm pin`). What a command writes once for all frames is
written after its tasks: reports are merged, figures gathered.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from rtsr_cli.core.errors import RequestError
from rtsr_cli.core.farms.commands import (
    Argument,
    FarmCommand,
    FarmJob,
    FarmStep,
    JobPath,
    PathPart,
    TaskPart,
    Word,
)
from rtsr_cli.core.frames.selection import Shard, format_ranges

MOST_TASKS = 100_000
"""Of a step; engines have limits of their own."""

EVALUATE = "evaluate"

GATHERING = frozenset({"predict-vrs", "label"})
"""Commands that write figures of all frames: run undivided at the end, they find these done."""

OWN = frozenset({"shard", "dry_run"})
"""Fields that the job sets itself, or that make no sense in one."""

READING = ("layout", "layer", "view")
"""Fields that decide how frames are read."""

OF_RESULT = frozenset({"outputs", "fail_under", "overwrite"})
"""Fields of `evaluate` that are of the whole result."""

Paths = dict[str, JobPath]


def plan_job(commands: Sequence[FarmCommand], tasks: int) -> FarmJob:
    """Return the job that runs commands one after the other, each divided.

    Args:
        commands: in their order.
        tasks: that each is divided into.

    Raises:
        RequestError: something is asked for that a job cannot do.
    """
    paths: Paths = {}
    steps: list[FarmStep] = []
    pinned: set[Path] = set()
    for command in commands:
        _check_command(command)
        steps += _pin_folders(command, paths, pinned)
        steps.append(_divide(command, paths, tasks))
        steps += _put_together(command, paths)
    names = " and ".join(dict.fromkeys(command.name for command in commands))
    return FarmJob(name=f"rtsr {names}", steps=_number(steps), paths=paths, tasks=tasks)


def _check_command(command: FarmCommand) -> None:
    for name in OWN:
        for argument in command.find(name):
            raise RequestError(f"leave out {argument.option}: the tasks of the job are the parts")
    if command.find("merge"):
        raise RequestError("leave out --merge: the job merges the parts of its tasks itself")
    if command.name == EVALUATE and not command.find("outputs"):
        raise RequestError("name an --output of evaluate: the parts of the tasks go there, merged")


def _number(steps: Iterable[FarmStep]) -> tuple[FarmStep, ...]:
    """Give steps names of their own."""
    named: list[FarmStep] = []
    for step in steps:
        same = sum(other.name.rstrip("0123456789") == step.name for other in named)
        named.append(replace(step, name=f"{step.name}{same + 1}") if same else step)
    return tuple(named)


def _pin_folders(command: FarmCommand, paths: Paths, pinned: set[Path]) -> list[FarmStep]:
    """Steps that declare what was measured of folders, unless the command names declarations."""
    if command.frames or command.find("capture_file"):
        return []
    reading = [word for name in READING for a in command.find(name) for word in _words(a, paths)]
    steps = []
    for argument in (a for a in command.arguments if a.frames):
        folder = _absolute(argument)
        if folder not in pinned:
            pinned.add(folder)
            # the folder by its place, after whatever names it in the command
            word = _words(replace(argument, option=None, written=True), paths)
            steps.append(FarmStep(name="pin", words=(("farm",), ("pin",), *word, *reading)))
    return steps


def _divide(command: FarmCommand, paths: Paths, tasks: int) -> FarmStep:
    """The step that runs the command once a task."""
    words = _run(command, paths, without=OF_RESULT if command.name == EVALUATE else {"frames"}
                 if command.frames else ())  # fmt: skip
    if command.frames:
        parts = [Shard(index=i, count=tasks).part(command.frames) for i in range(1, tasks + 1)]
        if not all(parts):
            raise RequestError(
                f"{tasks} tasks for {len(command.frames)} frames of {command.name}: give fewer "
                "--tasks, or more --frames"
            )
        ranges = tuple(format_ranges(part).replace(" ", "") for part in parts)
        words += (("--frames",), (TaskPart.FRAMES,))
        return FarmStep(name=command.name, words=words, ranges=ranges, divided=True)
    words += (("--shard",), (TaskPart.NUMBER, "/", TaskPart.COUNT))
    if command.name == EVALUATE:
        part = (*_name_parts(command, paths), "/part-", TaskPart.NUMBER, ".json")
        words += (("--output",), part)
    return FarmStep(name=command.name, words=words, divided=True)


def _put_together(command: FarmCommand, paths: Paths) -> list[FarmStep]:
    """The step after the tasks of a command, if it needs one."""
    if command.name in GATHERING:
        return [FarmStep(name="gather", words=_run(command, paths))]
    if command.name != EVALUATE:
        return []
    kept = (word for a in command.arguments if a.field in OF_RESULT for word in _words(a, paths))
    merge: tuple[Word, ...] = ((EVALUATE,), ("--merge",), _name_parts(command, paths), *kept)
    return [FarmStep(name="merge", words=merge)]


def _name_parts(command: FarmCommand, paths: Paths) -> Word:
    """Folder of the parts of a result: of this division, beside the first output."""
    output = command.find("outputs")[0]
    return (*_words(output, paths)[-1], ".parts/of-", TaskPart.COUNT)


def _run(command: FarmCommand, paths: Paths, without: Iterable[str] = ()) -> tuple[Word, ...]:
    left = [a for a in command.arguments if a.field not in set(without)]
    return ((command.name,), *(word for argument in left for word in _words(argument, paths)))


def _words(argument: Argument, paths: Paths) -> tuple[Word, ...]:
    option: tuple[Word, ...] = () if argument.option is None else ((argument.option,),)
    if argument.value is None:
        return option
    value = PathPart(_note_path(argument, paths)) if argument.path else argument.value
    return (*option, (value,))


def _absolute(argument: Argument) -> Path:
    """Where a path leads from here: tasks run in folders of their own."""
    return Path(argument.value or "").absolute()


def _note_path(argument: Argument, paths: Paths) -> str:
    """Remember a path, and what is done there; return its name."""
    path = _absolute(argument)
    known = next((one for one in paths.values() if one.path == path), None)
    if known is None:
        same = sum(name.rstrip("0123456789") == argument.path for name in paths)
        name = f"{argument.path}{same + 1}" if same else argument.path
        known = JobPath(name=name, path=path, folder=argument.folder)
    paths[known.name] = replace(
        known,
        read=known.read or not argument.written or argument.frames,
        written=known.written or argument.written,
    )
    return known.name
