"""What files say of the primaries of their radiance.

A declaration wins over the tag `colorInteropID`, the tag over nothing. `chromaticities` are only
held against what is read: many programs leave them as they were.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.provenance import COLOR_TAG, SCENE_SUFFIX
from rtsr_cli.core.frames.conventions import ColorSpace

SILENT_TAGS = frozenset({"", "unknown"})
"""Tags that say nothing of primaries."""

_D65, _D60 = (0.3127, 0.3290), (0.32168, 0.33767)

CHROMATICITIES: Mapping[ColorSpace, tuple[float, ...]] = {
    ColorSpace.REC709: (0.640, 0.330, 0.300, 0.600, 0.150, 0.060, *_D65),
    ColorSpace.REC2020: (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *_D65),
    ColorSpace.P3D65: (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *_D65),
    ColorSpace.AP1: (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, *_D60),
    ColorSpace.AP0: (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, *_D60),
}
"""x and y of red, green, blue and white [ITU-R BT.709, BT.2020; SMPTE RP 431; ACES]."""

CHROMATICITY_STEP = 2e-3
"""Chromaticities that are nearer mean the same: they are written with three digits."""


def find_foreign_tag(attributes: Iterable[Mapping[str, Any]]) -> str:
    """Return a tag that names no primaries that rtsr converts, "" if there is none."""
    tags = (str(known.get(COLOR_TAG, "")) for known in attributes)
    return next((t for t in tags if t not in SILENT_TAGS and _parse_tag(t) is None), "")


def read_color_space(attributes: Iterable[Mapping[str, Any]], where: str) -> ColorSpace | None:
    """Return the primaries that the tags of files name, None where they name none.

    Args:
        attributes: of each file that holds radiance.
        where: their folder, for messages.

    Raises:
        FrameFolderError: files disagree.
    """
    tags = sorted({str(known.get(COLOR_TAG, "")) for known in attributes})
    if len(tags) > 1:
        listed = ", ".join(repr(tag) for tag in tags)
        raise FrameFolderError(
            f"{where}: files disagree in their {COLOR_TAG} ({listed}); render them alike, or "
            'declare their primaries (capture.toml: colorspace = "lin_rec709")'
        )
    return _parse_tag(tags[0]) if tags else None


def _parse_tag(tag: str) -> ColorSpace | None:
    try:
        return ColorSpace(tag.removesuffix(SCENE_SUFFIX))
    except ValueError:
        return None


def describe_contradictions(
    attributes: Iterable[Mapping[str, Any]], space: ColorSpace | None, *, declared: bool
) -> tuple[str, ...]:
    """Say what attributes contradict the primaries that radiance is read with.

    Args:
        attributes: of each file that holds radiance.
        space: as it is read; None is taken for Rec.709.
        declared: whether the user says so.
    """
    read = space or ColorSpace.REC709
    how = f"declared as '{read}'" if declared else f"read as '{read}'"
    remedy = "" if declared else '; declare what holds (capture.toml: colorspace = "...")'
    texts: dict[str, None] = {}
    for known in attributes:
        tag = str(known.get(COLOR_TAG, ""))
        if tag not in SILENT_TAGS and _parse_tag(tag) is not read:
            texts[f"{COLOR_TAG} is '{tag}', radiance is {how}{remedy}"] = None
        given = known.get("chromaticities")
        if given is not None and not _are_near(given, CHROMATICITIES[read]):
            name = next((s for s, c in CHROMATICITIES.items() if _are_near(given, c)), None)
            what = f"those of '{name}'" if name else "of no primaries that are known"
            texts[f"chromaticities are {what}, radiance is {how}{remedy}"] = None
    return tuple(texts)


def _are_near(given: object, known: tuple[float, ...]) -> bool:
    values = tuple(given) if isinstance(given, (tuple, list)) else ()
    return len(values) == len(known) and all(
        abs(float(a) - b) <= CHROMATICITY_STEP for a, b in zip(values, known, strict=True)
    )
