"""`rtsr farm`: jobs that engines take, run on this machine and held to undivided runs."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from numpy.typing import NDArray

import rtsr_cli
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr

Run = Callable[..., Result]
Rgb = Callable[[Path], NDArray[np.float32]]

OPENJD = shutil.which("openjd", path=str(Path(sys.executable).parent))
with_openjd = pytest.mark.skipif(
    OPENJD is None, reason="openjd-cli is not installed (pip install openjd-cli)"
)
with_bash = pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")

SHARD_DB = 45.0
"""Least PSNR of a shard of `taau` to the whole run, after c / (1 + c), a picture standing still."""

DECLARED = """
layout = "rtsr"
[motion]
unit = "pixels"
direction = "previous-minus-current"
y_axis = "down"
"""


def openjd(*words: object) -> subprocess.CompletedProcess[str]:
    assert OPENJD is not None
    return subprocess.run(
        [OPENJD, *map(str, words)], capture_output=True, text=True, check=False, timeout=300
    )


def write_program(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(("#!/bin/bash", *lines)) + "\n")
    path.chmod(0o755)
    return path


def program(folder: Path, *before: str) -> Path:
    """`rtsr` of this tree, and what is done before it is run."""
    package = Path(rtsr_cli.__file__).parents[1]
    run = f'PYTHONPATH={package} exec {sys.executable} -m rtsr_cli "$@"'
    return write_program(folder / "rtsr", *before, run)


@pytest.fixture(scope="module")
def measured(textured: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shot whose motion runs the other way, which nothing declares."""
    shots = tmp_path_factory.mktemp("shots")
    for path in sorted(textured.glob("*.exr")):
        header = read_header(path)
        planes = dict(read_channels(path, header.channels))
        planes |= {c: -planes[c] for c in ("motion.X", "motion.Y")}
        write_exr(
            shots / "one" / path.name,
            planes,
            attributes=header.attributes,
            data_window=header.data_window,
            display_window=header.display_window,
        )
    return shots


@pytest.fixture
def capture(measured: Path, tmp_path: Path) -> Path:
    """A copy of it, for what writes into it."""
    return Path(shutil.copytree(measured, tmp_path / "in"))


def test_pinned_conventions_are_what_shards_need(rtsr: Run, capture: Path, tmp_path: Path) -> None:
    part = ("upscale", capture, tmp_path / "out", "--simulate-lr", 4, "--shard", "1/2")
    assert "is measured, not declared" in rtsr(*part).output
    result = rtsr("farm", "pin", capture)
    assert result.exit_code == 0, result.output
    assert "motion measured, written" in result.output
    declared = (capture / "one" / "capture.toml").read_text()
    assert 'direction = "current-minus-previous"' in declared
    again = rtsr("farm", "pin", capture)
    assert "1 shot, 0 files written" in again.output
    assert (capture / "one" / "capture.toml").read_text() == declared
    assert rtsr(*part).exit_code == 0


def test_pinning_keeps_what_is_declared(rtsr: Run, capture: Path) -> None:
    (capture / "capture.toml").write_text('licence = "CC0"\ncamera_cuts = [3]\n')
    assert rtsr("farm", "pin", capture).exit_code == 0
    own = (capture / "one" / "capture.toml").read_text()
    assert 'licence = "CC0"' in own
    assert "camera_cuts = [3]" in own


