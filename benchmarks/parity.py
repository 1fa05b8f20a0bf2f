"""The revision before a change against the one after it: the same pixels, channels, JSON, words?

    python benchmarks/parity.py BEFORE [AFTER] --data DATA [--only NAME ...] [--quick]

BEFORE and AFTER are source trees; AFTER is this one by default. Every case of `parity_cases.py`
runs `rtsr` of both trees in folders of its own; what they wrote, printed and exited with is
compared: EXR channels and attributes bit for bit, pictures, reports and events value by value,
text line by line, less times, stamps and versions. What BEFORE made is kept in `--cache`. Cases
with a tolerance say so, and the largest difference of each is printed. Exit 1: something differs.

Each tree has `--jobs` processes that have loaded libraries (never rtsr itself) and fork for a
command, so that a case does not pay for the start of torch; `--fresh` starts each anew. Networks
compute with `--threads` threads.
"""

from __future__ import annotations

import hashlib
import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import click
from parity_cases import CASES, INPUTS, Case, arguments, make_inputs
from parity_compare import Difference, Run, compare

SHOWN = 6
"""Differences of a case that are printed."""

HERE = Path(__file__).resolve().parents[1]
HOST = """
import importlib, json, os, runpy, sys
for name in (
    "numpy.typing", "torch", "OpenEXR", "pydantic.main", "safetensors.torch", "tqdm", "click",
    "fileseq", "jaxtyping", "tomllib", "zoneinfo", "multiprocessing.synchronize", "PIL.Image",
):
    importlib.import_module(name)
sys.modules["fileseq"].FrameSet("1-3x2,7")
for line in sys.stdin:
    ask = json.loads(line)
    child = os.fork()
    if child == 0:
        os.chdir(ask["folder"])
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        for number, name in ((1, ask["out"]), (2, ask["err"])):
            os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644), number)
        sys.path[0] = os.getcwd()
        sys.argv = ["rtsr", *ask["arguments"]]
        code = 1
        try:
            runpy.run_module("rtsr_cli", run_name="__main__", alter_sys=True)
            code = 0
        except SystemExit as error:
            code = error.code if isinstance(error.code, int) else int(error.code is not None)
        except BaseException:
            import traceback
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    status = os.waitpid(child, 0)[1]
    print(json.dumps(os.waitstatus_to_exitcode(status)), flush=True)
"""
"""A process that loads libraries once, and forks for each command to run `-m rtsr_cli`."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """How commands are run.

    Attributes:
        data: folder of rendered sequences.
        made: folder of the inputs that were made.
        jobs: commands at a time.
        threads: that each computes with.
        fresh: each command is a process from the start.
    """

    data: Path
    made: Path
    jobs: int
    threads: int
    fresh: bool


class Revision:
    """A source tree whose commands can be run."""

    def __init__(self, tree: Path, setting: Setting) -> None:
        """Start no process yet."""
        self.tree = tree
        self.setting = setting
        self._hosts: queue.LifoQueue[subprocess.Popen[str] | None] = queue.LifoQueue()
        for _ in range(setting.jobs):
            self._hosts.put(None)

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the processes."""
        while not self._hosts.empty():
            host = self._hosts.get()
            if host is not None:
                assert host.stdin
                host.stdin.close()
                host.wait()

    def rtsr(self, line: str, folder: Path, *more: str) -> int:
        """Run a command in a folder, its streams into `stdout` and `stderr` beside the folder."""
        command = [*arguments(line, self.setting.data, self.setting.made), *more]
        out, err = folder.with_name("stdout"), folder.with_name("stderr")
        if self.setting.fresh:
            with out.open("w") as stdout, err.open("w") as stderr:
                return subprocess.run(
                    [sys.executable, "-m", "rtsr_cli", *command],
                    cwd=folder, env=self._environment(), stdin=subprocess.DEVNULL,
                    stdout=stdout, stderr=stderr, check=False,
                ).returncode  # fmt: skip
        host = self._hosts.get()
        try:
            host = host or self._start()
            assert host.stdin
            assert host.stdout
            asked = {"arguments": command, "folder": str(folder), "out": str(out), "err": str(err)}
            host.stdin.write(json.dumps(asked) + "\n")
            host.stdin.flush()
            return int(host.stdout.readline())
        finally:
            self._hosts.put(host)

    def _environment(self) -> dict[str, str]:
        threads = {
            name: str(self.setting.threads) for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS")
        }
        return {**os.environ, "PYTHONPATH": str(self.tree), **threads}

    def _start(self) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-c", HOST], cwd="/", env=self._environment(), text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip

    def knows(self, wish: str, case: Case, folder: Path) -> bool:
        """Tell whether training has a setting (`a.b=c`)."""
        folder.mkdir(parents=True)
        self.rtsr(f"{case.line} --dry-run", folder)
        key = wish.split("=")[0].split(".")[-1]
        said = folder.with_name("stdout").read_text("utf-8")
        return f"\n{key} =" in said or f'"{key}"' in said


