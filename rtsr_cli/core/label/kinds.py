"""The kinds of labels, a row each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rtsr_cli.core.choices import LabelKind
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.label.class_labels import (
    CLASS_BUFFERS,
    CLASSES,
    declare_class_labels,
    describe_classes,
    summarise_classes,
)
from rtsr_cli.core.label.hole_labels import (
    HOLE_BUFFERS,
    SHARES,
    declare_hole_labels,
    describe_config,
    summarise_shares,
)
from rtsr_cli.core.label.labelling import Labelling
from rtsr_cli.core.label.rate_errors import RATE_BUFFERS, declare_rate_labels
from rtsr_cli.core.label.request import LabelRequest
from rtsr_cli.core.pairs.sources import PairSource
from rtsr_cli.core.run.figures import Summarise


@dataclass(frozen=True, kw_only=True)
class FigureKind:
    """Figures that a kind of labels keeps of its frames.

    Attributes:
        attribute: of a label's header, that holds them.
        options: of a request, plain values, how they were come by.
        summarise: those of frames -> those of all.
    """

    attribute: str
    options: Callable[[LabelRequest], Any]
    summarise: Summarise


@dataclass(frozen=True, kw_only=True)
class KindRow:
    """A kind of labels.

    Attributes:
        buffers: that frames must hold.
        declare: how a shot is labelled.
        figures: what is said of all frames in the end; None if nothing.
    """

    buffers: tuple[Buffer, ...]
    declare: Callable[[PairSource, LabelRequest], Labelling]
    figures: FigureKind | None = None


KINDS: Mapping[LabelKind, KindRow] = {
    LabelKind.VRS: KindRow(buffers=RATE_BUFFERS, declare=declare_rate_labels),
    LabelKind.HOLES: KindRow(
        buffers=HOLE_BUFFERS,
        declare=declare_hole_labels,
        figures=FigureKind(attribute=SHARES, options=describe_config, summarise=summarise_shares),
    ),
    LabelKind.CGTS: KindRow(
        buffers=CLASS_BUFFERS,
        declare=declare_class_labels,
        figures=FigureKind(
            attribute=CLASSES, options=describe_classes, summarise=summarise_classes
        ),
    ),
}
