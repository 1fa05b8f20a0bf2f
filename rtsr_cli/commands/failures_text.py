"""Failures of frames: a cause in full once, then the frames that it is of as well."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from rtsr_cli.core.frames.camera_needs import say_frames

NUMBER = re.compile(r"\d+")
"""What messages of one cause differ in: the frame, in names of files too, and counts."""


@dataclass(frozen=True, kw_only=True)
class Failures:
    """Frames that failed, by cause.

    Attributes:
        frames: shot and cause -> numbers, the one whose message is said first.
    """

    frames: dict[tuple[str, str], list[int]] = field(default_factory=dict)

    def add(self, shot: str, number: int, message: str) -> bool:
        """Take in a failure; return whether its cause is new, so that it is to be said."""
        alike = self.frames.setdefault((shot, NUMBER.sub("#", message)), [])
        alike.append(number)
        return len(alike) == 1

    def list_repeats(self) -> Iterator[str]:
        """Say of which other frames causes are; those that were of one frame say nothing."""
        for (shot, _), (first, *others) in self.frames.items():
            if others:
                where = "" if shot in ("", ".") else f"{shot}: "
                verb = "fail" if len(others) > 1 else "fails"
                yield f"{where}{say_frames(others)} {verb} for the same reason as frame {first}"
