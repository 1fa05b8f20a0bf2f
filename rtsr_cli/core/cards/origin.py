"""Where weights come from, as their metadata tell it: whoever wrote a file wrote these, too.

What is not there, or of another kind than `rtsr train` writes, is said to be not recorded.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from rtsr_cli.core.cards.markdown import write_facts, write_table
from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.network.weights import SavedWeights, find_margin
from rtsr_cli.core.settings import to_toml
from rtsr_cli.core.system import TrainingRecipe
from rtsr_cli.core.visible_text import make_visible
from rtsr_cli.core.wording import join_names, say_count

T = TypeVar("T")

UNRECORDED = "not recorded"

UNDECLARED = "not declared"
"""Licence of shots whose capture.toml names none."""

DECLARED_HEAD = ("for", "what", "shots", "frames", "licence, as declared")
"""Of the table of data that are known by pages."""

USES = ("training", "validation")
"""Parts of the data."""


def find_fact(facts: Mapping[str, Any], name: str, kind: type[T]) -> T | None:
    """Return a fact if it is there, and of its kind."""
    value = facts.get(name)
    known = isinstance(value, kind) and not (isinstance(value, bool) and kind is not bool)
    return value if known else None


def describe_file(weights: SavedWeights) -> list[str]:
    """Lines of what a file is: scale, size, step, revision, licence, hashes."""
    about = weights.about
    stored = weights.tensors.values()
    kinds = sorted({str(tensor.dtype).removeprefix("torch.") for tensor in stored})
    facts = {
        "scale": f"{weights.scale}x",
        "numbers": f"{sum(tensor.numel() for tensor in stored):,} ({', '.join(kinds)})",
        "bytes": f"{weights.path.stat().st_size:,}",
        "step": find_fact(about, "step", int),
        "rtsr": find_fact(about, "rtsr", str),
        "revision": find_fact(about, "revision", str),
        "licence": "that of rtsr, MIT" if weights.is_shipped else None,
        "SHA-256": f"`{weights.sha256()}`",
        "named in outputs": f"`{weights.digest()}`",
    }
    return write_facts({name: UNRECORDED if v in (None, "") else v for name, v in facts.items()})


def describe_data(weights: SavedWeights) -> list[str]:
    """Lines of what the network was trained and judged on."""
    data = find_fact(weights.about, "data", dict)
    declared = find_fact(weights.about, "declared", dict)
    if data is None and declared is not None:
        return _describe_declared(weights.about, declared)
    if data is None:
        return [_describe_older(weights.about)]
    lines: list[str] = []
    for use in USES:
        lines += _describe_part(use, find_fact(data, use, dict) or {})
    # what shots say of themselves leaves out what is known of them
    return lines if declared is None else [*lines, *_describe_declared(weights.about, declared)]


def _describe_older(about: Mapping[str, Any]) -> str:
    """What weights say that were written before they listed their data."""
    return (
        f"Trained on: {_name_older(about)}. Frames, licences and what it was judged on: "
        f"{UNRECORDED}."
    )


def _name_older(about: Mapping[str, Any]) -> str:
    """Names, or a number, of the shots."""
    trained = about.get("trained_on")
    named = ", ".join(f"`{make_visible(str(name))}`" for name in _list_of(trained))
    return named or (make_visible(trained) if isinstance(trained, str) else UNRECORDED)


def _describe_declared(about: Mapping[str, Any], declared: Mapping[str, Any]) -> list[str]:
    """What is known of data that a training did not record, and what is not."""
    lines = [
        f"Trained on: {_name_older(about)}, as the file's own training says. What is known of them "
        f"beside, by {_say(declared, 'source')}:",
        "",
    ]
    rows = [
        [use, *(_say(part, key) for key in ("name", "shots", "frames", "licence"))]
        for use in USES
        for part in _list_of(declared.get(use))
        if isinstance(part, dict)
    ]
    if rows:
        lines += [*write_table(DECLARED_HEAD, rows), ""]
    return [*lines, f"Not known: {_say(declared, 'unknown')}."]


def _say(facts: Mapping[str, Any], name: str) -> str:
    value = facts.get(name)
    return UNRECORDED if value in (None, "") else make_visible(str(value))


def _list_of(value: object) -> list[Any]:
    return value if isinstance(value, list) else []


def _describe_part(use: str, part: Mapping[str, Any]) -> list[str]:
    shots, frames = find_fact(part, "shots", int), find_fact(part, "frames", int)
    licences = find_fact(part, "licences", dict)
    if shots is None or frames is None or licences is None:
        return [f"For {use}: {UNRECORDED}.", ""]
    said = ", ".join(f"{name} ({count})" for name, count in licences.items())
    counted = f"{say_count(frames, 'frame')} of {say_count(shots, 'shot')}"
    lines = [f"For {use}: {counted}; licences by shots, as declared: {make_visible(said)}.", ""]
    listed = [shot for shot in _list_of(part.get("listed")) if isinstance(shot, dict)]
    rows = [[shot.get(key, UNRECORDED) for key in ("name", "frames", "licence")] for shot in listed]
    return lines + ([*write_table(("shot", "frames", "licence"), rows), ""] if rows else [])


def describe_figures(weights: SavedWeights, learning: TrainingRecipe | None) -> list[str]:
    """Lines of the validation's scores, with what they measure and how to get them."""
    scores = find_fact(weights.about, "validation", dict)
    if not scores or learning is None:
        return [f"Validation of these weights: {UNRECORDED}."]
    training = find_fact(weights.about, "training", dict) or {}
    frames = find_fact(training, "validation_frames", int)
    rows = [[name, _write_score(value)] for name, value in scores.items()]
    judged = _list_of((find_fact(weights.about, "declared", dict) or {}).get("validation"))
    names = [_say(part, "name") for part in judged if isinstance(part, dict)]
    return [
        *_describe_measured(weights.about),
        f"In training, {f'on {join_names(names)}, ' if names else ''}by `rtsr train "
        f"{weights.system} DATA --config SETTINGS --out RUN` with the settings "
        "below (the last columns of RUN/log.csv at that step), on whole frames for validation, "
        f"{UNRECORDED if frames is None else frames} at most, spread over the shots; means over the"
        f" frames of each shot, then over shots. {learning.protocol}.",
        "",
        *write_table(("score", "mean"), rows),
    ]


