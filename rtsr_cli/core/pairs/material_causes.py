"""Why the material of LR samples is not that of the HR pixels around, as users are told."""

from __future__ import annotations

from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.pairs.held_samples import TOLERANCE, HeldSamples, hold_samples, is_near
from rtsr_cli.core.shapes import Mask

DARKER_AT_HR, DARKER_AT_LR = (
    f"material is darker at {one} than at {other} (base colour missing at {one}?)"
    for one, other in (("HR", "LR"), ("LR", "HR"))
)
"""What is said of samples that contradict."""

DIFFERS = (
    "an object's material differs between LR and HR (its detail comes back if both sizes are "
    "rendered with one material)"
)
"""The same where neither size lacks it."""

UNSAID = ""
"""Cause of which nothing is said: nothing is wrong there."""

MISSING = 0.2
"""What is left of a material without its base colour, as a share of it at most, on the whole."""


def name_darker(lr: Frame, hr: Frame, scale: int, contradicts: Mask) -> str:
    """Say which size's material is missing where samples contradict; that it differs if none is."""
    held = hold_samples(lr, hr, scale)
    where = held.told & contradicts
    at_lr, at_hr = (float((image * where).sum()) for image in (held.material, held.placed))
    if min(at_lr, at_hr) > MISSING * max(at_lr, at_hr):
        return DIFFERS
    return DARKER_AT_LR if at_lr < at_hr else DARKER_AT_HR


def describe_difference(held: HeldSamples, where: Mask) -> str:
    """Say what colours samples have at both sizes, in the middle."""
    lr, hr = held.lr.gbuffer, held.hr.gbuffer
    pairs = {"material": (held.material, held.placed)}
    if Buffer.ALBEDO in lr and Buffer.ALBEDO in hr:
        pairs = {"base colour": (lr[Buffer.ALBEDO], held.place(hr[Buffer.ALBEDO])), **pairs}
    said = ""
    for name, images in pairs.items():
        own, there = (image[0][:, where[0, 0]].median(1).values for image in images)
        at_lr, at_hr = (", ".join(f"{value:.2g}" for value in values) for values in (own, there))
        said = f"{name} about {at_lr} at LR where HR has {at_hr}"
        # of one base colour metallic or roughness differs
        if not bool(is_near(own.view(1, 3, 1, 1), there.view(1, 3, 1, 1), TOLERANCE)):
            break
    return said
