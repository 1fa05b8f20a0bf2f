from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from click.testing import Result
from safetensors.torch import load_file
from torch import Tensor

from rtsr_cli.core.files.atomic_write import TEMPORARY_SUFFIX
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.network.weights import SHIPPED, read_weights
from rtsr_cli.core.training.clips import read_clips

ROOT = Path(__file__).resolve().parents[2]

SMALL = {
    "training.steps": 4,
    "training.batch": 2,
    "training.crop": 12,
    "training.warmup": 1,
    "training.validate_every": 4,
    "training.save_every": 1,
    "training.log_every": 1,
    "training.validation_frames": 1,
    "training.precision": '"fp32"',
}

Run = Callable[..., Result]


def settings(**changed: object) -> list[str]:
    names = {key.replace("__", "."): value for key, value in changed.items()}
    return [part for k, v in {**SMALL, **names}.items() for part in ("--set", f"{k}={v}")]


@pytest.fixture(scope="session")
def captures(tmp_path_factory: pytest.TempPathFactory, small_capture: Path) -> Path:
    """Two shots of two frames, 192 x 128."""
    root = tmp_path_factory.mktemp("captures")
    for name, numbers in (("one", (1, 2)), ("two", (3, 4))):
        (root / name).mkdir()
        for number in numbers:
            shutil.copy(small_capture / f"frame.{number:04d}.exr", root / name)
    (root / "capture.toml").write_text('licence = "CC0"\n')
    return root


@pytest.fixture(scope="session")
def clips_of_four(tmp_path_factory: pytest.TempPathFactory, small_capture: Path) -> Path:
    """Two shots of four frames, for what trains on clips."""
    root = tmp_path_factory.mktemp("clips")
    for name in ("one", "two"):
        (root / name).mkdir()
        for number in (1, 2, 3, 4):
            shutil.copy(small_capture / f"frame.{number:04d}.exr", root / name)
    return root


