"""Layers and stereo views: what one file holds of the same thing twice, and which is read.

A file can hold several view layers or groups of channels of one meaning (`channel_matching` finds
those), and several views, which its header tells apart. Buffers are bound by names without their
view, one view at a time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from rtsr_cli.core.captures.bound_channels import Binding
from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.channel_matching import UNNAMED, make_layer_error, match_layout
from rtsr_cli.core.captures.channel_tables import build_components
from rtsr_cli.core.captures.layout_files import choose_layout
from rtsr_cli.core.captures.layouts import Layout
from rtsr_cli.core.captures.sample_channels import (
    Samples,
    bind_samples,
    number_names,
    strip_samples,
)
from rtsr_cli.core.errors import FrameFolderError, LayerChoiceError, did_you_mean
from rtsr_cli.core.files.channel_names import strip_view
from rtsr_cli.core.files.exr import ExrHeader
from rtsr_cli.core.frames.buffers import Buffer

LUMINANCE, CHROMA = "Y", frozenset({"RY", "BY"})
"""Channels of pictures that are stored as luminance, and as chroma of a quarter of the samples."""


@dataclass(frozen=True, kw_only=True)
class BoundLayers:
    """How a frame set's buffers are bound.

    Attributes:
        layout: of the names.
        binding: where each buffer is.
        layers: names of the layers and views that there are.
        layer: that is read, empty where the files name none.
        notes: for the user.
        samples: of the buffers whose channels hold a sample each.
        sample_fault: why these cannot be read, where pixels can.
    """

    layout: Layout
    binding: Binding
    layers: tuple[str, ...] = ()
    layer: str = ""
    notes: tuple[str, ...] = ()
    samples: Samples = field(default_factory=dict)
    sample_fault: str = ""


Headers = Mapping[str, ExrHeader]
"""Per file sequence, the header of one file."""


def list_readable(header: ExrHeader) -> frozenset[str]:
    """Channels of a file that can be read; of luminance and chroma nothing can."""
    whole = header.channels - header.subsampled
    of_pictures = {
        f"{layer}{end}"
        for layer in list_luminance_layers(header)
        for end in (LUMINANCE, *CHROMA, "A")
    }
    return whole - of_pictures


def list_luminance_layers(header: ExrHeader) -> frozenset[str]:
    """Beginnings of channels' names (`layer.`) that hold luminance and chroma, of any size."""
    ends = [(name, end) for name in header.channels for end in CHROMA]
    layers = {name.removesuffix(end) for name, end in ends if f".{name}".endswith(f".{end}")}
    return frozenset(layer for layer in layers if _holds_chroma(header, layer))


def _holds_chroma(header: ExrHeader, layer: str) -> bool:
    """Tell whether a layer has luminance, and both of chroma, or one that is subsampled."""
    chroma = {f"{layer}{end}" for end in CHROMA} & header.channels
    complete = len(chroma) == len(CHROMA) or bool(chroma & header.subsampled)
    return complete and f"{layer}{LUMINANCE}" in header.channels


def list_plain_names(header: ExrHeader) -> frozenset[str]:
    """Names of a file's channels, and without their views, and without numbers of samples."""
    views = header.views
    plain = header.channels | {strip_view(c, views[c]) for c in header.channels if c in views}
    return plain | strip_samples(plain)


def join_layer(layer: str | None, view: str | None) -> str | None:
    """Return the name of a layer's view: `layer.view`, or the one that is named."""
    if layer is None or view is None:
        return layer or view
    return layer if f".{layer}".endswith(f".{view}") else f"{layer}.{view}"


