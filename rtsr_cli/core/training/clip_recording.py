"""From EXR sequences to clips: decoded once, kept in a cache that is keyed by content."""

from __future__ import annotations

import math
from collections.abc import Collection, Generator, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.choices import DemodulationMode, NonfinitePolicy
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.ownership import list_foreign, refuse_foreign
from rtsr_cli.core.files.provenance import FileDigests, digest_config, digest_values
from rtsr_cli.core.files.tensor_file import is_whole_tensor_file
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.selection import format_ranges
from rtsr_cli.core.frames.sequence import Frame, FrameSequence
from rtsr_cli.core.frames.storage import round_to_half
from rtsr_cli.core.imaging.demodulation import lighting_scale
from rtsr_cli.core.imaging.derivation import (
    DerivationConfig,
    derive,
    derive_material,
    resolve_needs,
)
from rtsr_cli.core.pairs.auxiliary_radiance import AuxiliaryRadiance
from rtsr_cli.core.pairs.nonfinite import apply_policy
from rtsr_cli.core.pairs.real_pairs import RealPairs
from rtsr_cli.core.pairs.simulation import Simulation, decimate_frame
from rtsr_cli.core.pairs.sources import PairInputs, PairSource
from rtsr_cli.core.pairs.straight_radiance import take_coverage_out
from rtsr_cli.core.system import System
from rtsr_cli.core.training.clip_parts import cut_run
from rtsr_cli.core.training.clips import (
    DERIVED,
    DOUBTS,
    MATERIAL_GAIN,
    SUFFIX,
    Clip,
    ClipFacts,
    leave_out_zeros,
    list_doubts,
    write_clips,
)

RECORDING = "clips-3"
"""What recordings hold; another one is made anew. 2: cameras, 3: pixel filters of LR radiance."""

CLIP_BYTES = 256 << 20
"""Planes of one clip in memory while it is recorded."""

MAX_CLIP_FRAMES = 16

RADIANCE_PARTS = frozenset({Buffer.COLOR, Buffer.LIGHTING, Buffer.LIGHTING_MASK})
"""What HR frames need not give where their radiance lies apart."""

HALF_BYTES = 2

MAX_CHANNELS = 24
"""Channels that a recording holds at most, about."""


@dataclass(frozen=True, kw_only=True)
class RecordedInputs:
    """What is recorded for a system.

    Attributes:
        lr, hr: buffers that it must have at each size, radiance among HR's.
        lr_optional, hr_optional: those that it uses where they are there.
        derivation: what divides radiance.
        scale: S of the LR frames.
        history: frames that go before a target.
        unroll: successive targets of a sample.
        beside: names of further radiance, recorded where it was captured.
        straight: radiance without its coverage, as upscaling shows it to a system.
    """

    lr: tuple[Buffer, ...]
    hr: tuple[Buffer, ...]
    lr_optional: tuple[Buffer, ...]
    hr_optional: tuple[Buffer, ...]
    derivation: DerivationConfig
    scale: int
    history: int
    unroll: int = 1
    beside: tuple[str, ...] = ()
    straight: bool = False


def list_recorded_inputs(system: System, config: object, scale: int) -> RecordedInputs:
    """Return what a system's training reads."""
    if system.learning is None:
        raise FrameFolderError(f"system '{system.name}' has nothing to train")
    reference = system.learning.reference
    return RecordedInputs(
        lr=tuple(dict.fromkeys((*system.lr_inputs, *system.unshaded_inputs))),
        hr=tuple(dict.fromkeys((*system.hr_inputs, *reference))),
        lr_optional=tuple(dict.fromkeys((*system.lr_optional, *system.unshaded_optional))),
        hr_optional=tuple(
            dict.fromkeys((*system.hr_optional, *system.learning.reference_optional, Buffer.ALBEDO))
        ),
        derivation=system.derivation(config),
        scale=scale,
        history=system.history_frames,
        unroll=system.learning.unroll,
        beside=system.learning.beside,
        straight=system.sees_straight,
    )


