"""Decoded frames for training: memory-mapped half-float planes, read a crop at a time.

A clip is a run of successive frames of one capture, whole or a region of it. A file of clips is a
safetensors file: tensor `<clip>/<size>.<buffer>` of shape (frames, channels, height, width),
`<size>` being `hr` or `lr`, and the rest as JSON in its metadata. Reading needs no EXR library.
"""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor

from rtsr_cli.core.documents import check_regular, parse_json
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.tensor_file import write_tensors
from rtsr_cli.core.frames.buffers import VECTOR_BUFFERS, Buffer
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.frames.storage import MAX_HALF
from rtsr_cli.core.limits import LARGEST_FACTOR
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.wording import say_count, say_verb

V = TypeVar("V")

FORMAT = "rtsr-clips-1"

SUFFIX = ".rtsr-clips"
"""Ends the name of a file of clips."""

DERIVED = frozenset({Buffer.LIGHTING, Buffer.LIGHTING_MASK, Buffer.SKY})
"""Never stored: made again from the rest when a crop is used, as augmentation changes the rest."""

MOTIONS = frozenset(buffer.value for buffer in VECTOR_BUFFERS)
"""Planes that are 0 where nothing moves."""

DOUBTS = "doubts"
"""Of what a file is about: what is to be said of its radiance, each time that it is used."""

CAMERA_NUMBERS = 32
"""Numbers of a frame's two matrices."""

LARGEST_COUNT = 1 << 31
"""Pixels and frames of a clip."""

MATERIAL_GAIN = "material_gain"
"""Plane dF / dc: F of an albedo c' is F + gain (c' - c), so that materials can be swapped."""


@dataclass(frozen=True, kw_only=True)
class ClipFacts:
    """What is known of a clip beside its pixels.

    Attributes:
        name: shot it comes from.
        numbers: of its frames, ascending, history unbroken.
        targets: position of the first frame that is a training target; those before it are history.
        display: (height, width) of the whole capture.
        top, left: the region's first pixel.
        lr_scale: HR pixels per pixel of its LR planes; 0 = LR frames are made by decimation.
        jitters_px: of the LR frames, in LR pixels.
        filter_width_px: standard deviation of the pixel filter over radiance of rendered LR frames,
            LR pixels; 0 = none is known of.
        lighting_scales: k of the whole frame, of each frame.
        pre_exposures: what each frame's radiance was multiplied by; empty = 1.
        validation: True if it is judged on and never trained on.
        group: samples are drawn from each group alike.
        captured: (height, width) of the frames that the region is of; None = of the display.
        zeros: `hr.<buffer>` and `lr.<buffer>` that the files hold, left out because all is 0.
        cameras: of each frame worldToCamera and worldToNDC, 32 numbers; empty = not all known.
        licence: of the frames, as their capture.toml declares it; empty where none does.
    """

    name: str
    numbers: tuple[int, ...]
    targets: int = 0
    display: Size
    top: int = 0
    left: int = 0
    lr_scale: int = 0
    jitters_px: tuple[Jitter, ...] = ()
    filter_width_px: float = 0.0
    lighting_scales: tuple[float, ...] = ()
    pre_exposures: tuple[float, ...] = ()
    validation: bool = False
    group: int = 0
    captured: Size | None = None
    zeros: tuple[str, ...] = ()
    cameras: tuple[tuple[float, ...], ...] = ()
    licence: str = ""


@dataclass(frozen=True)
class Clip:
    """Facts and planes: buffer name -> (frames, channels, height, width), half.

    Attributes:
        facts: what is known beside the pixels.
        hr, lr: planes of either size.
        scales: k of whole frames under simulations other than the recorded one, kept when measured.
    """

    facts: ClipFacts
    hr: Mapping[str, Tensor]
    lr: Mapping[str, Tensor] = field(default_factory=dict)
    scales: dict[Hashable, float] = field(default_factory=dict, compare=False, repr=False)

    @property
    def size(self) -> Size:
        """(height, width) of the HR region."""
        plane = next(iter(self.hr.values()))
        return plane.shape[-2], plane.shape[-1]

    @property
    def is_whole(self) -> bool:
        """Tell whether the region is all of the frames."""
        return self.size == (self.facts.captured or self.facts.display)

    @property
    def target_positions(self) -> range:
        """Frames that can be trained on or judged."""
        return range(self.facts.targets, len(self.facts.numbers))


