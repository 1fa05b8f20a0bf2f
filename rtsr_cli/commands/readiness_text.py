"""What `rtsr inspect` says of commands: what can run, what is missing, and what would mend that."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from rtsr_cli.core.choices import SystemTask
from rtsr_cli.core.inspect.fixes import Fix
from rtsr_cli.core.inspect.readiness import SKIP, SystemReadiness
from rtsr_cli.core.inspect.shot_inspection import ShotInspection
from rtsr_cli.core.pairs.sources import HR_FRAMES
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
    for fix in (fix for fix in inspection.fixes if not fix.write):
        note = f"; {fix.note}" if fix.note else ""
        # a comment, so that the whole line may be pasted
        yield label, f"{fix.line:<{LINE}} # {fix.where}: {fix.missing}{_say_serves(fix)}{note}"
        label = ""
    label = "to write"
    for fix in (fix for fix in inspection.fixes if fix.write):
        yield label, fix.write
        yield "", f"then {fix.line} at {fix.where}: {fix.missing}{_say_serves(fix)}"
        label = ""


LR, HR = "lr ", "hr "
"""How the names of what one size lacks begin."""


def _gather_sizes(missing: Sequence[str]) -> str:
    """Name what is missing: what both sizes lack once, behind the sizes, then what one lacks."""
    of_lr = [name.removeprefix(LR) for name in missing if name.startswith(LR)]
    of_hr = [name.removeprefix(HR) for name in missing if _is_of_hr(name)]
    both = [name for name in of_lr if name in of_hr]
    groups = {
        "lr and hr": both,
        "lr": [name for name in of_lr if name not in both],
        "hr": [name for name in of_hr if name not in both],
    }
    sized = [f"{size} {', '.join(names)}" for size, names in groups.items() if names]
    rest = [name for name in missing if not name.startswith(LR) and not _is_of_hr(name)]
    return "; ".join([*sized, *rest] if sized else [", ".join(rest)])


def _is_of_hr(name: str) -> bool:
    return name.startswith(HR) and name != HR_FRAMES


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
            text = f"missing: {_gather_sizes(readiness.missing)}"
            if readiness.missing and all(map(is_of_frames, readiness.missing)):
                text += f" (runs without those, by {SKIP})"
        yield label, f"{name:<{NAME}}{text}"
        label = ""