def list_recorded_buffers(
    required: Sequence[Buffer],
    optional: Sequence[Buffer],
    reader: FrameReader,
    derivation: DerivationConfig,
) -> tuple[Buffer, ...]:
    """Buffers to store, so that everything wanted can be derived from them later."""
    canonical = frozenset(Buffer) - DERIVED

    def available(buffer: Buffer) -> bool:
        config = _without_softening(derivation)
        return not resolve_needs(
            (buffer,), reader.readable, has_camera=reader.has_camera, config=config
        ).missing

    held = frozenset(b for b in canonical if available(b))
    there = [b for b in optional if b in held or b in DERIVED]
    stored = resolve_needs((*required, *there), held, has_camera=False, config=derivation).read
    return tuple(b for b in Buffer if b in stored)


def _without_softening(derivation: DerivationConfig) -> DerivationConfig:
    """Material is stored unsoftened, as softening is done on what is stored."""
    if derivation.mode is DemodulationMode.SOFTPLUS:
        return replace(derivation, mode=DemodulationMode.BRDF)
    return derivation


@dataclass(frozen=True)
class CapturedShot:
    """A shot to train on.

    Attributes:
        source: LR/HR pairs, or captures that LR frames are made from.
        reference: radiance at the target size, where it lies apart from the HR frames.
        beside: further radiance at the target size.
    """

    source: PairSource
    reference: FrameReader | None = None
    beside: tuple[AuxiliaryRadiance, ...] = ()

    @property
    def readers(self) -> tuple[FrameReader, ...]:
        """Every reader behind it."""
        apart = () if self.reference is None else (self.reference,)
        return (*self.source.readers, *apart, *(part.reader for part in self.beside))


def record_clips_of(
    shot: CapturedShot,
    wanted: RecordedInputs,
    *,
    cache: Path,
    policy: NonfinitePolicy,
    overwrite: bool = False,
) -> Generator[str, None, list[Path]]:
    """Return the files of clips of a shot, made now or before; yields what is recorded, before.

    Args:
        shot: its frames.
        wanted: from `list_recorded_inputs`.
        cache: folder of recordings.
        policy: for NaN and Inf.
        overwrite: replace files of others where recordings go.

    Raises:
        RtsrError: a file of others is in the way, a buffer is missing, a file cannot be read or
            written.
    """
    source = shot.source
    root = source.reader.frames.root
    apart = RADIANCE_PARTS if shot.reference is not None else frozenset()
    hr = tuple(b for b in wanted.hr if b not in apart)
    missing = source.missing(PairInputs(lr=wanted.lr, hr=hr, derivation=wanted.derivation))
    if missing:
        raise FrameFolderError(
            f"{root}: cannot be trained on, missing: {', '.join(missing)}. Training needs the "
            f"system's inputs, and radiance at the target size. Found: {_describe_shot(shot)}; "
            "channels of other names are declared under [buffers] in capture.toml ('rtsr inspect' "
            "lists them)"
        )
    key = _hash_recording(shot, wanted, policy)
    parts = list(_cut_parts(source, wanted))
    paths = [cache / f"{key}-{i:04d}{SUFFIX}" for i in range(len(parts))]
    if not overwrite:
        refuse_foreign(list_foreign(paths), "rtsr train")
    for path, (numbers, targets) in zip(paths, parts, strict=True):
        if not is_whole_tensor_file(path):
            also = "".join(f", {part.name}" for part in shot.beside)
            yield f"recording {root}, frames {format_ranges(numbers)}{also}"
            clip = _record_clip(shot, wanted, policy, numbers, targets)
            doubts = list_doubts(clip)
            about = {"frames": format_ranges(numbers)} | ({DOUBTS: doubts} if doubts else {})
            write_clips(path, [clip], about)
    return paths


def _describe_shot(shot: CapturedShot) -> str:
    return ", ".join(sorted({b.value for reader in shot.readers for b in reader.stored}))


