"""What users call the channels of a file: over its parts, and with the views that they belong to.

OpenEXR has two ways of keeping stereo views in one file: an attribute `multiView` and names like
`left.R` or `depth.left.Z`, in which the channels without a layer belong to the first view; or
parts that each say their `view`, and whose names usually say it again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

STEREO = ("left", "right")
"""Views that are known by their names, even where no attribute says that there are views."""

SEPARATORS = "._- "
"""Between the name of a part and its view: `rgba.left`, `depth_left`, `ViewLayer.Depth-left`."""


@dataclass(frozen=True, kw_only=True)
class NamedPart:
    """A part of a file, as far as its header names things.

    Attributes:
        name: of the part, often empty where there is only one.
        channels: names of its channels in the file.
        view: that all of them belong to, empty if the part names none.
        views: that they are told apart by, the default one first (`multiView`).
    """

    name: str
    channels: tuple[str, ...]
    view: str = ""
    views: tuple[str, ...] = ()

    @property
    def base(self) -> str:
        """The name without the view that it begins or ends with."""
        if not self.view:
            return self.name
        if self.name == self.view:
            return ""
        for separator in SEPARATORS:
            name = self.name.removesuffix(separator + self.view)
            name = name.removeprefix(self.view + separator)
            if name != self.name:
                return name
        return self.name

    def find_view(self, channel: str) -> str:
        """View that a channel of the part belongs to, empty if to none.

        It stands before the component; before all the rest only where it does not stand there.
        """
        if self.view or not self.views:
            return self.view
        *layers, _ = channel.split(".")
        if not layers:
            return self.views[0]
        return next((name for name in (layers[-1], layers[0]) if name in self.views), "")


def guess_views(channels: Sequence[str]) -> tuple[str, ...]:
    """Views of a part whose header names none; the one without a name first, or an empty name.

    `R` beside `right.R` is of the left eye; beside `left.R` and `right.R` it is of neither.
    """
    layers = [name.split(".")[:-1] for name in channels if "." in name]
    found = {name for held in layers for name in (held[-1], held[0])}.intersection(STEREO)
    if len(found) == 1 and "R" in channels:
        return (*(view for view in STEREO if view not in found), *found)
    return ("", *sorted(found)) if found else ()


def guess_part_views(parts: Sequence[NamedPart]) -> list[NamedPart]:
    """Add the view that a part's name ends in where its header names none, and its twin is there.

    `rgba.left` beside `rgba.right` is of the left eye.
    """
    names = {part.name for part in parts}
    return [replace(part, view=part.view or _guess_eye(part.name, names)) for part in parts]


def _guess_eye(name: str, names: Collection[str]) -> str:
    for eye, other in (STEREO, STEREO[::-1]):
        stem = name.removesuffix(eye)
        if stem != name and stem.endswith(tuple(SEPARATORS)) and f"{stem}{other}" in names:
            return eye
    return ""


def name_channels(parts: Sequence[NamedPart]) -> list[dict[str, str]]:
    """For each part, channel name in the file -> name for the user.

    The first part, and one without a name, keeps its channels' names, unless its own name tells it
    from its like: one of several samples (`color.0` beside `color.1`), or a pass of a layer
    (`ViewLayer.Combined` beside `ViewLayer.Depth` or `Other.Combined`). In the others `X` of the
    part `normal` is `normal.X`, unless it is called so already. Where parts are of several views,
    the view stands before the last component: `normal.left.X`. Names that are then there twice
    take the name of their part in any case.
    """
    if len(parts) < 2:
        return [{channel: channel for channel in part.channels} for part in parts]
    several = len({part.view for part in parts if part.view}) > 1
    told = _holds_sample(parts[0], parts[1:]) or _is_of_layer(parts[0], parts[1:])
    first = "" if told else parts[0].base
    named = [
        {
            c: _insert_view(_name_in_part(part, c, first), part.view if several else "")
            for c in part.channels
        }
        for part in parts
    ]
    counts = Counter(name for names in named for name in names.values())
    return [
        {
            c: f"{part.name}.{c}" if counts[name] > 1 and part.name else name
            for c, name in names.items()
        }
        for part, names in zip(parts, named, strict=True)
    ]


def _holds_sample(part: NamedPart, others: Sequence[NamedPart]) -> bool:
    """Tell whether a part is one of several samples: `color.0` beside `color.1`."""
    stem, _, number = part.base.rpartition(".")
    rest = [other.base.rpartition(".") for other in others]
    beside = any(s == stem and n.isdecimal() for s, _, n in rest)
    return bool(stem) and number.isdecimal() and beside


def _is_of_layer(part: NamedPart, others: Sequence[NamedPart]) -> bool:
    """Tell whether a part is called `layer.pass`, as another one of its layer, or pass, is."""
    layer, _, of_layer = part.base.rpartition(".")
    rest = [other.base.rpartition(".") for other in others if other.base != part.base]
    like = (other == layer or name == of_layer for other, _, name in rest if other)
    return bool(layer) and any(like)


def _name_in_part(part: NamedPart, channel: str, first: str) -> str:
    base = part.base
    keeps = base in {"", first} or channel == base or channel.startswith(f"{base}.")
    return channel if keeps else f"{base}.{channel}"


def _insert_view(name: str, view: str) -> str:
    *layers, last = name.split(".")
    return name if not view or view in layers else ".".join((*layers, view, last))


def strip_view(channel: str, view: str) -> str:
    """Return a channel's name without its view: `depth.left.Z` is `depth.Z`."""
    *layers, last = channel.split(".")
    if not view or view not in layers:
        return channel
    place = len(layers) - 1 - layers[::-1].index(view)
    return ".".join((*layers[:place], *layers[place + 1 :], last))


def find_views(parts: Sequence[NamedPart], named: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """User's name of a channel -> its view; channels of no view are left out."""
    return {
        user: view
        for part, names in zip(parts, named, strict=True)
        for channel, user in names.items()
        if (view := part.find_view(channel))
    }
