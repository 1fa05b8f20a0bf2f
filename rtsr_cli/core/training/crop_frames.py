"""Frames of a crop: cut out of a clip, changed, then made by the builder that `upscale` uses.

A cut is turned, relit and given other materials as pixels of the capture; what is derived from them
follows. An LR frame's samples are picked first, as all of that treats every pixel alike.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from rtsr_cli.core.choices import JitterMode
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.motion import Jitter
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.derivation import DerivationConfig
from rtsr_cli.core.imaging.resampling import decimate
from rtsr_cli.core.pairs.simulation import Offset, Simulation, keep_samples, shrink_view
from rtsr_cli.core.pairs.window import (
    QUOTIENT,
    Reads,
    build_hr,
    build_lr,
    build_reference,
    resolve_reads,
    select_hr,
)
from rtsr_cli.core.shapes import Color, Size
from rtsr_cli.core.training.augmentation import (
    SWAP_PLANES,
    PictureTurn,
    relight_planes,
    swap_albedo,
)
from rtsr_cli.core.training.clips import MATERIAL_GAIN, Clip
from rtsr_cli.core.training.samples import (
    SampleChoices,
    SampleRegion,
    SampleTask,
    choose_simulation,
)

FILTER_REACH = 2
"""LR pixels around a crop that a filter sees."""

NAMES = frozenset(b.value for b in Buffer)

Planes = Mapping[str, Tensor]


@dataclass(frozen=True, kw_only=True)
class Cut:
    """A place in a clip, what happens to its pixels, and what is read there.

    Attributes:
        clip: to cut from.
        region: where.
        choices: what happens.
        simulation: how LR frames are made.
        derivation: what divides radiance.
        lr, hr, reference: what the system's frames, and the one it is held against, are made of.
        unshaded: what LR frames are made of that were not rendered, where a system has such.
        is_rendered: tells whether the frame so many before the target was rendered.
        beside: names of further radiance of the reference.
    """

    clip: Clip
    region: SampleRegion
    choices: SampleChoices
    simulation: Simulation
    derivation: DerivationConfig
    lr: Reads
    hr: Reads
    reference: Reads
    unshaded: Reads
    is_rendered: Callable[[int], bool]
    beside: frozenset[str]

    def reads_of(self, position: int) -> Reads:
        """Return what an LR frame is made of."""
        age = self.region.position - position
        return self.lr if self.is_rendered(age) else self.unshaded


def plan_cut(clip: Clip, region: SampleRegion, choices: SampleChoices, task: SampleTask) -> Cut:
    """Resolve what a system reads against what a clip holds.

    Raises:
        FrameFolderError: the clip lacks something.
    """
    system, derivation = task.system, task.system.derivation(task.config)
    beside = frozenset(task.learning.beside) & clip.hr.keys()
    if beside or (clip.facts.lr_scale and MATERIAL_GAIN not in clip.lr):
        # all that a sample holds changes its materials, or nothing does
        choices = replace(choices, swap=None)

    def resolve(size: str, required: Collection[Buffer], optional: Collection[Buffer]) -> Reads:
        held = list_held_buffers(clip, size)
        return resolve_reads(required, optional, held, has_camera=False, derivation=derivation)

    cut = Cut(
        clip=clip,
        region=region,
        choices=choices,
        simulation=choose_simulation(clip, task, choices),
        derivation=derivation,
        lr=resolve(_lr_size(clip), system.lr_inputs, system.lr_optional),
        unshaded=resolve(_lr_size(clip), system.unshaded_inputs, system.unshaded_optional),
        is_rendered=system.is_rendered,
        hr=resolve("hr", system.hr_inputs, system.hr_optional),
        reference=resolve("hr", task.learning.reference, task.learning.reference_optional),
        beside=beside,
    )
    reads = (cut.lr, cut.unshaded, cut.hr, cut.reference)
    missing = dict.fromkeys(name for part in reads for name in part.missing)
    if missing:
        raise FrameFolderError(
            f"{clip.facts.name}: clips hold no {', '.join(missing)}, which system '{system.name}' "
            "reads; pack them again with it"
        )
    return cut


def list_held_buffers(clip: Clip, size: str) -> frozenset[Buffer]:
    """Stored buffers of a size, `hr` or `lr`; those that are 0 everywhere count."""
    planes = clip.lr if size == "lr" else clip.hr
    zeros = {name.removeprefix(f"{size}.") for name in clip.facts.zeros if name.startswith(size)}
    return frozenset(Buffer(name) for name in NAMES & (planes.keys() | zeros))


def _lr_size(clip: Clip) -> str:
    """Size of the planes that LR frames are made from."""
    return "lr" if clip.facts.lr_scale else "hr"


def make_lr_frame(cut: Cut, position: int) -> Frame:
    """Make the LR frame of a crop."""
    pick = _cut_rendered if cut.clip.facts.lr_scale else _sample_capture
    reads = cut.reads_of(position)
    planes = _change_planes(cut, pick(cut, position, _list_names(cut, reads)))
    view = shrink_view(_view(cut), cut.simulation.block)
    frame = _make_frame(cut, position, planes, reads, view)
    frame = replace(
        frame,
        camera=replace(frame.camera, jitter_px=_jitter(cut, position)),
        filter_width_px=cut.clip.facts.filter_width_px or cut.simulation.filter_width_px,
    )
    return build_lr(
        frame, reads, cut.derivation, lighting_scale=measure_lighting_scale(cut, position)
    )


def cut_hr(cut: Cut, position: int, *, goal: bool) -> Planes:
    """Cut what the HR frame is made of, and with `goal` the reference; changed."""
    reads = (cut.hr, cut.reference) if goal else (cut.hr,)
    names = _list_names(cut, *reads) | (cut.beside if goal else frozenset())
    height, width = (side * cut.simulation.block for side in cut.region.size)
    corner = (cut.region.top, cut.region.left)
    return _change_planes(cut, _make_window(cut.clip.hr, position, names, corner, (height, width)))


def make_hr_frame(cut: Cut, planes: Planes, position: int) -> Frame | None:
    """Make the HR frame of a crop from `cut_hr`; None if the system reads none."""
    if not cut.hr.used:
        return None
    frame = select_hr(_make_frame(cut, position, planes, cut.hr, _view(cut)), cut.hr)
    return build_hr(frame, cut.hr, cut.derivation, cut.simulation.samples_per_pixel)


def make_capture(cut: Cut, planes: Planes, position: int) -> Frame:
    """Make every sample of the crop's pixels from `cut_hr`."""
    frame = _make_frame(cut, position, planes, cut.reference, _view(cut))
    return replace(frame, gbuffer=frame.gbuffer.only(cut.reference.used))