def _hash_recording(shot: CapturedShot, wanted: RecordedInputs, policy: NonfinitePolicy) -> str:
    """Hash of everything that decides a recording."""
    source = shot.source
    inputs = PairInputs(lr=wanted.lr, hr=wanted.hr, derivation=wanted.derivation)
    files = sorted({p for n in source.reader.numbers for p in source.files(n, inputs)})
    if shot.reference is not None:
        apart = shot.reference
        files += [p for n in apart.numbers for p in apart.files(n, (Buffer.COLOR,))]
    files += [p for part in shot.beside for n in source.reader.numbers for p in part.files(n)]
    declarations = [reader.declaration for reader in shot.readers]
    plain = asdict(wanted)
    if plain.pop("straight") and any(Buffer.ALPHA in reader.stored for reader in shot.readers):
        declarations.append("straight")
    if source.reader.filter_width_px is not None:
        declarations.append(f"filter {source.reader.filter_width_px}")
    return digest_values(
        digest_config(RECORDING, plain, policy.value, declarations),
        FileDigests().of_all(tuple(files)),
    )


def _cut_parts(source: PairSource, wanted: RecordedInputs) -> Iterator[tuple[Sequence[int], int]]:
    """Cut unbroken runs into parts; yields numbers and the position of the first target."""
    reader = source.reader
    sequence = FrameSequence(numbers=reader.numbers, step=reader.step, cuts=reader.resets)
    height, width = source.readers[-1].size
    length = CLIP_BYTES // (height * width * HALF_BYTES * MAX_CHANNELS)
    for run in sequence.runs():
        yield from cut_run(
            run, min(MAX_CLIP_FRAMES, length), history=wanted.history, unroll=wanted.unroll
        )


def _record_clip(
    shot: CapturedShot,
    wanted: RecordedInputs,
    policy: NonfinitePolicy,
    numbers: Sequence[int],
    targets: int,
) -> Clip:
    source = shot.source
    real = isinstance(source, RealPairs)
    hr_reader, lr_reader = source.readers[-1], source.reader
    hr_required = wanted.hr if real else (*wanted.hr, *wanted.lr)
    hr_optional = wanted.hr_optional if real else (*wanted.hr_optional, *wanted.lr_optional)
    hr = list_recorded_buffers(hr_required, hr_optional, hr_reader, wanted.derivation)
    hr_frames = [_read_frame(hr_reader, n, hr, wanted, policy) for n in numbers]
    if shot.reference is not None:
        hr_frames = [_add_radiance(f, shot.reference, wanted, policy) for f in hr_frames]
        hr = tuple(dict.fromkeys((*hr, Buffer.COLOR)))
    planes = {b.value: _stack_planes(frame.gbuffer[b] for frame in hr_frames) for b in hr}
    gains = [_measure_material_gain(hr_reader, n, hr, wanted.derivation) for n in numbers]
    if all(gain is not None for gain in gains):
        planes[MATERIAL_GAIN] = _stack_planes(gain for gain in gains if gain is not None)
    for part in shot.beside:
        planes[part.name] = _stack_planes(part.image(n) for n in numbers)
    lr_planes: dict[str, Tensor] = {}
    if real:
        lr = list_recorded_buffers(wanted.lr, wanted.lr_optional, lr_reader, wanted.derivation)
        lr_frames = [_read_frame(lr_reader, n, lr, wanted, policy) for n in numbers]
        lr_planes = {b.value: _stack_planes(frame.gbuffer[b] for frame in lr_frames) for b in lr}
    else:
        simulation = Simulation(scale=wanted.scale)
        lr_frames = [
            decimate_frame(frame, frame.gbuffer.buffers, simulation) for frame in hr_frames
        ]
    facts = ClipFacts(
        name="",
        numbers=tuple(numbers),
        targets=targets,
        display=hr_reader.view.display,
        top=hr_reader.view.top,
        left=hr_reader.view.left,
        lr_scale=source.scale if real else 0,
        jitters_px=tuple(frame.camera.jitter_px for frame in lr_frames) if real else (),
        filter_width_px=(source.filter_width_px or 0.0) if real else 0.0,
        lighting_scales=tuple(_measure_scale(frame, wanted.derivation) for frame in lr_frames),
        pre_exposures=tuple(frame.camera.pre_exposure for frame in lr_frames),
        captured=hr_reader.size,
        cameras=_list_cameras(hr_frames),
    )
    return leave_out_zeros(Clip(facts, planes, lr_planes))


