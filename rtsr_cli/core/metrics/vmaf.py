"""VMAF, by the libvmaf in imageio-ffmpeg's program, over pipes.

Frames stream into the program as they come, its report comes back by a third pipe: no temporary
file, a few frames in memory. The models look at luma alone: 8 bit, BT.709, limited range; chroma
is sent as grey. Frame 0 has no motion, so that an identical one scores 97.4, not 100.
"""

from __future__ import annotations

import json
import os
import queue
import subprocess
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import TracebackType
from typing import Any, BinaryIO, Self

import numpy as np
from numpy.typing import NDArray

from rtsr_cli.core.errors import MetricUnavailableError, RtsrError
from rtsr_cli.core.imaging.color import LUMA_REC709
from rtsr_cli.core.shapes import Size

Bytes = NDArray[np.uint8]

MODEL, MODEL_4K = "vmaf_v0.6.1", "vmaf_4k_v0.6.1"
"""A 1080p screen at 3 picture heights, a 2160p screen at 1.5."""

ROWS_4K = 2160

BLACK, STEPS = 16.0, 219.0
"""Limited-range luma: 16 is black, 235 white [ITU-R BT.709]."""

GREY = 128

AHEAD = 4
"""Frames that wait to be written into a pipe."""

REMEDY = "pip install imageio-ffmpeg"


@dataclass(frozen=True, kw_only=True)
class VmafScores:
    """What libvmaf says of a sequence.

    Attributes:
        frames: 0 to 100, in order.
        mean, harmonic_mean: over the frames; the latter weighs bad ones more.
        model: name.
        build: version of libvmaf.
    """

    frames: tuple[float, ...]
    mean: float
    harmonic_mean: float
    model: str
    build: str


def program() -> str:
    """Return the path of imageio-ffmpeg's program.

    Raises:
        MetricUnavailableError: it is not installed; names the command that helps.
    """
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise MetricUnavailableError(f"VMAF needs libvmaf; run: {REMEDY}") from error
    return str(imageio_ffmpeg.get_ffmpeg_exe())


def default_model(height: int) -> str:
    """Return the model that a picture height calls for."""
    return MODEL_4K if height >= ROWS_4K else MODEL


def luma(display: Bytes) -> Bytes:
    """8-bit limited-range luma, h x w, of display-encoded 8-bit RGB, h x w x 3 [BT.709].

    Y = 16 + 219 (0.2126 R + 0.7152 G + 0.0722 B)
    """
    weights = np.array(LUMA_REC709, np.float32) * np.float32(STEPS / 255.0)
    values: Bytes = (display.astype(np.float32) @ weights + (BLACK + 0.5)).astype(np.uint8)
    return values


