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

from safetensors import SafetensorError, safe_open
from torch import Tensor

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.tensor_file import write_tensors
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.shapes import Size

FORMAT = "rtsr-clips-1"

SUFFIX = ".rtsr-clips"
"""Ends the name of a file of clips."""

DERIVED = frozenset({Buffer.LIGHTING, Buffer.LIGHTING_MASK, Buffer.SKY})
"""Never stored: made again from the rest when a crop is used, as augmentation changes the rest."""

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
        lighting_scales: k of the whole frame, of each frame.
        pre_exposures: what each frame's radiance was multiplied by; empty = 1.
        validation: True if it is judged on and never trained on.
        group: samples are drawn from each group alike.
        captured: (height, width) of the frames that the region is of; None = of the display.
        zeros: `hr.<buffer>` and `lr.<buffer>` that the files hold, left out because all is 0.
    """

    name: str
    numbers: tuple[int, ...]
    targets: int = 0
    display: Size
    top: int = 0
    left: int = 0
    lr_scale: int = 0
    jitters_px: tuple[Jitter, ...] = ()
    lighting_scales: tuple[float, ...] = ()
    pre_exposures: tuple[float, ...] = ()
    validation: bool = False
    group: int = 0
    captured: Size | None = None
    zeros: tuple[str, ...] = ()


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
        with safe_open(path, "pt") as opened:
            metadata = opened.metadata() or {}
            if metadata.get("format") != FORMAT:
                raise FrameFolderError(f"{path}: no packed clips; make them with rtsr train --pack")
            tensors = {key: opened.get_tensor(key) for key in opened.keys()}  # noqa: SIM118
    except (OSError, SafetensorError) as error:
        raise FrameFolderError(f"{path}: cannot be read as packed clips ({error})") from error
    clips = [
        Clip(
            _read_facts(facts),
            _read_planes(tensors, f"{i:06d}/hr."),
            _read_planes(tensors, f"{i:06d}/lr."),
        )
        for i, facts in enumerate(json.loads(metadata["clips"]))
    ]
    return clips, json.loads(metadata["about"])


def _read_planes(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {key.removeprefix(prefix): t for key, t in tensors.items() if key.startswith(prefix)}


def _read_facts(stored: Mapping[str, object]) -> ClipFacts:
    values = {key: tuple(v) if isinstance(v, list) else v for key, v in stored.items()}
    jitters = tuple(tuple(j) for j in values["jitters_px"])  # type: ignore[attr-defined]
    return ClipFacts(**{**values, "jitters_px": jitters})  # type: ignore[arg-type]


def count_frames(clips: Iterable[Clip]) -> int:
    """Frames that can be trained on."""
    return sum(len(clip.target_positions) for clip in clips)
