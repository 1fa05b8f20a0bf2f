"""Surveying a sequence by its headers, so that what is wrong is said before work starts."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any

from rtsr_cli.core.captures.bound_channels import Binding
from rtsr_cli.core.captures.camera_rows import CameraRow
from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.channel_tables import build_components
from rtsr_cli.core.captures.color_tags import (
    describe_contradictions,
    find_foreign_tag,
    read_color_space,
)
from rtsr_cli.core.captures.frame_numbers import choose_numbers
from rtsr_cli.core.captures.header_files import HeaderFiles, Headers, read_headers
from rtsr_cli.core.captures.layers import (
    BoundLayers,
    bind_layers,
    list_luminance_layers,
    list_readable,
)
from rtsr_cli.core.captures.layouts import Layout
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.regions import describe_crop, find_region, list_places
from rtsr_cli.core.captures.sample_channels import describe_use, join_samples_into
from rtsr_cli.core.captures.shots import FrameSet
from rtsr_cli.core.captures.surveyed_cameras import CameraSource
from rtsr_cli.core.captures.unrendered_frames import (
    Bind,
    FirstHeaders,
    RenderedBinding,
    bind_rendered,
    describe_lacking_channel,
    leave_out_partial,
    list_partial_streams,
    take_first,
)
from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import ExrHeader
from rtsr_cli.core.files.provenance import is_predicted
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.frames.conventions import Conventions, SpecularWorkflow

LUMINANCE_NOT_READ = (
    "pictures are stored as luminance and chroma (channels Y, RY, BY), which rtsr does not read; "
    "write them as R, G, B"
)


def open_frames(
    frames: FrameSet,
    *,
    headers: Headers | None = None,
    files: HeaderFiles | None = None,
    layout: Layout | None,
    capture: CaptureDeclaration,
    side_car: Mapping[int, CameraRow],
    layer: str | None = None,
    on_missing: MissingPolicy = MissingPolicy.ERROR,
    wanted: frozenset[int] | None = None,
    jittered: bool = True,
    unrendered: bool = False,
    left_out: Collection[int] = (),
) -> FrameReader:
    """Survey a sequence by its headers and bind its buffers.

    Args:
        frames: the files.
        headers: of those that are needed; of all if None.
        files: reads those that are asked for later.
        layout: that is named; the best match if None.
        capture: what the user declares.
        side_car: camera rows by frame number; their matrices replace the headers'.
        layer: layer or view that is read of files with several.
        on_missing: what to do about holes in the numbering.
        wanted: frames that are asked for; holes before and behind them are no matter.
        jittered: whether declared jitter applies to these frames (LR) or not (HR).
        unrendered: whether frames may hold no radiance.
        left_out: frames that are there, and not in `frames`; with policy hold others stand in.

    Raises:
        FrameFolderError: no layout fits, a buffer or frame is missing, sizes differ, or a buffer is
            in several layers.
    """
    files = files or HeaderFiles()
    headers = headers if headers is not None else read_headers(frames, files)

    def bind(first: FirstHeaders) -> BoundLayers:
        _check_usable(frames, first)
        return bind_layers(layout, capture, first, str(frames.root), layer)

    found = bind_rendered(headers, bind) if unrendered else _bind_first(headers, bind)
    found = leave_out_partial(found, headers, bind)
    first, bound = found.first, found.bound
    binding = bound.binding
    if capture.specular is SpecularWorkflow.F0:
        # base colour is then the diffuse colour already, and no metal takes from it
        binding = {b: c for b, c in binding.items() if b is not Buffer.METALLIC}
    samples = {b: several for b, several in bound.samples.items() if b in binding}
    whole = join_samples_into(binding, samples)
    used = sorted({c.stream for components in whole.values() for c in components})
    partial = list_partial_streams(whole) if unrendered else frozenset()
    _check_channels(frames, headers, whole, found.lacking)
    numbers, held = choose_numbers(
        frames,
        used,
        capture.frame_step,
        on_missing,
        wanted=wanted,
        partial=partial,
        left_out=left_out,
    )
    places = list_places({key: headers[key] for key in used}, whole)
    region = find_region(places, str(frames.root), capture.region)
    conventions, contradictions = _settle_colors(frames, headers, binding, capture, found)
    reader = FrameReader(
        frames=frames,
        layout=bound.layout,
        binding=binding,
        conventions=conventions,
        warnings=(*contradictions, *found.warnings),
        region=region,
        places=tuple(places),
        numbers=numbers,
        held=held,
        cameras={},
        step=capture.frame_step,
        filter_width_px=capture.filter_width_px,
        channels={key: {n: h.channels for n, h in by_n.items()} for key, by_n in headers.items()},
        subsampled={key: header.subsampled for key, header in first.items()},
        header_of=files.of,
        views={key: header.views for key, header in first.items()},
        layers=bound.layers,
        layer=bound.layer,
        matrices=capture.camera.matrices,
        notes=(
            *bound.notes,
            *found.notes,
            *describe_use(samples),
            *_list_notes(first),
            *describe_crop(places, region),
            *_list_unread(bound.layout, binding, first),
            *_list_elsewhere(frames, bound.layout, binding, capture),
        ),
        lacking=found.lacking,
        partial=found.partial,
        partial_said=found.warnings,
        samples=samples,
        sample_fault=bound.sample_fault,
    )
    main = _choose_headers(reader, headers)
    foreign_tag = _find_foreign_tag(reader, capture, headers)
    cameras = CameraSource(reader, files, capture, side_car, jittered=jittered)
    predicted = {
        n for n in numbers if (h := main.get(held.get(n, n))) and is_predicted(h.attributes)
    }
    return replace(
        reader,
        cameras=cameras.survey(main),
        cuts=cameras.list_cuts(),
        foreign_tag=foreign_tag,
        predicted=frozenset(predicted),
    )


def _bind_first(headers: Headers, bind: Bind) -> RenderedBinding:
    """Bind by the first file of each sequence, which all others have to be like."""
    first = take_first(headers)
    return RenderedBinding(bound=bind(first), first=first)


def _choose_headers(reader: FrameReader, headers: Headers) -> Mapping[int, ExrHeader]:
    """Header of every frame: of radiance's file, or of another where a frame has no such."""
    main = headers[reader.main_stream]
    if not reader.lacking:
        return main
    others = (headers[c.stream] for parts in reader.binding.values() for c in parts)
    return dict(ChainMap(dict(main), *map(dict, others)))


