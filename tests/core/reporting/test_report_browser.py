"""The report in a browser: headless Chromium, where there is one."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rtsr_cli.core.reporting.report import Moment, Strip, write_html_report

Evaluation = Callable[..., dict[str, Any]]

WAIT_S = 5.0

RIGHT = "\ue014"
"""The key, in WebDriver's code."""

CLIP = "return document.querySelector('#stage img:nth-of-type(2)').style.clipPath"

SEEN = (
    "return [...document.querySelectorAll('#stage img')].map(i => getComputedStyle(i).visibility)"
)

PLACE = "return Number(document.querySelector('.divider').getAttribute('aria-valuenow'))"


@pytest.fixture(scope="module")
def result(evaluation: Evaluation) -> dict[str, Any]:
    return evaluation()


@pytest.fixture(scope="module")
def page(
    tmp_path_factory: pytest.TempPathFactory,
    result: dict[str, Any],
    moments: list[Moment],
    strips: list[Strip],
) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(write_html_report(result, moments, strips), encoding="utf-8")
    return path


@pytest.fixture
def shown(browser: Any, page: Path) -> Any:
    """A browser that shows the report afresh."""
    browser.open(page)
    return browser


def eventually(condition: Callable[[], bool]) -> bool:
    """Whether something becomes true while we wait."""
    end = time.monotonic() + WAIT_S
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.05)
    return False


def test_the_console_is_silent_and_nothing_is_fetched(shown: Any) -> None:
    for mode in "2341":
        shown.keys("#stage", mode)
    assert shown.complaints() == []
    fetched = shown.run("return performance.getEntriesByType('resource').map(e => e.name)")
    assert [name for name in fetched if not name.startswith("data:")] == []


def test_the_numbers_of_the_summary_are_those_of_the_result(
    shown: Any, result: dict[str, Any]
) -> None:
    rows = shown.run(
        "return [...document.querySelectorAll('#summary tbody tr')].map(row => "
        "[row.cells[0].innerText, ...[...row.cells].slice(1).map("
        "c => [c.title, c.firstChild.innerText])])"
    )
    keys = ("psnr", "ssim", "flip")
    decimals = (2, 4, 5)
    for method, *cells in rows:
        means = result["methods"][method]["mean"]
        assert [float(title) for title, _ in cells] == [means[key] for key in keys]
        expected = [f"{means[key]:.{d}f}" for key, d in zip(keys, decimals, strict=True)]
        assert [text for _, text in cells] == expected
    assert [row[0] for row in rows] == ["bicubic", "taau", "fusesr"]
    bold = shown.run(
        "return [...document.querySelectorAll('#summary b')].map("
        "b => b.closest('tr').cells[0].innerText)"
    )
    assert bold == ["fusesr"] * 3


def test_one_choice_of_metric_and_shot_rules_regions_and_curves(
    shown: Any, result: dict[str, Any]
) -> None:
    shown.choose("#curves [data-pick=metric]", "2")
    shown.choose("#curves [data-pick=shot]", "1")
    tables = shown.run(
        "return [...document.querySelectorAll('#regions table')].filter(t => t.offsetParent)"
        ".map(t => [...t.rows].map(r => [...r.cells].map(c => c.title)))"
    )
    assert len(tables) == 1
    expected = [
        result["tests"][f"{m}/hall/turn"]["mean"]["flip"] for m in ("bicubic", "taau", "fusesr")
    ]
    assert [float(title) for title in tables[0][1][2:5]] == expected


def test_the_curves_tell_the_values_of_a_frame_by_keyboard(
    shown: Any, result: dict[str, Any]
) -> None:
    shown.keys("#plot", RIGHT * 3)
    told = shown.run("return document.getElementById('readout').innerText")
    frame = result["tests"]["fusesr/yard/stroll"]["frames"]["3"]
    assert "yard/stroll frame 3" in told
    assert f"fusesr {frame['psnr']:.2f} dB" in told


def test_a_click_on_a_curve_opens_the_nearest_frame_with_pictures(shown: Any) -> None:
    box = shown.run(
        "const c = document.getElementById('plot'); c.scrollIntoView({block: 'center'});"
        "const b = c.getBoundingClientRect(); return [b.left, b.top, b.width]"
    )
    shown.run(
        "const click = new MouseEvent('click', {clientX: arguments[0]});"
        "document.getElementById('plot').dispatchEvent(click)",
        box[0] + box[2] * 0.49,
    )
    assert "yard/stroll, frame 55" in shown.run(
        "return document.getElementById('about-frame').innerText"
    )


