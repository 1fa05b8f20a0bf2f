"""Job templates of the Open Job Description [specification "jobtemplate-2023-09"].

Deadline Cloud takes them, and `openjd run` of openjd-cli runs them on one machine. Tasks are an
index range, as lists of values end at 1,024. Paths are parameters without defaults, as a template
may not lead out of its folder; they are mapped where a farm has rules for that.
"""

from __future__ import annotations

import json
from typing import Any

from rtsr_cli.core.errors import RequestError
from rtsr_cli.core.farms.commands import FarmJob, FarmStep, JobPath, Part, PathPart, TaskPart, Word
from rtsr_cli.core.wording import say_count

VERSION = "jobtemplate-2023-09"

MOST_LISTED = 1024
"""Values of a list of task parameters."""

PROGRAM, TASKS, SHARD, FRAMES = "Rtsr", "Tasks", "Shard", "Frames"
"""Names of parameters: the command that runs rtsr, the number of tasks; of a task."""

RESERVED = "{{"
"""Begins what engines fill in; there is no way to write it as it is."""

PARTS = {
    TaskPart.NUMBER: f"{{{{Task.Param.{SHARD}}}}}",
    TaskPart.COUNT: f"{{{{Param.{TASKS}}}}}",
    TaskPart.FRAMES: f"{{{{Task.Param.{FRAMES}}}}}",
}


def write_openjd(job: FarmJob, about: str) -> str:
    """Write a template as JSON.

    Args:
        job: to write.
        about: the mark, and what made it.

    Raises:
        RequestError: a word cannot be written, or there are too many ranges of frames.
    """
    shards = any(step.divided and not step.ranges for step in job.steps)
    template = {
        "specificationVersion": VERSION,
        "name": job.name,
        "description": about,
        "parameterDefinitions": [
            {
                "name": PROGRAM,
                "type": "STRING",
                "default": "rtsr",
                "description": "The command that runs rtsr.",
            },
            *([_describe_tasks(job.tasks)] if shards else []),
            *(_describe_path(path) for path in job.paths.values()),
        ],
        "steps": [
            _describe_step(step, job.steps[i - 1] if i else None)
            for i, step in enumerate(job.steps)
        ],
    }
    return json.dumps(template, indent=2, ensure_ascii=False) + "\n"


def _describe_tasks(count: int) -> dict[str, Any]:
    return {
        "name": TASKS,
        "type": "INT",
        "default": count,
        "minValue": 1,
        "description": "Parts that each shot is divided into, a task each.",
    }


def _describe_path(path: JobPath) -> dict[str, Any]:
    flow = {(True, False): "IN", (False, True): "OUT"}.get((path.read, path.written), "INOUT")
    kind = "DIRECTORY" if path.folder else "FILE"
    return {"name": path.name, "type": "PATH", "objectType": kind, "dataFlow": flow}


def _describe_step(step: FarmStep, before: FarmStep | None) -> dict[str, Any]:
    described: dict[str, Any] = {"name": step.name}
    if before is not None:
        described["dependencies"] = [{"dependsOn": before.name}]
    if step.divided:
        described["parameterSpace"] = {"taskParameterDefinitions": [_describe_range(step)]}
    args = [_write_word(word) for word in step.words]
    run = {"command": f"{{{{Param.{PROGRAM}}}}}", "args": args}
    return {**described, "script": {"actions": {"onRun": run}}}


def _describe_range(step: FarmStep) -> dict[str, Any]:
    if not step.ranges:
        return {"name": SHARD, "type": "INT", "range": f"1-{PARTS[TaskPart.COUNT]}"}
    if len(step.ranges) > MOST_LISTED:
        raise RequestError(
            f"{say_count(len(step.ranges), 'range')} of frames: a template lists {MOST_LISTED} at "
            "most; give fewer --tasks"
        )
    return {"name": FRAMES, "type": "STRING", "range": list(step.ranges)}


def _write_word(word: Word) -> str:
    return "".join(_write_part(part) for part in word)


def _write_part(part: Part) -> str:
    if isinstance(part, PathPart):
        return f"{{{{Param.{part.name}}}}}"
    if isinstance(part, TaskPart):
        return PARTS[part]
    if RESERVED in part or not part.isprintable():
        raise RequestError(
            f"{part!r}: a template cannot hold '{RESERVED}' or control characters as they are; "
            "choose another name"
        )
    return part


def list_parameters(job: FarmJob) -> list[str]:
    """Words that give a job its paths, after `openjd run TEMPLATE`."""
    return [word for path in job.paths.values() for word in ("-p", f"{path.name}={path.path}")]
