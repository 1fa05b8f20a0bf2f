"""LR frames of one folder, and HR frames of another beside them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path

from rtsr_cli.core.captures.bound_channels import BoundBuffer
from rtsr_cli.core.captures.measuring.camera_decision import share_verdicts
from rtsr_cli.core.captures.measuring.camera_path import find_apart, gather_run
from rtsr_cli.core.captures.measuring.declaration_text import write_toml_value
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.regions import OutputWindows, check_origins, place_output
from rtsr_cli.core.captures.shots import HR_FOLDER, LR_FOLDER
from rtsr_cli.core.captures.surveyed import SurveyedValues
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.exr import ExrHeader
from rtsr_cli.core.frames.buffers import RADIANCE_BUFFERS, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata
from rtsr_cli.core.frames.camera_needs import say_frames
from rtsr_cli.core.imaging.derivation import CAMERA, derive_material
from rtsr_cli.core.pairs import pixel_filter
from rtsr_cli.core.pairs.buffer_moments import (
    BufferMoments,
    describe_foreign,
)
from rtsr_cli.core.pairs.doubted_material import leave_doubted
from rtsr_cli.core.pairs.held_samples import GUIDES
from rtsr_cli.core.pairs.nonfinite import apply_policy
from rtsr_cli.core.pairs.pair_agreement import (
    COMPARED,
    FEW_STRAYS,
    Misfit,
    choose_witness,
    find_misfit,
    find_other_moment,
    list_around,
)
from rtsr_cli.core.pairs.saturated_material import divide_saturated
from rtsr_cli.core.pairs.sources import (
    FITTING_HR,
    HR_FRAMES,
    FramePair,
    PairInputs,
    PairReads,
    check_frame,
    describe_lacking,
    describe_missing,
    resolve_buffers,
)
from rtsr_cli.core.pairs.window import Reads, build_hr, build_lr
from rtsr_cli.core.shapes import Size


@dataclass(frozen=True, kw_only=True)
class RealPairs:
    """LR frames, and HR frames beside them (or none) of `scale` times their size."""

    lr: FrameReader
    hr: FrameReader | None
    scale: int

    @property
    def reader(self) -> FrameReader:
        """The LR reader."""
        return self.lr

    @property
    def lr_size(self) -> Size:
        """(height, width) of the LR frames."""
        return self.lr.size

    def place_output(self, header: ExrHeader) -> OutputWindows:
        """In the display window of the HR frames, or in that of the LR frame enlarged."""
        plane = None if self.hr is None else self.hr.display
        return place_output(
            header, self.lr.channel_of(header), self.lr.region, Fraction(self.scale), plane
        )

    @property
    def readers(self) -> tuple[FrameReader, ...]:
        """LR's and HR's."""
        return (self.lr,) if self.hr is None else (self.lr, self.hr)

    @cached_property
    def jitters(self) -> bool:
        """Tell whether the LR frames' jitter differs, and nothing speaks against it."""
        offsets = {camera.jitter_px for camera in self.lr.cameras.values()}
        return len(offsets) > 1 and self.lr.jitter_trusted

    @property
    def frame_bytes(self) -> int:
        """Both resolutions."""
        return self.lr.frame_bytes + (0 if self.hr is None else self.hr.frame_bytes)

    @cached_property
    def _resolved(self) -> dict[PairInputs, PairReads]:
        """Of inputs that were asked for; nothing else about a source ever changes."""
        return {}

    def resolve(self, inputs: PairInputs) -> PairReads:
        """Say what is read for a system; without HR frames nothing is read of them."""
        if inputs not in self._resolved:
            unread: set[Buffer] = set()
            if Buffer.EMISSION in inputs.hr_optional and self._emits_at_lr_alone:
                # what is taken off radiance and not added again makes lamps black
                unread.add(Buffer.EMISSION)
            lr = resolve_buffers(inputs.lr, inputs.lr_optional, self.lr, inputs, unread)
            hr = Reads(stored=frozenset(), used=())
            if self.hr is not None:
                hr = resolve_buffers(inputs.hr, inputs.hr_optional, self.hr, inputs, unread)
            self._resolved[inputs] = PairReads(lr=lr, hr=hr)
        return self._resolved[inputs]

    def missing(
        self, inputs: PairInputs, numbers: Collection[int] | None = None
    ) -> tuple[str, ...]:
        """Name what is missing, with the resolution it is missing at where there are two."""
        reads = self.resolve(inputs)
        size = "" if self.hr is None and self.scale == 1 else "lr "
        lacking = describe_missing(reads.lr.missing, self.lr, size)
        read = self.lr.numbers if numbers is None else numbers
        lacking = (*lacking, *describe_lacking(read, reads.lr.stored, self.lr, size))
        if inputs.hr + inputs.hr_optional and self.misfit:
            lacking = (*lacking, FITTING_HR)
        if not inputs.hr:
            return lacking
        if self.hr is None:
            return (*lacking, HR_FRAMES)
        # of pixels that are turned no camera is judged
        judged = [name for name in reads.hr.missing if name != CAMERA or not self.misfit]
        return tuple(dict.fromkeys((*lacking, *describe_missing(judged, self.hr, "hr "))))

    def files(self, number: int, inputs: PairInputs) -> tuple[Path, ...]:
        """Files of both resolutions."""
        reads = self.resolve(inputs)
        lr = self.lr.files(number, reads.lr.stored)
        if self.hr is None or not inputs.hr + inputs.hr_optional:
            return lr
        return lr + self.hr.files(self.lr.held.get(number, number), reads.hr.stored)

    @cached_property
    def _filter(self) -> pixel_filter.FilterFinding | None:
        """As measured, which takes HR material."""
        if self.hr is None or self.missing(pixel_filter.INPUTS):
            return None
        return pixel_filter.measure_first(
            lambda number: self._read(number, pixel_filter.INPUTS), self.lr.numbers, self.scale
        )

    @property
    def filter_width_px(self) -> float | None:
        """As declared, else as measured."""
        if self.lr.filter_width_px is not None:
            return self.lr.filter_width_px
        return None if self._filter is None else self._filter.width_px

    @property
    def filter_measured(self) -> bool:
        """Tell whether a filter was found that nobody declared."""
        return self.lr.filter_width_px is None and bool(self.filter_width_px)

    @property
    def looks_filtered(self) -> bool | None:
        """As measured."""
        return None if self._filter is None else self._filter.filtered

    @cached_property
    def filter_doubt(self) -> str:
        """Both widths, and what to do; it takes HR material to measure."""
        declared = self.lr.filter_width_px
        if declared is None or self.hr is None or self.missing(pixel_filter.INPUTS):
            return ""
        found = pixel_filter.find_other_width(
            lambda number: self._read(number, pixel_filter.INPUTS),
            self.lr.numbers,
            self.scale,
            declared,
        )
        if found is None:
            return ""
        looks = f"filtered by {found:.2f} LR pixels" if found else "of point samples (0)"
        return (
            f"filter_width_px is declared as {declared:g}, but LR radiance looks {looks}; the "
            "declaration is obeyed: correct it, or leave it out, and it is measured"
        )

    @property
    def misfit(self) -> str:
        """What HR looks like beside LR, and what to do."""
        return self._describe(self._misfit)

    def _describe(self, found: Misfit | None) -> str:
        if self.hr is None or found is None or not found.looks:
            return ""
        remedy = f"{found.remedy}{_suggest_factor(found, self.lr, self.hr)}"
        seen = (
            f": as it is, {found.strays:.1%} of the LR samples of frame {found.frame} are unlike "
            "all HR pixels around them"
            if found.strays > FEW_STRAYS or not found.factors
            else ""
        )
        return (
            f"{self.hr.frames.root}: {found.where}: beside {self.lr.frames.root}, HR looks "
            f"{found.looks}{seen}; {remedy}"
        )

    @property
    def _emits_at_lr_alone(self) -> bool:
        """Tell whether LR's emission has parts that HR's lacks, and none the other way round."""
        if self.hr is None or Buffer.EMISSION not in self.lr.readable:
            return False
        if Buffer.EMISSION not in self.hr.readable:
            return True
        at_lr, at_hr = (
            {channel.channel for channel in reader.binding[Buffer.EMISSION]}
            for reader in (self.lr, self.hr)
        )
        return at_hr < at_lr

    @property
    def misfit_doubt(self) -> str:
        """The share of samples that no HR pixel is like, and light that one size alone has."""
        return "; ".join(text for text in (self._stray_doubt, self._emission_doubt) if text)

    @property
    def _emission_doubt(self) -> str:
        if self.hr is None or not self._emits_at_lr_alone:
            return ""
        return (
            f"LR frames hold emission that HR frames ({self.hr.frames.root}) lack: it is taken for "
            "reflected light, and lamps are blurred; write the same emission passes into every HR "
            "frame"
        )

    @property
    def _stray_doubt(self) -> str:
        found = self._misfit
        if self.hr is None or found is None or found.looks:
            return ""
        return (
            f"LR and HR ({self.hr.frames.root}) hardly show one picture in {found.where}: "
            f"{found.strays:.0%} of the LR samples of frame {found.frame} are unlike all HR pixels "
            f"around them in {', '.join(self._compared)}; render both of one scene, with one camera"
        )

    @cached_property
    def _compared(self) -> tuple[Buffer, ...]:
        """Buffers that both sizes hold, and that are the same at both."""
        return tuple(b for b in COMPARED if all(b in reader.readable for reader in self.readers))

    @cached_property
    def _misfit(self) -> Misfit | None:
        """How HR frames differ from LR's; None where nothing says that they do."""
        lr, hr, compared = self.lr, self.hr, self._compared
        numbers = [n for n in lr.numbers if n not in lr.held]
        if hr is None or not compared or not numbers:
            return None
        return find_misfit(
            lambda number: lr.read(number, compared).gbuffer,
            lambda number: hr.read(number, compared).gbuffer,
            numbers,
            self.scale,
            stored=set(hr.numbers).difference(hr.held),
            doubted=[n for n in _list_apart(lr.cameras, hr.cameras) if n in numbers],
            singly=not (lr.camera_unfit or hr.camera_unfit),
        )

    def load(self, number: int, inputs: PairInputs) -> FramePair:
        """Read both frames; HR radiance is never among what is asked for.

        Raises:
            FrameFolderError: one of both is of another moment, or cannot be read.
        """
        pair = self._read(number, inputs, own_moment=True)
        if not inputs.filter_known:
            return pair
        return replace(pair, lr=replace(pair.lr, filter_width_px=self.filter_width_px or 0.0))

    def _check_moment(self, number: int, lr: GBuffer, hr: GBuffer) -> None:
        """Refuse a frame one of whose files is another frame's: few are looked at before a run.

        Args:
            number: of the frame.
            lr, hr: what was read of it.

        Raises:
            FrameFolderError: what both sizes hold says so, or what LR radiance shows.
        """
        if self.hr is None:
            return
        small, large = self.lr, self.hr
        stored = set(small.numbers) & set(large.numbers) - set(small.held) - set(large.held)
        if number not in stored:
            return
        witness = choose_witness(lr, hr)
        found = None
        if witness is not None:
            found = find_other_moment(
                lambda other: small.read(other, (witness,)).gbuffer,
                lambda other: large.read(other, (witness,)).gbuffer,
                number,
                self.scale,
                own=(lr, hr),
                stored=stored,
            )
        if found is not None:
            raise FrameFolderError(self._describe(found))
        foreign = self._moments.find(number, lr, hr, list_around(number, stored))
        if foreign is not None:
            raise FrameFolderError(describe_foreign(foreign, small.frames.root, large.frames.root))

    @cached_property
    def _moments(self) -> BufferMoments:
        lr, hr = self.lr, self.hr
        assert hr is not None
        return BufferMoments(
            lambda number, buffers: lr.read(number, buffers).gbuffer,
            lambda number, buffers: hr.read(number, buffers).gbuffer,
            self.scale,
        )

    def _read(self, number: int, inputs: PairInputs, *, own_moment: bool = False) -> FramePair:
        """Read both frames, whatever filter went over radiance."""
        reads = self.resolve(inputs)
        checked = check_frame(self.lr.read(number, reads.lr.stored), inputs)
        divides = Buffer.LIGHTING in reads.lr.used and Buffer.MATERIAL in reads.hr.used
        divisor = (Buffer.MATERIAL,) if divides else ()
        lr = build_lr(checked.frame, _keep_guides(reads.lr, divisor), inputs.derivation)
        pair = FramePair(lr, None, checked.fixed, checked.negative, checked.covered)
        if self.hr is None or not inputs.hr + inputs.hr_optional:
            return pair
        stored = reads.hr.stored - RADIANCE_BUFFERS
        hr = self.hr.read(self.lr.held.get(number, number), stored)
        hr, fixed_hr = apply_policy(hr, inputs.on_nonfinite)
        if own_moment:
            self._check_moment(number, checked.frame.gbuffer, hr.gbuffer)
        hr = build_hr(hr, _keep_guides(reads.hr), inputs.derivation)
        if divides:
            lr, hr = divide_saturated(
                lr, hr, lambda: derive_material(checked.frame, inputs.derivation), self.scale
            )
        left = leave_doubted(lr, hr, self.scale, divided=divides)
        lr, hr = (
            replace(frame, gbuffer=frame.gbuffer.only(frame.gbuffer.keys() - unwanted))
            for frame, unwanted in (
                (left.lr, {Buffer.MATERIAL, *_list_guides(reads.lr)} - set(reads.lr.used)),
                (left.hr, set(_list_guides(reads.hr))),
            )
        )
        pair = replace(pair, lr=lr, hr=hr, fixed=pair.fixed + fixed_hr)
        return replace(pair, doubted=left.doubted, colours=left.colours, bare=left.bare)