def _list_cameras(frames: Sequence[Frame]) -> tuple[tuple[float, ...], ...]:
    """Return the matrices of every frame, row by row; nothing where one has none."""
    cameras = []
    for frame in frames:
        to_camera, to_ndc = frame.camera.world_to_camera, frame.camera.world_to_ndc
        if to_camera is None or to_ndc is None:
            return ()
        cameras.append((*to_camera.flatten().tolist(), *to_ndc.flatten().tolist()))
    return tuple(cameras)


def _read_frame(
    reader: FrameReader,
    number: int,
    buffers: Collection[Buffer],
    wanted: RecordedInputs,
    policy: NonfinitePolicy,
) -> Frame:
    raw = _without_softening(wanted.derivation)
    stored = resolve_needs(buffers, reader.readable, has_camera=reader.has_camera, config=raw).read
    return derive(_read_stored(reader, number, stored, wanted, policy), buffers, raw)


def _read_stored(
    reader: FrameReader,
    number: int,
    stored: Collection[Buffer],
    wanted: RecordedInputs,
    policy: NonfinitePolicy,
) -> Frame:
    """Read stored buffers; radiance is what the network will see."""
    straight = wanted.straight and Buffer.COLOR in stored
    coverage = {Buffer.ALPHA} & reader.readable if straight else set[Buffer]()
    frame, _ = apply_policy(reader.read(number, {*stored, *coverage}), policy)
    return take_coverage_out(frame)[0] if coverage else frame


def _add_radiance(
    frame: Frame, reference: FrameReader, wanted: RecordedInputs, policy: NonfinitePolicy
) -> Frame:
    """Add the radiance of the reference's frame of the same number."""
    truth = _read_stored(reference, frame.number, (Buffer.COLOR,), wanted, policy)
    color = {Buffer.COLOR: truth.gbuffer[Buffer.COLOR]}
    return replace(frame, gbuffer=frame.gbuffer.with_buffers(color))


def _measure_material_gain(
    reader: FrameReader, number: int, recorded: Collection[Buffer], derivation: DerivationConfig
) -> Tensor | None:
    """dF / dc, where F follows from an albedo: F is linear in it."""
    parts = {Buffer.ALBEDO, Buffer.METALLIC}
    known = reader.readable
    if not {Buffer.MATERIAL, Buffer.ALBEDO} <= set(recorded) or not parts <= known:
        return None
    if known & {Buffer.MATERIAL, Buffer.SPECULAR}:
        return None
    raw = _without_softening(derivation)
    stored = resolve_needs((Buffer.MATERIAL,), known, has_camera=reader.has_camera, config=raw).read
    frame = reader.read(number, stored)
    ends = []
    for value in (0.0, 1.0):
        albedo = torch.full_like(frame.gbuffer[Buffer.ALBEDO], value)
        changed = replace(frame, gbuffer=frame.gbuffer.with_buffers({Buffer.ALBEDO: albedo}))
        ends.append(derive_material(changed, raw)[:, :1])
    return ends[1] - ends[0]


def _stack_planes(planes: Iterator[Tensor]) -> Tensor:
    return torch.cat([round_to_half(p) for p in planes])


def _measure_scale(frame: Frame, derivation: DerivationConfig) -> float:
    """k of a whole LR frame; 1 where nothing is recorded that its radiance could be divided by."""
    quotient, camera = (Buffer.LIGHTING, Buffer.LIGHTING_MASK), frame.camera.has_matrices
    if resolve_needs(quotient, frame.gbuffer, has_camera=camera, config=derivation).missing:
        return 1.0
    lit = derive(frame, quotient, derivation)
    k = lighting_scale(lit.gbuffer[Buffer.LIGHTING], lit.gbuffer[Buffer.LIGHTING_MASK])
    return k if math.isfinite(k) and k > 0 else 1.0
