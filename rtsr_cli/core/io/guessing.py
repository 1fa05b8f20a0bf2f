"""Guessing from its name what an unknown channel may hold: a suggestion, never an assumption."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping

from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer

KEYWORDS: Mapping[Buffer, tuple[str, ...]] = {
    Buffer.MOTION: ("motion", "vel", "mvec", "mv", "vector", "flow", "backward"),
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
    Buffer.COLOR: ("color", "colour", "beauty", "radiance", "combined", "final", "hdr", "image"),
}
"""What names of channels, layers and files contain, the telling ones first."""


def guesses(channels: Mapping[str, Collection[str]]) -> dict[Buffer, tuple[str, ...]]:
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
        for name in sorted(names):
            groups[f"{stream}/{_layer(name)}"].append(f"{place}{name}")
    found: dict[Buffer, tuple[str, ...]] = {}
    for key, places in groups.items():
        buffer = _meant(key, len(places))
        if buffer is not None and buffer not in found:
            found[buffer] = _in_order(places)[: BUFFER_SPECS[buffer].channels]
    return found


def _layer(channel: str) -> str:
    return channel.rpartition(".")[0] or channel


def _meant(name: str, count: int) -> Buffer | None:
    """The first buffer whose keyword the name contains and that needs no more channels."""
    lower = name.lower()
    for buffer, words in KEYWORDS.items():
        if count >= BUFFER_SPECS[buffer].channels and any(word in lower for word in words):
            return buffer
    return None


COMPONENTS = {"r": 0, "x": 0, "u": 0, "g": 1, "y": 1, "v": 1, "b": 2, "z": 2, "a": 3, "w": 3}
"""Place of a component by its first letter: r g b a, red green blue, x y z w, u v."""


def _in_order(places: Collection[str]) -> tuple[str, ...]:
    def rank(place: str) -> int:
        return COMPONENTS.get(place.rpartition(".")[2][:1].lower(), 0)

    return tuple(sorted(places, key=lambda p: (rank(p), p)))