def open_real_pairs(
    lr: FrameReader,
    hr: FrameReader | None,
    scale: int | None,
    *,
    skip_missing: bool = False,
    wanted: frozenset[int] | None = None,
) -> RealPairs:
    """Match LR and HR frames.

    Args:
        lr: the frames to enlarge.
        hr: their G-buffers at the target size, or None.
        scale: as asked for, or None to take it from the sizes.
        skip_missing: leave out frames that HR lacks, instead of refusing.
        wanted: frames that are asked for, None for all; others may lack their HR frames.

    Raises:
        FrameFolderError: HR lacks a frame, is no multiple of LR, or contradicts `scale`.
    """
    if hr is None:
        if scale is None:
            raise FrameFolderError(
                f"{lr.frames.root}: there are no HR frames to take the scale from; add "
                "'hr/', name it with --hr, or give --scale (--simulate-lr makes LR frames)"
            )
        return RealPairs(lr=lr, hr=None, scale=scale)
    (lr_h, lr_w), (hr_h, hr_w) = lr.size, hr.size
    ratio = hr_w // lr_w
    if ratio < 1 or (hr_h, hr_w) != (lr_h * ratio, lr_w * ratio):
        raise FrameFolderError(
            f"{hr.frames.root}: HR is {hr_w} x {hr_h}, which is no whole multiple of LR "
            f"{lr_w} x {lr_h} in {lr.frames.root}; render both with one ratio"
        )
    if scale is not None and scale != ratio:
        raise FrameFolderError(
            f"{hr.frames.root}: HR is {ratio} times the size of LR, not {scale} times; "
            f"leave --scale out, or give frames of that ratio"
        )
    _check_windows(lr, hr, ratio)
    lacking = sorted(set(lr.numbers) - set(hr.numbers))
    refused = [n for n in lacking if not wanted or min(wanted) <= n <= max(wanted)]
    if refused and not skip_missing:
        raise FrameFolderError(describe_unpaired(refused, lr.frames.root, hr.frames.root))
    lr = replace(lr, numbers=tuple(n for n in lr.numbers if n not in set(lacking)))
    lr = _hold_pairs(lr, hr)
    return RealPairs(lr=_take_sky_rule(lr, hr), hr=_take_sky_rule(hr, lr), scale=ratio)


