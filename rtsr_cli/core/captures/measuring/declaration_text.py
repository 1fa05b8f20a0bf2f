"""Writing `capture.toml`: what was declared, measured or presumed, spelled out for the next run."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict

from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.channel_guesses import write_guess
from rtsr_cli.core.captures.measuring.measured_reader import MeasuredReader
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, VECTOR_BUFFERS, Buffer
from rtsr_cli.core.frames.conventions import Conventions
from rtsr_cli.core.frames.motion import MotionConvention

HEADING = "# What the frames beside this file hold, as rtsr understood it; correct what is wrong."

ALWAYS = frozenset({"unit", "direction", "y_axis", "jittered"})
"""Fields of [motion] that are written even where they are what memory has."""


def write_capture_text(
    settled: MeasuredReader | None,
    capture: CaptureDeclaration,
    guessed: Mapping[Buffer, tuple[str, ...]],
    unknown: Mapping[str, Sequence[str]],
    layers: Sequence[str] = (),
) -> str:
    """Return the text of a capture.toml.

    Args:
        settled: how the frames are read, None if they cannot be.
        capture: what was declared already; it is kept.
        guessed: suggestions for unknown channels, written as comments.
        unknown: channels that no buffer takes, per file sequence.
        layers: that have to be chosen from where the frames cannot be read.
    """
    lines = [HEADING]
    if settled is None:
        lines += [f"# layer = {write_toml_value(name)}" for name in layers]
    if settled is not None:
        lines += _list_general_lines(settled, capture)
        lines += _list_convention_lines(settled)
    lines += [*write_skeleton(unknown), *_list_buffer_lines(capture, guessed)] if unknown else []
    lines += _list_buffer_lines(capture, guessed) if not unknown else []
    return "\n".join(lines) + "\n"


def write_toml_value(value: object) -> str:
    """Write a string, number, boolean, or a list or table of such."""
    if isinstance(value, Mapping):
        pairs = ", ".join(f"{_write_key(k)} = {write_toml_value(v)}" for k, v in value.items())
        return f"{{{pairs}}}"
    if isinstance(value, list | tuple | frozenset):
        items = sorted(value) if isinstance(value, frozenset) else value
        return f"[{', '.join(write_toml_value(item) for item in items)}]"
    if isinstance(value, bool) or value is None:
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    return json.dumps(str(value), ensure_ascii=False)


def _write_key(key: object) -> str:
    text = str(key)
    plain = text.replace("_", "").replace("-", "").isalnum() and text.isascii()
    return text if plain else json.dumps(text, ensure_ascii=False)


KEPT = {
    "scale",
    "frame_step",
    "camera_cuts",
    "camera",
    "jitter_px",
    "filter_width_px",
    "colorspace",
    "licence",
}
"""Fields outside of tables that are written as they were declared."""


def _list_general_lines(settled: MeasuredReader, capture: CaptureDeclaration) -> list[str]:
    preset = settled.reader.layout.name.partition(" + ")[0]
    named = capture.layout or (preset if preset != "capture.toml" else None)
    lines = [f"layout = {write_toml_value(named)}"] if named else []
    if len(settled.reader.layers) > 1 and settled.reader.layer:
        lines.append(f"layer = {write_toml_value(settled.reader.layer)}")
    conventions = settled.reader.conventions
    lines.append(f"roughness = {write_toml_value(conventions.roughness)}")
    lines.append(f"specular = {write_toml_value(conventions.specular)}")
    declared = capture.model_dump(
        mode="json",
        include=KEPT,
        exclude_defaults=True,
    )
    return lines + [f"{name} = {write_toml_value(value)}" for name, value in declared.items()]


def _list_convention_lines(settled: MeasuredReader) -> list[str]:
    conventions: Conventions = settled.reader.conventions
    stored = settled.reader.stored
    lines = []
    if settled.motion_undecided:
        lines += ["", *(f"# {line.strip()}" for line in settled.motion_undecided.splitlines())]
    elif stored.intersection(VECTOR_BUFFERS):
        lines += ["[motion]", *list_motion_lines(conventions.motion)]
    if Buffer.DEPTH in stored:
        depth = conventions.depth
        lines += ["[depth]", f"kind = {write_toml_value(depth.kind)}"]
        lines += [f"reversed = {write_toml_value(depth.reversed)}"] if depth.reversed else []
        lines += [f"unit = {write_toml_value(depth.unit_m)}    # metres"]
        lines += ['from = "near"'] if depth.from_near else []
        lines += [f"near = {write_toml_value(depth.near_m)}"] if depth.near_m is not None else []
        lines += [f"sky = {write_toml_value(depth.sky)}"] if depth.sky is not None else []
    if Buffer.NORMAL in stored:
        normal = conventions.normal
        lines += ["[normal]", f"space = {write_toml_value(normal.space)}"]
        lines += [f"packed = {write_toml_value(normal.packed)}"]
        lines += [f"sky = {write_toml_value(normal.sky)}"] if normal.sky is not None else []
    if Buffer.POSITION in stored:
        lines += [
            "[position]",
            f"unit = {write_toml_value(conventions.metres_per_position)}    # metres",
        ]
    return lines


def list_motion_lines(convention: MotionConvention) -> list[str]:
    """Fields of [motion]: those that say most, and those that are not as in memory."""
    plain = asdict(MotionConvention())
    return [
        f"{name} = {write_toml_value(value)}"
        for name, value in asdict(convention).items()
        if name in ALWAYS or value != plain[name]
    ]


def _list_buffer_lines(
    capture: CaptureDeclaration, guessed: Mapping[Buffer, tuple[str, ...]]
) -> list[str]:
    own = capture.model_dump(mode="json", include={"buffers"}, exclude_defaults=True)
    lines = [
        f"{_write_key(b)} = {write_toml_value(_shorten_specs(s))}"
        for b, s in own.get("buffers", {}).items()
    ]
    if guessed:
        lines.append("# channels that no buffer takes; take away the # where the guess is right:")
        lines += [f"# {b} = {write_guess(b, places)}" for b, places in guessed.items()]
    return ["[buffers]", *lines] if lines else []


def write_skeleton(channels: Mapping[str, Sequence[str]]) -> list[str]:
    """Comments that say how to declare buffers, and which channels of which files there are."""
    names = ", ".join(f"{b} ({BUFFER_SPECS[b].channels})" for b in Buffer if b is not Buffer.SKY)
    return [
        "# [buffers] says which channel is which buffer, with as many channels as the number says:",
        f"# {names}",
        '#     color = "beauty.RGB"              the channels beauty.R, beauty.G, beauty.B',
        '#     motion = ["mv:R", "mv:G"]         channels R and G of the files mv.0001.exr, ...',
        '#     depth = {channel = "Z", file = "*", factor = 0.01, zero = 0.0}',
        '#     material = "diffuse.RGB + glossy.RGB", roughness = "1 - gloss.R", metallic = 0.0',
        *(f"# there are, in {key or 'the files'}: {' '.join(c)}" for key, c in channels.items()),
    ]


def _shorten_specs(specs: object) -> object:
    """Leave out the fields of a channel that say nothing."""
    if isinstance(specs, list):
        return [_shorten_specs(spec) for spec in specs]
    if isinstance(specs, dict):
        return {k: v for k, v in specs.items() if v is not None}
    return specs
