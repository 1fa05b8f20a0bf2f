"""Channels with a sample each: `color.0.R`, `color.1.R`, ... in files of the pixels' size.

The number stands before the component, or last where there is none (`metallic.0`). Without it, a
name is one that layouts and `[buffers]` know. Layer `color` is radiance, which layouts call `R`.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from rtsr_cli.core.captures.bound_channels import Binding, BoundBuffer, BoundSum
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, NORMAL_BUFFERS, Buffer, Resampling

RADIANCE_LAYER = "color"
"""Layer of radiance whose samples are numbered; without numbers radiance has no layer."""

_NUMBERED = re.compile(r"(?P<layer>.+)\.(?P<number>0|[1-9]\d{0,3})(?P<component>\.[^.]+)?")

Samples = Mapping[Buffer, tuple[BoundBuffer, ...]]
"""Where each sample of each buffer that has several is."""

NumberedNames = Mapping[str, Mapping[str, Mapping[int, str]]]
"""Per file sequence, name without number -> number -> name."""


Names = Mapping[str, Mapping[str, str]]
"""Per file sequence, a name that buffers are bound by -> the channel in the file."""


@dataclass(frozen=True, kw_only=True)
class BoundPixels:
    """Where buffers are, pixel by pixel and sample by sample.

    Attributes:
        binding: what stands for a pixel.
        samples: of the buffers that have several.
        fault: why samples cannot be read, where no buffer depends on them.
    """

    binding: Binding
    samples: Samples
    fault: str = ""


@dataclass(frozen=True)
class SampleName:
    """A channel's name without the number of its sample, and the number."""

    plain: str
    number: int


def split_sample(name: str) -> SampleName | None:
    """Take the number of a sample out of a channel's name; None where there is none."""
    match = _NUMBERED.fullmatch(name)
    if match is None:
        return None
    return SampleName(match["layer"] + (match["component"] or ""), int(match["number"]))


def strip_samples(names: Iterable[str]) -> frozenset[str]:
    """Names without the numbers of their samples, of those that have two or more."""
    split = (split_sample(name) for name in names)
    counts = Counter(sample.plain for sample in split if sample is not None)
    return frozenset(plain for plain, count in counts.items() if count > 1)


def number_names(streams: Mapping[str, Collection[str]], own: Collection[str]) -> NumberedNames:
    """Find the channels that have samples: two or more of one name but for the number.

    Args:
        streams: channels of each file sequence.
        own: names that a layout or the user spells out; `color.R` among them is no `R`.
    """
    numbered: dict[str, dict[str, dict[int, str]]] = {}
    for key, names in streams.items():
        several = strip_samples(names)
        for name in sorted(names):
            sample = split_sample(name)
            if sample is None or sample.plain not in several:
                continue
            layer, _, component = sample.plain.rpartition(".")
            bare = layer == RADIANCE_LAYER and sample.plain not in own
            plain = component if bare else sample.plain
            numbered.setdefault(key, {}).setdefault(plain, {})[sample.number] = name
    return numbered


def find_samples(binding: Binding, numbered: NumberedNames) -> Samples:
    """Find every sample of the buffers that have several.

    Args:
        binding: buffers by names without numbers.
        numbered: of `number_names`.

    Raises:
        ValueError: a sample is missing, or buffers have different numbers of them.
    """
    found: dict[Buffer, list[dict[int, str]]] = {}
    for buffer, bound in binding.items():
        held = [numbered.get(c.stream, {}).get(c.channel) for c in bound]
        if any(held):
            found[buffer] = [dict(names) for names in held if names]
    counts = {b: 1 + max(n for names in parts for n in names) for b, parts in found.items()}
    for buffer, parts in found.items():
        for names in parts:
            missing = sorted(set(range(counts[buffer])) - set(names))
            if missing:
                held_name = next(iter(names.values()))
                raise ValueError(
                    f"sample {missing[0]} of buffer '{buffer}' is missing: channel '{held_name}' "
                    f"is there, but none of number {missing[0]} (samples are numbered from 0 to "
                    f"{counts[buffer] - 1}); write all samples of every channel"
                )
    if len(set(counts.values())) > 1:
        listed = ", ".join(f"'{buffer}' {count}" for buffer, count in counts.items())
        raise ValueError(
            f"buffers have different numbers of samples a pixel ({listed}); write as many of each"
        )
    return {
        buffer: tuple(_take_sample(binding[buffer], numbered, i) for i in range(count))
        for buffer, count in counts.items()
    }