def bind_layers(
    named: Layout | None,
    capture: CaptureDeclaration,
    headers: Headers,
    where: str,
    layer: str | None,
) -> BoundLayers:
    """Choose the layout of a frame set, and find the buffers of one of its layers.

    Args:
        named: preset or layout file that is named, or None to detect one.
        capture: what the user declares; its `layout` and `layer` are not looked at.
        headers: of one file of each sequence.
        where: folder, for messages.
        layer: that the user asks for: a layer, a view, or `layer.view`.

    Raises:
        LayerChoiceError: several hold the same buffer, and none is asked for.
        FrameFolderError: no layout fits, several do, or there is no layer of that name.
    """
    views = sorted({v for h in headers.values() for v in h.views.values()})
    chosen, rest = _split_layer(layer, views)
    own = _list_own_names(named, capture)
    view = chosen or (views[0] if len(views) == 1 else "")
    try:
        if chosen is None and len(views) > 1:
            return _bind_the_only_view(named, capture, headers, where, (views, own, layer))
        bound = _bind_view(named, capture, _list_view(headers, view, own), where, rest)
        return _with_views(bound, views, view, layer, where)
    except FrameFolderError as error:
        if layer is None or rest is None or _is_layer(rest, headers):
            raise
        names = _list_view(headers, view or "".join(views[:1]), own)
        choices = _list_choices(named, capture, names, where, views)
        if not choices:
            raise
        raise _make_unknown_error(layer, choices, where) from error


def _split_layer(layer: str | None, views: Sequence[str]) -> tuple[str | None, str | None]:
    """Return the view and the layer that a name stands for: `left`, `Layer`, or `Layer.left`."""
    for view in views:
        if layer == view:
            return view, None
        if layer is not None and layer.endswith(f".{view}"):
            return view, layer.removesuffix(f".{view}")
    return None, layer


def _is_layer(name: str, headers: Headers) -> bool:
    """Tell whether some channel is of a layer of that name."""
    channels = (channel for header in headers.values() for channel in header.channels)
    return name == UNNAMED or any(f".{name}." in f".{channel}" for channel in channels)


def _list_choices(
    named: Layout | None,
    capture: CaptureDeclaration,
    names: _Names,
    where: str,
    views: Sequence[str],
) -> list[str]:
    """Names of the layers and views that could have been asked for."""
    try:
        layers = _bind_view(named, capture, names, where, None).layers
    except LayerChoiceError as error:
        layers = error.layers
    except FrameFolderError:
        layers = ()
    return [*views, *(f"{layer}.{view}" for layer in layers for view in views)] or [*layers]


def _list_own_names(named: Layout | None, capture: CaptureDeclaration) -> frozenset[str]:
    """Channels that the user may have spelled out with their view."""
    own = {**({} if named is None else named.buffers), **build_components(capture.buffers)}
    return frozenset(t.place.channel for parts in own.values() for c in parts for t in c.terms)


_Names = Mapping[str, Mapping[str, str]]
"""Per file sequence, plain name -> channel."""


def _list_view(headers: Headers, view: str, own: Collection[str]) -> _Names:
    """Channels of a view and of none, without it in their names; with it where that is spelled."""
    names: dict[str, dict[str, str]] = {}
    for key, header in headers.items():
        readable = list_readable(header)
        found: dict[str, str] = {}
        for channel in sorted(readable):
            plain = strip_view(channel, header.views.get(channel, ""))
            if plain != channel and channel in own:
                found[channel] = channel
            shown = header.views.get(channel, view) == view
            # what names its view comes before what belongs to it as the default one
            if shown and (plain != channel or plain not in found):
                found[plain] = channel
        names[key] = found
    return names


def _bind_view(
    named: Layout | None,
    capture: CaptureDeclaration,
    names: _Names,
    where: str,
    layer: str | None,
) -> BoundLayers:
    """Bind what a view holds; of a layer, what its names hold without it where that is more."""
    inside = {} if layer is None else _list_inside(names, layer)
    unknown: FrameFolderError | None = None
    bound: BoundLayers | None = None
    try:
        bound = _bind_names(named, capture, names, where, layer)
        if not inside or layer is None:
            return bound
    except FrameFolderError as error:
        if not inside:
            raise
        unknown = error
    try:
        other = _bind_names(named, capture, inside, where, None)
    except FrameFolderError as error:
        if bound is not None and bound.layer:
            return bound
        raise unknown or error from error
    if isinstance(unknown, LayerChoiceError) and len(other.binding) == 1:
        # a group of one buffer is no choice for the others
        raise unknown
    if bound is not None and bound.layer and len(bound.binding) >= len(other.binding):
        return bound
    layers = bound.layers if bound is not None and layer in bound.layers else (str(layer),)
    return replace(other, layers=layers, layer=str(layer))


def _list_inside(names: _Names, layer: str) -> _Names:
    """Channels that a layer begins, by their names without it."""
    before = f"{layer}."
    inside = {
        key: {n.removeprefix(before): c for n, c in found.items() if n.startswith(before)}
        for key, found in names.items()
    }
    return {key: found for key, found in inside.items() if found}


