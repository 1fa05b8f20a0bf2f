"""Readings of motion that the user has to choose from, as lines of capture.toml."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace

from rtsr_cli.core.captures.measuring.motion_finding import MotionCandidate, MotionFinding
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.frames.motion import MotionConvention, YAxis

SENSE = frozenset({"unit", "direction", "y_axis"})
"""Fields of [motion] that together say what a vector means."""


def describe_undecided(reader: FrameReader, finding: MotionFinding | None) -> str:
    """Say why nothing decides how vectors are read, and list the readings there are.

    Args:
        reader: as surveyed.
        finding: what was measured, None if nothing could be.
    """
    name = reader.layout.name
    choices = [_format_declaration(reader.conventions.motion)]
    if finding is None or not finding.candidates:
        text = (
            f"layout '{name}' does not say for certain how motion is stored, and it cannot be "
            "measured (nothing moves, or fewer than two frames); declare it"
        )
    elif finding.best is None:
        text = "no reading of the motion vectors fits the frames better than none; declare it"
    else:
        choices = list(dict.fromkeys(_format_choice(c, finding.ties) for c in finding.ties))
        text = (
            "the motion vectors can be read in ways that fit equally well; declare which is right"
        )
    lines = "".join(f"\n    {choice}" for choice in choices)
    example = "" if len(choices) > 1 else ", for example"
    return f"{text} at the head of capture.toml{example}:{lines}"


def describe_unfit(reader: FrameReader) -> str:
    """Say that the frames do not follow their vectors, however these are read."""
    return (
        "no reading of the motion vectors fits the frames better than unrelated frames would be "
        "fitted; render them with their frames, or declare how they are stored at the head of "
        "capture.toml, for example:\n    " + _format_declaration(reader.conventions.motion)
    )


def describe_repeated(reader: FrameReader) -> str:
    """Say that frames which repeat do not tell how vectors are read."""
    return (
        "frames repeat the one before them, so that nothing tells how their motion vectors are "
        "stored; declare it at the head of capture.toml, for example:\n    "
        + _format_declaration(reader.conventions.motion)
    )


def _format_choice(candidate: MotionCandidate, ties: Sequence[MotionCandidate]) -> str:
    """One of the tied readings as a line of capture.toml; both senses of no component are one."""
    convention = replace(candidate.convention, y_axis=YAxis.DOWN)
    alike = {
        c.convention.y_axis
        for c in ties
        if replace(c.convention, y_axis=YAxis.DOWN) == convention and c.error == candidate.error
    }
    shifted = any(c.convention.file_offset for c in ties)
    if len(alike) == 1:
        return _format_declaration(candidate.convention, shifted=shifted)
    text = _format_declaration(convention, shifted=shifted)
    return f"{text}    # the vertical component is zero everywhere: either y_axis"


def _format_declaration(convention: MotionConvention, *, shifted: bool = False) -> str:
    """Write a convention as a line that stands before every table of capture.toml."""
    memory = asdict(MotionConvention())
    always = {*SENSE, "file_offset"} if shifted else SENSE
    fields = (
        f'{name} = "{value}"' if isinstance(value, str) else f"{name} = {value!r}"
        for name, value in asdict(convention).items()
        if name in always or value != memory[name]
    )
    return f"motion = {{{', '.join(fields)}}}"