def describe_unpaired(numbers: Collection[int], lr: Path, hr: Path) -> str:
    """Say which frames of a folder have no HR frames beside them, and what to do."""
    return (
        f"{hr}: HR lacks {say_frames(sorted(numbers))} that LR has in {lr}; render "
        f"{'it' if len(numbers) == 1 else 'them'}, or use --on-missing skip"
    )


def settle_cameras(pairs: RealPairs) -> RealPairs:
    """Let both sizes share what is found about their cameras; see `share_verdicts`."""
    if pairs.hr is None:
        return pairs
    lr, hr = share_verdicts(pairs.lr, pairs.hr, lambda: pairs.misfit)
    return replace(pairs, lr=lr, hr=hr)


def _keep_guides(reads: Reads, further: Collection[Buffer] = ()) -> Reads:
    """Add buffers to those of a frame; and what tells surfaces apart, as far as it is read."""
    return replace(reads, used=(*reads.used, *further, *_list_guides(reads)))


def _list_guides(reads: Reads) -> list[Buffer]:
    """What tells surfaces apart, of what is read and not used.

    F0 comes with a diffuse colour; without metallic, a base colour is found from both, if it is
    that which is used.
    """
    found = Buffer.ALBEDO in reads.used and Buffer.METALLIC not in reads.stored
    guides = GUIDES if found else (*GUIDES, Buffer.SPECULAR)
    return [b for b in guides if b in reads.stored and b not in reads.used]


