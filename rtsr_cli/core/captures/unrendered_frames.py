"""Sequences some of whose frames were not rendered: their files hold a G-buffer and no radiance.

What is read is bound by two frames, one of each kind, so that it does not matter which comes first,
nor what else either kind holds.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from rtsr_cli.core.captures.bound_channels import Binding, BoundChannel
from rtsr_cli.core.captures.header_files import Headers
from rtsr_cli.core.captures.layers import BoundLayers
from rtsr_cli.core.errors import FrameFolderError, find_close
from rtsr_cli.core.files.exr import ExrHeader
from rtsr_cli.core.frames.buffers import RADIANCE_BUFFERS, Buffer
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.wording import say_missing

FirstHeaders = Mapping[str, ExrHeader]
"""Per file sequence, what stands for its files."""

Bind = Callable[[FirstHeaders], BoundLayers]
"""Finds the buffers among the channels of some files."""


@dataclass(frozen=True, kw_only=True)
class RenderedBinding:
    """How the buffers of a sequence are bound, rendered frames and others together.

    Attributes:
        bound: layout and channels.
        first: what stands for the files of each sequence.
        lacking: buffer -> frames that do not hold it: radiance, and what is not bound since one
            kind of frames has it alone, or some frames have it not.
        partial: those of them that some frames have not, of whatever kind.
        notes: of what one kind of frames has alone, for the user.
        warnings: of what some frames have not.
    """

    bound: BoundLayers
    first: FirstHeaders
    lacking: Mapping[Buffer, frozenset[int]] = field(default_factory=dict)
    partial: Mapping[Buffer, frozenset[int]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()


def take_first(headers: Headers) -> dict[str, ExrHeader]:
    """Let the first file of a sequence stand for all of its files."""
    return {key: next(iter(by_number.values())) for key, by_number in headers.items()}


def bind_rendered(headers: Headers, bind: Bind) -> RenderedBinding:
    """Bind by a rendered frame and, where the first frame is none, by the first one, too.

    Args:
        headers: of all files that are of interest.
        bind: finds buffers.

    Raises:
        FrameFolderError: as `bind`.
    """
    first: FirstHeaders = take_first(headers)
    bound, error = _try_binding(bind, first)
    if bound is None or Buffer.COLOR not in bound.binding:
        found = _bind_by_later_frames(headers, bind, first)
        if found is None and error is not None:
            raise error
        bound, first = found or (bound, first)
    assert bound is not None
    lacking = list_lacking(headers, bound.binding)
    unrendered = lacking.get(Buffer.COLOR, frozenset())
    apart = _list_kept_apart(headers, lacking, unrendered)
    binding = {b: parts for b, parts in bound.binding.items() if b not in apart}
    return RenderedBinding(
        bound=replace(bound, binding=binding),
        first=first,
        lacking={b: n for b, n in lacking.items() if b in RADIANCE_BUFFERS or b in apart},
        notes=tuple(
            f"buffer '{b}' is not read: {say_frames(lacking[b])} "
            f"{'has' if len(lacking[b]) == 1 else 'have'} none"
            for b in apart
        ),
    )


def _try_binding(
    bind: Bind, first: FirstHeaders
) -> tuple[BoundLayers | None, FrameFolderError | None]:
    try:
        return bind(first), None
    except FrameFolderError as error:
        return None, error


def _bind_by_later_frames(
    headers: Headers, bind: Bind, first: FirstHeaders
) -> tuple[BoundLayers, FirstHeaders] | None:
    """Bind by the first files and those of the first frame with radiance; None without one."""
    joined = {key: join_headers(by_number.values()) for key, by_number in headers.items()}
    if all(joined[key].channels == header.channels for key, header in first.items()):
        return None
    whole, _ = _try_binding(bind, joined)
    if whole is None or Buffer.COLOR not in whole.binding:
        return None
    color = {(c.stream, c.channel) for c in whole.binding[Buffer.COLOR]}
    shown = {
        key: join_headers([header, *_find_holder(headers[key], [c for s, c in color if s == key])])
        for key, header in first.items()
    }
    bound, _ = _try_binding(bind, shown)
    return None if bound is None else (bound, shown)


def _find_holder(by_number: Mapping[int, ExrHeader], channels: list[str]) -> list[ExrHeader]:
    """The first header that holds some channels; none where there are no channels."""
    holders = (h for h in by_number.values() if channels and h.channels.issuperset(channels))
    return [header for _, header in zip(range(1), holders, strict=False)]


def join_headers(headers: Iterable[ExrHeader]) -> ExrHeader:
    """Return the first header with the channels of all."""
    first, *others = headers
    joined = first
    for other in others:
        if not other.channels <= joined.channels:
            joined = replace(
                joined,
                channels=joined.channels | other.channels,
                subsampled=joined.subsampled | other.subsampled,
                views={**other.views, **joined.views},
            )
    return joined


def list_lacking(headers: Headers, binding: Binding) -> dict[Buffer, frozenset[int]]:
    """Return the frames that lack a channel of a buffer; buffers that none lacks are left out."""
    used = {c.stream for parts in binding.values() for c in parts}
    numbers = {n for key in used for n in headers[key]}
    lacking = {}
    for buffer, parts in binding.items():
        places = {(c.stream, c.channel) for c in parts}
        without = {
            n
            for n in numbers
            if any(n not in headers[s] or c not in headers[s][n].channels for s, c in places)
        }
        if without:
            lacking[buffer] = frozenset(without)
    return lacking


def _list_kept_apart(
    headers: Headers, lacking: Mapping[Buffer, frozenset[int]], unrendered: frozenset[int]
) -> list[Buffer]:
    """Buffers beside radiance that all rendered frames lack, or all others, and no frame else."""
    rendered = frozenset(n for by_number in headers.values() for n in by_number) - unrendered
    if not unrendered or not rendered:
        return []
    return [
        buffer
        for buffer, without in lacking.items()
        if buffer not in RADIANCE_BUFFERS and without in (rendered, unrendered)
    ]


def leave_out_partial(found: RenderedBinding, headers: Headers, bind: Bind) -> RenderedBinding:
    """Bind no buffer that the files of some frames lack: the rest can be read of every frame.

    Radiance stays bound, and a frame without it is refused by whoever takes it for rendered.

    Args:
        found: as bound by some files of each sequence.
        headers: of all files that are of interest.
        bind: finds buffers.
    """
    whole = found.bound.binding
    joined = {key: join_headers(by_number.values()) for key, by_number in headers.items()}
    if any(joined[key].channels != header.channels for key, header in found.first.items()):
        other, _ = _try_binding(bind, joined)
        if other is not None and other.layout == found.bound.layout:
            whole = {**other.binding, **whole}
    unheld = {
        buffer: without
        for buffer, parts in whole.items()
        if buffer not in RADIANCE_BUFFERS | found.lacking.keys()
        and (without := _list_without(headers, parts))
    }
    binding = {b: parts for b, parts in found.bound.binding.items() if b not in unheld}
    return replace(
        found,
        bound=replace(found.bound, binding=binding),
        lacking={**found.lacking, **unheld},
        partial=unheld,
        warnings=_describe_partial(whole, headers, unheld),
    )


def _list_without(headers: Headers, parts: Iterable[BoundChannel]) -> frozenset[int]:
    """Frames whose files are there and lack a channel."""
    return frozenset(
        n for c in parts for n, h in headers[c.stream].items() if c.channel not in h.channels
    )


def _describe_partial(
    binding: Binding, headers: Headers, unheld: Mapping[Buffer, frozenset[int]]
) -> tuple[str, ...]:
    """Say which frames lack which channel, once for all buffers that it is part of."""
    grouped: dict[tuple[frozenset[int], BoundChannel], list[Buffer]] = {}
    for buffer, without in unheld.items():
        held = next(c for c in binding[buffer] if _list_without(headers, (c,)))
        grouped.setdefault((without, held), []).append(buffer)
    return tuple(
        _say_partial(
            without, buffers, describe_lacking_channel(held.channel, without, headers[held.stream])
        )
        for (without, held), buffers in grouped.items()
    )


def describe_lacking_channel(
    channel: str, without: Collection[int], headers: Mapping[int, ExrHeader]
) -> str:
    """Say that some frames lack a channel, and which of theirs may be it by another name.

    Args:
        channel: that they lack.
        without: numbers of the frames that lack it.
        headers: of the file sequence that holds it, by frame.
    """
    held = [header.channels for number, header in headers.items() if number in without]
    others = [header.channels for number, header in headers.items() if number not in without]
    instead = frozenset.intersection(*held).difference(*others)
    one = len(without) == 1
    renamed = "".join(
        f", which {'has' if one else 'have'} '{name}' in its place: renamed?"
        for name in find_close(channel, sorted(instead))
    )
    which = "this one" if one else "these"
    return f"channel '{channel}' is in the other frames, not in {which}{renamed}"


def _say_partial(without: frozenset[int], buffers: Sequence[Buffer], lacking: str) -> str:
    one = len(without) == 1
    return (
        f"{say_frames(without)}: {say_missing(buffers)} ({lacking}), so that "
        f"{'they are' if len(buffers) > 1 else 'it is'} not used in any frame; render "
        f"{'this frame' if one else 'these frames'} again, or leave {'it' if one else 'them'} out: "
        "--on-missing skip"
    )


def list_partial_streams(binding: Binding) -> frozenset[str]:
    """File sequences that hold radiance alone: frames that were not rendered have no such file."""
    radiance: set[str] = set()
    others: set[str] = set()
    for buffer, parts in binding.items():
        (radiance if buffer in RADIANCE_BUFFERS else others).update(c.stream for c in parts)
    return frozenset(radiance - others) if others else frozenset()