def make_reference(cut: Cut, planes: Planes, position: int) -> Frame:
    """Make what the crop's output is held against from `cut_hr`."""
    frame = _make_frame(cut, position, planes, cut.reference, _view(cut))
    return build_reference(
        replace(frame, beside={name: planes[name] for name in cut.beside}),
        cut.reference,
        cut.derivation,
        samples_per_pixel=cut.simulation.samples_per_pixel,
        lighting_scale=measure_lighting_scale(cut, position),
    )


def measure_lighting_scale(cut: Cut, position: int) -> float:
    """k of the whole LR frame, the gain of the light in it.

    It was recorded for the middle samples of captures of one sample a pixel, a pixel filter left
    out. Under another simulation it is measured as `upscale` does, where the whole frame is there;
    crops that were packed keep what was recorded.
    """
    simulation, facts = cut.simulation, cut.clip.facts
    recorded = simulation.jitter is JitterMode.NONE and simulation.samples_per_pixel == 1
    if facts.lr_scale or recorded or not cut.clip.is_whole or not QUOTIENT & set(cut.lr.used):
        return facts.lighting_scales[position] * cut.choices.mean_gain
    return _measure_scale(cut, position) * cut.choices.mean_gain


def _measure_scale(cut: Cut, position: int) -> float:
    """k of a whole frame's samples, measured once."""
    clip, simulation, offset = cut.clip, cut.simulation, _offset(cut, position)
    key = (position, offset, simulation.block, simulation.lr_filter, cut.derivation)
    if key not in clip.scales:
        reads = resolve_reads(
            tuple(QUOTIENT), (), list_held_buffers(clip, "hr"), has_camera=False,
            derivation=cut.derivation,
        )  # fmt: skip
        planes = {
            b.value: keep_samples(b, plane[position, None], simulation, offset).float()
            for b in reads.stored
            if (plane := clip.hr.get(b.value)) is not None
        }
        frame = _make_frame(cut, position, planes, reads, View(display=clip.size))
        clip.scales[key] = build_lr(frame, reads, cut.derivation).lighting_scale
    return clip.scales[key]


def _offset(cut: Cut, position: int) -> Offset:
    """Sample of each block of the capture that lies at the frame's offset after the turn."""
    offset = cut.simulation.offset(cut.clip.facts.numbers[position])
    return cut.choices.turn.source_offset(offset, cut.simulation.block)


def _jitter(cut: Cut, position: int) -> Jitter:
    facts = cut.clip.facts
    if facts.lr_scale:
        return cut.choices.turn.jitter(facts.jitters_px[position])
    return cut.simulation.jitter_px(facts.numbers[position])


def _view(cut: Cut) -> View:
    """The part of the image plane that the turned crop shows, in HR pixels."""
    facts, region = cut.clip.facts, cut.region
    height, width = (side * cut.simulation.block for side in region.size)
    view = View(display=facts.display, top=facts.top + region.top, left=facts.left + region.left)
    return cut.choices.turn.view(view, (height, width))