def test_curves_have_ink_of_every_method(shown: Any) -> None:
    counts = shown.run(
        """const c = document.getElementById('plot');
        const p = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        const style = getComputedStyle(document.documentElement);
        return ['--m0', '--m1', '--m2'].map(name => {
          const hex = style.getPropertyValue(name).trim();
          const rgb = [1, 3, 5].map(k => parseInt(hex.slice(k, k + 2), 16));
          let n = 0;
          for (let k = 0; k < p.length; k += 4)
            n += rgb.every((v, j) => Math.abs(v - p[k + j]) < 8);
          return n;
        })"""
    )
    assert min(counts) > 300


def test_dragging_the_divider_moves_the_clip(shown: Any) -> None:
    before = shown.run(CLIP)
    width = shown.run("return document.querySelector('.picture').clientWidth")
    shown.drag(".divider", 120)
    after = shown.run(CLIP)
    assert before != after
    assert shown.run(PLACE) == pytest.approx(50 + 100 * 120 / width, abs=1)


def test_arrow_keys_move_the_divider_also_after_an_exchange(shown: Any) -> None:
    shown.keys(".divider", RIGHT * 5)
    assert shown.run(PLACE) == 60
    first = shown.run("return document.querySelector('#stage img').alt")
    shown.keys(".divider", " ")
    assert shown.run("return document.querySelector('#stage img').alt") != first
    assert shown.run("return document.activeElement.className") == "divider"


def test_flicker_shows_one_picture_then_the_other(shown: Any) -> None:
    shown.keys("#stage", "2")
    first = shown.run(SEEN)
    assert sorted(first) == ["hidden", "visible"]
    assert eventually(lambda: shown.run(SEEN) != first), "the timer does not run"
    shown.click("#play")
    still = shown.run(SEEN)
    time.sleep(0.7)
    assert shown.run(SEEN) == still
    shown.keys("#stage", " ")
    assert shown.run(SEEN) == still[::-1]


def test_the_heat_map_of_each_side_is_shown(shown: Any, moments: list[Moment]) -> None:
    shown.keys("#stage", "4")
    sources = shown.run("return [...document.querySelectorAll('#stage img')].map(i => i.src)")
    heat = moments[0].heat
    assert sources == [heat["bicubic"].uri(), heat["fusesr"].uri()]


def test_zoom_is_by_pixels_and_both_sides_scroll_together(shown: Any) -> None:
    shown.keys("#stage", "3")
    shown.choose("#zoom", "4")
    state = "return [...document.querySelectorAll('.port')].map(p => [p.scrollLeft, p.scrollTop])"
    look = (
        "const i = document.querySelector('#stage img');"
        "return [i.clientWidth, getComputedStyle(i).imageRendering]"
    )
    assert shown.run(look) == [2560, "pixelated"]
    shown.run("document.querySelector('.port').scrollTo(900, 300)")
    assert eventually(lambda: shown.run(state) == [[900, 300]] * 2)


def test_the_worst_region_is_found_in_the_frame(shown: Any) -> None:
    shown.click("#crops figure:nth-child(3) button")
    where = shown.run(
        "const box = query => document.querySelector(query).getBoundingClientRect();"
        "const m = box('.mark'), p = box('.pane');"
        "return [m.width, (m.left + m.right - p.left - p.right) / 2]"
    )
    assert where[0] == pytest.approx(4 * 64, abs=1)
    assert abs(where[1]) < 2
    assert shown.run("return document.getElementById('right').selectedOptions[0].text") == "taau"


def test_the_next_frame_comes_by_key(shown: Any) -> None:
    shown.keys("#stage", "n")
    current = shown.run("return document.querySelector('#moments [aria-current=true]').innerText")
    assert "frame 12" in current
    assert "hall/turn" in current


def test_hostile_names_are_text(browser: Any, evaluation: Evaluation, tmp_path: Path) -> None:
    name = "</script><img src=x onerror='window.hit=1'><b>\"'`${1}"
    path = tmp_path / "report.html"
    path.write_text(
        write_html_report(evaluation(methods=(name, "__proto__"), shots=("",))), encoding="utf-8"
    )
    browser.open(path)
    assert browser.run("return window.hit === undefined && document.images.length === 0")
    legend = "return [...document.querySelectorAll('#legend button')].map(b => b.textContent)"
    assert browser.run(legend) == [name, "__proto__"]
    assert browser.complaints() == []


def test_a_narrow_window_does_not_scroll_sideways(browser: Any, page: Path) -> None:
    browser.ask("POST", "/window/rect", {"width": 500, "height": 900})
    browser.open(page)
    over = browser.run("return document.documentElement.scrollWidth - window.innerWidth")
    browser.ask("POST", "/window/rect", {"width": 1500, "height": 1000})
    assert over <= 0
