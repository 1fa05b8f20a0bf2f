"""What extrapolation does with a frame: predict it, or hand on what was rendered."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.provenance import PAST, PREDICTED, name_color_space
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.storage import fits_half
from rtsr_cli.core.imaging.coverage import CoveredColor
from rtsr_cli.core.imaging.frame_motion import chain_motion
from rtsr_cli.core.imaging.warping import backward_warp
from rtsr_cli.core.lighting.past_lighting import find_rendered
from rtsr_cli.core.pairs.sources import PairSource
from rtsr_cli.core.run.frame_pairs import FrameInTurn
from rtsr_cli.core.run.loop import Product
from rtsr_cli.core.run.outputs import OutputFrame
from rtsr_cli.core.run.prediction import NetworkRun, Predictor, list_debug_pictures
from rtsr_cli.core.shapes import Image
from rtsr_cli.core.system import FrameWindow, Prediction


class Extrapolation:
    """Predicts a shot's frames that were not rendered, and writes what is wanted."""

    def __init__(
        self,
        run: NetworkRun,
        source: PairSource,
        past: Mapping[int, int],
        *,
        previews: bool,
        debug: bool,
    ) -> None:
        """Start a shot.

        Args:
            run: how the system is run.
            source: of the frames.
            past: of those that were not rendered, how many rendered ones lie before them.
            previews: a PNG beside each EXR.
            debug: an EXR of what the system saw and decided.
        """
        self._predictor, self._system = Predictor(run), run.system
        self._past, self._reader = past, source.reader
        self._colorspace = source.reader.conventions.colorspace
        self._tag = name_color_space(source.reader.conventions)
        self._previews, self._debug = previews, debug
        self._covered: CoveredColor | None = None

    def __call__(self, moment: FrameInTurn) -> Product | None:
        """Return what writes a frame; None where it is only history."""
        rendered = moment.number not in self._past
        if rendered:
            self._covered = moment.pair.covered
        if not moment.wanted:
            return None
        if rendered:
            buffers = moment.window.current.gbuffer.buffers
            covered = self._covered
            made = Prediction(image=buffers[Buffer.COLOR] if covered is None else covered.stored)
            return self._write(moment, made, buffers.get(Buffer.ALPHA), predicted=False)
        if not any(Buffer.COLOR in past.gbuffer for past in moment.window.lr[1:]):
            raise FrameFolderError(self._describe_no_past(moment))
        made = cover_prediction(self._predictor.predict(moment), moment.window, self._covered)
        return self._write(moment, made, carry_alpha(moment.window), predicted=True)

    def _describe_no_past(self, moment: FrameInTurn) -> str:
        """Say of a frame why nothing lies before it; one that is stood in for by its own number."""
        stand_in = self._reader.held.get(moment.number)
        if stand_in is None:
            return (
                f"{moment.source}: no rendered frame of the same shot lies before it (it is at the "
                "start, after a cut or after a gap); render it, and name it with --rendered"
            )
        return (
            f"{self._reader.frames.root}, frame {moment.number}: it counts as missing, and frame "
            f"{stand_in} stands in for its buffers (--on-missing hold); no past is carried over a "
            f"missing frame, so there is nothing to predict it from; render frame {moment.number} "
            "again with all its buffers, or leave it out: --on-missing skip"
        )

    def _write(
        self, moment: FrameInTurn, made: Prediction, alpha: Image | None, *, predicted: bool
    ) -> Product:
        """Return the product of a picture.

        Raises:
            FrameFolderError: there is none, or one that is not finite.
        """
        name = f"system '{self._system.name}'"
        if made.image is None:
            raise FrameFolderError(f"{moment.source}: {name} gave no image")
        largest = moment.check_output(made.image, name)
        stamp: dict[str, Any] = {}
        if predicted:
            past = {PAST: self._past[moment.number]}
            stamp = {PREDICTED: 1, **past, "rtsr:system": self._system.name}
        picture = OutputFrame(
            path=moment.path,
            color=made.image,
            alpha=alpha,
            as_float=not fits_half(made.image, largest),
            attributes={**moment.attributes, **moment.provenance({**stamp, **self._tag})},
            windows=moment.windows,
            passed=moment.passed,
            colorspace=self._colorspace,
            previews=self._previews,
            debug=list_debug_pictures(moment, made) if self._debug else None,
        )
        return moment.product(picture.write, as_float=picture.as_float, stages=made.seconds)


def cover_prediction(
    made: Prediction, window: FrameWindow, covered: CoveredColor | None
) -> Prediction:
    """Premultiply a picture by the weight that the last rendered radiance was divided by."""
    if covered is None or made.image is None:
        return made
    return replace(made, image=made.image * carry_image(window, covered.weight))


def carry_alpha(window: FrameWindow) -> Image | None:
    """Coverage of the last rendered frame along the vectors; None where the frames hold none."""
    alpha = window.lr[find_rendered(window)].gbuffer.buffers.get(Buffer.ALPHA)
    return None if alpha is None else carry_image(window, alpha)


def carry_image(window: FrameWindow, image: Image) -> Image:
    """Move an image of the last rendered frame along the vectors."""
    moved, _ = backward_warp(image, chain_motion(window.lr[: find_rendered(window) + 1]))
    return moved