@pytest.fixture(scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames are decoded once for all tests."""
    return tmp_path_factory.mktemp("cache")


def train(rtsr: Run, captures: Path, cache: Path, out: Path, *more: str) -> Result:
    return rtsr("train", "fusesr-fast", captures, "--out", out, "--cache", cache, *more)


def test_a_run_leaves_what_the_contract_says(
    rtsr: Run, captures: Path, cache: Path, tmp_path: Path
) -> None:
    result = train(rtsr, captures, cache, tmp_path, *settings(data__validation='["two"]'))
    assert result.exit_code == 0, result.output
    assert "2 frames of 1 shot to train on, 2 to validate" in result.output
    there = {path.name for path in tmp_path.iterdir()}
    assert there >= {
        "config.toml", "last.safetensors", "best.safetensors", "last.md", "best.md", "state",
        "log.csv", "pictures",
    }  # fmt: skip
    assert [p.name for p in (tmp_path / "pictures").iterdir()] == ["step-000004-two-4.png"]
    weights = read_weights(tmp_path / "best.safetensors")
    assert weights.system == "fusesr-fast"
    assert weights.about["trained_on"] == ["one"]
    assert weights.about["data"]["training"]["licences"] == {"CC0": 1}
    card = (tmp_path / "best.md").read_text()
    assert weights.sha256() in card
    assert "For validation: 2 frames of 1 shot; licences by shots, as declared: CC0 (1)." in card
    assert "| two | 2 | CC0 |" in card
    assert len((tmp_path / "log.csv").read_text().splitlines()) == 5


def test_a_run_begins_without_what_killed_ones_left(
    rtsr: Run, captures: Path, cache: Path, tmp_path: Path
) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    host = os.uname().nodename.partition(".")[0][:24]
    parts = [
        tmp_path / folder / f".a1b2-x.{host}-{ended.pid}{TEMPORARY_SUFFIX}"
        for folder in (".", "state", "pictures")
    ]
    for part in parts:
        part.parent.mkdir(exist_ok=True)
        part.write_bytes(b"half a file")
    assert train(rtsr, captures, cache, tmp_path, *settings(training__steps=1)).exit_code == 0
    assert not [part for part in parts if part.exists()]


def test_clips_that_were_cut_are_recorded_again(rtsr: Run, captures: Path, tmp_path: Path) -> None:
    asked = (captures, tmp_path / "cache", tmp_path / "run", *settings(training__steps=1))
    assert train(rtsr, *asked).exit_code == 0
    clips = {path: path.read_bytes() for path in (tmp_path / "cache").glob("*.rtsr-clips")}
    for path, content in clips.items():
        path.write_bytes(content[: len(content) // 2])
    index = next((tmp_path / "cache").glob("*.json"))
    index.write_bytes(index.read_bytes()[:40])
    assert train(rtsr, *asked).exit_code == 0
    assert {path: path.read_bytes() for path in clips} == clips


def test_trained_weights_upscale(rtsr: Run, captures: Path, cache: Path, tmp_path: Path) -> None:
    assert train(rtsr, captures, cache, tmp_path / "run", *settings()).exit_code == 0
    weights = tmp_path / "run" / "best.safetensors"
    result = rtsr(
        "upscale", captures / "one", tmp_path / "out", "--simulate-lr", "4", "--weights", weights
    )
    assert result.exit_code == 0, result.output
    assert "system fusesr-fast" in result.output
    again = rtsr(
        "upscale", captures / "one", tmp_path / "out", "--simulate-lr", "4", "--weights", weights
    )
    assert "0 written, 2 kept" in again.output


def test_a_recurrent_network_trains_goes_on_and_upscales(
    rtsr: Run, clips_of_four: Path, captures: Path, cache: Path, tmp_path: Path
) -> None:
    few = settings(training__steps=2, training__validate_every=2)
    run = ["train", "nsrd", clips_of_four, "--out", tmp_path / "run", "--cache", cache]
    assert rtsr(*run, *few).exit_code == 0
    kept = (tmp_path / "run" / "last.safetensors").read_bytes()
    assert rtsr(*run, *few).exit_code == 0
    assert (tmp_path / "run" / "last.safetensors").read_bytes() == kept
    result = rtsr(
        "upscale", clips_of_four / "one", tmp_path / "out", "--simulate-lr", "4",
        "--weights", tmp_path / "run" / "best.safetensors",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "system nsrd" in result.output
    refused = rtsr("train", "nsrd", captures, "--out", tmp_path / "short", "--cache", cache, *few)
    assert refused.exit_code == 3
    assert "4 successive frames" in refused.output


def test_a_run_starts_from_weights_that_are_there(
    rtsr: Run, captures: Path, cache: Path, tmp_path: Path
) -> None:
    first, still = tmp_path / "first", tmp_path / "still"
    assert train(rtsr, captures, cache, first, *settings()).exit_code == 0
    begun = str(first / "last.safetensors")
    slow = settings(training__learning_rate=1e-12)
    assert train(rtsr, captures, cache, still, *slow, "--init", begun).exit_code == 0
    before, after = (read_weights(run / "last.safetensors").tensors for run in (first, still))
    for name in (n for n in before if n.endswith("weight")):
        assert torch.allclose(before[name].float(), after[name].float(), atol=1e-6), name


@pytest.mark.parametrize("wrong", ["another system's", "no weights"])
def test_weights_to_start_from_are_checked_before_frames_are_read(
    rtsr: Run, captures: Path, tmp_path: Path, wrong: str
) -> None:
    file = captures / "v" / "nothing"
    if wrong == "another system's":
        file = SHIPPED / "fusesr-4x.safetensors"
    result = train(rtsr, captures, tmp_path / "cache", tmp_path / "run", "--init", str(file))
    assert result.exit_code == 3
    assert str(file) in result.output
    assert not (tmp_path / "cache").exists()
    assert not (tmp_path / "run").exists()


def test_lr_frames_beside_hr_frames_and_their_radiance_train(
    rtsr: Run, small_shot: Path, cache: Path, tmp_path: Path
) -> None:
    result = train(rtsr, small_shot, cache, tmp_path, *settings())
    assert result.exit_code == 0, result.output
    assert "4 frames of 1 shot to train on" in result.output


def test_one_shot_is_judged_on_what_it_was_trained_on_and_says_so(
    rtsr: Run, captures: Path, cache: Path, tmp_path: Path
) -> None:
    result = train(rtsr, captures / "one", cache, tmp_path, *settings())
    assert result.exit_code == 0, result.output
    assert "no shot is held out" in result.output


@pytest.mark.parametrize(
    ("assignment", "said"),
    [
        ("training.stpes=3", "there is no 'stpes', did you mean 'steps'?"),
        ("network.fusion=cat", "not one of unshuffle, pool, upsample, none"),
        ("nonsense.a=1", "there is no table 'nonsense'"),
        ("training.scale=3", "made for 2x, 4x, 8x, not 3x"),
        ('data.exclude=["nothing*"]', "nothing* matches no shot"),
    ],
)
def test_settings_that_do_not_fit_are_refused(
    rtsr: Run, captures: Path, cache: Path, tmp_path: Path, assignment: str, said: str
) -> None:
    result = train(rtsr, captures, cache, tmp_path / "run", *settings(), "--set", assignment)
    assert result.exit_code == 3
    assert said in result.output
    assert not (tmp_path / "run" / "config.toml").exists()


def test_a_run_is_not_gone_on_with_under_other_settings(
    rtsr: Run, captures: Path, cache: Path, tmp_path: Path
) -> None:
    assert train(rtsr, captures, cache, tmp_path, *settings()).exit_code == 0
    result = train(rtsr, captures, cache, tmp_path, *settings(training__batch=1))
    assert result.exit_code == 3
    assert "training.batch is 2, not 1" in result.output
    result = train(rtsr, captures, cache, tmp_path, *settings(training__log_every=2))
    assert result.exit_code == 0, result.output


def test_frames_without_radiance_are_refused_by_name(
    rtsr: Run, captures: Path, cache: Path, tmp_path: Path
) -> None:
    shot = tmp_path / "dark"
    shot.mkdir()
    for path in (captures / "one").iterdir():
        header = read_header(path)
        names = [name for name in header.channels if name not in "RGB"]
        write_exr(shot / path.name, read_channels(path, names), attributes=header.attributes)
    result = train(rtsr, shot, cache, tmp_path / "run", *settings())
    assert result.exit_code == 3
    assert "missing: color" in result.output


@pytest.mark.parametrize("options", [(), ("--out", "a", "--pack", "b")])
def test_either_a_run_or_a_pack(rtsr: Run, captures: Path, options: tuple[str, ...]) -> None:
    result = rtsr("train", "fusesr-fast", captures, *options)
    assert result.exit_code == 2
    assert "give either --out RUN or --pack FILE" in result.output


def test_a_dry_run_prints_the_settings_and_writes_nothing(
    rtsr: Run, captures: Path, tmp_path: Path
) -> None:
    result = rtsr("train", "fusesr", captures, "--out", tmp_path / "run", "--dry-run", *settings())
    assert result.exit_code == 0, result.output
    assert "steps = 4" in result.output
    assert not (tmp_path / "run").exists()


BARE = """
import importlib.abc, importlib.util, sys
blocked = {"OpenEXR", "OpenImageIO", "pydantic", "fileseq", "jaxtyping", "colour"}
class Refuse(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in blocked:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Refuse())
found = importlib.util.find_spec
importlib.util.find_spec = lambda n, *a: None if n.split(".")[0] in blocked else found(n, *a)
from rtsr_cli.__main__ import main
main()
"""


def test_a_pack_trains_where_little_is_installed(
    rtsr: Run, captures: Path, cache: Path, tmp_path: Path
) -> None:
    pack = tmp_path / "crops.rtsr-clips"
    packed = rtsr(
        "train", "fusesr-fast", captures, "--pack", pack, "--pack-crops", "6", "--cache", cache,
        *settings(data__validation='["two"]'),
    )  # fmt: skip
    assert packed.exit_code == 0, packed.output
    assert "7 clips packed" in packed.output
    command = [sys.executable, "-c", BARE, "train", "fusesr-fast", str(pack), "--out"]
    done = subprocess.run(
        [*command, str(tmp_path / "run"), *settings()],
        capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "best.safetensors").is_file()


@pytest.mark.slow
def test_a_killed_run_ends_as_one_that_was_not(captures: Path, cache: Path, tmp_path: Path) -> None:
    def command(out: Path) -> list[str]:
        start = [sys.executable, "-m", "rtsr_cli", "train", "fusesr-fast", str(captures)]
        changed = settings(training__steps=12, training__validate_every=12)
        return [*start, "--out", str(out), "--cache", str(cache), *changed]

    whole, cut = tmp_path / "whole", tmp_path / "cut"
    subprocess.run(command(whole), check=True, cwd=ROOT, capture_output=True)
    process = subprocess.Popen(
        command(cut), cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    state = cut / "state" / "state.json"
    deadline = time.monotonic() + 120
    while not state.is_file() and time.monotonic() < deadline:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert state.is_file()
    assert not (cut / "last.safetensors").is_file() or '"step": 12' not in state.read_text()
    subprocess.run(command(cut), check=True, cwd=ROOT, capture_output=True)
    for name in ("last.safetensors", "state/step-000000012.safetensors"):
        assert (cut / name).read_bytes() == (whole / name).read_bytes(), name
    rows = [
        [line.rsplit(",", 1)[0] for line in (run / "log.csv").read_text().splitlines()]
        for run in (whole, cut)
    ]
    assert rows[0] == rows[1]


@pytest.mark.slow
@pytest.mark.parametrize("system", ["fusesr-fast", "nsrd"])
def test_two_processes_make_the_steps_of_one_with_twice_the_batch(
    captures: Path, clips_of_four: Path, cache: Path, tmp_path: Path, system: str
) -> None:
    data = clips_of_four if system == "nsrd" else captures

    def trained(out: Path, launcher: list[str], batch: int) -> dict[str, Tensor]:
        # batches are normalised by each process' own statistics
        changed = settings(
            training__batch=batch, training__freeze_statistics=0.0, training__save_every=2
        )
        command = [*launcher, "train", system, data, "--out", out, "--cache", cache]
        done = subprocess.run(
            [*map(str, command), *changed], cwd=ROOT, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return load_file(out / "last.safetensors")

    alone = [sys.executable, "-m", "rtsr_cli"]
    together = [
        sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2",
        "-m", "rtsr_cli",
    ]  # fmt: skip
    one = trained(tmp_path / "one", alone, 4)
    two = trained(tmp_path / "two", together, 2)
    fresh = trained(tmp_path / "other", alone, 2)
    assert one.keys() == two.keys()
    # Adam makes a whole step of the rounding of a gradient that is nearly 0: sums are compared
    apart = sum(float((one[k] - two[k]).abs().sum()) for k in one)
    assert apart < 0.05 * sum(float((one[k] - fresh[k]).abs().sum()) for k in one)
    rows = [(tmp_path / run / "log.csv").read_text().splitlines() for run in ("one", "two")]
    losses = [[float(row.split(",")[1]) for row in table[1:]] for table in rows]
    assert len(losses[0]) == 4
    assert losses[0] == pytest.approx(losses[1], rel=1e-3)


def test_radiance_that_is_no_light_or_too_large_is_said_each_time(
    rtsr: Run, captures: Path, tmp_path: Path, changed: Callable[..., Path]
) -> None:
    def spoil(planes: dict[str, Any], number: int) -> None:
        planes["R"] = planes["R"].astype(np.float32)
        if number == 1:
            planes["R"][4, 5:8] = -0.5
            planes["R"][9, 5] = 1e6

    shot = changed(captures / "one", spoil)
    for out in ("a", "b"):
        one = settings(training__steps=1)
        result = train(rtsr, shot, tmp_path / "cache", tmp_path / out, *one)
        assert result.exit_code == 0, result.output
        assert "3 values of hr radiance are below 0" in result.output
        assert "1 value of hr radiance is trained on as 65504" in result.output


def test_a_network_is_trained_on_the_colour_of_what_covers_a_pixel(
    rtsr: Run, captures: Path, tmp_path: Path, changed: Callable[..., Path]
) -> None:
    def cover(planes: dict[str, Any], number: int) -> None:
        del number
        alpha = np.full(planes["R"].shape, 0.25, np.float32)
        planes["A"] = alpha
        for channel in "RGB":
            planes[channel] = (planes[channel] * alpha).astype(np.float32)

    shot = changed(captures / "one", cover)
    for source, cache in ((shot, "covered"), (captures / "one", "plain")):
        result = train(
            rtsr, source, tmp_path / cache, tmp_path / f"run-{cache}", *settings(training__steps=1)
        )
        assert result.exit_code == 0, result.output
    (covered,), (plain,) = (
        read_clips(next((tmp_path / cache).glob("*.rtsr-clips")))[0]
        for cache in ("covered", "plain")
    )
    torch.testing.assert_close(covered.hr["color"], plain.hr["color"], rtol=1e-3, atol=1e-3)
