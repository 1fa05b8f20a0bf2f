"""What of rtsr_cli one frame passes through between its loader's return and its writer's call.

    python benchmarks/walk.py [TREE] [--command predict-vrs] [--list]

Runs the command of TREE (this tree by default) on its `sample_data/`, or on rendered frames for
`predict-vrs`, in a process of its own, with `sys.setprofile` in the thread of the frame loop only.
Prints how many files and functions of rtsr_cli are seen between the two marks for one frame in the
middle of the run, and which; of the first frame, which also imports, the numbers. Marks are
qualified names, `--start` one that returns and `--end` one that is called. A second table has
the calls in all threads of functions whose names `--watch` matches, by shot and by frame: from
runs of 2 and of 6 frames, so that what is done once a shot and what is done for each frame are
told apart.
"""

from __future__ import annotations

import io
import os
import re
import runpy
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import click

HERE = Path(__file__).resolve().parents[1]
PACKAGE = f"{os.sep}rtsr_cli{os.sep}"
COMMANDS = {
    "upscale": ("upscale", "IN", "OUT", "--system", "fusesr-fast"),
    "predict-vrs": ("predict-vrs", "IN", "OUT"),
}
FEW, MANY = 2, 6
"""Frames of the runs that calls are counted in."""

WATCH = (
    r"^(declared|read_capture|read_declarations|_?available|resolve_needs|loads|read_layout|load_layout|"
    r"detect\w*|find_channels|bind\w*|resolve\w*)$"
)
"""Functions that parse or resolve: of the present tree, and likely names of later ones."""

Name = tuple[str, str]
"""File below rtsr_cli (or module), and qualified name."""


@dataclass
class Frames:
    """Profiles one thread: what is seen from the start mark to the end mark, each time.

    Attributes:
        start: qualified name whose return to rtsr_cli begins.
        end: qualified name whose call ends.
        seen: functions of every finished stretch.
        open: of the stretch under way; None: between stretches.
    """

    start: str
    end: str
    seen: list[set[Name]] = field(default_factory=list)
    open: set[Name] | None = None

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """Take one event of the interpreter."""
        code = frame.f_code
        if self.open is None:
            caller = frame.f_back
            if event == "return" and code.co_qualname == self.start and caller is not None:
                self.open = set() if PACKAGE in caller.f_code.co_filename else None
        elif event == "call" and code.co_qualname == self.end:
            self.seen.append(self.open)
            self.open = None
        elif PACKAGE in code.co_filename:
            self.open.add(name_of(code))


@dataclass
class Calls:
    """Counts the calls of functions, in every thread.

    Attributes:
        pattern: that the function's own name matches.
        counts: calls by name.
    """

    pattern: re.Pattern[str]
    counts: Counter[Name] = field(default_factory=Counter)

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """Take one event of the interpreter."""
        code = frame.f_code
        if event != "call" or not self.pattern.match(code.co_name):
            return
        if PACKAGE in code.co_filename or code.co_filename.endswith("tomllib/_parser.py"):
            self.counts[name_of(code)] += 1


def name_of(code: CodeType) -> Name:
    """Return file and qualified name of a function."""
    return code.co_filename.rsplit(PACKAGE, 1)[-1], code.co_qualname


def run_command(tree: str, arguments: list[str], profile: Callable[..., None], every: bool) -> None:
    """Run a command of a tree in this process under a profile, in all threads if `every`."""
    sys.path.insert(0, tree)
    sys.argv = ["rtsr", *arguments]
    if every:
        threading.setprofile(profile)
    sys.setprofile(profile)
    try:
        with redirect_stdout(io.StringIO()):
            runpy.run_module("rtsr_cli", run_name="__main__", alter_sys=True)
    except SystemExit as error:
        if error.code:
            raise RuntimeError(f"{arguments}: exit code {error.code}") from error
    finally:
        sys.setprofile(None)
        threading.setprofile(None)


