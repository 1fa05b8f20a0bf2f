"""From an evaluation's request to what is judged and how, checked before a pixel is compared."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from rtsr_cli.core.choices import MetricName, SsimConvention
from rtsr_cli.core.devices import resolve_device
from rtsr_cli.core.errors import FrameFolderError, MetricUnavailableError
from rtsr_cli.core.evaluation.comparisons import (
    CompareOptions,
    Comparison,
    name_methods,
    open_comparisons,
)
from rtsr_cli.core.evaluation.events import MetricUnavailable
from rtsr_cli.core.evaluation.judgement import Judgement
from rtsr_cli.core.evaluation.metric_table import METRICS, MetricRules
from rtsr_cli.core.evaluation.protocols import PROTOCOLS
from rtsr_cli.core.evaluation.request import EvaluateRequest
from rtsr_cli.core.evaluation.shot_scores import ScoringOptions
from rtsr_cli.core.files.folders import is_file, is_folder
from rtsr_cli.core.frames.selection import Selection, Shard, format_ranges
from rtsr_cli.core.metrics.flip import DEFAULT_PPD
from rtsr_cli.core.metrics.lpips import Lpips
from rtsr_cli.core.metrics.vmaf import find_ffmpeg
from rtsr_cli.core.pairs.opening import ReadOptions

EXR_SUFFIX = ".exr"
PICTURE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg"})

ALL_POLICIES, OWN_POLICY = "--on-missing skip|hold (history restarts there)", "--on-missing skip"
"""What reading advises, and what of it judging has: a frame that stands in is not judged."""


def open_request(request: EvaluateRequest) -> list[Comparison]:
    """Survey the folders and check that they can be compared.

    Raises:
        RtsrError: a folder, shot or frame is missing, or sizes differ.
    """
    check_folders(request)
    options = CompareOptions(
        gbuffer=request.gbuffer,
        samples=request.samples_per_pixel,
        selection=make_selection(request),
        predicted_only=PROTOCOLS[request.protocol].predicted_only,
        changes=any(METRICS[name].of_change for name in request.metrics),
        read=ReadOptions(
            layout=request.layout,
            layer=request.layer,
            view=request.view,
            capture=request.capture_file,
            on_missing=request.on_missing,
            sharded=request.shard is not None,
            selection=make_selection(request),
        ),
    )
    tests = name_methods(request.test_folders)
    try:
        comparisons = open_comparisons(tests, request.reference_folder, options)
    except FrameFolderError as error:
        # advice about missing frames is put as `evaluate` takes it
        raise FrameFolderError(str(error).replace(ALL_POLICIES, OWN_POLICY)) from error
    check_counted(comparisons, request.skip_first, options.selection)
    return comparisons


def make_selection(request: EvaluateRequest) -> Selection:
    """Frames that are judged."""
    part = request.shard
    return Selection(
        frames=request.frames, shard=Shard(index=part[0], count=part[1]) if part else None
    )


def check_folders(request: EvaluateRequest) -> None:
    """Refuse folders that are not there, or hold pictures of other formats alone.

    Raises:
        FrameFolderError: names the folder, and what it was given as.
    """
    named: list[tuple[Path, str]] = [(folder, "TEST") for folder in request.test_folders]
    named.append((request.reference_folder, "REF"))
    if request.gbuffer is not None:
        named.append((request.gbuffer, "--gbuffer"))
    for folder, role in named:
        if is_file(folder):
            raise FrameFolderError(
                f"{folder}: is a file ({role}); name the folder that holds the frames"
            )
        if not is_folder(folder):
            raise FrameFolderError(f"{folder}: no such folder ({role})")
        others = _picture_suffixes(folder)
        if others:
            raise FrameFolderError(
                f"{folder}: holds {' and '.join(sorted(others))} files, no EXR ({role}); evaluate "
                "reads linear radiance from EXR frames: give the folder that has them"
            )


def _picture_suffixes(folder: Path) -> frozenset[str]:
    """Suffixes of the pictures below a folder; none where one EXR is among them."""
    suffixes = set()
    for path in folder.rglob("*"):
        suffix = path.suffix.lower()
        if suffix == EXR_SUFFIX:
            return frozenset()
        suffixes.add(suffix)
    return PICTURE_SUFFIXES & suffixes


def check_counted(comparisons: Sequence[Comparison], skip_first: int, selection: Selection) -> None:
    """Refuse to skip so much that no shot has a mean; of a shard the others may have one.

    Raises:
        FrameFolderError: names the reference's folder and its frames.
    """
    whole = replace(selection, shard=None)
    if any(set(whole.of(c.available)) - set(c.available[:skip_first]) for c in comparisons):
        return
    first = comparisons[0]
    raise FrameFolderError(
        f"{first.reference.frames.root}: --skip-first {skip_first} leaves no frame of any test for "
        f"means; frames {format_ranges(whole.of(first.available))} are judged, skip fewer"
    )


def make_judgement(request: EvaluateRequest) -> Generator[MetricUnavailable, None, Judgement]:
    """Load what the metrics need; yields those that cannot be had.

    Raises:
        ConfigError: the device is not there.
    """
    protocol = PROTOCOLS[request.protocol]
    convention = SsimConvention(request.ssim_convention or protocol.ssim_convention)
    device = resolve_device(request.device)
    wanted = MetricRules(
        protocol=protocol,
        metrics=tuple(str(name) for name in request.metrics),
        ssim=convention,
        ppd=request.ppd or DEFAULT_PPD,
    )
    rules, unavailable = load_metrics(wanted, request.lpips_weights, device)
    for metric, reason in unavailable.items():
        yield MetricUnavailable(metric=metric, reason=reason)
    tests = name_methods(request.test_folders)
    return Judgement(
        run=ScoringOptions(
            rules=rules,
            border=request.border,
            skip_first=request.skip_first,
            jobs=request.jobs,
            device=device,
        ),
        options={
            "border": request.border,
            "skip_first": request.skip_first,
            "samples_per_pixel": request.samples_per_pixel,
            "ssim_convention": convention.value,
            "ppd": rules.ppd,
        },
        inputs={
            "reference": str(request.reference_folder),
            "gbuffer": str(request.gbuffer or request.reference_folder),
            "tests": {name: str(path) for name, path in tests.items()},
        },
        unavailable=unavailable,
        selection=make_selection(request),
    )


def load_metrics(
    rules: MetricRules, weights: Path | None, device: str
) -> tuple[MetricRules, Mapping[str, str]]:
    """Load what metrics need; one that cannot be had is left out, and its reason returned."""
    unavailable: dict[str, str] = {}
    if MetricName.LPIPS in rules.metrics:
        try:
            network = Lpips.load(weights, device)
            rules = replace(rules, lpips=network.map, lpips_source=network.weights.source)
        except MetricUnavailableError as error:
            unavailable[MetricName.LPIPS.value] = str(error)
    if MetricName.VMAF in rules.metrics:
        try:
            find_ffmpeg()
        except MetricUnavailableError as error:
            unavailable[MetricName.VMAF.value] = str(error)
    left = tuple(name for name in rules.metrics if name not in unavailable)
    return replace(rules, metrics=left), unavailable
