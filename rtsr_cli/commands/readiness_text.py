"""What `rtsr inspect` says of commands: what can run, what is missing, and what would mend that."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.inspect.fixes import Fix
from rtsr_cli.core.inspect.readiness import SKIP, SystemReadiness
from rtsr_cli.core.inspect.shot_inspection import ShotInspection
from rtsr_cli.core.run.system_inputs import is_of_frames
from rtsr_cli.core.wording import join_names

LABELS = {SystemTask.UPSCALE.value: "systems"}
"""Labels of commands' lines where they are not the command's name."""

EVERY = "all"
"""Stands for all systems of a command where none can run, for one reason."""

NAME, LINE = 16, 40
"""Widths of columns."""

FEW = 3
"""Systems that are named; of more, the number is."""


def list_readiness_lines(inspection: ShotInspection) -> Iterator[tuple[str, str]]:
    """Every system and part of every command, then what would provide what is missing.

    Yields labels, empty where the line before has it, and texts.
    """
    for command, systems in inspection.commands.items():
        yield from _list_command_lines(LABELS.get(command, command), systems)
    label = "to paste"
    for fix in inspection.fixes:
        note = f"; {fix.note}" if fix.note else ""
        # a comment, so that the whole line may be pasted
        yield label, f"{fix.line:<{LINE}} # {fix.where}: {fix.missing}{_say_serves(fix)}{note}"
        label = ""


def _say_serves(fix: Fix) -> str:
    """Say what would run with it; of much, how much."""
    if not fix.serves:
        return ""
    who = join_names(fix.serves) if len(fix.serves) <= FEW else f"{len(fix.serves)} systems"
    return f", with which {who} can run"


def _list_command_lines(
    label: str, systems: Mapping[str, SystemReadiness]
) -> Iterator[tuple[str, str]]:
    found = set(systems.values())
    alike = len(systems) > 1 and len(found) == 1 and not any(r.ready for r in found)
    shown = {EVERY: found.pop()} if alike else systems
    for name, readiness in shown.items():
        if readiness.ready:
            text = f"ready{' with ' + readiness.how if readiness.how else ''}"
        else:
            text = f"missing: {', '.join(readiness.missing)}"
            if readiness.missing and all(map(is_of_frames, readiness.missing)):
                text += f" (runs without those, by {SKIP})"
        yield label, f"{name:<{NAME}}{text}"
        label = ""
