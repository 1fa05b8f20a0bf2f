"""Guessing from its name what an unknown channel may hold: a suggestion, never an assumption."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping

from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer

KEYWORDS: Mapping[Buffer, tuple[str, ...]] = {
    Buffer.MOTION: ("motion", "vel", "mvec", "mv", "mo", "vector", "flow", "backward"),
    Buffer.FORWARD: ("forward",),
    Buffer.ALBEDO: ("albedo", "basecolor", "base_color", "base", "diffcol", "diffuse"),
    Buffer.NORMAL: ("normal", "nrm", "nml", "norm"),
    Buffer.DEPTH: ("depth", "viewz", "linearz", "zdepth", "dist"),
    Buffer.ROUGHNESS: ("rough", "rgh", "smooth", "gloss"),
    Buffer.METALLIC: ("metal", "mtl"),
    Buffer.SPECULAR: ("specular", "f0"),
    Buffer.EMISSION: ("emis", "emit"),
    Buffer.OBJECT_ID: ("objectid", "object_id", "instance", "stencil", "entity", "id"),
    Buffer.POSITION: ("worldpos", "position", "pos"),
    Buffer.NOV: ("nov", "ndotv"),
    Buffer.REACTIVE: ("reactive", "translucen"),
    Buffer.COLOR: (
        "color",
        "colour",
        "beauty",
        "radiance",
        "combined",
        "final",
        "hdr",
        "lit",
        "image",
    ),
}
"""What names of channels, layers and files contain, the telling ones first; see
`_contains_keyword`."""

WHOLE, BEGINNING = 2, 3
"""Words of so many letters must be a whole word of the name, or begin one: they are in many."""

WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
"""A part of a name: sceneDepth, scene_depth and SceneDepth have two."""


def guess_buffers(channels: Mapping[str, Collection[str]]) -> dict[Buffer, tuple[str, ...]]:
    """Suggest buffers for channels that no layout knows.

    Args:
        channels: for each file sequence, the names of its unknown channels.

    Returns:
        for each buffer that some group of channels may be, their places as capture.toml writes
        them: `channel`, or `file:channel` where there are several sequences.
    """
    groups: dict[str, list[str]] = defaultdict(list)
    for stream, names in channels.items():
        place = f"{stream}:" if len(channels) > 1 and stream else ""
        layers = Counter(_strip_component(name) for name in names)
        for name in sorted(names):
            # one channel alone is called what its name says
            layer = _strip_component(name) if layers[_strip_component(name)] > 1 else name
            groups[f"{stream}/{layer}"].append(f"{place}{name}")
    suggestions: dict[Buffer, tuple[str, ...]] = {}
    for key, places in groups.items():
        buffer = _guess_buffer(key, len(places))
        if buffer is not None and buffer not in suggestions:
            suggestions[buffer] = _sort_places(places)[: BUFFER_SPECS[buffer].channels]
    return suggestions


def _strip_component(channel: str) -> str:
    """The name without its component: `mo` of mo.x, mo_x and moX, nothing of R."""
    before, separated, _ = channel.rpartition(".")
    if separated:
        return before
    is_component = channel[-1:].lower() in COMPONENTS
    apart = len(channel) == 1 or channel[-2] in "_-" or channel[-1].isupper()
    return channel[:-1].rstrip("_-") if is_component and apart else channel


def _guess_buffer(name: str, count: int) -> Buffer | None:
    """The first buffer whose keyword the name contains and that needs no more channels."""
    parts = [part.lower() for part in WORD.findall(name)]
    for buffer, words in KEYWORDS.items():
        enough = count >= BUFFER_SPECS[buffer].channels
        if enough and any(_contains_keyword(word, name.lower(), parts) for word in words):
            return buffer
    return None


def _contains_keyword(word: str, name: str, parts: Collection[str]) -> bool:
    if len(word) <= WHOLE:
        return word in parts
    if len(word) <= BEGINNING:
        return any(part.startswith(word) for part in parts)
    return word in name


COMPONENTS = {"r": 0, "x": 0, "u": 0, "g": 1, "y": 1, "v": 1, "b": 2, "z": 2, "a": 3, "w": 3}
"""Place of a component by its first letter: r g b a, red green blue, x y z w, u v."""


def _sort_places(places: Collection[str]) -> tuple[str, ...]:
    def rank(place: str) -> int:
        channel = place.rpartition(":")[2]
        _, separated, component = channel.rpartition(".")
        letter = component[:1] if separated else channel[-1:]
        return COMPONENTS.get(letter.lower(), 0)

    return tuple(sorted(places, key=lambda p: (rank(p), p)))
