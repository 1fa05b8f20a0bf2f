"""What frames lack, and channels of theirs that are likely to be it: as lines to paste."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

from rtsr_cli.core.captures.channel_guesses import (
    GuessCheck,
    guess_buffers,
    guess_material,
    write_guess,
)
from rtsr_cli.core.captures.guess_checks import check_guesses, choose_files
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.sample_channels import join_samples_into
from rtsr_cli.core.frames.buffers import Buffer

PARTS = frozenset({Buffer.MATERIAL, Buffer.ALBEDO, Buffer.METALLIC, Buffer.ROUGHNESS, Buffer.NOV})
"""What need not be there where material is."""


def list_bound(reader: FrameReader) -> dict[str, frozenset[str]]:
    """Channels that buffers take, by file sequence."""
    bound: dict[str, set[str]] = {}
    for components in join_samples_into(reader.binding, reader.samples).values():
        for c in components:
            bound.setdefault(c.stream, set()).add(c.channel)
    return {key: frozenset(names) for key, names in bound.items()}


def list_unknown(reader: FrameReader) -> dict[str, tuple[str, ...]]:
    """Channels that no buffer takes, by file sequence."""
    bound = list_bound(reader)
    unknown = {
        key: tuple(sorted(frozenset().union(*by_number.values()) - bound.get(key, frozenset())))
        for key, by_number in reader.channels.items()
    }
    return {key: names for key, names in unknown.items() if names}


def guess_further(
    reader: FrameReader, unknown: Mapping[str, tuple[str, ...]], check: GuessCheck
) -> dict[Buffer, tuple[str, ...]]:
    """Buffers that channels nobody knows could be; what is not read for a reason is none."""
    known = reader.layout.list_unread(unknown)
    rest = {
        key: tuple(c for c in channels if c not in known)
        for key, channels in unknown.items()
        if not known.keys() & {key, key.rpartition("/")[0]}
    }
    guessed = guess_buffers(rest, check)
    known_buffers = reader.binding.keys() | reader.lacking.keys()
    return {b: places for b, places in guessed.items() if b not in known_buffers}


BASE_COLOUR_NOTE = "base colour alone: what is without any (metal, glass) is enlarged as radiance"
"""What it takes for a material of base colour to be right."""


def find_base_colour(reader: FrameReader, others: Collection[Buffer] = ()) -> str:
    """What base colour is made of, as `material` takes it; empty where more of it is known.

    It is all there is to divide by where no pass says what is of metal and no camera says what is
    seen at which angle: Mitsuba's `albedo` is the reflectance of all that has a diffuse one.

    Args:
        reader: of the frames.
        others: buffers that unknown channels are likely to be.
    """
    more = {Buffer.MATERIAL, Buffer.METALLIC, Buffer.SPECULAR}
    known = reader.stored | reader.lacking.keys()
    if Buffer.ALBEDO not in reader.stored or more & (known | set(others)):
        return ""
    return reader.binding[Buffer.ALBEDO].describe(streams=len(reader.channels) > 1)


def suggest_lines(readers: Iterable[FrameReader], lacking: Collection[str]) -> tuple[str, ...]:
    """Write the lines of `[buffers]` by which frames would have what they lack, one a buffer.

    Args:
        readers: of the frames, of each size.
        lacking: names of buffers, with or without their size.
    """
    names = {name.removeprefix("lr ").removeprefix("hr ") for name in lacking}
    wanted = frozenset(buffer for buffer in Buffer if buffer in names)
    if not wanted:
        return ()
    lines = (line for reader in readers for line in _suggest_of(reader, wanted))
    by_key: dict[str, str] = {}
    for line in lines:
        # a key that is there twice is no TOML
        by_key.setdefault(line.partition(" = ")[0], line)
    return tuple(by_key.values())


def _suggest_of(reader: FrameReader, wanted: frozenset[Buffer]) -> Iterator[str]:
    unknown = list_unknown(reader)
    # what is not looked for needs no look at pixels
    others = frozenset(Buffer) - wanted - ({Buffer.MATERIAL} if wanted & PARTS else set())
    check = check_guesses(choose_files(reader.frames, reader.channels), others | reader.stored)
    held = reader.stored | reader.lacking.keys()
    sought = wanted & PARTS and Buffer.MATERIAL not in held
    material = guess_material(unknown, check) if sought else ""
    guessed = guess_further(reader, unknown, check)
    base_colour = ""
    if wanted & PARTS and not material and not reader.has_matrices:
        base_colour = find_base_colour(reader, guessed)
    if material:
        yield f'material = "{material}"'
    elif base_colour:
        yield f'material = "{base_colour}"  # {BASE_COLOUR_NOTE}'
    for buffer, places in guessed.items():
        if not ((material or base_colour) and buffer in PARTS):
            yield f"{buffer} = {write_guess(buffer, places)}"
