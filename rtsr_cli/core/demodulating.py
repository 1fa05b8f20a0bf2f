"""Running demodulation over folders: radiance -> lighting, material, emission; and back."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import torch

from rtsr_cli.core.derive import DerivationConfig, derive_material, derive_sky, needs
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging import demodulation as dm
from rtsr_cli.core.io.atomic import remove_leftovers
from rtsr_cli.core.io.exr import read_header, write_exr
from rtsr_cli.core.io.nonfinite import NonfinitePolicy, checked
from rtsr_cli.core.io.outputs import (
    OutputState,
    buffer_channels,
    image_channels,
    output_name,
    output_state,
    refuse_foreign,
    refuse_inputs,
)
from rtsr_cli.core.io.provenance import FileDigests, color_tag, config_digest, digest, provenance
from rtsr_cli.core.io.reading import FrameReader
from rtsr_cli.core.io.selection import Selection
from rtsr_cli.core.io.streaming import BackgroundWriter, prefetch, read_ahead
from rtsr_cli.core.shapes import Color, Mask

COMMAND = "demodulate"


@dataclass(frozen=True, kw_only=True)
class DemodulateOptions:
    """How to run.

    Attributes:
        derivation: the divisor.
        inverse: multiply back instead.
        full: write float instead of half.
        jobs: threads that read, and threads that write.
        overwrite: replace stale and foreign files.
        on_nonfinite: policy for NaN and Inf.
        selection: which frames are written.
    """

    derivation: DerivationConfig = field(default_factory=DerivationConfig)
    inverse: bool = False
    full: bool = False
    jobs: int = 2
    overwrite: bool = False
    on_nonfinite: NonfinitePolicy = NonfinitePolicy.ERROR
    selection: Selection = field(default_factory=Selection)


@dataclass(frozen=True, kw_only=True)
class FrameReport:
    """What became of a frame.

    Attributes:
        error: largest recomposition error relative to max(|c|, 1e-3), as the file stores it.
        undivided: share of the pixels with mask 0.
        kept: True if the output was there already.
        failed: message, empty if all went well.
    """

    shot: str
    number: int
    path: Path
    error: float = 0.0
    undivided: float = 0.0
    kept: bool = False
    failed: str = ""


@dataclass(frozen=True, kw_only=True)
class DemodulatePlan:
    """One frame set, checked and ready."""

    name: str
    reader: FrameReader
    folder: Path
    read: frozenset[Buffer]
    selected: tuple[int, ...]
    pending: tuple[int, ...]
    config_hash: str
    digests: FileDigests

    def path(self, number: int) -> Path:
        """Return the output of a frame."""
        return self.folder / output_name(self.reader, number)

    def stamp(self, number: int) -> str:
        """Return the stamp of an output."""
        content = self.digests.of_all(self.reader.files(number, self.read))
        return digest(self.config_hash, content, self.reader.camera_values(number))


def plan_frames(
    name: str, reader: FrameReader, folder: Path, options: DemodulateOptions
) -> DemodulatePlan:
    """Check one frame set: buffers that are missing, outputs that are in the way.

    Raises:
        RtsrError: before anything is computed.
    """
    wanted = (
        (Buffer.LIGHTING, Buffer.MATERIAL)
        if options.inverse
        else (Buffer.COLOR, Buffer.MATERIAL, Buffer.SKY)
    )
    stored = reader.stored if options.inverse else reader.stored - {Buffer.LIGHTING}
    resolved = needs(wanted, stored, has_camera=reader.has_camera, config=options.derivation)
    if resolved.missing:
        raise FrameFolderError(
            f"{reader.frames.root}: cannot {'recompose' if options.inverse else 'demodulate'}, "
            f"missing: {', '.join(resolved.missing)}. Layout '{reader.layout.name}' found: "
            f"{', '.join(sorted(reader.stored))}. Render what is missing, give a camera "
            "side-car in capture.toml, or choose another --mode"
        )
    emission = {Buffer.EMISSION} & set(reader.stored)
    plan = DemodulatePlan(
        name=name,
        reader=reader,
        folder=folder,
        read=resolved.read | emission,
        selected=options.selection.of(reader.numbers),
        pending=(),
        config_hash=config_digest(
            COMMAND,
            asdict(options.derivation),
            options.inverse,
            options.full,
            options.on_nonfinite,
            reader.declaration,
        ),
        digests=FileDigests(),
    )
    refuse_inputs([plan.path(n) for n in plan.selected], [reader])
    states = {n: _state(plan, n) for n in plan.selected}
    if not options.overwrite:
        foreign = [plan.path(n) for n, s in states.items() if s is OutputState.FOREIGN]
        refuse_foreign(foreign, f"rtsr {COMMAND}")
    return replace(plan, pending=tuple(n for n, s in states.items() if s is not OutputState.DONE))


def _state(plan: DemodulatePlan, number: int) -> OutputState:
    """State of one output; inputs are hashed only where it is there."""
    path = plan.path(number)
    return output_state(path, plan.stamp(number)) if path.exists() else OutputState.ABSENT


def run_frames(plan: DemodulatePlan, options: DemodulateOptions) -> Iterator[FrameReport]:
    """Compute and write what is pending; yield a report for every selected frame."""
    for number in set(plan.selected) - set(plan.pending):
        yield FrameReport(shot=plan.name, number=number, path=plan.path(number), kept=True)
    if not plan.pending:
        return
    remove_leftovers(plan.folder)

    def work(number: int) -> tuple[FrameReport, Mapping[str, Any]]:
        frame, _ = checked(plan.reader.read(number, plan.read), options.on_nonfinite)
        report = FrameReport(shot=plan.name, number=number, path=plan.path(number))
        return (
            _recomposed(frame, report, options)
            if options.inverse
            else _divided(frame, report, options)
        )

    ahead = read_ahead(options.jobs, plan.reader.frame_bytes)
    with BackgroundWriter[FrameReport](options.jobs) as writer:
        for number, future in prefetch(work, plan.pending, ahead):
            error = future.exception()
            if isinstance(error, FrameFolderError):
                yield FrameReport(
                    shot=plan.name, number=number, path=plan.path(number), failed=str(error)
                )
                continue
            report, channels = future.result()
            writer.submit(report, _write(plan, number, channels))
            yield from _written(writer, wait=False)
        yield from _written(writer, wait=True)


def _written(writer: BackgroundWriter[FrameReport], *, wait: bool) -> Iterator[FrameReport]:
    for report, error in writer.done(wait=wait):
        if error is not None:
            raise error
        yield report


def _write(plan: DemodulatePlan, number: int, channels: Mapping[str, Any]) -> Any:
    source = plan.reader.path(number)
    attributes = {
        **read_header(source).attributes,
        **provenance(
            command=COMMAND,
            config_hash=plan.config_hash,
            source=source,
            stamp=plan.stamp(number),
            extra=color_tag(plan.reader.conventions),
        ),
    }

    def write() -> None:
        write_exr(
            plan.path(number),
            channels,
            attributes=attributes,
            data_window=plan.reader.region,
            display_window=plan.reader.display,
        )

    return write


def as_stored(image: Color, *, full: bool) -> Color:
    """Return the values that a file will hold."""
    return image if full else image.half().float()


def _divided(
    frame: Frame, report: FrameReport, options: DemodulateOptions
) -> tuple[FrameReport, Mapping[str, Any]]:
    """Demodulate one frame; divisor and emission are rounded before the division, not after.

    Only the quotient's own rounding is then left in the recomposed radiance.
    """
    full = options.full
    radiance = frame.gbuffer[Buffer.COLOR]
    parts = divide(frame, options.derivation, full=full)
    lighting = as_stored(parts.lighting, full=full)
    recomposed = dm.remodulate(lighting, parts.material, parts.emission)
    channels = {
        **buffer_channels(Buffer.LIGHTING, lighting, full=full),
        **buffer_channels(Buffer.MATERIAL, parts.material, full=full),
        "mask": buffer_channels(Buffer.LIGHTING_MASK, parts.mask)[Buffer.LIGHTING_MASK.value],
    }
    if parts.emission is not None:
        channels |= buffer_channels(Buffer.EMISSION, parts.emission, full=full)
    return replace(
        report,
        error=dm.recomposition_error(radiance, recomposed),
        undivided=float(1.0 - parts.mask.mean()),
    ), channels


def divide(frame: Frame, config: DerivationConfig, *, full: bool) -> dm.Demodulated:
    """Demodulate with a divisor and an emission that a file can hold exactly."""
    softplus = config.mode is dm.DemodulationMode.SOFTPLUS
    material = as_stored(derive_material(frame, config), full=full)
    sky: Mask = torch.zeros_like(material[:, :1]) if softplus else derive_sky(frame.gbuffer)
    emission = None if softplus else frame.gbuffer.buffers.get(Buffer.EMISSION)
    radiance = frame.gbuffer[Buffer.COLOR]
    parts = dm.demodulate(radiance, material, sky=sky, emission=emission, epsilon=config.epsilon)
    if parts.emission is None:
        return parts
    stored = as_stored(parts.emission, full=full)
    reflected = (radiance - stored).clamp(min=0.0)
    # where rounding lifts emission above radiance the difference is below the file's precision
    return replace(parts, emission=stored, lighting=reflected / parts.material)


def _recomposed(
    frame: Frame, report: FrameReport, options: DemodulateOptions
) -> tuple[FrameReport, Mapping[str, Any]]:
    gbuffer = frame.gbuffer
    radiance = dm.remodulate(
        gbuffer[Buffer.LIGHTING],
        gbuffer[Buffer.MATERIAL],
        gbuffer.buffers.get(Buffer.EMISSION),
    )
    return report, image_channels("", radiance, "RGB", full=options.full)
