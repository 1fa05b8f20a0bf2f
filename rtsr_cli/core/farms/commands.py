"""Commands as a farm takes them: words whose paths and parts are known as such.

A word is made of parts. What an engine fills in, paths and the number of a task, is a part of its
own, so that each engine writes it in its own way and no text has to be searched for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path


class TaskPart(StrEnum):
    """What differs from task to task."""

    NUMBER = "number"
    """Of the task, from 1."""
    COUNT = "count"
    """Of all tasks."""
    FRAMES = "frames"
    """Range of frame numbers that is the task's."""


@dataclass(frozen=True)
class PathPart:
    """A path that a job is given; equal paths have one name."""

    name: str


Part = str | PathPart | TaskPart

Word = tuple[Part, ...]
"""One word of a command line."""


@dataclass(frozen=True, kw_only=True)
class Argument:
    """An argument or option of a command as it was given.

    Attributes:
        option: as users type it, None for what goes by its place.
        value: its value, None for a flag.
        field: name of what it sets.
        path: what a path is called in a job; empty for values that are none.
        folder: whether the path is of a folder, not of a file.
        written: whether the command writes there.
        frames: whether frames are read there whose conventions have to be declared.
    """

    option: str | None
    value: str | None
    field: str
    path: str = ""
    folder: bool = True
    written: bool = False
    frames: bool = False


@dataclass(frozen=True, kw_only=True)
class FarmCommand:
    """A command that can be divided.

    Attributes:
        name: as users type it.
        arguments: in their order.
        frames: numbers of the frames that tasks share where parts are no `--shard`; empty where
            they are.
    """

    name: str
    arguments: tuple[Argument, ...]
    frames: tuple[int, ...] = ()

    def find(self, field_name: str) -> tuple[Argument, ...]:
        """Arguments that set a field."""
        return tuple(a for a in self.arguments if a.field == field_name)


@dataclass(frozen=True, kw_only=True)
class JobPath:
    """A path that a job is given.

    Attributes:
        name: in the job.
        path: absolute, on this machine.
        folder: whether it is a folder.
        read, written: what is done there.
    """

    name: str
    path: Path
    folder: bool
    read: bool = False
    written: bool = False


@dataclass(frozen=True, kw_only=True)
class FarmStep:
    """One command of a job, after which the next one may begin.

    Attributes:
        name: shown by engines.
        words: after `rtsr`.
        ranges: of the frames of each task, where tasks are no shards.
        divided: whether it is run once a task.
    """

    name: str
    words: tuple[Word, ...]
    ranges: tuple[str, ...] = ()
    divided: bool = False


@dataclass(frozen=True, kw_only=True)
class FarmJob:
    """A job: steps, each after the one before it.

    Attributes:
        name: shown by engines.
        steps: in their order.
        paths: that they read and write, by name.
        tasks: of each divided step.
    """

    name: str
    steps: tuple[FarmStep, ...]
    paths: Mapping[str, JobPath] = field(default_factory=dict)
    tasks: int
