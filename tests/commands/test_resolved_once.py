"""What a shot's opening reads and parses: every file once, whichever command runs."""

from __future__ import annotations

import threading
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result

from rtsr_cli.core.captures import declarations, reader
from rtsr_cli.core.files import exr
from rtsr_cli.core.files.exr import read_header
from rtsr_cli.core.files.header_cache import HeaderCache

Run = Callable[..., Result]

LAYOUT = """
[buffers]
color = ["R", "G", "B"]
albedo = ["albedo.R", "albedo.G", "albedo.B"]
normal = ["normal.X", "normal.Y", "normal.Z"]
depth = "depth.Z"
roughness = "roughness"
metallic = "metallic"
motion = ["motion.X", "motion.Y"]

[motion]
unit = "pixels"
direction = "previous-minus-current"
y_axis = "down"
jittered = false
"""


class Calls:
    """How often files were parsed, and headers were opened beside those of pixels that are read."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.parsed: Counter[tuple[str, str]] = Counter()
        self.toml: Counter[str] = Counter()
        self.headers: Counter[Path] = Counter()
        self._inside = threading.local()
        for name in ("read_capture", "load_layout", "read_side_car"):
            patch.setattr(declarations, name, self._counted(name, getattr(declarations, name)))
        loads, opened, window = tomllib.loads, exr._open, reader.read_pixels
        cached = HeaderCache.read

        def load(text: str, **options: Any) -> dict[str, Any]:
            self.toml[text] += 1
            return loads(text, **options)

        def open_file(path: Path, *, header_only: bool) -> Any:
            if header_only and not getattr(self._inside, "pixels", False):
                self.headers[path] += 1
            return opened(path, header_only=header_only)

        def read(*arguments: Any) -> Any:
            self._inside.pixels = True
            try:
                return window(*arguments)
            finally:
                self._inside.pixels = False

        def read_cached(cache: HeaderCache, path: Path) -> exr.ExrHeader:
            self.headers[path] += 1
            self._inside.pixels = True
            try:
                return cached(cache, path)
            finally:
                self._inside.pixels = False

        patch.setattr(HeaderCache, "read", read_cached)
        patch.setattr(tomllib, "loads", load)
        patch.setattr(exr, "_open", open_file)
        patch.setattr(reader, "read_pixels", read)

    def _counted(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(argument: object) -> Any:
            self.parsed[name, str(argument)] += 1
            return function(argument)

        return call


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Iterator[Calls]:
    """Count from here on."""
    yield Calls(monkeypatch)


@pytest.fixture
def declared_shot(small_capture: Path, tmp_path: Path) -> Path:
    """Frames in a folder below IN, with a capture.toml, a layout file and a camera side-car."""
    shot = tmp_path / "in" / "shot"
    shot.mkdir(parents=True)
    rows = ["frame,worldToCamera,worldToNDC"]
    for number, path in enumerate(sorted(small_capture.glob("*.exr")), 1):
        (shot / path.name).hardlink_to(path)
        attributes = read_header(path).attributes
        matrices = (attributes[name] for name in ("worldToCamera", "worldToNDC"))
        cells = (" ".join(map(str, np.ravel(m))) for m in matrices)
        rows.append(f"{number},{','.join(cells)}")
    (shot / "camera.csv").write_text("\n".join(rows), encoding="utf-8")
    (shot / "my.toml").write_text(LAYOUT, encoding="utf-8")
    text = 'layout = "my.toml"\ncamera = "camera.csv"\n'
    (shot / "capture.toml").write_text(text, encoding="utf-8")
    return tmp_path / "in"


def _hold_once(calls: Calls, files: int) -> None:
    assert calls.parsed and max(calls.parsed.values()) == 1
    assert calls.toml and max(calls.toml.values()) == 1
    assert len(calls.headers) == files and max(calls.headers.values()) == 1


@pytest.mark.parametrize(
    "command",
    [
        ("upscale", "--system", "bicubic", "--scale", 2),
        ("upscale", "--system", "taau", "--simulate-lr", 2),
        ("upscale", "--system", "taau", "--simulate-lr", 2, "--passthrough", "roughness"),
        ("demodulate",),
        ("label", "--kind", "vrs"),
        ("predict-vrs",),
    ],
    ids=lambda command: "-".join(map(str, command)),
)
def test_planning_reads_every_declaration_and_header_once(
    rtsr: Run, declared_shot: Path, tmp_path: Path, calls: Calls, command: tuple[object, ...]
) -> None:
    name, *options = command
    result = rtsr(name, declared_shot, tmp_path / "out", "--dry-run", *options)
    assert result.exit_code == 0, result.output
    _hold_once(calls, files=4)


def test_upscaling_pairs_reads_every_declaration_and_header_once(
    rtsr: Run, small_shot: Path, tmp_path: Path, calls: Calls
) -> None:
    result = rtsr("upscale", small_shot, tmp_path / "out", "--system", "bicubic", "--dry-run")
    assert result.exit_code == 0, result.output
    _hold_once(calls, files=8)


def test_frames_that_are_written_are_asked_for_their_attributes_and_nothing_is_parsed_again(
    rtsr: Run, small_shot: Path, tmp_path: Path, calls: Calls
) -> None:
    result = rtsr("upscale", small_shot, tmp_path / "out", "--system", "bicubic", "--frames", "1")
    assert result.exit_code == 0, result.output
    assert max(calls.parsed.values()) == max(calls.toml.values()) == 1
    # the output's attributes are those that the file has when its pixels are read
    written = small_shot / "lr" / "frame.0001.exr"
    assert {path: n for path, n in calls.headers.items() if n > 1} == {written: 2}


def test_inspect_reads_every_declaration_and_header_once(
    rtsr: Run, declared_shot: Path, small_shot: Path, calls: Calls
) -> None:
    assert rtsr("inspect", declared_shot).exit_code == 0
    _hold_once(calls, files=4)
    assert rtsr("inspect", small_shot).exit_code == 0
    _hold_once(calls, files=12)


def test_evaluate_reads_the_headers_of_frames_with_buffers_once(
    rtsr: Run, small_capture: Path, tmp_path: Path, calls: Calls
) -> None:
    test = tmp_path / "test"
    test.mkdir()
    for path in small_capture.glob("*.exr"):
        (test / path.name).hardlink_to(path)
    result = rtsr("evaluate", test, small_capture, "--metric", "psnr", "--dry-run")
    assert result.exit_code == 0, result.output
    assert len(calls.headers) == 8 and max(calls.headers.values()) == 1


def test_evaluate_reads_the_cameras_of_reference_and_buffers_once(
    rtsr: Run, declared_shot: Path, calls: Calls
) -> None:
    shot = declared_shot / "shot"
    result = rtsr("evaluate", shot, shot, "--metric", "psnr", "--dry-run")
    assert result.exit_code == 0, result.output
    assert calls.parsed["read_side_car", str(shot / "camera.csv")] == 1
