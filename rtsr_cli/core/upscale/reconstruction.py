"""What `upscale` does with a frame: predict it, and write the picture."""

from __future__ import annotations

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.files.provenance import name_color_space
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.storage import fits_half
from rtsr_cli.core.imaging.coverage import multiply_coverage
from rtsr_cli.core.imaging.resampling import upsample_bicubic
from rtsr_cli.core.lighting.radiance import measure_undivided
from rtsr_cli.core.pairs.sources import PairSource
from rtsr_cli.core.run.frame_pairs import FrameInTurn
from rtsr_cli.core.run.loop import Product
from rtsr_cli.core.run.outputs import OutputFrame
from rtsr_cli.core.run.prediction import NetworkRun, Predictor, list_debug_pictures
from rtsr_cli.core.shapes import Color, Image
from rtsr_cli.core.system import Prediction
from rtsr_cli.core.upscale.lost_material import describe_lost


class Reconstruction:
    """Predicts a shot's frames, and writes those that are wanted."""

    def __init__(self, run: NetworkRun, source: PairSource, *, previews: bool, debug: bool) -> None:
        """Start a shot.

        Args:
            run: how the network is run.
            source: of the pairs.
            previews: a PNG beside each EXR.
            debug: an EXR of what the system saw and decided.
        """
        self._predictor = Predictor(run)
        self._system = run.system
        self._colorspace = source.reader.conventions.colorspace
        self._tag = name_color_space(source.reader.conventions)
        self._previews, self._debug = previews, debug
        self._name = f"system '{run.system.name}'"

    def __call__(self, moment: FrameInTurn) -> Product | None:
        """Predict a frame; return what writes it."""
        prediction = self._predictor.predict_if_due(moment)
        if prediction is None:
            return None
        if not moment.wanted:
            # it fails as it would if it were wanted, and is no history then
            if prediction.image is not None:
                moment.check_output(prediction.image, self._name)
            return None
        picture = self._picture(moment, prediction)
        return moment.product(
            picture.write,
            as_float=picture.as_float,
            no_material=measure_undivided(moment.window),
            no_material_why=describe_lost(moment.pair, moment.window),
        )

    def _picture(self, moment: FrameInTurn, prediction: Prediction) -> OutputFrame:
        """Return the output of a prediction.

        Raises:
            FrameFolderError: the system gave no image, or one that is not finite.
        """
        if prediction.image is None:
            raise FrameFolderError(f"{moment.source}: {self._name} gave no image")
        image = cover_image(moment, prediction.image)
        largest = moment.check_output(image, self._name)
        known = moment.provenance({"rtsr:system": self._system.name, **self._tag})
        return OutputFrame(
            path=moment.path,
            color=image,
            alpha=enlarge_alpha(moment),
            as_float=not fits_half(image, largest),
            attributes={**moment.attributes, **known},
            windows=moment.windows,
            colorspace=self._colorspace,
            passed=moment.passed,
            previews=self._previews,
            debug=list_debug_pictures(moment, prediction) if self._debug else None,
        )


def cover_image(moment: FrameInTurn, straight: Color) -> Color:
    """Premultiply a picture by the coverage that its LR radiance was divided by, if it was."""
    covered, jitter_px = moment.pair.covered, moment.pair.lr.camera.jitter_px
    if covered is None:
        return straight
    return multiply_coverage(straight, covered, moment.window.scale, jitter_px)


def enlarge_alpha(moment: FrameInTurn) -> Image | None:
    """Coverage at the target size, None where the frames hold none."""
    frame = moment.pair.lr
    alpha = frame.gbuffer.buffers.get(Buffer.ALPHA)
    if alpha is None:
        return None
    return upsample_bicubic(alpha, moment.window.scale, frame.camera.jitter_px).clamp(0.0, 1.0)
