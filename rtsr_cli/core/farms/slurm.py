"""Slurm: one bash script that is an array job, and that submits itself step by step.

`bash SCRIPT` submits every step after the one before it (`afterok`); `sbatch SCRIPT` runs the first
divided step alone, a task of it each. Source: sbatch(1), "--array", "--dependency".
"""

from __future__ import annotations

import shlex

from rtsr_cli.core.errors import RequestError
from rtsr_cli.core.farms.commands import FarmJob, FarmStep, Part, PathPart, TaskPart, Word

HEAD = """#!/bin/bash
#SBATCH --job-name={name}
#SBATCH --array=1-{tasks}
# {about}
#
# bash SCRIPT          submits every step, each after the one before it
# bash SCRIPT STEP     runs a step here; a divided one as task $SLURM_ARRAY_TASK_ID
# Options of a site (partition, memory, time, GPU): in SBATCH_OPTIONS, or above as #SBATCH lines.
set -euo pipefail

rtsr=${{RTSR:-rtsr}}
tasks={tasks}
task=${{SLURM_ARRAY_TASK_ID:-}}
"""

TAIL = """
# shellcheck disable=SC2086  # options are several words
submit() { # step, array or nothing, job before it or nothing
    sbatch --parsable ${SBATCH_OPTIONS:-} ${2:+--array="$2"} \\
        ${3:+--dependency=afterok:"$3" --kill-on-invalid-dep=yes} "$0" "$1" | cut -d ';' -f 1
}

submit_all() {
    local job=
"""

END = """    echo "submitted, the last as job $job"
}

case ${1:-} in
"""

ONCE = "1-1"
"""Array of a step that is no array: it takes the place of the script's own."""


def write_slurm(job: FarmJob, about: str) -> str:
    """Write a script.

    Args:
        job: to write.
        about: the mark, and what made it.

    Raises:
        RequestError: a word cannot be written.
    """
    lines = [HEAD.format(name=job.name.replace(" ", "-"), tasks=job.tasks, about=about)]
    lines += [f"{_name_variable(p.name)}={_quote(str(p.path))}\n" for p in job.paths.values()]
    lines += [_write_function(step) for step in job.steps]
    lines.append(TAIL)
    lines += [
        f'    job=$(submit {step.name} {f"1-{job.tasks}" if step.divided else ONCE} "$job")\n'
        for step in job.steps
    ]
    lines.append(END)
    lines += [f"{step.name}) {_name_function(step)} ;;\n" for step in job.steps]
    first = next(step for step in job.steps if step.divided)
    lines.append(
        f"'') if [[ -n $task ]]; then {_name_function(first)}; else submit_all; fi ;;\n"
        f'*) echo "no step is called $1 (there are: {", ".join(s.name for s in job.steps)})" >&2\n'
        "    exit 2 ;;\nesac\n"
    )
    return "".join(lines)


def _write_function(step: FarmStep) -> str:
    ranges = ""
    if step.ranges:
        listed = " ".join(step.ranges)
        ranges = f"    local ranges=({listed})\n    local frames=${{ranges[$((task - 1))]}}\n"
    need = '    : "${task:?set SLURM_ARRAY_TASK_ID}"\n' if step.divided else ""
    words = " ".join(_write_word(word) for word in step.words)
    return f'\n{_name_function(step)}() {{\n{need}{ranges}    "$rtsr" {words}\n}}\n'


def _name_function(step: FarmStep) -> str:
    return f"run_{step.name.replace('-', '_')}"


def _name_variable(name: str) -> str:
    return f"path_{name.lower()}"


def _write_word(word: Word) -> str:
    return "".join(_write_part(part) for part in word)


def _write_part(part: Part) -> str:
    if isinstance(part, PathPart):
        return f'"${{{_name_variable(part.name)}}}"'
    if isinstance(part, TaskPart):
        return PARTS[part]
    return _quote(part)


def _quote(text: str) -> str:
    if "\0" in text or "\n" in text:
        raise RequestError(f"{text!r}: a name with ends of lines cannot be written; choose another")
    return shlex.quote(text)


PARTS = {
    TaskPart.NUMBER: '"$task"',
    TaskPart.COUNT: '"$tasks"',
    TaskPart.FRAMES: '"$frames"',
}
