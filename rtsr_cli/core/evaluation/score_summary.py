"""Scores of frames put together: means, intervals, regions, merging of parts.

The mean of a metric is the mean over frames. Infinite values (PSNR of identical frames) are left
out of it where others are finite; where all are infinite, so is the mean.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rtsr_cli.core import statistics
from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.cadence import FULL_PAST
from rtsr_cli.core.frames.gaps import format_gaps, list_gaps
from rtsr_cli.core.frames.selection import format_ranges

HISTORY = "history"
"""Of a test: "full" and "less", the frames with so much history and their means."""

Scores = Mapping[str, float | None]
"""Metric -> value; None where a frame has none."""

REASONS = "reasons"
"""Of a frame: metric -> why it has no value; there only where one has none."""

PAST, BETWEEN = "past", "between"
"""Of a predicted frame: rendered ones before it, as its file says. Of a frame that lies between
predicted ones: true; it has scores of its change alone."""

BELOW_ZERO = ("negative", "negative_reference")
"""Of a frame: values of radiance below 0 in the test and in the reference."""

FACTS = frozenset(
    {"nonfinite", "nonfinite_reference", "counted", "regions", REASONS, PAST, BETWEEN, *BELOW_ZERO}
)
"""What a frame's entry holds beside its scores."""

INFINITE_RULE = (
    "infinite values (identical frames) are left out of means unless all are; "
    'JSON holds them as "inf"'
)

VMAF, VMAF_HARMONIC = "vmaf", "vmaf-harmonic"
"""Of the latter there is no value a frame: its mean lets bad frames weigh more."""

MISSING_PARTS = "parts missing: "
"""Starts the note of a result that lacks parts; merging it with them takes the note away."""

NO_HISTORY = (
    "no judged frame has history (the frame before it in all folders, no cut between): "
    "temporal metrics cannot be made"
)
"""Note of a part that is the whole's only if every part has it."""

STANDING_STILL = (
    "VMAF: parts that were made without --shard count their first frames as standing still, so "
    "that this is not the VMAF of one run"
)


def pooled_mean(values: Iterable[float | None]) -> float | None:
    """Return the mean by the rule above; None without values."""
    known = [v for v in values if v is not None and not math.isnan(v)]
    finite = [v for v in known if math.isfinite(v)]
    if finite:
        return math.fsum(finite) / len(finite)
    return known[0] if known else None


def harmonic_mean(values: Iterable[float | None]) -> float | None:
    """n / sum(1 / (v + 1)) - 1, as libvmaf pools scores; None without values."""
    known = [v for v in values if v is not None and v > -1.0]
    return len(known) / math.fsum(1.0 / (v + 1.0) for v in known) - 1.0 if known else None


def score_interval(values: Iterable[float | None]) -> list[float] | None:
    """95 % interval of the mean over those values that are there and finite."""
    bounds = statistics.mean_interval([v for v in values if v is not None and math.isfinite(v)])
    return None if bounds is None else list(bounds)


@dataclass(frozen=True, kw_only=True)
class FrameScores:
    """Scores of one method on one frame.

    Attributes:
        number: frame number.
        scores: metric -> value.
        regions: region -> share of the pixels and metric -> value; None where it cannot be made.
        nonfinite: pixels that are NaN or Inf in the test.
        nonfinite_reference: pixels that are in the reference.
        negative, negative_reference: values of radiance below 0.
        reasons: metric -> why it has no value.
        counted: False where the frame is shown but takes no part in means (`--skip-first`).
        past: rendered frames before a predicted one, None where nothing says so.
        between: whether it lies between predicted frames, and has scores of its change alone.
    """

    number: int
    scores: Scores
    regions: Mapping[str, Scores | None]
    nonfinite: int
    nonfinite_reference: int = 0
    negative: int = 0
    negative_reference: int = 0
    reasons: Mapping[str, str] = field(default_factory=dict)
    counted: bool = True
    past: int | None = None
    between: bool = False

    def facts(self) -> dict[str, Any]:
        """Return the plain values of the JSON file."""
        return {
            **self.scores,
            "nonfinite": self.nonfinite,
            "nonfinite_reference": self.nonfinite_reference,
            "negative": self.negative,
            "negative_reference": self.negative_reference,
            **({REASONS: dict(self.reasons)} if self.reasons else {}),
            "counted": self.counted,
            **({} if self.past is None else {PAST: self.past}),
            **({BETWEEN: True} if self.between else {}),
            "regions": {name: None if r is None else dict(r) for name, r in self.regions.items()},
        }


