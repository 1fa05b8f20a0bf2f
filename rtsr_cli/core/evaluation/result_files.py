"""Results as files: JSON that is read again, CSV, and which files `rtsr evaluate` wrote."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rtsr_cli.core.documents import check_regular, parse_json, read_json, shorten_value
from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.evaluation.score_summary import BETWEEN, PAST, REASONS
from rtsr_cli.core.files.atomic_write import check_writable
from rtsr_cli.core.files.ownership import is_own, list_foreign
from rtsr_cli.core.limits import LARGEST_FRAME
from rtsr_cli.core.visible_text import make_all_visible, write_cell

Result = Mapping[str, Any]

INFINITE = {"inf": math.inf, "-inf": -math.inf}
"""How JSON, which has no infinite numbers, holds them."""

CSV_HEAD, CSV_TAIL = ("test", "shot", "frame", "region", "share"), ("nonfinite",)
"""Columns before and after those of the metrics, and of why some are empty."""

MOST_DIGITS = 29
"""Of a frame's number."""

LARGEST_SCORE = 1e30
"""Scores that are finite go so far."""

HEAD_CHARACTERS = 1 << 16

JSON_FIELDS: Mapping[str, type] = {
    "protocol": str, "options": dict, "metrics": dict, "rules": str, "tests": dict,
}  # fmt: skip
"""What a result always holds."""