def frames_of(tree: str, arguments: list[str], start: str, end: str) -> list[set[Name]]:
    """Return the functions of every frame of a run."""
    profile = Frames(start, end)
    run_command(tree, arguments, profile, every=False)
    return profile.seen


def calls_of(tree: str, arguments: list[str], watch: str) -> Counter[Name]:
    """Return the calls of the functions that are watched."""
    profile = Calls(re.compile(watch))
    run_command(tree, arguments, profile, every=True)
    return profile.counts


def anew(work: Callable[..., Any], *arguments: object) -> Any:
    """Call a function in a process of its own: nothing is imported or cached yet."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(work, *arguments).result()


def command_line(command: str, data: Path, out: Path, frames: int) -> list[str]:
    """Return the arguments of a run."""
    places = {"IN": str(data), "OUT": str(out)}
    arguments = [places.get(part, part) for part in COMMANDS[command]]
    return [*arguments, "--frames", f"1-{frames}", "--jobs", "1", "-q"]


def make_capture(tree: Path, folder: Path) -> None:
    """Render frames with radiance."""
    line = ["synth", str(folder), "--size", "192x128", "--frames", f"1-{MANY}", "-q"]
    anew(run_command, str(tree), line, ignore, False)


def ignore(*_: object) -> None:
    """Take an event and keep nothing of it."""


@click.command()
@click.argument("tree", type=click.Path(exists=True, path_type=Path), default=HERE)
@click.option("--command", "commands", multiple=True, type=click.Choice(list(COMMANDS)))
@click.option("--start", default="Future.result", show_default=True)
@click.option("--end", default="BackgroundWriter.submit", show_default=True)
@click.option("--watch", default=WATCH, help="Regular expression.")
@click.option("--list", "listing", is_flag=True, help="Also every function.")
def main(
    *, tree: Path, commands: tuple[str, ...], start: str, end: str, watch: str, listing: bool
) -> None:
    """Print files and functions of a frame, and calls by shot and frame."""
    tree = tree.resolve()
    with tempfile.TemporaryDirectory() as folder:
        places = {"upscale": tree / "sample_data", "predict-vrs": Path(folder) / "capture"}
        make_capture(tree, places["predict-vrs"])
        for command in commands or COMMANDS:
            show_frame(command, str(tree), places[command], (start, end), listing=listing)
            show_calls(command, str(tree), places[command], watch)


def show_frame(
    command: str, tree: str, data: Path, marks: tuple[str, str], *, listing: bool
) -> None:
    """Print what one frame in the middle of a run passes through."""
    with tempfile.TemporaryDirectory() as out:
        line = command_line(command, data, Path(out) / "out", MANY)
        seen = anew(frames_of, tree, line, *marks)
    if len(seen) < MANY:
        raise click.ClickException(
            f"{command}: marks {marks} were passed {len(seen)} times in {MANY} frames"
        )
    functions = seen[MANY // 2]
    files = Counter(file for file, _ in functions)
    print(f"{' '.join(COMMANDS[command])}: {len(files)} files, {len(functions)} functions a frame")
    first = {file for file, _ in seen[0]}
    print(f"  (the first frame, imports with it: {len(first)} files, {len(seen[0])} functions)")
    for file in sorted(files):
        names = sorted(name for at, name in functions if at == file)
        print(f"  {file}: {', '.join(names) if listing else files[file]}")


def show_calls(command: str, tree: str, data: Path, watch: str) -> None:
    """Print how often what is watched is called, once a shot and for each frame."""
    counts = []
    for frames in (FEW, MANY):
        with tempfile.TemporaryDirectory() as out:
            line = command_line(command, data, Path(out) / "out", frames)
            counts.append(anew(calls_of, tree, line, watch))
    print(f"{command}: calls                         a shot   a frame   ({MANY} frames)")
    for name in sorted(counts[1]):
        frame = (counts[1][name] - counts[0][name]) / (MANY - FEW)
        shot = counts[0][name] - FEW * frame
        print(f"  {name[0]} {name[1]}: {shot:g}  {frame:g}  ({counts[1][name]})")


if __name__ == "__main__":
    main()
