"""The nearest fix of what is missing, as a line to paste; none where it would be a guess."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from rtsr_cli.core.captures.channel_guesses import write_guess
from rtsr_cli.core.captures.likely_channels import BASE_COLOUR_NOTE, PARTS
from rtsr_cli.core.captures.measuring.declaration_text import write_toml_value
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer
from rtsr_cli.core.imaging.derivation import CAMERA
from rtsr_cli.core.inspect.readiness import SystemReadiness
from rtsr_cli.core.pairs.sources import FITTING_HR, HR_FRAMES, name_once
from rtsr_cli.core.wording import join_names

BUFFERS_TABLE = "[buffers] of capture.toml"
CAMERA_TABLE = "[camera] of capture.toml"
HEAD = "the head of capture.toml"
SHELL = "the command line"
"""Where lines belong."""

CONSTANTS: Mapping[Buffer, tuple[float, str]] = {
    Buffer.METALLIC: (0.0, "if nothing is of metal"),
    Buffer.ROUGHNESS: (0.5, "one number for all surfaces, if no pass holds it"),
}
"""Buffers that may be one number for a whole scene: one to begin with, and when it is right."""

MATERIAL_NOTE = "all that radiance is divided by"
CAMERA_FILE = "camera.csv"
"""What a file of cameras that is still to be written may be called."""

CAMERA_NOTE = "the file that lies beside it"
CAMERA_CONTENT = (
    f"{CAMERA_FILE}, beside capture.toml: a row a frame, columns frame, worldToCamera and "
    "worldToNDC of 16 numbers each (docs/frames.md, Cameras)"
)


@dataclass(frozen=True, kw_only=True)
class Fix:
    """A line that provides something that is missing.

    Attributes:
        missing: what, without the size of the frames.
        where: the line belongs.
        line: to paste.
        note: what it takes to be right; may be empty.
        write: what has to be written before the line is right; empty if the line is all.
        bare: whether nothing in the files speaks for it.
        serves: systems, and parts of commands, that would run with it and the other lines.
    """

    missing: str
    where: str
    line: str
    note: str = ""
    write: str = ""
    bare: bool = False
    serves: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Hints:
    """What is known of frames that may stand for what is missing.

    Attributes:
        guessed: buffer -> channels that may be it, by name and by what they hold.
        layers: to choose from.
        layout: that the frames look like, where it has to be named; else empty.
        named: buffers that the names of unknown channels speak for; no constant stands for those.
        material: how channels add up to what radiance is divided by; empty if they do not.
        base_colour: what base colour is made of, where nothing else of the material is there, nor a
            camera that it would take; else empty.
        divided: whether passes say what radiance is divided by: what is of metal is in them, and a
            constant would contradict it.
        camera: convention by which matrices that are there would be right; empty if none is known.
        side_car: file that the cameras are declared to be in; empty if none is.
        undeclared: file of cameras that lies there, and nothing declares; empty if none does.
    """

    guessed: Mapping[Buffer, tuple[str, ...]] = field(default_factory=dict)
    layers: tuple[str, ...] = ()
    layout: str = ""
    named: frozenset[Buffer] = frozenset()
    material: str = ""
    base_colour: str = ""
    divided: bool = False
    camera: str = ""
    side_car: str = ""
    undeclared: str = ""


def list_fixes(
    commands: Mapping[str, Mapping[str, SystemReadiness]], hints: Hints
) -> tuple[Fix, ...]:
    """Return the lines that would provide what the systems of commands lack.

    A line that no file speaks for, a constant or a place, is offered where something would run with
    the lines that there are; what lacks more beside it would gain nothing. None is while HR frames
    do not fit LR's: the frames have to be mended first.

    Args:
        commands: by command, whether each of its systems or parts can run.
        hints: what may stand for what is missing.
    """
    missing: dict[str, bool] = {}
    unlocked: dict[str, dict[str, None]] = {}
    judged = [(name, r) for systems in commands.values() for name, r in systems.items()]
    unfit = any(FITTING_HR in readiness.missing for _, readiness in judged)
    for system, readiness in judged:
        names = dict.fromkeys(map(strip_size, readiness.missing))
        unlocks = not unfit and all(any(True for _ in _list_fixes_of(n, hints)) for n in names)
        missing.update({name: unlocks or missing.get(name, False) for name in names})
        for name in names if unlocks else ():
            unlocked.setdefault(name, {})[system] = None
    fixes = [
        replace(fix, serves=tuple(unlocked.get(name, ())))
        for name, unlocks in missing.items()
        for fix in _list_fixes_of(name, hints)
        if unlocks or not fix.bare
    ]
    # channels that may be something are worth a line even while nothing can be read at all
    known = {fix.line for fix in fixes}
    offered = [_declare_guess(b, hints) for b in hints.guessed] if _is_unread(missing) else []
    fixes += [fix for fix in offered if fix.line not in known]
    return tuple(_merge_fixes(fixes))


def _merge_fixes(fixes: Iterable[Fix]) -> Iterator[Fix]:
    """Offer a line once, for all that it provides: a key that is pasted twice is no TOML."""
    grouped: dict[tuple[str, str], list[Fix]] = {}
    for fix in fixes:
        grouped.setdefault((fix.where, fix.line), []).append(fix)
    for same in grouped.values():
        names = name_once(fix.missing for fix in same)
        serves = dict.fromkeys(name for fix in same for name in fix.serves)
        yield replace(same[0], missing=join_names(names), serves=tuple(serves))


def strip_size(missing: str) -> str:
    """Leave out of which frames something is missing: one declaration is for both sizes."""
    return missing if missing == HR_FRAMES else missing.removeprefix("lr ").removeprefix("hr ")


UNREAD, UNNAMED = "a known layout", "a named layout"
"""What is missing where no layout fits, and where one fits that nothing proves."""


def _is_unread(missing: Mapping[str, bool]) -> bool:
    return UNREAD in missing


def _list_fixes_of(missing: str, hints: Hints) -> Iterator[Fix]:
    if missing in {buffer.value for buffer in Buffer}:
        yield from _list_buffer_fixes(Buffer(missing), hints)
    elif missing.startswith(CAMERA):
        yield from _list_camera_fixes(missing, hints)
    elif missing == HR_FRAMES:
        note = "the folder of the G-buffers of the target size"
        yield Fix(missing=missing, where=SHELL, line="--hr DIR", note=note, bare=True)
    elif hints.layout and missing == UNNAMED:
        line = f"layout = {write_toml_value(hints.layout)}"
        yield Fix(missing=missing, where=HEAD, line=line, note="or --layout")
    elif missing == "a choice of layer":
        for name in hints.layers:
            line = f"layer = {write_toml_value(name)}"
            yield Fix(missing=missing, where=HEAD, line=line, note="or --layer NAME")


def _list_camera_fixes(missing: str, hints: Hints) -> Iterator[Fix]:
    """Say what matrices look like, or where to give some; none where a side-car is at fault.

    A file is declared where there is one; else it has to be written first.
    """
    convention = f"convention = {write_toml_value(hints.camera)}"
    if hints.camera and hints.side_car:
        # beside `camera = "camera.csv"` a table [camera] would be no TOML
        line = f"camera = {{file = {write_toml_value(hints.side_car)}, {convention}}}"
        note = "what they look like; in the place of what it says of the camera"
        yield Fix(missing=missing, where=HEAD, line=line, note=note)
    elif hints.camera:
        yield Fix(missing=missing, where=CAMERA_TABLE, line=convention, note="what they look like")
    elif hints.undeclared and not hints.side_car:
        line = f"camera = {write_toml_value(hints.undeclared)}"
        yield Fix(missing=missing, where=HEAD, line=line, note=CAMERA_NOTE)
    elif not hints.side_car:
        line = f"camera = {write_toml_value(CAMERA_FILE)}"
        yield Fix(missing=missing, where=HEAD, line=line, write=CAMERA_CONTENT, bare=True)


def _list_buffer_fixes(buffer: Buffer, hints: Hints) -> Iterator[Fix]:
    if hints.material and buffer in PARTS:
        line = f"material = {write_toml_value(hints.material)}"
        yield Fix(missing=buffer.value, where=BUFFERS_TABLE, line=line, note=MATERIAL_NOTE)
    elif buffer in hints.guessed:
        yield _declare_guess(buffer, hints)
    elif Buffer.MATERIAL in hints.guessed and buffer in PARTS:
        yield replace(_declare_guess(Buffer.MATERIAL, hints), missing=buffer.value)
    elif hints.base_colour and buffer in PARTS:
        line = f"material = {write_toml_value(hints.base_colour)}"
        yield Fix(missing=buffer.value, where=BUFFERS_TABLE, line=line, note=BASE_COLOUR_NOTE)
    elif buffer is Buffer.METALLIC and hints.divided:
        return
    elif buffer in CONSTANTS and buffer not in hints.named:
        value, note = CONSTANTS[buffer]
        line = f"{buffer} = {write_toml_value(value)}"
        yield Fix(missing=buffer.value, where=BUFFERS_TABLE, line=line, note=note, bare=True)


def _declare_guess(buffer: Buffer, hints: Hints) -> Fix:
    line = f"{buffer} = {write_guess(buffer, hints.guessed[buffer])}"
    note = f"if these are {BUFFER_SPECS[buffer].unit}"
    return Fix(missing=buffer.value, where=BUFFERS_TABLE, line=line, note=note)