def _list_colored(
    headers: Headers, binding: Binding, lacking: Collection[int]
) -> list[Mapping[str, Any]]:
    """Attributes of the files that hold radiance."""
    by_number = headers[binding[Buffer.COLOR][0].stream]
    return [header.attributes for n, header in by_number.items() if n not in lacking]


def _settle_colors(
    frames: FrameSet,
    headers: Headers,
    binding: Binding,
    capture: CaptureDeclaration,
    found: RenderedBinding,
) -> tuple[Conventions, tuple[str, ...]]:
    """Conventions with the primaries that files name, and what contradicts how they are read."""
    conventions = capture.conventions(found.bound.layout.conventions)
    if Buffer.COLOR not in binding:
        return conventions, ()
    attributes = _list_colored(headers, binding, found.lacking.get(Buffer.COLOR, ()))
    declared = conventions.colorspace is not None
    if not declared:
        space = read_color_space(attributes, str(frames.root))
        conventions = replace(conventions, colorspace=space)
    contradictions = describe_contradictions(attributes, conventions.colorspace, declared=declared)
    return conventions, contradictions


def _find_foreign_tag(reader: FrameReader, capture: CaptureDeclaration, headers: Headers) -> str:
    """Name the tag of radiance that is no space rtsr converts, if nothing is declared."""
    if capture.colorspace is not None or Buffer.COLOR not in reader.binding:
        return ""
    return find_foreign_tag(_list_colored(headers, reader.binding, reader.unrendered))


def _list_notes(first: Mapping[str, ExrHeader]) -> tuple[str, ...]:
    held = any(list_luminance_layers(header) for header in first.values())
    return (LUMINANCE_NOT_READ,) if held else ()


def _list_unread(layout: Layout, binding: Binding, first: Mapping[str, ExrHeader]) -> Iterator[str]:
    """Say of what a layout knows and does not read why that is so."""
    found = layout.list_unread({key: header.channels for key, header in first.items()})
    said = {
        unread.why: name for name, unread in reversed(found.items()) if unread.unless not in binding
    }
    yield from (f"'{name}' is not read: {why}" for why, name in said.items())


def _list_elsewhere(
    frames: FrameSet, layout: Layout, binding: Binding, capture: CaptureDeclaration
) -> Iterator[str]:
    """Say which buffers `[buffers]` makes of channels that the other resolution alone has."""
    for buffer, declared in build_components(capture.buffers).items():
        if buffer in binding and layout.buffers[buffer] != declared:
            names = binding[buffer].describe(streams=False)
            yield (
                f"'{buffer}' of {frames.root} is read as layout '{layout.name}' has it ({names}): "
                "none of these files holds what is declared in [buffers]"
            )


def _check_usable(frames: FrameSet, first: Mapping[str, ExrHeader]) -> None:
    if any(list_readable(header) for header in first.values()):
        return
    if any(list_luminance_layers(header) for header in first.values()):
        raise FrameFolderError(f"{frames.root}: {LUMINANCE_NOT_READ}")
    subsampled = sorted({c for header in first.values() for c in header.subsampled})
    raise FrameFolderError(
        f"{frames.root}: every channel ({', '.join(subsampled)}) is subsampled; write channels of "
        "the full size (R, G, B)"
    )


def _check_channels(
    frames: FrameSet,
    headers: Headers,
    binding: Binding,
    lacking_at: Mapping[Buffer, Collection[int]],
) -> None:
    for buffer, components in binding.items():
        spared = lacking_at.get(buffer, ())
        for c in components:
            by_number = {n: h for n, h in headers[c.stream].items() if n not in spared}
            lacking = [n for n, h in by_number.items() if c.channel not in h.channels]
            if lacking:
                one = len(lacking) == 1
                why = describe_lacking_channel(c.channel, lacking, by_number)
                raise FrameFolderError(
                    f"{frames.root}, {say_frames(lacking)}: buffer '{buffer}' is missing ({why}); "
                    f"render {'this frame' if one else 'these frames'} again, or leave "
                    f"{'it' if one else 'them'} out: --on-missing skip"
                )
            view = next(iter(by_number.values())).views.get(c.channel)
            others = [n for n, h in by_number.items() if h.views.get(c.channel) != view]
            if others:
                raise FrameFolderError(
                    f"{frames.root}, {say_frames(others)}: buffer '{buffer}' (channel "
                    f"'{c.channel}') is of another view than in other frames; write all frames "
                    "with the same views"
                )