def hold_frame(clip: Clip, position: int) -> Clip:
    """Show one frame of a capture at all of a clip's moments: nothing moves, the sampling does.

    Args:
        clip: of a capture; LR frames that were rendered hold one sampling.
        position: of the frame.
    """
    facts = clip.facts

    def hold_plane(name: str, plane: Tensor) -> Tensor:
        frame = plane[position, None]
        return (torch.zeros_like(frame) if name in MOTIONS else frame).expand_as(plane)

    def hold_each(values: tuple[V, ...]) -> tuple[V, ...]:
        return values[position : position + 1] * len(values)

    held = replace(
        facts,
        lighting_scales=hold_each(facts.lighting_scales),
        pre_exposures=hold_each(facts.pre_exposures),
        cameras=hold_each(facts.cameras),
    )
    return Clip(held, {name: hold_plane(name, plane) for name, plane in clip.hr.items()})


def leave_out_zeros(clip: Clip) -> Clip:
    """Leave out, and name, an emission that is nowhere: most scenes' frames hold none."""
    name = Buffer.EMISSION.value
    sizes = {"hr": clip.hr, "lr": clip.lr}
    empty = [s for s, planes in sizes.items() if name in planes and not bool(planes[name].any())]
    hr, lr = (
        {key: plane for key, plane in planes.items() if size not in empty or key != name}
        for size, planes in sizes.items()
    )
    zeros = tuple(f"{size}.{name}" for size in empty)
    return replace(clip, facts=replace(clip.facts, zeros=zeros), hr=hr, lr=lr)


def list_doubts(clip: Clip) -> list[str]:
    """Say what of a clip's radiance is no light, or was too large for the half that it is kept in.

    Planes hold what is beyond half as its largest number.
    """
    doubts = []
    for size, planes in (("hr", clip.hr), ("lr", clip.lr)):
        color = planes.get(Buffer.COLOR.value)
        if color is None:
            continue
        below, beyond = int((color < 0).sum()), int((color >= MAX_HALF).sum())
        if below:
            doubts.append(
                f"{say_count(below, 'value')} of {size} radiance {say_verb(below)} below 0, which "
                "no light is"
            )
        if beyond:
            doubts.append(
                f"{say_count(beyond, 'value')} of {size} radiance {say_verb(beyond)} trained on as "
                f"{MAX_HALF:.0f}"
            )
    return doubts


def write_clips(path: Path, clips: Sequence[Clip], about: Mapping[str, object]) -> None:
    """Write a file of clips; `about` says what the planes were made for.

    Raises:
        OutputError: it cannot be written.
    """
    tensors = {
        f"{i:06d}/{size}.{name}": plane.contiguous()
        for i, clip in enumerate(clips)
        for size, planes in (("hr", clip.hr), ("lr", clip.lr))
        for name, plane in planes.items()
    }
    facts = [asdict(clip.facts) for clip in clips]
    metadata = {"format": FORMAT, "about": json.dumps(about), "clips": json.dumps(facts)}
    write_tensors(path, tensors, metadata)


