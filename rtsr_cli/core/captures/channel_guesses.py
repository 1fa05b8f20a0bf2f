"""Guessing from its name what an unknown channel may hold: a suggestion, never an assumption."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence

from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer

KEYWORDS: Mapping[Buffer, tuple[str, ...]] = {
    Buffer.MOTION: ("motion", "speed", "vel", "mvec", "mv", "mo", "vector", "flow", "backward"),
    Buffer.FORWARD: ("forward",),
    Buffer.ALBEDO: ("albedo", "alb", "basecolor", "base_color", "base", "diffcol", "diffuse"),
    Buffer.NORMAL: ("normal", "nrm", "nml", "norm", "n"),
    Buffer.DEPTH: ("depth", "viewz", "linearz", "zdepth", "zbuf", "dist"),
    Buffer.ROUGHNESS: ("rough", "rgh", "smooth", "gloss"),
    Buffer.METALLIC: ("metal", "mtl"),
    Buffer.SPECULAR: ("specularcolor", "specular_color", "speccol", "f0"),
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

HINTED: Mapping[Buffer, str] = {Buffer.DEPTH: "z"}
"""What one word of the name of a single channel begins with, where nothing else speaks: a hint,
which its values have to prove."""

ALONE: Mapping[Buffer, tuple[str, ...]] = {
    Buffer.MATERIAL: ("material", "mat", "matl", "brdf", "divisor"),
}
"""What names consist of, whole: beside other words these say nothing of what channels hold."""

OF_LIGHT = ("light", "direct", "illum", "irrad", "shad", "bounce")
"""In names of channels that hold light, whatever surface it comes from."""

OF_LOBES = ("glossy",)
"""In names of channels that hold the light or the colour of mirrors, no glossiness."""

OF_COATS = ("coat", "sheen", "clear")
"""In names of channels that describe what lies over a surface, not the surface."""

OF_LENSES = ("depthoffield", "depth_of_field", "dof")
"""In names of channels that hold what a lens does, no depth."""

OF_DENOISERS = ("denois",)
"""In names of what guides a denoiser: through mirrors, surfaces are those that they show."""

SURFACE = frozenset({Buffer.ALBEDO, Buffer.SPECULAR, Buffer.ROUGHNESS, Buffer.METALLIC})
"""Buffers that hold no light."""

NUMBERS = frozenset({Buffer.ROUGHNESS, Buffer.METALLIC})
"""Buffers of one number, which no colour is."""

WHOLE, BEGINNING = 2, 3
"""Words of so many letters must be a whole word of the name, or begin one: they are in many."""

WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
"""A part of a name: sceneDepth, scene_depth and SceneDepth have two."""


SPACE_CHANNELS = 3
"""No buffer has more."""

Place = tuple[str, str]
"""A file sequence, and a channel of it."""

GuessCheck = Callable[[Buffer, Sequence[Place]], bool]
"""`check(buffer, places)`: whether a group of channels, x or red first, can be a buffer."""


def _believe(_: Buffer, __: Sequence[Place]) -> bool:
    return True


def guess_buffers(
    channels: Mapping[str, Collection[str]], check: GuessCheck = _believe
) -> dict[Buffer, tuple[str, ...]]:
    """Suggest buffers for channels that no layout knows.

    Args:
        channels: for each file sequence, the names of its unknown channels.
        check: holds a guess against what the channels hold; a name that it contradicts is none.

    Returns:
        for each buffer that some group of channels may be, their places as capture.toml writes
        them: `channel`, or `file:channel` where there are several sequences.
    """
    groups: dict[str, list[Place]] = defaultdict(list)
    for stream, names in channels.items():
        layers = Counter(_strip_component(name) for name in names)
        for name in sorted(names):
            # one channel alone is called what its name says
            layer = _strip_component(name) if layers[_strip_component(name)] > 1 else name
            groups[f"{stream}/{layer}"].append((stream, name))
    suggestions: dict[Buffer, tuple[str, ...]] = {}
    sorted_groups = {key: _sort_places(held) for key, held in groups.items()}
    for key, places in sorted_groups.items():
        buffer = _choose_candidate(_list_candidates(key, len(places)), places, check)
        if buffer is not None and buffer not in suggestions:
            chosen = places[: BUFFER_SPECS[buffer].channels]
            suggestions[buffer] = tuple(_write_place(p, several=len(channels) > 1) for p in chosen)
    for buffer in HINTED.keys() - suggestions.keys():
        likely = [p for p in sorted_groups.values() if hints_at(buffer, p) and check(buffer, p)]
        if len(likely) == 1:
            [place] = likely[0]
            suggestions[buffer] = (_write_place(place, several=len(channels) > 1),)
    return suggestions


def hints_at(buffer: Buffer, places: Sequence[Place]) -> bool:
    """Tell whether the name of a single channel hints at a buffer, and speaks for none."""
    if len(places) != 1 or buffer not in HINTED:
        return False
    [(_, channel)] = places
    words = [word.lower() for word in WORD.findall(channel)]
    if any(True for _ in _list_candidates(channel, SPACE_CHANNELS)):
        return False
    return any(word.startswith(HINTED[buffer]) for word in words)


def list_named(channels: Mapping[str, Collection[str]]) -> frozenset[Buffer]:
    """Buffers that some channel's name speaks for, whatever it holds.

    Args:
        channels: as `guess_buffers` takes them.
    """
    names = {name for held in channels.values() for name in held}
    return frozenset(b for name in names for b in _list_candidates(name, SPACE_CHANNELS))


def _choose_candidate(
    candidates: Iterator[Buffer], places: Sequence[Place], check: GuessCheck
) -> Buffer | None:
    """The first buffer that a name speaks for, or one that its values alone prove."""
    first = next(candidates, None)
    if first is None or check(first, places):
        return first
    return next((b for b in candidates if b in TELLING and check(b, places)), None)


DIFFUSE, GLOSSY, COLOUR = ("diff",), ("gloss", "spec"), ("col",)
"""In names of the two colours that add up to what light is multiplied by."""


def guess_material(channels: Mapping[str, Collection[str]], check: GuessCheck = _believe) -> str:
    """Suggest how material is made of unknown channels; empty where nothing speaks for it.

    Args:
        channels: as `guess_buffers` takes them.
        check: the same.
    """
    found = [_find_layer(channels, words, check) for words in (DIFFUSE, GLOSSY)]
    return " + ".join(f"{place}.RGB" for place in found) if all(found) else ""


def _find_layer(
    channels: Mapping[str, Collection[str]], words: tuple[str, ...], check: GuessCheck
) -> str:
    """The only layer of a colour R, G, B whose name has one of some words."""
    found = []
    for stream, names in channels.items():
        layers = sorted({name.rpartition(".")[0] for name in names} - {""})
        for layer in layers:
            places = [(stream, f"{layer}.{c}") for c in "RGB"]
            named = all(any(w in layer.lower() for w in group) for group in (words, COLOUR))
            held = named and all(channel in names for _, channel in places)
            if held and check(Buffer.MATERIAL, places):
                found.append(_write_place((stream, layer), several=len(channels) > 1))
    return found[0] if len(found) == 1 else ""


TELLING = frozenset({Buffer.NORMAL})
"""Buffers that nothing else looks like: vectors of length 1."""


def _write_place(place: Place, *, several: bool) -> str:
    stream, channel = place
    return f"{stream}:{channel}" if several and stream else channel


TURNED = ("smooth", "gloss")
"""In names of channels that hold 1 - roughness."""


def write_guess(buffer: Buffer, places: Sequence[str]) -> str:
    """Write the value that declares a guess under [buffers]."""
    if buffer is Buffer.ROUGHNESS and any(word in places[0].lower() for word in TURNED):
        return f'"1 - {places[0]}"'
    listed = ", ".join(f'"{place}"' for place in places)
    return listed if len(places) == 1 else f"[{listed}]"


def _strip_component(channel: str) -> str:
    """The name without its component: `mo` of mo.x, mo_x and moX, nothing of R."""
    before, separated, _ = channel.rpartition(".")
    if separated:
        return before
    is_component = channel[-1:].lower() in COMPONENTS
    apart = len(channel) == 1 or channel[-2] in "_-" or channel[-1].isupper()
    return channel[:-1].rstrip("_-") if is_component and apart else channel


def _list_candidates(name: str, count: int) -> Iterator[Buffer]:
    """Buffers whose keyword the name contains and that need no more channels, the likely first."""
    parts = [part.lower() for part in WORD.findall(name)]
    if _has_any(OF_DENOISERS, name) or _has_any(OF_LENSES, name):
        return
    for buffer, words in KEYWORDS.items():
        lit = buffer in SURFACE and _has_any((*OF_LIGHT, *OF_COATS), name)
        shared = buffer in NUMBERS and _has_any(OF_LOBES, name)
        enough = count >= BUFFER_SPECS[buffer].channels and not lit and not shared
        if enough and any(_contains_keyword(word, name.lower(), parts) for word in words):
            yield buffer
    stream, _, layer = name.rpartition("/")
    own = {word.lower() for word in WORD.findall(layer or stream)}
    for buffer, whole in ALONE.items():
        if own and own <= set(whole) and count >= BUFFER_SPECS[buffer].channels:
            yield buffer


def _has_any(words: tuple[str, ...], name: str) -> bool:
    return any(word in name.lower() for word in words)


def _contains_keyword(word: str, name: str, parts: Collection[str]) -> bool:
    if len(word) <= WHOLE:
        return word in parts
    if len(word) <= BEGINNING:
        return any(part.startswith(word) for part in parts)
    return word in name


COMPONENTS = {"r": 0, "x": 0, "u": 0, "g": 1, "y": 1, "v": 1, "b": 2, "z": 2, "a": 3, "w": 3}
"""Place of a component by its first letter: r g b a, red green blue, x y z w, u v."""


def _sort_places(places: Collection[Place]) -> tuple[Place, ...]:
    def rank(place: Place) -> int:
        _, separated, component = place[1].rpartition(".")
        letter = component[:1] if separated else place[1][-1:]
        return COMPONENTS.get(letter.lower(), 0)

    return tuple(sorted(places, key=lambda p: (rank(p), p)))