def test_pinning_says_where_comments_are(rtsr: Run, capture: Path) -> None:
    own = capture / "one" / "capture.toml"
    own.write_text("# mine\nfilter_width_px = 0.1234567890123\n")
    pinned = rtsr("farm", "pin", capture)
    assert pinned.exit_code == 0, pinned.output
    assert "motion measured, written; all else is spelled out" in pinned.output
    assert "capture.toml.bak is the former one, with its comments" in pinned.output
    assert "# mine" in own.with_name("capture.toml.bak").read_text()
    # no digit of a number is lost
    assert "filter_width_px = 0.1234567890123\n" in own.read_text()


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("--engine", "openjb", "--", "upscale", "a", "b"), 2, "did you mean 'openjd'?"),
        (("--engine", "openjd", "--", "inspect", "a"), 2, "neither --shard nor --frames"),
        (("--engine", "openjd", "--", "upscal", "a", "b"), 2, "did you mean 'upscale'?"),
        (("--engine", "openjd", "--", "upscale", "a"), 2, "Missing argument 'OUT'"),
        (("--engine", "openjd", "--", "upscale", "a", "b", "--shard", "1/2"), 2,
         "leave out --shard"),
        (("--engine", "openjd", "--", "upscale", "a", "b", "--dry-run"), 2, "leave out --dry-run"),
        (("--engine", "slurm", "--", "evaluate", "a", "b"), 2, "name an --output of evaluate"),
        (("--engine", "slurm", "--", "synth", "a", "--frames", "1-2"), 2, "8 tasks for 2 frames"),
        (("--engine", "openjd", "--", "upscale", "", "b"), 2, "IN is empty; name a file or fo"),
        (("--engine", "openjd", "--", "upscale", "a", "b", "--capture", ""), 2, "--capture is emp"),
        (("--engine", "openjd"), 2, "Missing argument"),
    ],
)  # fmt: skip
def test_what_no_job_can_be_made_of_is_one_message(
    rtsr: Run, words: tuple[str, ...], code: int, said: str
) -> None:
    result = rtsr("farm", "emit", *words)
    assert result.exit_code == code
    assert said in result.output
    assert "Traceback" not in result.output


def test_a_file_of_others_is_not_replaced(rtsr: Run, tmp_path: Path) -> None:
    words = ("--output", tmp_path / "job.json", "--", "upscale", "a", "b")
    (tmp_path / "job.json").write_text("{}")
    result = rtsr("farm", "emit", "--engine", "openjd", *words)
    assert result.exit_code == 3
    assert "job.json: rtsr farm did not write this" in result.output
    assert rtsr("farm", "emit", "--engine", "openjd", "--overwrite", *words).exit_code == 0
    # the same job is written again; another one, as of another engine, replaces it when asked
    assert rtsr("farm", "emit", "--engine", "openjd", *words).exit_code == 0
    before = (tmp_path / "job.json").read_bytes()
    for other in (
        ("slurm", *words),
        ("openjd", *words[:-1], "c"),
        ("openjd", "--tasks", 3, *words),
    ):
        refused = rtsr("farm", "emit", "--engine", *other)
        assert refused.exit_code == 3
        assert "job.json: a job of another command, or of another version" in refused.output
    assert (tmp_path / "job.json").read_bytes() == before
    assert rtsr("farm", "emit", "--engine", "slurm", "--overwrite", *words).exit_code == 0
    assert "{this file}" not in (tmp_path / "job.json").read_text()


@pytest.mark.parametrize("asked", [(), ("--overwrite",)])
def test_a_folder_is_no_file_of_a_job(rtsr: Run, tmp_path: Path, asked: tuple[str, ...]) -> None:
    words = ("--engine", "openjd", "--output", tmp_path, *asked, "--", "upscale", "a", "b")
    refused = rtsr("farm", "emit", *words)
    assert refused.exit_code == 3
    assert "a folder; name a file, such as" in refused.output


@pytest.mark.parametrize(
    "words",
    [
        ("upscal", "a", "b"),
        ("upscale", "a", "b", "--shard", "1/2"),
        ("evaluate", "a", "b"),
        ("inspect", "a"),
    ],
)
def test_what_emit_refuses_names_emit(rtsr: Run, words: tuple[str, ...]) -> None:
    result = rtsr("farm", "emit", "--engine", "openjd", "--", *words)
    assert result.exit_code == 2
    assert "farm emit [OPTIONS] -- COMMAND..." in result.output.splitlines()[0]


@with_openjd
@pytest.mark.parametrize(
    "command",
    [
        ("upscale", "in", "out", "--weights", "w.safetensors", "--capture", "c.toml"),
        ("demodulate", "in", "out", "--layout", "my.toml"),
        ("label", "in", "out", "--kind", "vrs"),
        ("extrapolate", "in", "out", "-v", "--frames", "1-9"),
        ("evaluate", "a", "b", "--ref", "r", "--output", "x.json", "--output", "x.html"),
        ("synth", "out", "--frames", "1-16", "--", "predict-vrs", "out", "rates"),
    ],
    ids=lambda words: words[0],
)
def test_templates_hold_to_the_schema(rtsr: Run, tmp_path: Path, command: tuple[str, ...]) -> None:
    job = tmp_path / "job.json"
    result = rtsr("farm", "emit", "--engine", "openjd", "--output", job, "--", *command)
    assert result.exit_code == 0, result.output
    checked = openjd("check", job)
    assert checked.returncode == 0, checked.stdout + checked.stderr