def _bind_names(
    named: Layout | None,
    capture: CaptureDeclaration,
    names: _Names,
    where: str,
    layer: str | None,
) -> BoundLayers:
    numbered = number_names(names, _list_own_names(named, capture))
    streams = {key: frozenset({*found, *numbered.get(key, ())}) for key, found in names.items()}
    layout, binding = choose_layout(named, capture, streams, where, layer)
    matched = match_layout(layout, streams, layer)
    if layer is not None and matched.layers and not matched.knows(layer):
        raise _make_unknown_error(layer, matched.layers, where)
    read = matched.scope or (layer if layer is not None and matched.knows(layer) else "")
    notes = () if layer is None or read else (_describe_no_layers(layer),)
    try:
        pixels = bind_samples(binding, numbered, names)
    except ValueError as error:
        raise FrameFolderError(f"{where}: {error}") from error
    return BoundLayers(
        layout=layout,
        binding=pixels.binding,
        layers=matched.layers,
        layer=read,
        notes=notes,
        samples=pixels.samples,
        sample_fault=pixels.fault,
    )


def _describe_no_layers(layer: str) -> str:
    return (
        f"layer '{layer}' is asked for, but these files have no layers; they are read as they are"
    )


def _make_unknown_error(layer: str, layers: Sequence[str], where: str) -> FrameFolderError:
    return FrameFolderError(f"{where}: no layer is called '{layer}'{did_you_mean(layer, layers)}")


def _with_views(
    bound: BoundLayers, views: Sequence[str], view: str, layer: str | None, where: str
) -> BoundLayers:
    """Add the views to what was bound of one of them."""
    if not views:
        return bound
    if bound.notes and layer is not None:
        raise _make_unknown_error(layer, views, where)
    read = ".".join(name for name in (bound.layer, view) if name)
    scopes = bound.layers or ("",)
    names = tuple(".".join(n for n in (s, v) if n) for s in scopes for v in views)
    return replace(bound, layers=names, layer=read)


def _bind_the_only_view(
    named: Layout | None,
    capture: CaptureDeclaration,
    headers: Headers,
    where: str,
    asked: tuple[Sequence[str], Collection[str], str | None],
) -> BoundLayers:
    """Bind what several views hold, as long as no two of them hold the same buffer.

    Raises:
        LayerChoiceError: two of them do; names the choices.
    """
    views, own, layer = asked
    bound: dict[str, BoundLayers] = {}
    errors: list[FrameFolderError] = []
    for view in views:
        try:
            names = _list_view(headers, view, own)
            bound[view] = _bind_view(named, capture, names, where, layer)
        except FrameFolderError as error:
            errors.append(error)
    if not bound:
        raise _name_views(errors[0], views, where)
    rivals: dict[Buffer, Sequence[str]] = dict(_list_rival_views(bound))
    if rivals:
        raise make_layer_error(rivals, where)
    most = max(bound.values(), key=lambda b: len(b.binding))
    if most.notes and layer is not None:
        raise _make_unknown_error(layer, views, where)
    merged = {b: parts for one in bound.values() for b, parts in one.binding.items()}
    return replace(most, binding=merged, layers=tuple(views), layer=layer or "")


def _name_views(error: FrameFolderError, views: Sequence[str], where: str) -> FrameFolderError:
    """Return what is wrong with every view; of layers to choose from, each with each view."""
    if not isinstance(error, LayerChoiceError):
        return error
    choices = [f"{layer}.{view}" for layer in error.layers for view in views]
    return make_layer_error({Buffer(error.buffer): choices}, where)


def _list_rival_views(bound: Mapping[str, BoundLayers]) -> Iterator[tuple[Buffer, Sequence[str]]]:
    """Buffers that views hold in channels of their own, each with the names of the choices."""
    names = {view: ".".join(n for n in (one.layer, view) if n) for view, one in bound.items()}
    for buffer in dict.fromkeys(b for one in bound.values() for b in one.binding):
        places = {
            names[v]: one.binding[buffer] for v, one in bound.items() if buffer in one.binding
        }
        if len(set(places.values())) > 1:
            yield buffer, tuple(places)
