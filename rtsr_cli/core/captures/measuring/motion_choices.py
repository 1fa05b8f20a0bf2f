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
    choices = [write_motion(reader.conventions.motion)]
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
        "capture.toml, for example:\n    " + write_motion(reader.conventions.motion)
    )


def describe_repeated(reader: FrameReader) -> str:
    """Say that frames which repeat do not tell how vectors are read."""
    return (
        "frames repeat the one before them, so that nothing tells how their motion vectors are "
        "stored; declare it at the head of capture.toml, for example:\n    "
        + write_motion(reader.conventions.motion)
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
        return write_motion(candidate.convention, shifted=shifted)
    text = write_motion(convention, shifted=shifted)
    return f"{text}    # the vertical component is zero everywhere: either y_axis"


def describe_distrust(
    convention: MotionConvention, finding: MotionFinding, *, declared: bool
) -> str:
    """Say what would make vectors relied upon that are not: a line, or that one names the system.

    Args:
        convention: that they are read by.
        finding: what was measured.
        declared: whether the user declares it.
    """
    if declared:
        return "these frames do not show that what is declared is right: name the system"
    read = finding.of(replace(convention, jittered=False, jitter_inverted=False))
    if read is None or read not in finding.ties:
        # what is declared would be relied upon no more
        return "these frames do not show which reading of it is right: name the system to use it"
    line = write_motion(convention, shifted=any(c.convention.file_offset for c in finding.ties))
    return f"if it is right as it is read: {line} at the head of capture.toml"


def write_motion(convention: MotionConvention, *, shifted: bool = False) -> str:
    """Write a convention as a line that stands before every table of capture.toml."""
    memory = asdict(MotionConvention())
    always = {*SENSE, "file_offset"} if shifted else SENSE
    fields = (
        f'{name} = "{value}"' if isinstance(value, str) else f"{name} = {value!r}"
        for name, value in asdict(convention).items()
        if name in always or value != memory[name]
    )
    return f"motion = {{{', '.join(fields)}}}"