def summarise_frames(frames: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Put the frames of one method and shot together, by number, as `FrameScores.facts`."""
    counted = [f for f in frames.values() if f["counted"]]
    names = [k for k in _list_keys(counted) if k not in FACTS]
    means = {name: pooled_mean(f.get(name) for f in counted) for name in names}
    if VMAF in means:
        means[VMAF_HARMONIC] = harmonic_mean(f.get(VMAF) for f in counted)
    return {
        "mean": means,
        "confidence": {name: score_interval(f.get(name) for f in counted) for name in names},
        "frames": dict(frames),
        "regions": _average_regions([f["regions"] for f in counted]),
        **_split_by_history(frames, names),
        "nonfinite": sum(int(f["nonfinite"]) for f in frames.values()),
        **{
            name: sum(int(f.get(name, 0)) for f in frames.values())
            for name in ("nonfinite_reference", *BELOW_ZERO)
        },
    }


def _split_by_history(
    frames: Mapping[str, Mapping[str, Any]], names: Sequence[str]
) -> dict[str, Any]:
    """Means of predicted frames with full history, and of the others; nothing without stamps."""
    told = {n: f for n, f in frames.items() if f["counted"] and PAST in f}
    groups = {
        "full": {n: f for n, f in told.items() if f[PAST] >= FULL_PAST},
        "less": {n: f for n, f in told.items() if f[PAST] < FULL_PAST},
    }
    split = {
        name: {
            "frames": [int(n) for n in held],
            "mean": {metric: pooled_mean(f.get(metric) for f in held.values()) for metric in names},
            "regions": _average_regions([f["regions"] for f in held.values()]),
        }
        for name, held in groups.items()
        if held
    }
    return {HISTORY: split} if split else {}


def _list_keys(mappings: Iterable[Mapping[str, Any]]) -> list[str]:
    return list(dict.fromkeys(key for mapping in mappings for key in mapping))


def _average_regions(frames: Sequence[Mapping[str, Scores | None]]) -> dict[str, Any]:
    """Means over the frames in which a region is; None where it is in none."""
    region_means: dict[str, Any] = {}
    for region in _list_keys(frames):
        held = [scores for f in frames if (scores := f.get(region)) is not None]
        means = {key: pooled_mean(scores.get(key) for scores in held) for key in _list_keys(held)}
        region_means[region] = means or None
    return region_means


def group_by_method(tests: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Means of every method over its shots, each shot counting once."""
    methods: dict[str, list[Mapping[str, Any]]] = {}
    for test in tests.values():
        methods.setdefault(test["method"], []).append(test)
    return {
        method: {
            "mean": {
                key: pooled_mean(t["mean"].get(key) for t in shots)
                for key in _list_keys(t["mean"] for t in shots)
            },
            "confidence": {
                key: score_interval(t["mean"].get(key) for t in shots)
                for key in _list_keys(t["mean"] for t in shots)
            },
            "shots": len(shots),
        }
        for method, shots in methods.items()
    }


ResultPart = tuple[str, Mapping[str, Any]]
"""File name and content of a part's result."""


def merge_results(parts: Sequence[ResultPart]) -> dict[str, Any]:
    """Join the results of parts of the same frames (`--shard`), by frame number.

    Parts that are missing are told in the notes of every test.

    Raises:
        FrameFolderError: a part was judged by other rules, of other tests, or holds what another
            one holds.
    """
    first = parts[0][1]
    _check_rules(parts)
    _check_tests(parts)
    shard = _join_shards(parts)
    tests: dict[str, dict[str, Any]] = {}
    for key, test in first["tests"].items():
        facts = {**test, **summarise_frames(_join_frames(parts, key))}
        tests[key] = {**facts, "notes": _join_notes(parts, key, shard)}
    result = {**first, "tests": tests}
    result.pop("shard", None)
    if shard is not None and _list_missing_parts(shard):
        result["shard"] = shard
    if "methods" in first:
        result["methods"] = group_by_method(tests)
    return result


def _check_rules(parts: Sequence[ResultPart]) -> None:
    first_name, first = parts[0]
    for name, part in parts:
        for rule, what in (
            ("protocol", "another protocol"),
            ("options", "other options"),
            ("metrics", "other metrics"),
        ):
            if part.get(rule) != first.get(rule):
                raise FrameFolderError(
                    f"{name}: was judged with {what} than {first_name}; evaluate it again with "
                    "the same options"
                )


def _check_tests(parts: Sequence[ResultPart]) -> None:
    """Every part holds every test: means over different frames would not compare."""
    holders = {key: name for name, part in reversed(parts) for key in part["tests"]}
    for name, part in parts:
        lacking = [key for key in holders if key not in part["tests"]]
        if lacking:
            listed = ", ".join(f"'{key}'" for key in lacking)
            raise FrameFolderError(
                f"{name}: lacks {listed}, which {holders[lacking[0]]} has; tests compare over the "
                "same frames only: evaluate this part again with the same TEST folders"
            )


def _join_frames(parts: Sequence[ResultPart], key: str) -> dict[str, Any]:
    """Frames of one test, of all parts, in order."""
    frames: dict[str, Any] = {}
    for name, part in parts:
        frames_of_part = part["tests"][key]["frames"]
        twice = sorted(set(frames) & set(frames_of_part), key=int)
        if twice:
            raise FrameFolderError(
                f"{name}: frame {twice[0]} of '{key}' is in another part already; merge each part "
                "once"
            )
        frames |= frames_of_part
    return dict(sorted(frames.items(), key=lambda item: int(item[0])))


def _list_lasting(parts: Sequence[ResultPart], key: str) -> list[str]:
    """Notes of a test's parts that are true of the whole, once each."""
    told = [part["tests"][key].get("notes", ()) for _, part in parts]
    # a part of first frames alone has none where the others have
    partial = () if all(NO_HISTORY in notes for notes in told) else (NO_HISTORY,)
    listed = dict.fromkeys(note for notes in told for note in notes if note not in partial)
    return [note for note in listed if not note.startswith(MISSING_PARTS)]


def _join_notes(
    parts: Sequence[ResultPart], key: str, shard: Mapping[str, Any] | None
) -> list[str]:
    """Notes of all parts once each, and what is to be said of the parts themselves."""
    notes = _list_lasting(parts, key)
    missing = [] if shard is None else _list_missing_parts(shard)
    if shard is not None and missing:
        notes.append(
            f"{MISSING_PARTS}{format_gaps(missing)} of {shard['of']} (--shard); all figures are "
            "of the other parts alone"
        )
    unsharded = len(parts) > 1 and any("shard" not in part for _, part in parts)
    if unsharded and VMAF in parts[0][1]["metrics"] and STANDING_STILL not in notes:
        notes.append(STANDING_STILL)
    return notes


def _join_shards(parts: Sequence[ResultPart]) -> dict[str, Any] | None:
    """Which parts of how many there are; None where no part says."""
    known = [(name, part["shard"]) for name, part in parts if "shard" in part]
    if not known:
        return None
    first_name, first = known[0]
    taken: dict[int, str] = {}
    for name, shard in known:
        if any(shard[key] != first[key] for key in ("of", "frames")):
            raise FrameFolderError(
                f"{name}: is {_describe_shard(shard)}, {first_name} is {_describe_shard(first)}; "
                "merge parts of one division (--shard, --frames)"
            )
        for index in shard["parts"]:
            if index in taken:
                raise FrameFolderError(
                    f"{name}: part {index}/{shard['of']} is in {taken[index]} already; merge each "
                    "part once"
                )
            taken[index] = name
    return {**first, "parts": sorted(taken)}


def _describe_shard(shard: Mapping[str, Any]) -> str:
    of_frames = "" if shard["frames"] is None else f" of frames {shard['frames']}"
    return f"part {format_ranges(shard['parts'])} of {shard['of']}{of_frames}"


def _list_missing_parts(shard: Mapping[str, Any]) -> list[range]:
    return list_gaps(set(shard["parts"]), {1, shard["of"]}, 1)