def _list_apart(
    cameras: Mapping[int, CameraMetadata], others: Mapping[int, CameraMetadata]
) -> list[int]:
    """Numbers of the surveyed frames whose matrices differ between both sizes."""
    run, other = gather_run(cameras), gather_run(others)
    return [] if run is None or other is None else find_apart(run, other)


def _suggest_factor(misfit: Misfit, lr: FrameReader, hr: FrameReader) -> str:
    """What declares a factor that the values of one size have; empty where it is none.

    They are HR's, unless LR's alone are no such values. capture.toml is that of both sizes, and a
    file sequence of one name is in both.
    """
    if not misfit.factors or misfit.buffer is None:
        return ""
    if misfit.buffer in lr.faulty - hr.faulty:
        names, reader, other, folder = ("HR", "LR"), lr, hr, LR_FOLDER
        factors = [float(f"{factor:.4g}") for factor in misfit.factors]
    else:
        names, reader, other, folder = ("LR", "HR"), hr, lr, HR_FOLDER
        factors = [_invert(factor) for factor in misfit.factors]
    right, wrong = names
    bound = reader.binding[misfit.buffer].tinted(factors)
    rename = ""
    if {c.stream for c in bound} & {c.stream for c in other.binding[misfit.buffer]}:
        bound = bound.moved_to(folder)
        rename = (
            f"rename {wrong}'s files to {folder}.####.exr ({right}'s have the same name now, and "
            "would be multiplied, too), and write in "
        )
    made: str | list[str] = bound.describe(streams=True)
    if len(set(misfit.factors)) > 1:
        made = [BoundBuffer((part,)).describe(streams=True) for part in bound.components]
    line = f"{misfit.buffer} = {write_toml_value(made)}"
    return f"; or, if {right} is right, {rename}capture.toml: [buffers] {line}"


