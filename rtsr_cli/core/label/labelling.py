"""What a kind of labels declares of a shot, so that plan, checks and loop follow from it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from rtsr_cli.core.pairs.auxiliary_radiance import AuxiliaryRadiance
from rtsr_cli.core.pairs.sources import PairInputs
from rtsr_cli.core.run.frame_pairs import Work


@dataclass(frozen=True, kw_only=True)
class Labelling:
    """How the frames of a shot are labelled.

    Attributes:
        name: who reads the buffers, for messages.
        inputs: buffers that are read.
        work: labels a frame, and writes it.
        settings: plain values that decide the outputs' bytes.
        passed: further radiance that is read.
        history_frames: predecessors in the window.
        outputs_of: numbers of the frames that get labels; None = all.
        details: what is told of it before the first frame.
    """

    name: str
    inputs: PairInputs
    work: Work
    settings: Any
    passed: tuple[AuxiliaryRadiance, ...] = ()
    history_frames: int = 0
    outputs_of: Collection[int] | None = None
    details: Mapping[str, Any] = field(default_factory=dict)