def _take_sample(bound: BoundBuffer, numbered: NumberedNames, number: int) -> BoundBuffer:
    names = {}
    for c in bound:
        known = numbered.get(c.stream, {}).get(c.channel)
        names[c.stream, c.channel] = c.channel if known is None else known[number]
    return bound.renamed(names)


def bind_samples(binding: Binding, numbered: NumberedNames, names: Names) -> BoundPixels:
    """Say what stands for a pixel, and where its samples are.

    A buffer that is there without numbers, too, stands for its pixels as it is.

    Args:
        binding: buffers, by names that may lack the numbers of samples.
        numbered: of `number_names`.
        names: names that there are, numbers included.

    Raises:
        ValueError: samples do not fit, and a buffer is nothing but samples.
    """
    whole = {b for b, bound in binding.items() if all(c.channel in names[c.stream] for c in bound)}
    samples: Samples = {}
    fault = ""
    try:
        samples = find_samples(binding, numbered)
    except ValueError as error:
        if len(whole) < len(binding):
            raise
        fault = str(error)
    pixels = {
        b: bound if b in whole else stand_for_pixel(b, samples[b]) for b, bound in binding.items()
    }
    return BoundPixels(
        binding={b: _name_channels(bound, names) for b, bound in pixels.items()},
        samples={b: tuple(_name_channels(s, names) for s in held) for b, held in samples.items()},
        fault=fault,
    )


def _name_channels(bound: BoundBuffer, names: Names) -> BoundBuffer:
    """Return a buffer by the channels' names in the files."""
    return bound.renamed({(c.stream, c.channel): names[c.stream][c.channel] for c in bound})


def takes_mean(buffer: Buffer) -> bool:
    """Tell whether the mean of a buffer's samples stands for a pixel, or its first one."""
    return BUFFER_SPECS[buffer].resampling is Resampling.MEAN and buffer not in NORMAL_BUFFERS


def stand_for_pixel(buffer: Buffer, samples: Sequence[BoundBuffer]) -> BoundBuffer:
    """Return what a pixel's own value is: the mean of its samples, or the first one."""
    if not takes_mean(buffer):
        return samples[0]
    share = 1.0 / len(samples)
    return BoundBuffer(
        tuple(
            BoundSum(
                terms=tuple(
                    replace(term, factor=term.factor * share) for one in alike for term in one.terms
                ),
                constant=alike[0].constant,
            )
            for alike in zip(*(bound.components for bound in samples), strict=True)
        )
    )


def join_samples_into(binding: Binding, samples: Samples) -> Binding:
    """Return buffers with all channels of all samples, for checks of what files hold."""
    return {
        buffer: BoundBuffer(
            (*bound.components, *(c for one in samples.get(buffer, ()) for c in one.components))
        )
        for buffer, bound in binding.items()
    }


def count_samples(samples: Samples) -> int:
    """Samples of a pixel; 1 where channels have no numbers."""
    return len(next(iter(samples.values()))) if samples else 1


def describe_samples(buffer: Buffer, samples: Sequence[BoundBuffer], *, streams: bool) -> str:
    """Say which channels a buffer's samples are, and what stands for a pixel."""
    first, last = (samples[i].describe(streams=streams) for i in (0, -1))
    stands = "mean" if takes_mean(buffer) else "first"
    return f"{stands} of {first} to {last}"


def describe_use(samples: Samples) -> tuple[str, ...]:
    """Say what stands for a pixel where channels have samples; nothing where they have none."""
    if not samples:
        return ()
    means = [b.value for b in samples if takes_mean(b)]
    firsts = [b.value for b in samples if not takes_mean(b)]
    told = [f"{', '.join(means)}: their mean"] if means else []
    told += [f"{', '.join(firsts)}: the first"] if firsts else []
    return (
        f"{count_samples(samples)} samples a pixel, of which is read {'; '.join(told)} "
        "(all by label --kind cgts)",
    )