def run_case(revision: Revision, case: Case, place: Path) -> Run:
    """Run a case's commands in `place`/run."""
    shutil.rmtree(place, ignore_errors=True)
    folder = place / "run"
    more = ()
    if case.wish and revision.knows(case.wish, case, place / "wish"):
        more = ("--set", case.wish)
    folder.mkdir(parents=True)
    (folder / "out").mkdir() if "--output" in case.line else None
    if case.copy:
        source = Path(case.copy.format(data=revision.setting.data, made=revision.setting.made))
        copy_writable(source, folder / "in")
    codes = [revision.rtsr(line, folder) for line in case.first]
    codes.append(revision.rtsr(case.line, folder, *more))
    (place / "codes").write_text(json.dumps(codes), encoding="utf-8")
    return read_run(revision.tree, place)


def copy_writable(source: Path, target: Path) -> None:
    """Copy a folder; files may be written to."""
    shutil.copytree(source, target, copy_function=shutil.copyfile)
    for folder in (target, *(path for path in target.rglob("*") if path.is_dir())):
        folder.chmod(0o755)


def read_run(tree: Path, place: Path) -> Run:
    """Read what `run_case` left."""
    return Run(
        folder=place / "run",
        tree=tree,
        codes=tuple(json.loads((place / "codes").read_text(encoding="utf-8"))),
        out=(place / "stdout").read_text("utf-8", errors="replace"),
        err=(place / "stderr").read_text("utf-8", errors="replace"),
    )


