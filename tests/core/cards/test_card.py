"""What cards say of weights, and what they leave open."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from rtsr_cli.core.cards.card import write_card
from rtsr_cli.core.network.weights import SHIPPED, SavedWeights, read_weights, save_weights
from rtsr_cli.core.training.checkpoints import describe_data
from rtsr_cli.core.training.clips import Clip, ClipFacts
from rtsr_cli.models import load_system

PLANES = {"color": torch.zeros(3, 3, 2, 2)}


def clip_of(name: str, licence: str, *, validation: bool = False, first: int = 1) -> Clip:
    """Three frames of a shot, the first of them history."""
    numbers = (first, first + 1, first + 2)
    facts = ClipFacts(
        name=name, numbers=numbers, targets=1, display=(2, 2), licence=licence,
        validation=validation,
    )  # fmt: skip
    return Clip(facts, PLANES)


def weights_of(folder: Path, about: dict[str, Any]) -> SavedWeights:
    """Weights that say this of themselves."""
    path = folder / "mine.safetensors"
    save_weights(
        path, {"a": torch.zeros(1234)}, system="gather", scale=4, config={"age": 0.9}, about=about
    )
    return read_weights(path)


def card_of(folder: Path, about: dict[str, Any]) -> str:
    return write_card(load_system("gather"), [weights_of(folder, about)])


def test_data_are_counted_by_frames_shots_and_declared_licences() -> None:
    clips = [clip_of("a", "CC0"), clip_of("a", "CC0", first=2), clip_of("b", "")]
    assert describe_data(clips) == {
        "shots": 2,
        # 2 3 and 3 4 of the one, 2 3 of the other: each counted once
        "frames": 5,
        "licences": {"CC0": 1, "not declared": 1},
        "listed": [
            {"name": "a", "frames": 3, "licence": "CC0"},
            {"name": "b", "frames": 2, "licence": "not declared"},
        ],
    }


def test_many_shots_are_counted_and_not_listed() -> None:
    described = describe_data([clip_of(f"{i:03d}", "CC0") for i in range(41)])
    assert described == {"shots": 41, "frames": 82, "licences": {"CC0": 41}}


def test_a_card_says_what_the_metadata_hold(tmp_path: Path) -> None:
    trained = describe_data([clip_of("a", "CC BY 4.0")])
    card = card_of(
        tmp_path,
        {
            "data": {"training": trained, "validation": trained, "held_out": False},
            "training": {"validation_frames": 7, "jitter": "none"},
            "validation": {"psnr": 31.25},
            "step": 900,
        },
    )
    assert "For training: 2 frames of 1 shot; licences by shots, as declared: CC BY 4.0 (1)" in card
    assert "| a | 2 | CC BY 4.0 |" in card
    assert "| psnr | 31.2500 |" in card
    assert "7 at most" in card
    assert "PSNR after c / (1 + c)" in card
    assert "| step | 900 |" in card
    assert "| numbers | 1,234 (float32) |" in card
    assert "No shot was held out" in card
    assert "were not jittered" in card


def test_what_pages_declare_stands_with_what_is_not_known(tmp_path: Path) -> None:
    card = card_of(
        tmp_path,
        {
            "trained_on": "46 shots",
            "declared": {
                "training": [{"name": "a/b", "shots": 1, "frames": None, "licence": "CC0 | x"}],
                "validation": [{"name": "c/d", "shots": 1, "frames": 8, "licence": "MIT"}],
                "source": "docs/x.md",
                "unknown": "the seeds",
            },
            "measured": {"lines": ["rtsr synth shot", "rtsr evaluate"], "scores": {"psnr": 30.5}},
            "validation": {"psnr": 27.5},
        },
    )
    assert "Trained on: 46 shots, as the file's own training says." in card
    assert "| training | a/b | 1 | not recorded | CC0 \\| x |" in card
    assert "| validation | c/d | 1 | 8 | MIT |" in card
    assert "by docs/x.md:" in card
    assert "Not known: the seeds." in card
    assert "```sh\nrtsr synth shot\nrtsr evaluate\n```" in card
    assert card.index("| psnr | 30.5000 |") < card.index("| psnr | 27.5000 |")
    assert "In training, on c/d, by `rtsr train gather DATA" in card


def test_what_is_known_of_recorded_data_stands_beside_them(tmp_path: Path) -> None:
    recorded = describe_data([clip_of("a", "not declared")])
    declared = {
        "training": [{"name": "a", "shots": 1, "frames": 2, "licence": "CC0"}],
        "validation": [],
        "source": "a page",
        "unknown": "seeds",
    }
    data = {"training": recorded, "validation": recorded}
    card = card_of(tmp_path, {"data": data, "declared": declared})
    assert "For training: 2 frames of 1 shot" in card
    assert "| training | a | 1 | 2 | CC0 |" in card
    assert "Not known: seeds." in card


def test_declarations_of_another_shape_break_no_card(tmp_path: Path) -> None:
    card = card_of(
        tmp_path, {"declared": {"training": 3, "source": ["x"]}, "measured": {"lines": 1}}
    )
    assert "Not known: not recorded." in card


def test_the_margin_of_predicted_errors_is_said(tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    for about, words in (
        ({"validation": {"under": 0.0123}}, "adds 0.0123 to"),
        ({}, "adds 0.0000"),
    ):
        save_weights(path, {}, system="rt-percept", scale=1, config={}, about=about)
        card = write_card(load_system("rt-percept"), [read_weights(path)])
        assert words in card
    assert "adds 0" not in card_of(tmp_path, {"validation": {"under": 0.5}})


def test_shipped_weights_say_what_of_their_data_is_known() -> None:
    """Names, counts, licences, and lines that anyone can type; or plainly that none are known."""
    for path in sorted(SHIPPED.glob("*.safetensors")):
        weights = read_weights(path)
        declared, measured = weights.about["declared"], weights.about["measured"]
        assert declared["unknown"], path.name
        assert declared["source"], path.name
        for part in (*declared["training"], *declared["validation"]):
            assert part["name"], path.name
            assert part["licence"], path.name
        assert measured["lines"][0].startswith("rtsr synth shot --seed"), path.name
        assert len(measured["scores"]) >= 3, path.name


def test_what_the_metadata_do_not_hold_is_not_recorded(tmp_path: Path) -> None:
    card = card_of(tmp_path, {})
    for name in ("step", "rtsr", "revision", "licence"):
        assert f"| {name} | not recorded |" in card
    assert "Trained on: not recorded. Frames, licences and what it was judged on: not" in card
    assert "Validation of these weights: not recorded." in card
    assert "Settings of the training: not recorded." in card
    assert "held out" not in card


def test_what_others_wrote_ends_no_cell_and_moves_no_cursor(tmp_path: Path) -> None:
    shot = {"name": "x | <b>\x1b[2J\n# y", "frames": 1, "licence": "z"}
    part = {"shots": 1, "frames": 1, "licences": {"z\n# w": 1}, "listed": [shot, "no shot"]}
    card = card_of(
        tmp_path, {"data": {"training": part, "validation": []}, "validation": {"p": {}}}
    )
    assert "| x \\| &lt;b>\\x1b[2J\\n# y | 1 | z |" in card
    assert "z\\n# w (1)" in card
    assert "For validation: not recorded." in card
    assert "| p | not recorded |" in card


def test_hashes_are_those_of_the_file(tmp_path: Path) -> None:
    weights = weights_of(tmp_path, {})
    card = write_card(load_system("gather"), [weights])
    assert f"`{weights.sha256()}`" in card
    weights.path.write_bytes(weights.path.read_bytes() + b"\0")
    assert f"`{weights.sha256()}`" not in card