def _describe_measured(about: Mapping[str, Any]) -> list[str]:
    """Figures that anyone can repeat, where the file has them."""
    measured = find_fact(about, "measured", dict)
    if measured is None:
        return []
    lines = [make_visible(str(line)) for line in _list_of(measured.get("lines"))]
    scores = find_fact(measured, "scores", dict) or {}
    return [
        "Measured with these weights; anyone can repeat it:",
        "",
        "```sh",
        *lines,
        "```",
        "",
        *write_table(("score", "mean"), [[name, _write_score(v)] for name, v in scores.items()]),
        "",
    ]


def describe_margin(weights: SavedWeights) -> list[str]:
    """Lines of what is added to the errors that the weights predict."""
    margin = find_margin(weights.about)
    return [
        f"`rtsr {SystemTask.PREDICT_VRS.value}` adds {margin:.4f} to every prediction before it is "
        "transformed back, the mean underestimation above, 0 where that is not recorded; "
        "`--margin` chooses another.",
        "",
    ]


def _write_score(value: object) -> str:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return f"{value:.4f}" if number else UNRECORDED


def describe_settings(weights: SavedWeights) -> list[str]:
    """Lines of the network's and the training's settings, as `rtsr train --config` takes them."""
    training = find_fact(weights.about, "training", dict) or {}
    text = to_toml({"system": weights.system, "network": weights.config, "training": training})
    lines = ["```toml", *(make_visible(line) for line in text.splitlines()), "```"]
    return lines if training else [*lines, "", f"Settings of the training: {UNRECORDED}."]


def list_limits(weights: SavedWeights) -> list[str]:
    """Sentences on what the training leaves out, as far as it is recorded."""
    training = find_fact(weights.about, "training", dict) or {}
    augmentation = find_fact(training, "augmentation", dict) or {}
    limits = [f"`{make_visible(weights.path.name)}` is for {weights.scale}x alone."]
    if training.get("jitter") == "none" and weights.scale > 1:
        limits.append("LR frames that were made for its training were not jittered.")
    if augmentation.get("filtered_share") == 0.0:
        limits.append("Its training saw no LR radiance that a pixel filter went over.")
    if find_fact(find_fact(weights.about, "data", dict) or {}, "held_out", bool) is False:
        limits.append(
            "No shot was held out: it was judged on frames that it was trained on, and its figures "
            "look too good."
        )
    return limits
