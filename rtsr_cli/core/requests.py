"""What every request checks; imports no torch, as commands read their defaults from requests."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from rtsr_cli.core.choices import Precision, Runtime
from rtsr_cli.core.errors import RequestError, did_you_mean

MOST_JOBS = 64
"""Threads that read, and threads that write, at most."""


def check_ranges(request: Any, **ranges: tuple[float, float]) -> None:
    """Hold numbers of a request to be from the least to the most that they may be.

    Args:
        request: a dataclass; fields that are None are left out.
        ranges: field -> (least, most), `math.inf` where there is no most.

    Raises:
        RequestError: one is not; names it.
    """
    for name, (least, most) in ranges.items():
        value = getattr(request, name)
        if value is not None and not (least <= value <= most and math.isfinite(value)):
            upper = "on" if most == math.inf else f"to {most:g}"
            raise RequestError(f"{name} is {value}: a number from {least:g} {upper}")


def check_runtime(request: Any) -> None:
    """Hold what goes together with exported files, which onnxruntime computes on the processor.

    Args:
        request: a frozen dataclass with `runtime`, `model`, `weights_file`, `device`, while it is
            made.

    Raises:
        RequestError: something does not.
    """
    if request.runtime is not Runtime.ONNX:
        if request.model is not None:
            raise RequestError("--model is read with --runtime onnx only; add it")
        return
    if request.model is None:
        raise RequestError("--runtime onnx needs --model, a folder that rtsr export wrote")
    if request.weights_file is not None:
        raise RequestError("--weights: with --runtime onnx they are in --model; leave it out")
    if request.device not in {"auto", "cpu"}:
        raise RequestError("--device: --runtime onnx computes on the processor; leave it out")
    if getattr(request, "precision", Precision.AUTO) is not Precision.AUTO:
        raise RequestError("--precision is that of the files in --model; leave it out")
    object.__setattr__(request, "device", "cpu")


def check_shard(shard: tuple[int, int] | None) -> None:
    """Hold a part (i, n) to be one of n.

    Raises:
        RequestError: it is not.
    """
    if shard is not None and not 1 <= shard[0] <= shard[1]:
        raise RequestError(f"shard is {shard[0]}/{shard[1]}: parts go from 1/n to n/n")


def accept_words(request: Any) -> None:
    """Turn words into the paths and enum members that fields hold, collections into sets.

    A notebook may say `jitter="halton"`; compared with members, a word would be none of them.

    Args:
        request: a frozen dataclass, while it is made.

    Raises:
        RequestError: a word is no member; suggests one.
    """
    declared: type = type(request)
    kinds = _word_kinds(declared)
    for field in fields(request):
        value, kind = getattr(request, field.name), kinds.get(field.name)
        if field.name in _set_fields(declared) and value is not None:
            object.__setattr__(request, field.name, frozenset(value))
        if kind is None or value is None:
            continue
        if isinstance(value, (tuple, list)):
            accepted: object = tuple(_accept_word(field.name, kind, word) for word in value)
        else:
            accepted = _accept_word(field.name, kind, value)
        object.__setattr__(request, field.name, accepted)


def _accept_word(name: str, kind: type[StrEnum] | type[Path], word: object) -> object:
    if not isinstance(word, str) or isinstance(word, kind):
        return word
    if issubclass(kind, Path):
        return kind(word)
    members = {member.value: member for member in kind}
    if word not in members:
        raise RequestError(f"{name} is '{word}'{did_you_mean(word, members)}")
    return members[word]


@cache
def _word_kinds(request: type) -> Mapping[str, type[StrEnum] | type[Path]]:
    """Field -> the enum or path that it holds, alone, or None, or in a tuple."""
    return {
        name: kind
        for name, hint in get_type_hints(request).items()
        for kind in _leaves(hint)
        if isinstance(kind, type) and issubclass(kind, (StrEnum, Path))
    }


@cache
def _set_fields(request: type) -> frozenset[str]:
    """Fields that hold a frozen set, or None: frame numbers, given as any collection."""
    return frozenset(
        name
        for name, hint in get_type_hints(request).items()
        if any(get_origin(part) is frozenset for part in (hint, *get_args(hint)))
    )


def _leaves(hint: object) -> Iterator[object]:
    inner = get_args(hint)
    if not inner:
        yield hint
    for part in inner:
        yield from _leaves(part)