class Vmaf:
    """One running comparison: `add` frames in order, then `finish`."""

    def __init__(self, size: Size, model: str = MODEL, *, executable: str | None = None) -> None:
        """Remember what will be compared; the program starts on entering.

        Args:
            size: (height, width); an odd last row or column is left out.
            model: name of a built-in model; `neg` ones ignore sharpening.
            executable: program in place of imageio-ffmpeg's.
        """
        self._size = (size[0] // 2 * 2, size[1] // 2 * 2)
        self._model = model
        self._executable = executable
        self._feeds: list[_Feed] = []

    def __enter__(self) -> Self:
        """Start the program.

        Raises:
            MetricUnavailableError: it is not installed.
        """
        executable = self._executable or program()
        (test_out, test_in), (ref_out, ref_in), (log_out, log_in) = (os.pipe() for _ in range(3))
        theirs, ours = (test_out, ref_out, log_in), (test_in, ref_in, log_out)
        try:
            self._process = subprocess.Popen(
                self._command(executable, *theirs),
                pass_fds=theirs,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
            )
        except OSError as error:
            for descriptor in ours:
                os.close(descriptor)
            raise MetricUnavailableError(
                f"VMAF: {executable} cannot be run ({error.strerror}); run: {REMEDY}"
            ) from error
        finally:
            for descriptor in theirs:
                os.close(descriptor)
        self._feeds = [_Feed(os.fdopen(descriptor, "wb")) for descriptor in ours[:2]]
        self._report = _Collector(os.fdopen(log_out, "rb"))
        self._said = _Collector(self._process.stderr)
        return self

    def _command(self, executable: str, test: int, reference: int, log: int) -> list[str]:
        height, width = self._size
        layout = ["-f", "rawvideo", "-pix_fmt", "yuv420p", "-s", f"{width}x{height}", "-r", "25"]
        filtering = (
            f"libvmaf=model=version={self._model}:n_threads=1:log_fmt=json:log_path=/dev/fd/{log}"
        )
        inputs = [*layout, "-i", f"pipe:{test}", *layout, "-i", f"pipe:{reference}"]
        quiet = ["-hide_banner", "-loglevel", "error", "-nostdin"]
        return [executable, *quiet, *inputs, "-lavfi", filtering, "-f", "null", "-"]

    def add(self, test: Bytes, reference: Bytes) -> None:
        """Compare a frame: display-encoded 8-bit RGB, h x w x 3.

        Raises:
            RtsrError: sizes differ, or the program has ended.
        """
        self.add_luma(luma(test), luma(reference))

    def add_luma(self, test: Bytes, reference: Bytes) -> None:
        """Compare a frame given as limited-range luma, h x w.

        Raises:
            RtsrError: sizes differ, or the program has ended.
        """
        height, width = self._size
        for feed, plane in zip(self._feeds, (test, reference), strict=True):
            if plane.shape[0] // 2 * 2 != height or plane.shape[1] // 2 * 2 != width:
                raise RtsrError(
                    f"VMAF: a frame is {plane.shape[1]} x {plane.shape[0]}, expected "
                    f"{width} x {height}"
                )
            feed.put(plane[:height, :width].tobytes() + bytes([GREY]) * (height * width // 2))
        if any(feed.broken for feed in self._feeds):
            raise self._failure()

    def finish(self) -> VmafScores:
        """Wait for the scores of all frames.

        Raises:
            RtsrError: the program failed.
        """
        for feed in self._feeds:
            feed.end()
        code = self._process.wait()
        text = self._report.result()
        if code != 0 or not text:
            raise self._failure()
        report: dict[str, Any] = json.loads(text)
        pooled = report["pooled_metrics"]["vmaf"]
        return VmafScores(
            frames=tuple(float(frame["metrics"]["vmaf"]) for frame in report["frames"]),
            mean=float(pooled["mean"]),
            harmonic_mean=float(pooled["harmonic_mean"]),
            model=self._model,
            build=f"libvmaf {report.get('version', '')}".strip(),
        )

    @property
    def returncode(self) -> int | None:
        """Exit code of the program, None while it runs."""
        return self._process.poll()

    def _failure(self) -> RtsrError:
        self._process.kill()
        self._process.wait()
        said = self._said.result().decode(errors="replace").strip().splitlines()
        why = said[-1] if said else f"exit code {self._process.returncode}"
        return RtsrError(f"VMAF: the program ended ({why}); leave vmaf out, or try: {REMEDY}")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the program, whatever became of it."""
        self._process.kill()
        self._process.wait()
        for feed in self._feeds:
            feed.end()
        self._report.result()
        self._said.result()


class _Feed:
    """Writes into a pipe in a thread: neither of two inputs may wait for the other."""

    def __init__(self, pipe: BinaryIO) -> None:
        self.broken = False
        self._pipe = pipe
        self._queue: queue.Queue[bytes | None] = queue.Queue(AHEAD)
        self._thread = _started(self._run)

    def put(self, frame: bytes) -> None:
        """Queue a frame; block while too many wait."""
        self._queue.put(frame)

    def end(self) -> None:
        """Close the pipe behind what is queued."""
        if self._thread.is_alive():
            self._queue.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (frame := self._queue.get()) is not None:
            # what comes after a break is taken and dropped, so that nobody waits
            if not self.broken:
                self._try(partial(self._pipe.write, frame))
        self._try(self._pipe.close)

    def _try(self, write: Callable[[], object]) -> None:
        try:
            write()
        except OSError:
            self.broken = True


class _Collector:
    """Reads a pipe to its end in a thread."""

    def __init__(self, pipe: Any) -> None:
        self._pipe = pipe
        self._text = b""
        self._thread = _started(self._run)

    def _run(self) -> None:
        with self._pipe:
            self._text = self._pipe.read()

    def result(self) -> bytes:
        """Return everything, once the other side is closed."""
        self._thread.join()
        return self._text


def _started(run: Callable[[], None]) -> threading.Thread:
    thread = threading.Thread(target=run, name="rtsr-vmaf", daemon=True)
    thread.start()
    return thread