def _list_names(cut: Cut, *reads: Reads) -> frozenset[str]:
    """Planes that frames are made of, and what a swap of materials changes."""
    swap = SWAP_PLANES if cut.choices.swap is not None else frozenset()
    return swap.union(*({b.value for b in r.stored} for r in reads))


def _make_window(
    planes: Planes, position: int, names: Collection[str], corner: tuple[int, int], size: Size
) -> dict[str, Tensor]:
    rows, columns = slice(corner[0], corner[0] + size[0]), slice(corner[1], corner[1] + size[1])
    return {n: p[position, None, :, rows, columns] for n, p in planes.items() if n in names}


def _cut_rendered(cut: Cut, position: int, names: Collection[str]) -> dict[str, Tensor]:
    """Pixels of an LR frame that was rendered."""
    scale, region = cut.simulation.scale, cut.region
    corner = (region.top // scale, region.left // scale)
    return _make_window(cut.clip.lr, position, names, corner, region.size)


def _sample_capture(cut: Cut, position: int, names: Collection[str]) -> dict[str, Tensor]:
    """Samples of a capture that an LR frame is made of, radiance filtered first."""
    simulation, region, offset = cut.simulation, cut.region, _offset(cut, position)
    height, width = (side * simulation.block for side in region.size)
    planes = _make_window(cut.clip.hr, position, names, (region.top, region.left), (height, width))
    plain = replace(simulation, lr_filter="none")
    sampled = {
        name: keep_samples(Buffer(name), plane, plain, offset)
        if name in NAMES
        else decimate(plane, simulation.block, offset)
        for name, plane in planes.items()
    }
    color = Buffer.COLOR.value
    if simulation.lr_filter != "none" and color in planes:
        sampled[color] = _filter_radiance(cut, cut.clip.hr[color][position, None], offset)
    return sampled


def _filter_radiance(cut: Cut, color: Color, offset: Offset) -> Color:
    """Filter the crop and what the filter sees around it, and keep the crop's samples."""
    region, block = cut.region, cut.simulation.block
    reach = FILTER_REACH * block
    top, left = max(0, region.top - reach), max(0, region.left - reach)
    bottom = region.top + region.size[0] * block + reach
    right = region.left + region.size[1] * block + reach
    x, y = offset[0] + region.left - left, offset[1] + region.top - top
    # the margin is whole blocks wide, and less at a border of the clip
    within = (x % block, y % block)
    around = color[..., top:bottom, left:right]
    filtered = keep_samples(Buffer.COLOR, around, cut.simulation, within)
    return filtered[
        ..., y // block : y // block + region.size[0], x // block : x // block + region.size[1]
    ]


def _change_planes(cut: Cut, planes: Planes) -> dict[str, Tensor]:
    """Turn, relight and swap materials; pixels move as halves, and change as floats."""
    choices = cut.choices
    changed = {name: choices.turn.plane(name, plane).float() for name, plane in planes.items()}
    changed = relight_planes(changed, choices.gain, beside=cut.beside)
    return changed if choices.swap is None else swap_albedo(changed, choices.swap)


def _make_frame(cut: Cut, position: int, planes: Planes, reads: Reads, view: View) -> Frame:
    """Put buffers together, those that are 0 everywhere too, with what is known of the moment."""
    facts = cut.clip.facts
    buffers = {Buffer(name): plane for name, plane in planes.items() if name in NAMES}
    size = next(iter(planes.values())).shape[-2:]
    for buffer in reads.stored - buffers.keys():
        buffers[buffer] = torch.zeros(1, BUFFER_SPECS[buffer].channels, *size)
    if Buffer.OBJECT_ID in buffers:
        buffers[Buffer.OBJECT_ID] = buffers[Buffer.OBJECT_ID].round().to(torch.int32)
    return Frame(
        number=facts.numbers[position],
        gbuffer=GBuffer(buffers, f"{facts.name}, frame {facts.numbers[position]}"),
        camera=_make_camera(cut, position),
        view=view,
    )


def _make_camera(cut: Cut, position: int) -> CameraMetadata:
    """Exposure, and the matrices; none where the picture was turned, and the world with it."""
    facts = cut.clip.facts
    exposure = facts.pre_exposures[position] if facts.pre_exposures else 1.0
    if not facts.cameras or cut.choices.turn != PictureTurn():
        return CameraMetadata(pre_exposure=exposure)
    to_camera, to_ndc = torch.tensor(facts.cameras[position], dtype=torch.float64).view(2, 4, 4)
    return CameraMetadata(world_to_camera=to_camera, world_to_ndc=to_ndc, pre_exposure=exposure)
