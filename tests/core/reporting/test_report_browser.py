"""The report in headless Chromium: no error, the numbers of the JSON, swipe, flicker, keys."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

BROWSER, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
ARGUMENTS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--window-size=1300,900",
]  # fmt: skip
SPACE, RIGHT, LEFT = "\ue00d", "\ue014", "\ue012"
STARTING_S = 20.0
SESSION = {"browserName": "chrome", "goog:loggingPrefs": {"browser": "ALL"}}

pytestmark = pytest.mark.skipif(
    BROWSER is None or DRIVER is None, reason="chromium and chromium-driver are not installed"
)


class Browser:
    """One page, by W3C WebDriver."""

    def __init__(self, base: str, profile: Path) -> None:
        self._base = base
        chrome = {"binary": BROWSER, "args": [*ARGUMENTS, f"--user-data-dir={profile}"]}
        wanted = {**SESSION, "goog:chromeOptions": chrome}
        made = self._call("POST", "/session", {"capabilities": {"alwaysMatch": wanted}})
        self._session = f"/session/{made['sessionId']}"

    def _call(self, method: str, path: str, content: Any = None) -> Any:
        data = None if method == "GET" else json.dumps(content or {}).encode()
        request = urllib.request.Request(self._base + path, data, method=method)
        request.add_header("Content-Type", "application/json")
        with urllib.request.urlopen(request, timeout=60) as answer:
            return json.loads(answer.read())["value"]

    def open(self, page: Path) -> None:
        self._call("POST", f"{self._session}/url", {"url": page.as_uri()})

    def run(self, script: str, *arguments: Any) -> Any:
        content = {"script": script, "args": list(arguments)}
        return self._call("POST", f"{self._session}/execute/sync", content)

    def act(self, *sources: dict[str, Any]) -> None:
        self._call("POST", f"{self._session}/actions", {"actions": list(sources)})

    def keys(self, text: str) -> None:
        down = [
            a
            for c in text
            for a in ({"type": "keyDown", "value": c}, {"type": "keyUp", "value": c})
        ]
        self.act({"type": "key", "id": "keys", "actions": down})

    def drag(self, start: tuple[int, int], end: tuple[int, int]) -> None:
        moves = [
            {"type": "pointerMove", "x": start[0], "y": start[1]},
            {"type": "pointerDown", "button": 0},
            {"type": "pointerMove", "x": end[0], "y": end[1], "duration": 50},
            {"type": "pointerUp", "button": 0},
        ]
        self.act({"type": "pointer", "id": "mouse", "actions": moves})

    def complaints(self) -> list[str]:
        logged = self._call("POST", f"{self._session}/se/log", {"type": "browser"})
        return [entry["message"] for entry in logged if entry["level"] in {"SEVERE", "WARNING"}]

    def close(self) -> None:
        self._call("DELETE", self._session)


@pytest.fixture(scope="module")
def browser(page: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    folder = tmp_path_factory.mktemp("browser")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    environment = {**os.environ, "HOME": str(folder), "no_proxy": "127.0.0.1"}
    driver = subprocess.Popen(
        [str(DRIVER), f"--port={port}"],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment,
    )  # fmt: skip
    try:
        found = started(f"http://127.0.0.1:{port}", folder / "profile")
        written = folder / "report.html"
        written.write_text(page, encoding="utf-8")
        found.open(written)
        yield found
        found.close()
    finally:
        driver.kill()
        driver.wait()


def started(base: str, profile: Path) -> Browser:
    end = time.monotonic() + STARTING_S
    while True:
        try:
            return Browser(base, profile)
        except (urllib.error.URLError, ConnectionError):
            if time.monotonic() > end:
                raise
            time.sleep(0.1)


def test_the_numbers_are_those_of_the_result(browser: Browser, fake: SimpleNamespace) -> None:
    rows = browser.run(
        "return [...document.querySelectorAll('#summary tbody tr')].map(r => r.innerText)"
    )
    methods = fake.evaluation()["methods"]
    assert len(rows) == len(methods)
    for row, (method, found) in zip(rows, methods.items(), strict=True):
        assert row.startswith(method)
        assert f"{found['mean']['psnr']:.2f}" in row
    bold = browser.run(
        "return [...document.querySelectorAll('#summary tbody b, #summary tbody strong,"
        " #summary tbody .best')].map(e => e.closest('tr').innerText.trim().split(/\\s/)[0])"
    )
    assert set(bold) == {"fusesr"}


def clips(browser: Browser) -> list[str]:
    found: list[str] = browser.run(
        "return [...document.querySelectorAll('#stage img')].map(i => i.style.clipPath)"
    )
    return found


def test_dragging_the_divider_uncovers_the_other_picture(browser: Browser) -> None:
    browser.run("document.querySelector('#stage').scrollIntoView({block: 'center'})")
    box = browser.run(
        "const b = document.querySelector('#stage .divider').getBoundingClientRect();"
        "return [b.x + b.width / 2, b.y + b.height / 2]"
    )
    before = clips(browser)
    start = (round(box[0]), round(box[1]))
    browser.drag(start, (start[0] - 150, start[1]))
    after = clips(browser)
    assert len(after) == 2
    assert before != after
    assert (
        int(
            browser.run(
                "return document.querySelector('.divider').ariaValueNow || "
                "document.querySelector('.divider').getAttribute('aria-valuenow')"
            )
        )
        < 45
    )


def test_arrow_keys_move_the_divider(browser: Browser) -> None:
    browser.run("document.querySelector('#stage .divider').focus()")
    before = clips(browser)
    browser.keys(RIGHT)
    moved = clips(browser)
    assert moved != before
    browser.keys(LEFT)
    assert clips(browser) == before


def test_flicker_shows_one_picture_and_then_the_other(browser: Browser) -> None:
    def visible() -> list[str]:
        found: list[str] = browser.run(
            "return [...document.querySelectorAll('#stage img')].map(i => i.style.visibility)"
        )
        return found

    browser.run(
        "document.querySelector('input[value=flicker]').click();"
        "document.querySelector('#stage').focus()"
    )
    assert browser.run("return document.querySelector('#stage').dataset.mode") == "flicker"
    seen = set()
    end = time.monotonic() + 5.0
    while len(seen) < 2 and time.monotonic() < end:
        seen.add(tuple(visible()))
        time.sleep(0.05)
    assert seen == {("visible", "hidden"), ("hidden", "visible")}
    browser.keys("1")
    assert browser.run("return document.querySelector('#stage').dataset.mode") == "swipe"


def test_heat_maps_and_the_next_frame(browser: Browser) -> None:
    first = browser.run("return document.querySelector('#about-frame').innerText")
    browser.run("document.querySelector('#stage').focus()")
    browser.keys("4")
    assert browser.run("return document.querySelectorAll('#stage img').length") == 2
    assert not browser.run("return document.querySelector('#scale').hidden")
    browser.keys("n")
    assert browser.run("return document.querySelector('#about-frame').innerText") != first


def test_a_metric_that_is_picked_shows_its_regions(browser: Browser) -> None:
    browser.run(
        "const s = document.querySelector('#regions [data-pick=metric]'); s.selectedIndex = 2;"
        "s.dispatchEvent(new Event('change', {bubbles: true}))"
    )
    shown = browser.run(
        "return [...document.querySelectorAll('#regions [data-metric]')]"
        ".filter(p => !p.hidden).map(p => p.dataset.metric)"
    )
    assert set(shown) == {"flip"}


def test_nothing_is_complained_about(browser: Browser) -> None:
    assert browser.complaints() == []
