"""What `synth` is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.captures.layout_names import PAIR_LAYOUTS
from rtsr_cli.core.choices import JitterMode
from rtsr_cli.core.errors import RequestError
from rtsr_cli.core.requests import MOST_JOBS, accept_words, check_ranges

SHOTS, SCALES, SAMPLES = (1, 10_000), (2, 16), (1, 16)
"""Least and most of `shots`, `scale` and `samples`."""


@dataclass(frozen=True, kw_only=True)
class SynthRequest:
    """Render frames of random analytic scenes, with exact buffers.

    Attributes:
        out_folder: of the shot, or of one folder a shot.
        size: (height, width) of the output.
        frames: numbers of the frames.
        seed: which scene.
        shots: write that many seeds, from `seed` on, each into a folder of its own.
        layout: of the channels.
        scale: write a pair: LR of size / scale, and HR; None writes one resolution.
        jitter: of the samples, LR's of a pair.
        samples: K: of a single resolution, K x K samples of each output pixel are stored; of a
            pair, the reference is their mean.
        static_camera: the camera stays where it is at frame 1.
        jobs: threads that render, and threads that write.
        overwrite: replace files that this run would not have written.
    """

    out_folder: Path
    size: tuple[int, int] = (540, 960)
    frames: frozenset[int] = frozenset(range(1, 9))
    seed: int = 0
    shots: int | None = None
    layout: str = "rtsr"
    scale: int | None = None
    jitter: JitterMode = JitterMode.NONE
    samples: int = 1
    static_camera: bool = False
    jobs: int = 2
    overwrite: bool = False

    def __post_init__(self) -> None:
        """Check what goes together.

        Raises:
            RequestError: samples would be jittered twice, or two resolutions have no place.
        """
        accept_words(self)
        check_ranges(self, shots=SHOTS, scale=SCALES, samples=SAMPLES, jobs=(1, MOST_JOBS))
        if self.scale is not None:
            return
        if self.samples > 1 and self.jitter is not JitterMode.NONE:
            raise RequestError("--samples stores every sample of a pixel; leave --jitter out")
        if self.layout in PAIR_LAYOUTS:
            raise RequestError(
                f"layout '{self.layout}' keeps two resolutions apart; give --scale, e.g. --scale 2"
            )
