"""`rtsr evaluate` after parsing: comparisons, one run; then a table, files, thresholds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from tqdm import tqdm

from rtsr_cli.commands import evaluation_text as text
from rtsr_cli.commands.basics import LOG, device_named
from rtsr_cli.commands.interruption import unwinding
from rtsr_cli.commands.options import emit
from rtsr_cli.commands.running import FAILED, selection
from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.errors import (
    ConfigError,
    FrameFolderError,
    MetricUnavailableError,
    did_you_mean,
)
from rtsr_cli.core.evaluation import results
from rtsr_cli.core.evaluation.comparing import (
    CompareOptions,
    Comparison,
    method_names,
    open_comparisons,
)
from rtsr_cli.core.evaluation.frames import check_border
from rtsr_cli.core.evaluation.illustrating import moments, strips
from rtsr_cli.core.evaluation.judging import JudgedShot, Judgement, judged_shot, result_of
from rtsr_cli.core.evaluation.metric_table import METRICS, Rules
from rtsr_cli.core.evaluation.protocols import PROTOCOLS
from rtsr_cli.core.evaluation.running import RunOptions
from rtsr_cli.core.io.atomic import write_atomically
from rtsr_cli.core.io.opening import ReadOptions
from rtsr_cli.core.io.selection import Selection, ranges
from rtsr_cli.core.metrics.flip import DEFAULT_PPD
from rtsr_cli.core.metrics.lpips import Lpips
from rtsr_cli.core.metrics.ssim import SsimConvention
from rtsr_cli.core.metrics.vmaf import ffmpeg
from rtsr_cli.core.reporting.report import html_report

EXR_SUFFIX = ".exr"
PICTURE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg"})

ALL_POLICIES, OWN_POLICY = "--on-missing skip|hold (history restarts there)", "--on-missing skip"
"""What reading advises, and what of it judging has: a frame that stands in is not judged."""


@dataclass(frozen=True, kw_only=True)
class Evaluated:
    """A result, and what its pictures are made from; nothing of the latter after a merge.

    `contents` are those of the files that are to be written.
    """

    result: Mapping[str, Any]
    contents: Mapping[Path, str] = field(default_factory=dict)
    shots: Sequence[JudgedShot] = ()
    judgement: Judgement | None = None

    @property
    def lacking(self) -> tuple[str, ...]:
        """Metrics that could not be had."""
        return () if self.judgement is None else tuple(self.judgement.unavailable)


def evaluated(chosen: Mapping[str, Any]) -> Evaluated | None:
    """Judge, or join parts; None for a dry run. Nothing is written yet."""
    text.check_outputs(chosen["outputs"], overwrite=chosen["overwrite"])
    found = _merged(chosen["tests"]) if chosen["merge"] else _judged(chosen)
    if found is None:
        return None
    _check_demands(chosen, found.result)
    contents = {path: WRITERS[path.suffix.lower()](found) for path in chosen["outputs"]}
    return replace(found, contents=contents)


def _check_demands(chosen: Mapping[str, Any], result: Mapping[str, Any]) -> None:
    """Refuse demands on metrics that merged parts do not hold.

    Raises:
        ConfigError: names the metric.
    """
    known = result["metrics"]
    for condition in chosen["demanded"]:
        if condition.metric not in known:
            hint = did_you_mean(condition.metric, known)
            raise ConfigError(f"--fail-under: the parts hold no metric '{condition.metric}'{hint}")


def deliver(chosen: Mapping[str, Any], found: Evaluated) -> int:
    """Print and write; return the exit code."""
    _tell(chosen, found.result)
    for path, content in found.contents.items():
        with unwinding():
            write_atomically(path, partial(_put, content))
        LOG.info("%s: written", path)
    missed = results.failures(found.result, chosen["demanded"])
    for line in missed:
        LOG.error("Missed: %s", line)
    failed = [reason for shot in found.shots for reason in shot.failed]
    for reason in failed:
        LOG.error("Failed: %s", reason)
    # one that was named is missed; of all of them, those that can be had are enough
    lacking = found.lacking if set(chosen["metrics"]) < set(METRICS) else ()
    return FAILED if missed or failed or lacking else 0


def _put(content: str, path: Path) -> None:
    path.write_text(content, encoding="utf-8")


def _html(found: Evaluated) -> str:
    if found.judgement is None:
        return html_report(found.result, (), ())
    return html_report(
        found.result, tuple(moments(found.shots, found.judgement)), tuple(strips(found.shots))
    )


WRITERS: Mapping[str, Callable[[Evaluated], str]] = {
    ".json": lambda found: text.as_json(found.result),
    ".csv": lambda found: text.as_csv(found.result),
    ".html": _html,
}
"""What a suffix of `--output` writes."""


def _judged(chosen: Mapping[str, Any]) -> Evaluated | None:
    """Survey, judge and put together; None for a dry run."""
    protocol = PROTOCOLS[chosen["protocol"]]
    options = CompareOptions(
        gbuffer=chosen["gbuffer"],
        samples=chosen["samples_per_pixel"],
        selection=selection(chosen),
        predicted_only=protocol.predicted_only,
        read=ReadOptions(
            layout=chosen["layout"],
            capture=chosen["capture_file"],
            on_missing=MissingPolicy(chosen["on_missing"]),
            sharded=chosen["shard"] is not None,
        ),
    )
    _check_folders(chosen)
    tests = method_names(chosen["tests"])
    comparisons = _comparisons(tests, chosen["reference"], options)
    _check_counted(comparisons, chosen["skip_first"], options.selection)
    judgement = _judgement(chosen, tests)
    for comparison in comparisons:
        check_border(comparison, chosen["border"])
        _announce(chosen, comparison)
    if chosen["dry_run"]:
        return None
    shots = []
    with tqdm(total=sum(len(c.numbers) for c in comparisons), unit="frame", disable=None) as bar:
        for comparison in comparisons:
            shots.append(judged_shot(comparison, judgement, bar.update))
    return Evaluated(result=result_of(shots, judgement), shots=shots, judgement=judgement)


def _comparisons(
    tests: Mapping[str, Path], reference: Path, options: CompareOptions
) -> list[Comparison]:
    """Survey; advice about missing frames is put as this command takes it."""
    try:
        return open_comparisons(tests, reference, options)
    except FrameFolderError as error:
        raise FrameFolderError(str(error).replace(ALL_POLICIES, OWN_POLICY)) from error


def _check_folders(chosen: Mapping[str, Any]) -> None:
    """Refuse folders that are not there, or hold pictures of other formats alone.

    Raises:
        FrameFolderError: names the folder, and what it was given as.
    """
    named = [(folder, "TEST") for folder in chosen["tests"]]
    named += [(chosen["reference"], "REF"), (chosen["gbuffer"], "--gbuffer")]
    for folder, role in named:
        if folder is None:
            continue
        if folder.is_file():
            raise FrameFolderError(
                f"{folder}: is a file ({role}); name the folder that holds the frames"
            )
        if not folder.is_dir():
            raise FrameFolderError(f"{folder}: no such folder ({role})")
        others = _picture_suffixes(folder)
        if others:
            raise FrameFolderError(
                f"{folder}: holds {' and '.join(sorted(others))} files, no EXR ({role}); evaluate "
                "reads linear radiance from EXR frames: give the folder that has them"
            )


def _picture_suffixes(folder: Path) -> frozenset[str]:
    """Suffixes of the pictures below a folder; none where one EXR is among them."""
    found = set()
    for path in folder.rglob("*"):
        suffix = path.suffix.lower()
        if suffix == EXR_SUFFIX:
            return frozenset()
        found.add(suffix)
    return PICTURE_SUFFIXES & found


def _check_counted(
    comparisons: Sequence[Comparison], skip_first: int, selection: Selection
) -> None:
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
        f"means; frames {ranges(whole.of(first.available))} are judged, skip fewer"
    )


def _judgement(chosen: Mapping[str, Any], tests: Mapping[str, Path]) -> Judgement:
    protocol = PROTOCOLS[chosen["protocol"]]
    convention = SsimConvention(chosen["ssim_convention"] or protocol.ssim_convention)
    device = device_named(chosen["device"])
    rules = Rules(
        protocol=protocol,
        metrics=chosen["metrics"],
        ssim=convention,
        ppd=chosen["ppd"] or DEFAULT_PPD,
    )
    rules, unavailable = _equipped(rules, chosen, device)
    return Judgement(
        run=RunOptions(
            rules=rules,
            border=chosen["border"],
            skip_first=chosen["skip_first"],
            jobs=chosen["jobs"],
            device=device,
        ),
        options={
            "border": chosen["border"],
            "skip_first": chosen["skip_first"],
            "samples_per_pixel": chosen["samples_per_pixel"],
            "ssim_convention": convention.value,
            "ppd": rules.ppd,
        },
        inputs={
            "reference": str(chosen["reference"]),
            "gbuffer": str(chosen["gbuffer"] or chosen["reference"]),
            "tests": {name: str(path) for name, path in tests.items()},
        },
        unavailable=unavailable,
        selection=selection(chosen),
    )


def _equipped(rules: Rules, chosen: Mapping[str, Any], device: str) -> tuple[Rules, dict[str, str]]:
    """Load what metrics need; one that cannot be had is left out, and said."""
    unavailable: dict[str, str] = {}
    if "lpips" in rules.metrics:
        try:
            network = Lpips.load(chosen["lpips_weights"], device)
            rules = replace(rules, lpips=network.map, lpips_source=network.weights.source)
        except MetricUnavailableError as error:
            unavailable["lpips"] = str(error)
    if "vmaf" in rules.metrics:
        try:
            ffmpeg()
        except MetricUnavailableError as error:
            unavailable["vmaf"] = str(error)
    for reason in unavailable.values():
        LOG.warning("Warning: %s", reason)
    left = tuple(name for name in rules.metrics if name not in unavailable)
    return replace(rules, metrics=left), unavailable


def _announce(chosen: Mapping[str, Any], comparison: Comparison) -> None:
    height, width = comparison.size
    facts = {
        "shot": comparison.shot,
        "frames": ranges(comparison.numbers),
        "size": [width, height],
        "reference": str(comparison.reference.frames.root),
        "gbuffer": None if comparison.gbuffer is None else str(comparison.gbuffer.frames.root),
    }
    if chosen["as_json"]:
        emit({"event": "plan", **facts})
        return
    if not set(comparison.numbers) - set(comparison.available[: chosen["skip_first"]]):
        LOG.warning("%s: --skip-first leaves no frame for means", facts["reference"])
    LOG.info(
        "%s: frames %s, %d x %d, against %s; buffers: %s",
        comparison.shot or ", ".join(comparison.tests),
        facts["frames"],
        width,
        height,
        facts["reference"],
        facts["gbuffer"] or "none",
    )


def _merged(paths: Sequence[Path]) -> Evaluated:
    """Join the JSON files of parts."""
    parts = []
    for path in paths:
        try:
            parts.append((str(path), text.from_json(path.read_text(encoding="utf-8"))))
        except (OSError, ValueError, OverflowError) as error:
            raise FrameFolderError(
                f"{path}: is no result of 'rtsr evaluate --output part.json' ({error})"
            ) from error
    return Evaluated(result=results.merged(parts))


def _tell(chosen: Mapping[str, Any], result: Mapping[str, Any]) -> None:
    if chosen["as_json"]:
        emit({"event": "done", **text.strict(result)})
        return
    for line in (*text.table(result), *text.perfect_frames(result)):
        LOG.info("%s", line)
    if any(any(r for r in test["regions"].values()) for test in result["tests"].values()):
        for line in text.region_table(result):
            LOG.debug("%s", line)
    for key, test in result["tests"].items():
        for note in test["notes"]:
            LOG.warning("Note: %s: %s", key, note)