def read_clips(path: Path) -> tuple[list[Clip], dict[str, object]]:
    """Open a file of clips; pixels are read when they are used.

    Raises:
        FrameFolderError: it is not there, or no file of clips.
    """
    try:
        check_regular(path)
        with safe_open(path, "pt") as opened:
            metadata = opened.metadata() or {}
            if metadata.get("format") != FORMAT:
                raise FrameFolderError(f"{path}: no packed clips; make them with rtsr train --pack")
            tensors = {key: opened.get_tensor(key) for key in opened.keys()}  # noqa: SIM118
            about = parse_json(metadata["about"])
            clips = _make_clips(parse_json(metadata["clips"]), tensors)
    except (OSError, SafetensorError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FrameFolderError(f"{path}: cannot be read as packed clips ({error})") from error
    return clips, about


def _make_clips(
    listed: Sequence[Mapping[str, object]], tensors: Mapping[str, Tensor]
) -> list[Clip]:
    """Make the clips of a file; what does not fit ends in an error of Python's."""
    clips = [
        Clip(
            _read_facts(facts),
            _read_planes(tensors, f"{i:06d}/hr."),
            _read_planes(tensors, f"{i:06d}/lr."),
        )
        for i, facts in enumerate(listed)
    ]
    for i, clip in enumerate(clips):
        planes = [*clip.hr.values(), *clip.lr.values()]
        frames = len(clip.facts.numbers)
        whole = clip.hr and all(plane.ndim == 4 and len(plane) == frames for plane in planes)
        if not whole or not 0 <= clip.facts.targets < frames:
            raise ValueError(f"clip {i} does not hold the frames that it lists")
        for named in (clip.hr, clip.lr):
            if len({tuple(plane.shape[-2:]) for plane in named.values()}) > 1:
                raise ValueError(f"buffers of clip {i} are of several sizes")
    return clips


def _read_planes(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {key.removeprefix(prefix): t for key, t in tensors.items() if key.startswith(prefix)}


def _read_facts(stored: Mapping[str, object]) -> ClipFacts:
    """Make facts of plain values.

    Raises:
        ValueError: one is of another kind than it is written as.
    """
    values = {key: tuple(v) if isinstance(v, list) else v for key, v in stored.items()}
    jitters = tuple(tuple(j) for j in values["jitters_px"])  # type: ignore[attr-defined]
    cameras = tuple(tuple(c) for c in values.get("cameras", ()))  # type: ignore[attr-defined]
    rows = {"jitters_px": jitters, "cameras": cameras}
    facts = ClipFacts(**{**values, **rows})  # type: ignore[arg-type]
    wrong = [name for name, holds in _check_facts(facts).items() if not holds]
    if wrong:
        raise ValueError(f"its facts are damaged: {', '.join(wrong)}")
    return facts


def _check_facts(facts: ClipFacts) -> dict[str, bool]:
    """Whether each fact is of its kind, and as many as there are frames."""
    frames = len(facts.numbers) if isinstance(facts.numbers, tuple) else -1
    counts = {
        name: getattr(facts, name) for name in ("targets", "top", "left", "lr_scale", "group")
    }
    return {
        **{name: _is_count(value) for name, value in counts.items()},
        "name": isinstance(facts.name, str),
        "licence": isinstance(facts.licence, str),
        "numbers": frames > 0 and all(type(n) is int for n in facts.numbers),
        "display": _is_size(facts.display),
        "captured": facts.captured is None or _is_size(facts.captured),
        "jitters_px": len(facts.jitters_px) in (0, frames)
        and all(len(j) == 2 and all(map(_is_number, j)) for j in facts.jitters_px),
        "filter_width_px": _is_number(facts.filter_width_px) and facts.filter_width_px >= 0.0,
        "lighting_scales": _are_numbers(facts.lighting_scales, frames),
        "pre_exposures": _are_numbers(facts.pre_exposures, frames),
        "cameras": len(facts.cameras) in (0, frames)
        and all(len(c) == CAMERA_NUMBERS and all(map(_is_number, c)) for c in facts.cameras),
        "validation": isinstance(facts.validation, bool),
        "zeros": isinstance(facts.zeros, tuple) and all(isinstance(z, str) for z in facts.zeros),
    }


def _is_count(value: object) -> bool:
    return type(value) is int and 0 <= value <= LARGEST_COUNT


def _is_size(value: object) -> bool:
    return isinstance(value, tuple) and len(value) == 2 and all(_is_count(v) and v for v in value)


def _is_number(value: object) -> bool:
    return type(value) in (int, float) and abs(value) <= LARGEST_FACTOR  # type: ignore[arg-type]


def _are_numbers(values: object, frames: int) -> bool:
    """Tell whether there is a positive number for each frame, or none at all."""
    if not isinstance(values, tuple) or len(values) not in (0, frames):
        return False
    return all(_is_number(v) and v > 0 for v in values)


def count_frames(clips: Iterable[Clip]) -> int:
    """Frames that can be trained on."""
    return sum(len(clip.target_positions) for clip in clips)