def tree_digest(tree: Path) -> str:
    """Hash the package of a tree: its revision, changed or not."""
    digest = hashlib.blake2b(digest_size=8)
    for path in sorted((tree / "rtsr_cli").rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            digest.update(str(path.relative_to(tree)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def case_key(case: Case, threads: int) -> str:
    """Name the folder of a case's outputs: its name, and a hash of what it runs."""
    ran = (case.line, case.first, case.copy, case.wish, threads)
    return f"{case.name}-{hashlib.blake2b(repr(ran).encode(), digest_size=4).hexdigest()}"


def prepare(before: Revision, cases_made: Path) -> None:
    """Make the inputs once."""
    ready = cases_made / "ready"
    wanted = hashlib.blake2b(repr((INPUTS, make_inputs.__doc__)).encode()).hexdigest()
    if ready.is_file() and ready.read_text(encoding="utf-8") == wanted:
        return
    shutil.rmtree(cases_made, ignore_errors=True)
    cases_made.mkdir(parents=True)
    make_inputs(before.tree, before.setting.data, cases_made)
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work) / "run"
        folder.mkdir()
        for line in INPUTS:
            if before.rtsr(line, folder):
                raise click.ClickException(f"{line}: {folder.with_name('stderr').read_text()}")
    ready.write_text(wanted, encoding="utf-8")


def chosen_cases(only: Iterable[str], *, quick: bool) -> tuple[Case, ...]:
    """Return the cases that were asked for."""
    cases = [case for case in CASES if case.quick or not quick]
    return tuple(case for case in cases if not only or case.name.startswith(tuple(only)))


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What came of a case.

    Attributes:
        case: it.
        differences: all that differs, allowed or not.
        codes: exit codes before.
        seconds: of the commands after.
    """

    case: Case
    differences: tuple[Difference, ...]
    codes: tuple[int, ...]
    seconds: float

    @property
    def bad(self) -> tuple[Difference, ...]:
        """Differences that are not allowed."""
        return tuple(d for d in self.differences if not d.allowed)


def judge(before: Revision, after: Revision, cache: Path, work: Path, case: Case) -> Verdict:
    """Run a case on both, the revision before only if it is not in the cache."""
    place = cache / case_key(case, before.setting.threads)
    if (place / "codes").is_file():
        earlier = read_run(before.tree, place)
    else:
        earlier = run_case(before, case, place)
    started = time.perf_counter()
    later = run_case(after, case, work / case.name)
    seconds = time.perf_counter() - started
    differences = tuple(compare(earlier, later, case.files, case.within))
    shutil.rmtree(work / case.name)
    return Verdict(case=case, differences=differences, codes=earlier.codes, seconds=seconds)


def show(verdict: Verdict) -> None:
    """Print one line, and the differences that are not allowed."""
    case, bad = verdict.case, verdict.bad
    allowed = [d for d in verdict.differences if d.allowed]
    word = "DIFFERS" if bad else "within" if allowed else "equal"
    tail = f"; largest {max(d.size for d in allowed):.2e} of {case.within}" if allowed else ""
    print(f"{word:8}{case.name} ({verdict.seconds:.1f} s{tail})", flush=True)
    if verdict.codes[-1] != case.code:
        print(f"    note: exit code {verdict.codes[-1]} before, the table says {case.code}")
    for difference in bad[:SHOWN]:
        print(f"    {difference.where}: {difference.what} (by {difference.size:.2e})")
    if len(bad) > SHOWN:
        print(f"    and {len(bad) - SHOWN} more")


def verdicts(
    before: Revision, after: Revision, cache: Path, cases: tuple[Case, ...]
) -> Iterator[Verdict]:
    """Judge cases, several at a time, in order."""
    with (
        tempfile.TemporaryDirectory(prefix="parity-") as work,
        ThreadPoolExecutor(before.setting.jobs) as pool,
    ):
        yield from pool.map(lambda c: judge(before, after, cache, Path(work), c), cases)


@click.command()
@click.argument("before", type=click.Path(exists=True, path_type=Path))
@click.argument("after", type=click.Path(exists=True, path_type=Path), default=HERE)
@click.option("--data", required=True, type=click.Path(exists=True, path_type=Path))
@click.option("--only", multiple=True, help="Cases whose names begin so. Repeatable.")
@click.option("--quick", is_flag=True, help="A fifth of the cases.")
@click.option("--exact", is_flag=True, help="No tolerance for any case.")
@click.option(
    "--cache", type=click.Path(path_type=Path), default=Path(tempfile.gettempdir()) / "rtsr-parity"
)
@click.option("--jobs", default=2, show_default=True, help="Cases at a time.")
@click.option("--threads", default=1, show_default=True, help="Threads of each command.")
@click.option("--fresh", is_flag=True, help="Start every command from nothing.")
@click.option("--list", "listing", is_flag=True, help="Name the cases only.")
def main(
    *, before: Path, after: Path, data: Path, only: tuple[str, ...], quick: bool, exact: bool,
    cache: Path, jobs: int, threads: int, fresh: bool, listing: bool,
) -> None:  # fmt: skip
    """Run both revisions and print what differs."""
    cases = chosen_cases(only, quick=quick)
    if exact:
        cases = tuple(replace(case, within=None) for case in cases)
    if listing:
        print("\n".join(case.name for case in cases))
        return
    started = time.perf_counter()
    home = cache.resolve() / tree_digest(before)
    setting = Setting(
        data=data.resolve(), made=home / "made", jobs=jobs, threads=threads, fresh=fresh
    )
    with Revision(before.resolve(), setting) as first, Revision(after.resolve(), setting) as second:
        prepare(first, setting.made)
        results = []
        for verdict in verdicts(first, second, home / "cases", cases):
            show(verdict)
            results.append(verdict)
    used = [v for v in results if v.differences and not v.bad]
    failed = [v.case.name for v in results if v.bad]
    print(f"{len(results)} cases in {time.perf_counter() - started:.0f} s: "
          f"{len(results) - len(used) - len(failed)} equal, {len(used)} within their tolerance, "
          f"{len(failed)} differ{': ' if failed else ''}{', '.join(failed)}")  # fmt: skip
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