@with_openjd
def test_a_job_that_failed_is_run_again_and_ends_as_one_run(
    rtsr: Run, capture: Path, tmp_path: Path, files_of: Callable[[Path], dict[str, bytes]]
) -> None:
    out, report, job = tmp_path / "out", tmp_path / "report.json", tmp_path / "job.json"
    upscale = ("--simulate-lr", "4", "--system", "bicubic")
    result = rtsr(
        "farm", "emit", "--engine", "openjd", "--tasks", "2", "--output", job, "--",
        "upscale", capture, out, *upscale, "--", "evaluate", out, capture, "--output", report,
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    paths = ("-p", f"In={capture}", "-p", f"Out={out}", "-p", f"Output={report}")
    broken = program(tmp_path, '[[ "$*" != *upscale*--shard\\ 2/2* ]] || exit 1')
    failed = openjd("run", job, *paths, "-p", f"Rtsr={broken}")
    assert failed.returncode != 0
    half = files_of(out)
    assert sorted(half) == ["one/frame.0001.exr", "one/frame.0002.exr"]
    assert not report.exists()
    before = {name: (out / name).stat().st_mtime_ns for name in half}
    done = openjd("run", job, *paths, "-p", f"Rtsr={program(tmp_path)}")
    assert done.returncode == 0, done.stdout + done.stderr
    # what was done is kept
    assert {name: (out / name).stat().st_mtime_ns for name in half} == before
    assert rtsr("upscale", capture, tmp_path / "whole", *upscale).exit_code == 0
    assert files_of(out) == files_of(tmp_path / "whole")
    whole = tmp_path / "whole.json"
    assert rtsr("evaluate", out, capture, "--output", whole).exit_code == 0
    assert json.loads(report.read_text()) == json.loads(whole.read_text())


def run_script(script: Path, folder: Path, *words: str, **variables: str) -> str:
    """Run a script of Slurm's with programs that write down their words; return these."""
    log = folder / "log"
    log.write_text("")
    programs = folder / "bin"
    programs.mkdir(exist_ok=True)
    write_program(programs / "rtsr", f'echo "$*" >> {log}')
    write_program(programs / "sbatch", f'echo "sbatch $*" >> {log}', f"wc -l < {log}")
    path = f"{programs}{os.pathsep}{os.environ['PATH']}"
    environment = {k: v for k, v in os.environ.items() if not k.startswith("SLURM")}
    subprocess.run(
        ["bash", str(script), *words],
        env=environment | {"PATH": path} | variables,
        check=True,
        capture_output=True,
        timeout=60,
    )
    return log.read_text()


@pytest.fixture(scope="module")
def still(textured: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A picture that stands still for longer than a part replays: its history reaches furthest."""
    shot = tmp_path_factory.mktemp("still")
    path = textured / "frame.0003.exr"
    header = read_header(path)
    planes = {name: plane[:64, :64] for name, plane in read_channels(path, header.channels).items()}
    planes |= {name: np.zeros_like(planes[name]) for name in ("motion.X", "motion.Y")}
    for number in range(1, 41):
        write_exr(shot / f"still.{number:04d}.exr", planes, attributes=header.attributes)
    (shot / "capture.toml").write_text(DECLARED)
    return shot


@with_bash
def test_an_array_job_divides_a_recurrent_run_within_what_pre_roll_leaves(
    rtsr: Run, still: Path, tmp_path: Path, load_rgb: Rgb
) -> None:
    out, whole, job = tmp_path / "out", tmp_path / "whole", tmp_path / "job.sh"
    options = ("--system", "taau", "--simulate-lr", "2", "--jitter", "halton")
    emit = ("farm", "emit", "--engine", "slurm", "--tasks", "2", "--output", job, "--")
    assert rtsr(*emit, "upscale", still, out, *options).exit_code == 0
    for task in ("1", "2"):
        words = run_script(job, tmp_path, "upscale", SLURM_ARRAY_TASK_ID=task).split()
        assert words[-2:] == ["--shard", f"{task}/2"]
        result = rtsr(*words)
        assert result.exit_code == 0, result.output
    assert rtsr("upscale", still, whole, *options).exit_code == 0
    frames = sorted(path.name for path in whole.glob("*.exr"))
    assert sorted(path.name for path in out.glob("*.exr")) == frames
    errors = []
    for name in frames:
        images = [load_rgb(folder / name).astype(np.float64) for folder in (out, whole)]
        shown = [image / (1 + image) for image in images]
        errors.append(float(np.mean((shown[0] - shown[1]) ** 2)))
    assert max(errors[:20]) == 0.0
    # the 21st frame has 16 of its 20 past ones
    assert 0.0 < max(errors[20:]) < 10 ** (-SHARD_DB / 10)


@with_bash
def test_figures_of_all_frames_are_gathered_when_the_parts_are_done(
    rtsr: Run, small_capture: Path, tmp_path: Path
) -> None:
    out, whole, job = tmp_path / "out", tmp_path / "whole", tmp_path / "job.sh"
    options = ("--estimator", "analytic")
    emit = ("farm", "emit", "--engine", "slurm", "--tasks", "2", "--output", job, "--")
    assert rtsr(*emit, "predict-vrs", small_capture, out, *options).exit_code == 0
    for step, task in (("pin", "1"), ("predict-vrs", "1"), ("predict-vrs", "2"), ("gather", "1")):
        words = run_script(job, tmp_path, step, SLURM_ARRAY_TASK_ID=task).split()
        result = rtsr(*words)
        assert result.exit_code == 0, result.output
    assert "0 written, 4 kept" in result.output
    assert rtsr("predict-vrs", small_capture, whole, *options).exit_code == 0
    files = sorted(path.name for path in whole.iterdir())
    assert sorted(path.name for path in out.iterdir()) == files
    assert all((out / name).read_bytes() == (whole / name).read_bytes() for name in files)


@with_bash
def test_frames_that_are_rendered_in_parts_are_those_of_one_run(
    rtsr: Run, tmp_path: Path, files_of: Callable[[Path], dict[str, bytes]]
) -> None:
    out, whole, job = tmp_path / "out", tmp_path / "whole", tmp_path / "job.sh"
    options = ("--frames", "1-3", "--size", "24x16")
    emit = ("farm", "emit", "--engine", "slurm", "--tasks", "2", "--output", job, "--")
    assert rtsr(*emit, "synth", out, *options).exit_code == 0
    for task, frames in (("1", "1"), ("2", "2-3")):
        words = run_script(job, tmp_path, SLURM_ARRAY_TASK_ID=task).split()
        assert words[-2:] == ["--frames", frames]
        assert rtsr(*words).exit_code == 0
    assert rtsr("synth", whole, *options).exit_code == 0
    assert files_of(out) == files_of(whole)


@with_bash
def test_steps_are_submitted_each_after_the_one_before_it(rtsr: Run, tmp_path: Path) -> None:
    job = tmp_path / "job.sh"
    result = rtsr(
        "farm", "emit", "--engine", "slurm", "--tasks", "32", "--output", job, "--",
        "upscale", "in", "out", "--", "evaluate", "out", "in", "--output", "r.json",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    lines = run_script(job, tmp_path, SBATCH_OPTIONS="--partition gpu").splitlines()
    start = "sbatch --parsable --partition gpu --array="
    after = "--dependency=afterok:{} --kill-on-invalid-dep=yes "
    assert lines == [
        f"{start}1-1 {job} pin",
        f"{start}1-32 {after.format(1)}{job} upscale",
        f"{start}1-32 {after.format(2)}{job} evaluate",
        f"{start}1-1 {after.format(3)}{job} merge",
    ]
    unknown = subprocess.run(["bash", str(job), "x"], capture_output=True, text=True, check=False)
    assert unknown.returncode == 2
    assert "no step is called x" in unknown.stderr
