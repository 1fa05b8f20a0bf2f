"""What `evaluate` is asked for; imports no torch."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from rtsr_cli.core.choices import MetricName, MissingPolicy, ProtocolName, SsimConvention
from rtsr_cli.core.errors import ConfigError, RequestError
from rtsr_cli.core.evaluation.demands import Condition, parse_conditions
from rtsr_cli.core.requests import MOST_JOBS, accept_words, check_ranges, check_shard

OUTPUT_SUFFIXES = (".json", ".csv", ".html")
"""What results are written as."""

MOST_SAMPLES = 16
PPD_RANGE = (1.0, 1000.0)


@dataclass(frozen=True, kw_only=True)
class EvaluateRequest:
    """Which frames are judged, by what, and what is written of it.

    Attributes:
        tests: folders of frames; with `merge` JSON files of parts.
        reference: folder of the true frames; without it `tests` are two folders, the second one
            being the reference.
        gbuffer: folder of buffers of the judged resolution; None for the reference's own.
        metrics: what is measured.
        protocol: how frames are shown to the metrics.
        ssim_convention: in place of the protocol's.
        ppd: pixels per degree, for FLIP; None for FLIP's own default.
        border: pixels left out at each side.
        skip_first: first frames of each shot that take no part in means.
        samples_per_pixel: K; the reference holds K x K samples of each judged pixel.
        outputs: files to write, their suffixes among `OUTPUT_SUFFIXES`.
        overwrite: replace outputs that something else wrote, too.
        fail_under: demands on means, like "psnr>30,flip<0.1"; None for none.
        merge: join parts in place of judging.
        lpips_weights: file of AlexNet and heads; None for where they are looked for.
        device: torch device, or `auto`.
        layout: channel layout or a TOML file of one; None to detect it.
        layer: layer or stereo view that is read of files with several.
        view: stereo view that is read, of that layer if one is named.
        capture_file: declarations in place of the shots' capture.toml.
        frames: numbers that are judged; None for all.
        shard: (i, n), the part of each shot that is judged; None for all.
        jobs: frames judged at a time.
        on_missing: frames that not every folder has; ERROR or SKIP.
        dry_run: check everything, judge nothing.
    """

    tests: tuple[Path, ...]
    reference: Path | None = None
    gbuffer: Path | None = None
    metrics: tuple[MetricName, ...] = (MetricName.PSNR, MetricName.SSIM, MetricName.FLIP)
    protocol: ProtocolName = ProtocolName.RTSR
    ssim_convention: SsimConvention | None = None
    ppd: float | None = None
    border: int = 0
    skip_first: int = 0
    samples_per_pixel: int = 1
    outputs: tuple[Path, ...] = ()
    overwrite: bool = False
    fail_under: str | None = None
    merge: bool = False
    lpips_weights: Path | None = None
    device: str = "auto"
    layout: str | None = None
    layer: str | None = None
    view: str | None = None
    capture_file: Path | None = None
    frames: frozenset[int] | None = None
    shard: tuple[int, int] | None = None
    jobs: int = 2
    on_missing: MissingPolicy = MissingPolicy.ERROR
    dry_run: bool = False

    def __post_init__(self) -> None:
        """Check what goes together.

        Raises:
            RequestError: something does not.
        """
        accept_words(self)
        if self.merge:
            if self.reference is not None:
                raise RequestError("--merge joins JSON files; it takes no --ref")
        elif self.reference is None and len(self.tests) != 2:
            raise RequestError(
                "without --ref exactly two folders are taken, TEST REF; name the reference with "
                "--ref"
            )
        if not self.tests or not self.metrics:
            raise RequestError(f"name at least one {'metric' if self.tests else 'TEST'}")
        self._check_values()
        self._parse_demands()

    def _check_values(self) -> None:
        check_ranges(
            self,
            ppd=PPD_RANGE,
            border=(0, math.inf),
            skip_first=(0, math.inf),
            samples_per_pixel=(1, MOST_SAMPLES),
            jobs=(1, MOST_JOBS),
        )
        check_shard(self.shard)
        if self.on_missing is MissingPolicy.HOLD:
            raise RequestError("a frame that stands in is not judged: --on-missing error or skip")
        for path in self.outputs:
            if path.suffix.lower() not in OUTPUT_SUFFIXES:
                raise RequestError(f"'{path}' ends in none of {', '.join(OUTPUT_SUFFIXES)}")

    def _parse_demands(self) -> tuple[Condition, ...]:
        if self.fail_under is None:
            return ()
        known = tuple(MetricName) if self.merge else self.metrics
        try:
            return parse_conditions(self.fail_under, known)
        except ConfigError as error:
            raise RequestError(f"--fail-under: {error}") from error

    @property
    def demands(self) -> tuple[Condition, ...]:
        """Conditions of `fail_under`; what merged parts hold is found out when they are read."""
        return self._parse_demands()

    @property
    def test_folders(self) -> tuple[Path, ...]:
        """Folders that are judged."""
        return self.tests if self.reference is not None else self.tests[:1]

    @property
    def reference_folder(self) -> Path:
        """Folder of the true frames."""
        return self.tests[-1] if self.reference is None else self.reference
