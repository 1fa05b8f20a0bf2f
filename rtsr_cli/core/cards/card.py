"""The card of a system, or of weights: a page of Markdown that follows from declaration and file.

Nothing in it is known from elsewhere: what is declared of a system, what weights say of themselves,
their bytes. So a card can be written again, and held to what it is about.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rtsr_cli.core.cards.markdown import write_facts, write_table
from rtsr_cli.core.cards.origin import (
    describe_data,
    describe_figures,
    describe_file,
    describe_margin,
    describe_settings,
    list_limits,
)
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer
from rtsr_cli.core.marks import MARKDOWN_MARK_LINE
from rtsr_cli.core.network.weights import SavedWeights
from rtsr_cli.core.system import System
from rtsr_cli.core.visible_text import make_visible
from rtsr_cli.core.wording import say_count

SUFFIX = ".md"

CONVENTIONS = (
    "In memory, whatever files hold: linear scene-referred HDR radiance, float32, rows down, pixel "
    "centres at +0.5. Motion in pixels of its own resolution, x right, y down, previous minus "
    "current, jitter excluded: previous position = position + motion. Jitter is the sample's "
    "position minus the pixel's centre, in LR pixels. Depth is planar, in metres; normals are in "
    "world space; roughness is perceptual (alpha = roughness^2). `capture.toml` says what files "
    "hold, and frames are converted when they are read."
)


def place_card(weights: Path) -> Path:
    """Where the card of weights lies: beside them."""
    return weights.with_suffix(SUFFIX)


def write_card(system: System, weights: Sequence[SavedWeights]) -> str:
    """Write a card.

    Args:
        system: what it is of.
        weights: of that system, those that the card is about.

    Returns:
        Markdown, the mark in its first line.

    Raises:
        OSError: a file of weights is gone.
    """
    lines = [
        f"# {system.name}",
        "",
        f"{system.summary[:1].upper()}{system.summary[1:]}.",
        "",
        *_describe_system(system),
        "",
        "## Inputs",
        "",
        *_describe_inputs(system),
        "",
        "## Conventions",
        "",
        CONVENTIONS,
        "",
        *(line for held in weights for line in _describe_weights(system, held)),
        *_describe_measurements(system),
        "## Limits",
        "",
        *(f"- {limit}" for limit in _list_system_limits(system)),
        *(f"- {limit}" for held in weights for limit in list_limits(held)),
    ]
    if not weights:
        lines.append("- No weights come along." if system.learning else "- Nothing is trained.")
    return MARKDOWN_MARK_LINE + "\n".join(lines) + "\n"


def _describe_system(system: System) -> list[str]:
    reach = "whole frames" if system.halo_px is None else f"{system.halo_px} LR pixels each way"
    history = f"{say_count(system.history_frames, 'frame')} before the current one"
    state = f", and state; a shard replays {say_count(system.preroll_frames, 'frame')}"
    facts = {
        "task": system.task.value,
        "citation": system.citation,
        "scales": ", ".join(f"{scale}x" for scale in system.scales) or "any whole factor",
        "history": history + (state if system.recurrent else ""),
        "an output depends on": reach,
    }
    return write_facts(facts)


def _describe_inputs(system: System) -> list[str]:
    lists: dict[tuple[str, str], tuple[Buffer, ...]] = {
        ("LR", "yes"): system.lr_inputs,
        ("LR", "where it is there"): system.lr_optional,
        ("HR", "yes"): system.hr_inputs,
        ("HR", "where it is there"): system.hr_optional,
        ("not rendered", "yes"): system.unshaded_inputs,
        ("not rendered", "where it is there"): system.unshaded_optional,
    }
    rows = [
        [f"`{buffer}`", frame, needed, BUFFER_SPECS[buffer].channels, BUFFER_SPECS[buffer].unit]
        for (frame, needed), buffers in lists.items()
        for buffer in buffers
    ]
    return write_table(("buffer", "of frame", "needed", "channels", "in memory"), rows)


def _describe_weights(system: System, weights: SavedWeights) -> list[str]:
    return [
        f"## Weights `{make_visible(weights.path.name)}`",
        "",
        *describe_file(weights),
        "",
        "### Data",
        "",
        *describe_data(weights),
        "",
        "### Figures",
        "",
        *describe_figures(weights, system.learning),
        "",
        *(describe_margin(weights) if system.tiles is not None else []),
        "### Settings",
        "",
        *describe_settings(weights),
        "",
    ]


def _describe_measurements(system: System) -> list[str]:
    if not system.measured_by:
        return []
    listed = (f"- `{command}`: `{page}`" for command, page in system.measured_by.items())
    return [
        "## Measured elsewhere",
        "",
        "Figures of sequences that no network was trained on, of the weights that come with rtsr; "
        "protocol and figures are on the page:",
        "",
        *listed,
        "",
    ]


def _list_system_limits(system: System) -> list[str]:
    limits = [
        "Figures are of the sequences that they were measured on; `rtsr evaluate` judges others."
    ]
    if system.scales:
        limits.append("Other scales than those above are refused.")
    if system.rendered_every:
        limits.append(
            f"Made for one rendered frame in {system.rendered_every}, and for no other cadence."
        )
    if system.recurrent:
        limits.append(
            "A start, a cut and a gap begin anew; a shard differs from the whole run by what its "
            f"pre-roll leaves: `python benchmarks/shards.py --system {system.name}` prints it."
        )
    if system.halo_px is None:
        limits.append("Frames are not tiled: memory grows with their size.")
    return limits
