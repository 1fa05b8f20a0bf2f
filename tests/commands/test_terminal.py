"""What is shown, and where it cannot be: work goes on to its end, and the exit code stays true."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from rtsr_cli.commands.exit_codes import EXIT_CODES
from rtsr_cli.core.evaluation.result_files import encode_csv
from rtsr_cli.core.files.exr import write_exr

Run = Callable[..., Result]
ROOT = Path(__file__).resolve().parents[2]
EVIL = "evil\x1b[31m\nError: fake\u202e.X"
RTSR = f"{sys.executable} -m rtsr_cli"


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    return write_frames(tmp_path / "Łódź")


def write_frames(folder: Path, base: str = "a") -> Path:
    pixels = np.random.default_rng(1).random((16, 24)).astype(np.float16)
    for number in (1, 2):
        write_exr(folder / f"{base}.{number:04d}.exr", dict.fromkeys(("R", "G", "B"), pixels))
    return folder


def shell(line: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        ["bash", "-c", line], capture_output=True, env={**os.environ, **environment}, check=False
    )


@pytest.mark.parametrize(
    ("where", "unbuffered"),
    [
        (">&-", ""), ("2>&-", ""), ("<&- >&- 2>&-", "1"), ("| head -c 1", ""),
        ("| head -c 1", "1"), ("2>&1 >/dev/null | true", ""),
    ],
)  # fmt: skip
def test_work_goes_on_where_nobody_listens(
    frames: Path, tmp_path: Path, where: str, unbuffered: str
) -> None:
    out = tmp_path / "out"
    line = f"{RTSR} upscale {frames} {out} --system bicubic --scale 2 --json {where}"
    done = shell(f"set -o pipefail; {line}", PYTHONUNBUFFERED=unbuffered)
    assert done.returncode == 0, done.stderr
    assert done.stderr == b""
    assert len(list(out.iterdir())) == 2


@pytest.mark.parametrize("where", [">&-", "2>&-", "2>&1 | head -c 1"])
def test_a_refusal_is_one_where_nobody_listens(tmp_path: Path, where: str) -> None:
    done = shell(f"set -o pipefail; {RTSR} upscale {tmp_path / 'none'} {tmp_path} {where}")
    assert done.returncode == 3


def test_a_closed_descriptor_leads_into_no_file(frames: Path, tmp_path: Path) -> None:
    """A file that took the number of standard error would get what libraries say to it."""
    (frames / "a.0002.exr").write_bytes((frames / "a.0002.exr").read_bytes()[:-30])
    out = tmp_path / "out"
    asked = f"upscale {frames} {out} --system bicubic --scale 2"
    assert shell(f"{RTSR} {asked} >&- 2>&-").returncode == 1
    assert b"0 written, 1 kept, 0 failed" in shell(f"{RTSR} {asked} --frames 1").stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_behind_standard_output_does_not_stop_the_work(
    frames: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    done = shell(f"{RTSR} upscale {frames} {out} --system bicubic --scale 2 > /dev/full")
    assert done.returncode == 3
    assert done.stderr == (b"Error: standard output: cannot be written (No space left on device)\n")
    assert len(list(out.iterdir())) == 2


@pytest.mark.parametrize(
    ("encoding", "shown"), [("cp1252", "\\u0141ód\\u017a"), ("ascii", "\\u0141\\xf3d\\u017a")]
)
def test_letters_that_an_encoding_lacks_are_shown_as_escapes(
    frames: Path, tmp_path: Path, encoding: str, shown: str
) -> None:
    line = f"{RTSR} upscale {frames} {tmp_path / 'out'} --system bicubic --scale 2"
    done = shell(line, PYTHONIOENCODING=encoding)
    assert done.returncode == 0
    assert f"{tmp_path}/{shown}: layout" in done.stdout.decode(encoding)
    assert len(list((tmp_path / "out").iterdir())) == 2
    refused = shell(f"{RTSR} inspect {frames}/none", PYTHONIOENCODING=encoding)
    assert refused.returncode == 3
    assert shown in refused.stderr.decode(encoding)


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux only")
def test_names_that_are_not_utf8_work_and_are_shown_as_escapes(tmp_path: Path) -> None:
    name = os.fsdecode(b"n\xff\xfe")
    frames = write_frames(tmp_path / name, name)
    out, report = tmp_path / f"out{name}", tmp_path / f"r{name}"
    asked = [sys.executable, "-m", "rtsr_cli", "upscale", frames, out, "--system", "bicubic"]
    done = subprocess.run([*asked, "--scale", "2", "--json"], capture_output=True, check=True)
    events = [json.loads(line) for line in done.stdout.decode().splitlines()]
    assert events[1]["path"] == f"{tmp_path}/outn\\xff\\xfe/n\\xff\\xfe.0001.exr"
    assert b"udc" not in done.stdout
    assert len(list(out.iterdir())) == 2
    again = subprocess.run([*asked, "--scale", "2"], capture_output=True, check=True)
    assert "0 written, 2 kept" in again.stdout.decode()
    judged = [sys.executable, "-m", "rtsr_cli", "evaluate", out, out, "--metric", "psnr"]
    outputs = [f"{report}.{suffix}" for suffix in ("json", "csv", "html")]
    subprocess.run([*judged, *(p for o in outputs for p in ("--output", o))], check=True)
    written = [Path(output).read_text(encoding="utf-8") for output in outputs]
    assert f"out{name}" not in "".join(written)
    assert list(json.loads(written[0])["tests"]) == ["outn\\xff\\xfe"]
    assert "outn\\xff\\xfe,.,1,all" in written[1] or "outn\\xff\\xfe,,1,all" in written[1]
    assert "outn\\xff\\xfe" in written[2]
    refused = subprocess.run(
        [sys.executable, "-m", "rtsr_cli", "inspect", tmp_path / f"no{name}", "--json"],
        capture_output=True, check=False,
    )  # fmt: skip
    assert refused.returncode == 3
    assert "non\\xff\\xfe" in refused.stderr.decode()


def test_control_characters_in_names_are_shown_and_not_obeyed(rtsr: Run, tmp_path: Path) -> None:
    folder = write_frames(tmp_path / "f")
    planes = dict.fromkeys(("R", "G", "B", EVIL), np.zeros((16, 24), np.float16))
    write_exr(folder / "a.0001.exr", planes)
    write_exr(folder / "a.0002.exr", planes)
    shown = "evil\\x1b[31m\\nError: fake\\u202e.X"
    for asked in (("inspect", folder), ("upscale", folder, tmp_path / "o", "--system", "taau")):
        result = rtsr(*asked)
        assert "\x1b" not in result.output
        assert "\nError: fake" not in result.output
    assert shown in rtsr("inspect", folder).stdout
    assert json.loads(rtsr("inspect", folder, "--json").stdout)["unknown"]["a"] == [EVIL]
    (folder / "capture.toml").write_text('"la\\u001b[2Jyout" = 1\n')
    refused = rtsr("inspect", folder)
    assert refused.exit_code == 3
    assert "la\\x1b[2Jyout: no such field" in refused.stderr


def test_cells_of_a_table_are_no_formulas() -> None:
    test = {
        "method": "=HYPERLINK(1)", "shot": "-2+3", "frames": {}, "notes": [],
        "regions": {"all": {}}, "mean": {"psnr": -3.5}, "nonfinite": 0,
    }  # fmt: skip
    lines = encode_csv({"metrics": {"psnr": {}}, "tests": {"t": test}}).splitlines()
    assert lines[1] == "'=HYPERLINK(1),'-2+3,,all,,-3.5,,0"


def test_the_table_of_exit_codes_is_in_the_help_and_the_readme(rtsr: Run) -> None:
    text = " ".join(rtsr("--help").stdout.split())
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert list(EXIT_CODES) == [0, 1, 2, 3, 130, 143]
    for code, meaning in EXIT_CODES.items():
        assert f"{code} {meaning}" in text
        assert f"| {code} | {meaning} |" in readme


@pytest.mark.parametrize("what", ["run", "pack"])
def test_a_limit_on_the_size_of_files_refuses_a_training_in_one_message(
    small_capture: Path, tmp_path: Path, what: str
) -> None:
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (9000, 9000))"
    run = f"{limit}; import sys; from rtsr_cli.cli import main; main()"
    target = ["--out", tmp_path / "r"] if what == "run" else ["--pack", tmp_path / "r" / "p"]
    few = ["--set", "training.steps=1", "--set", "training.crop=12"]
    asked = ["train", "fusesr-fast", small_capture, *target, *few, "--device", "cpu"]
    line = [sys.executable, "-c", run, *map(str, asked)]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == 3, done.stderr
    assert "Traceback" not in done.stderr
    assert "cannot be written (File too large)" in done.stderr
    assert not [p for p in tmp_path.rglob(".*")]