def encode_json(result: Result) -> str:
    """Write the result as strict JSON."""
    plain = make_all_visible(encode_numbers(result))
    return json.dumps(plain, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def encode_numbers(value: Any) -> Any:
    """Return plain values as JSON can hold them: infinite numbers as "inf", NaN as null."""
    if isinstance(value, float) and not math.isfinite(value):
        return next((name for name, known in INFINITE.items() if value == known), None)
    if isinstance(value, Mapping):
        return {key: encode_numbers(held) for key, held in value.items()}
    if isinstance(value, list | tuple):
        return [encode_numbers(held) for held in value]
    return value


def decode_json(content: str) -> dict[str, Any]:
    """Read a result that `encode_json` wrote; what follows from its frames is left as it is.

    Raises:
        ValueError: it is none; says what is wrong.
    """
    entry = parse_json(content)
    _check_fields(entry, JSON_FIELDS, "the result")
    _check_fields(entry, {k: dict for k in ("inputs", "regions", "versions") if k in entry}, "it")
    for name, metric in entry["metrics"].items():
        _check_fields(metric, dict.fromkeys(("title", "unit", "better"), str), f"metric '{name}'")
    _require(bool(entry["tests"]), "it has no tests")
    if "shard" in entry:
        _check_shard(entry["shard"])
    tests = {key: _parse_test(test, f"test '{key}'") for key, test in entry["tests"].items()}
    return {**entry, "tests": tests}


def _check_fields(entry: Any, fields: Mapping[str, type], what: str) -> None:
    _require(isinstance(entry, dict), f"{what} is no object")
    for name, kind in fields.items():
        right = isinstance(entry.get(name), kind)
        _require(right, f"'{name}' of {what} is missing, or of another kind")


def _require(condition: bool, complaint: str) -> None:
    if not condition:
        raise ValueError(complaint)


def _check_shard(entry: Any) -> None:
    _check_fields(entry, {"parts": list, "of": int}, "'shard'")
    right = all(isinstance(i, int) and 1 <= i <= entry["of"] for i in entry["parts"])
    _require(right and "frames" in entry, "'shard' names no parts")


def _parse_test(entry: Any, what: str) -> dict[str, Any]:
    _check_fields(entry, {"method": str, "shot": str, "frames": dict, "notes": list}, what)
    _require(all(isinstance(n, str) for n in entry["notes"]), f"notes of {what} are no sentences")
    frames = {key: _parse_frame(key, facts, what) for key, facts in entry["frames"].items()}
    return {**entry, "frames": frames}


def _parse_frame(number: str, entry: Any, what: str) -> dict[str, Any]:
    """One frame's facts, infinite numbers as numbers."""
    what = f"frame '{shorten_value(number)}' of {what}"
    right = number.isascii() and number.removeprefix("-").isdecimal()
    _require(right and abs(int(number[:MOST_DIGITS])) <= LARGEST_FRAME, f"{what} has no number")
    _require(len(number) < MOST_DIGITS, f"{what} has no number")
    plain = {"nonfinite": int, "counted": bool, "regions": dict}
    _check_fields(entry, plain, what)
    plain |= {k: kind for k, kind in ((PAST, int), (BETWEEN, bool)) if k in entry}
    _check_fields(entry, plain, what)
    reasons = entry.get(REASONS, {})
    _check_fields(reasons, dict.fromkeys(reasons, str), f"'{REASONS}' of {what}")
    regions = {
        region: None if scores is None else _parse_scores(scores, what)
        for region, scores in entry["regions"].items()
    }
    scores = _parse_scores({k: v for k, v in entry.items() if k not in {*plain, REASONS}}, what)
    return {**entry, **scores, "regions": regions}


def _parse_scores(entry: Any, what: str) -> dict[str, float | None]:
    _check_fields(entry, {}, f"a region of {what}")
    return {name: _parse_score(value, f"'{name}' of {what}") for name, value in entry.items()}


def _parse_score(value: Any, what: str) -> float | None:
    if isinstance(value, str) and value in INFINITE:
        return INFINITE[value]
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return None
    _require(type(value) in (int, float), f"{what} is no number")
    _require(abs(value) <= LARGEST_SCORE or math.isinf(value), f"{what} is no score")
    return float(value)


def is_result(path: Path) -> bool:
    """Tell whether `rtsr evaluate` wrote a file, by what its suffix promises."""
    if not path.is_file():
        return False
    try:
        check_regular(path)
        with path.open(encoding="utf-8") as stream:
            if path.suffix.lower() == ".json":
                entry = read_json(path)
                return isinstance(entry, dict) and entry.keys() >= JSON_FIELDS.keys()
            head = stream.read(HEAD_CHARACTERS)
    except (OSError, ValueError):
        return False
    if path.suffix.lower() == ".csv":
        columns = tuple(head.partition("\n")[0].split(","))
        return columns[: len(CSV_HEAD)] == CSV_HEAD and columns[-1:] == CSV_TAIL
    return is_own(path)


def encode_csv(result: Result) -> str:
    """Write a line a test, frame and region; means carry no frame number."""
    metrics = list(result["metrics"])
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")

    def write_row(*cells: object) -> None:
        table.writerow([write_cell(cell) for cell in cells])

    write_row(*CSV_HEAD, *metrics, REASONS, *CSV_TAIL)
    for test in result["tests"].values():
        place = [test["method"], test["shot"]]
        for frame, facts in test["frames"].items():
            for region, scores in facts["regions"].items():
                everything = facts if region == "all" else scores or {}
                write_row(
                    *place, frame, region, (scores or {}).get("share"),
                    *(everything.get(m) for m in metrics),
                    _join_reasons(facts) if region == "all" else "", facts["nonfinite"],
                )  # fmt: skip
        for region, scores in test["regions"].items():
            everything = test["mean"] if region == "all" else scores or {}
            write_row(
                *place, "", region, (scores or {}).get("share"),
                *(everything.get(m) for m in metrics), "", test["nonfinite"],
            )  # fmt: skip
    return text.getvalue()


def _join_reasons(facts: Mapping[str, Any]) -> str:
    """Why a frame lacks values, in one cell."""
    return "; ".join(f"{metric}: {reason}" for metric, reason in facts.get(REASONS, {}).items())


def check_outputs(paths: Sequence[Path], *, overwrite: bool) -> None:
    """Refuse files that cannot be written, or that something else wrote.

    Raises:
        OutputError: names the file.
    """
    for path in paths:
        file = next((p for p in path.parents if p.exists() and not p.is_dir()), None)
        if file is not None:
            raise OutputError(f"{path}: {file} is a file, no folder; choose another --output")
        if path.is_dir():
            raise OutputError(f"{path}: is a folder; name a file in --output")
        if not overwrite and list_foreign([path], is_result):
            raise OutputError(
                f"{path}: 'rtsr evaluate' did not write this file; choose another --output, or "
                "replace it with --overwrite"
            )
        check_writable(path.parent)
