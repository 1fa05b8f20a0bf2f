"""`rtsr systems`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from rtsr_cli.core import system_facts
from rtsr_cli.core.network.weights import SHIPPED, list_shipped
from rtsr_cli.models import list_system_names, list_trainable_names

ROOT = Path(__file__).resolve().parents[2]


def test_every_system_is_listed_with_its_inputs(rtsr: Callable[..., Result]) -> None:
    result = rtsr("systems")
    assert result.exit_code == 0, result.output
    for name in list_system_names():
        assert f"{name}: " in result.output
    assert "hr material" in result.output


def test_json_has_one_object_a_system(rtsr: Callable[..., Result]) -> None:
    facts = [json.loads(line) for line in rtsr("systems", "--json").stdout.splitlines()]
    assert [f["name"] for f in facts] == list(list_system_names())
    assert {f["name"] for f in facts if f["parameters"]} == set(list_trainable_names())


def test_parameters_are_shown_for_every_scale(rtsr: Callable[..., Result]) -> None:
    lines = [line.strip() for line in rtsr("systems").stdout.splitlines()]
    assert "parameters 36,968 (2x), 68,108 (4x), 192,668 (8x)" in lines
    assert "parameters 2,274,662 (4x), 2,800,118 (8x)" in lines
    assert "parameters -" in lines


def test_flops_of_every_network_are_those_of_its_publication(
    rtsr: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    # a 27th of the rows, so that the test is quick: every layer's cost grows with the pixels
    monkeypatch.setattr(system_facts, "OUTPUT_SIZE", (40, 1920))
    facts = [json.loads(line) for line in rtsr("systems", "--flops", "--json").stdout.splitlines()]
    found = {
        (f["name"], n["variant"], n["scale"]): (n["parameters"], round(27 * n["gmac"], 3))
        for f in facts
        for n in f["networks"]
        # maps that others pool do not shrink with the rows; their own tests count them at full size
        if f["name"].startswith("fusesr")
    }
    assert found == {
        ("fusesr", "head", 4): (2_274_662, 317.356),
        ("fusesr", "head", 8): (2_800_118, 96.485),
        ("fusesr", "first-release", 4): (2_164_006, 303.024),
        ("fusesr", "first-release", 8): (2_578_870, 89.319),
        ("fusesr-fast", "default", 2): (36_968, 18.710),
        ("fusesr-fast", "default", 4): (68_108, 8.835),
        ("fusesr-fast", "default", 8): (192_668, 6.366),
        ("fusesr-direct", "default", 4): (2_247_014, 313.773),
        ("fusesr-direct", "default", 8): (2_689_526, 92.902),
    }


def test_flops_say_what_they_were_counted_for(
    rtsr: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(system_facts, "OUTPUT_SIZE", (32, 64))
    output = rtsr("systems", "--flops").stdout
    # 8.835 GMAC for 1920 x 1080 pixels, 1012.5 times 64 x 32
    assert "default 4x from 16x8: 68,108 parameters, 0.009 GMAC" in output
    assert output.count(" GMAC") == 20


SHIPPING = sorted({name for name in list_system_names() if list_shipped(name)})


@pytest.mark.parametrize("name", SHIPPING)
def test_cards_of_the_docs_are_what_the_command_writes(
    rtsr: Callable[..., Result], name: str
) -> None:
    page = ROOT / "docs" / "cards" / f"{name}.md"
    result = rtsr("systems", "--card", name)
    assert result.exit_code == 0, result.output
    assert page.read_text(encoding="utf-8") == result.stdout, f"rtsr systems --card {name} > {page}"


def test_every_file_of_the_package_has_its_place_in_a_card() -> None:
    shipped = {path.name for name in SHIPPING for path in list_shipped(name)}
    assert shipped == {path.name for path in SHIPPED.glob("*.safetensors")}
    pages = "".join(p.read_text(encoding="utf-8") for p in (ROOT / "docs" / "cards").glob("*.md"))
    assert all(f"## Weights `{name}`" in pages for name in shipped)


def test_a_file_of_weights_has_a_card_and_a_system_without_weights_too(
    rtsr: Callable[..., Result],
) -> None:
    file = rtsr("systems", "--card", SHIPPED / "fusesr-fast-2x.safetensors").stdout
    assert "# fusesr-fast\n" in file
    assert "fusesr-fast-2x.safetensors" in file
    assert "fusesr-fast-4x.safetensors" not in file
    assert "- Nothing is trained." in rtsr("systems", "--card", "bicubic").stdout
    assert "- No weights come along." in rtsr("systems", "--card", "fusesr-direct").stdout


def test_cards_of_nothing_are_refused(rtsr: Callable[..., Result], tmp_path: Path) -> None:
    result = rtsr("systems", "--card", "gathr")
    assert result.exit_code == 3
    assert "no system is called 'gathr', did you mean 'gather'?" in result.output
    (tmp_path / "x.safetensors").write_bytes(b"nothing")
    result = rtsr("systems", "--card", tmp_path / "x.safetensors")
    assert result.exit_code == 3
    assert "x.safetensors: cannot be read as weights" in result.output
    result = rtsr("systems", "--card", "gather", "--json")
    assert result.exit_code == 2
    assert "--card is a page of text" in result.output