def _invert(factor: float) -> float:
    return float(f"{1.0 / factor:.4g}")


def _hold_pairs(lr: FrameReader, hr: FrameReader) -> FrameReader:
    """Let the whole pair of the frame before stand in where its HR frame does.

    LR radiance of one moment over the G-buffer of another would be a picture of neither.
    """
    sources = {n: lr.held.get(hr.held[n], hr.held[n]) for n in lr.numbers if n in hr.held}
    if not sources:
        return lr
    own = {n: lr.cameras[source] for n, source in sources.items() if source in lr.cameras}
    known = {**lr.cameras, **own}
    cameras = SurveyedValues(known, set(lr.numbers) - known.keys(), lr.cameras.__getitem__)
    return replace(lr, held={**lr.held, **sources}, cameras=cameras)


def _take_sky_rule(reader: FrameReader, other: FrameReader) -> FrameReader:
    """Let what is sky at one size be sky at the other, where nothing was found there."""
    own, theirs = reader.conventions.depth, other.conventions.depth
    if own.sky is not None or theirs.sky is None or own.kind is not theirs.kind:
        return reader
    depth = replace(own, sky=theirs.sky)
    return replace(reader, conventions=replace(reader.conventions, depth=depth))


def _check_windows(lr: FrameReader, hr: FrameReader, scale: int) -> None:
    """Raise where the pixels of both resolutions do not show the same part of the image plane."""
    if lr.view.at_scale(scale) != hr.view:
        raise FrameFolderError(
            f"{hr.frames.root}: HR shows another part of the image plane than LR in "
            f"{lr.frames.root}: {hr.places[0].describe()}, {lr.places[0].describe()}; render both "
            "with the same crop and overscan"
        )
    check_origins(
        (*(place.at_scale(scale) for place in lr.places), *hr.places), str(hr.frames.root)
    )
