"""Whether motion and jitter, as they are read, can be relied upon for accumulating frames."""

from __future__ import annotations

from dataclasses import replace

from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.measuring.jitter_finder import JitterFinding, JitterVerdict
from rtsr_cli.core.captures.measuring.measured_reader import MeasuredReader
from rtsr_cli.core.frames.buffers import Buffer

DOUBTED_JITTER = frozenset(
    {JitterVerdict.WRONG_SIGN, JitterVerdict.UNDECLARED, JitterVerdict.CONSTANT_OFFSET}
)
"""Verdicts by which samples do not lie where the declaration says."""


def is_motion_trusted(settled: MeasuredReader, capture: CaptureDeclaration) -> bool:
    """Tell whether vectors are read in the one way that fits, or as declared and not worse.

    Args:
        settled: with the conventions that vectors are read by.
        capture: what the user declares.
    """
    finding = settled.measured.motion
    if Buffer.MOTION not in settled.reader.stored or finding is None or settled.measured.repeated:
        return False
    used = replace(settled.reader.conventions.motion, jittered=False, jitter_inverted=False)
    best = settled.measured.best
    if best is not None and best.convention == used:
        return True
    candidate = finding.of(used)
    return capture.motion.decides() and candidate is not None and candidate in finding.ties


def is_jitter_trusted(finding: JitterFinding | None) -> bool:
    """Tell whether nothing speaks against the jitter that is declared."""
    return finding is None or finding.verdict not in DOUBTED_JITTER
