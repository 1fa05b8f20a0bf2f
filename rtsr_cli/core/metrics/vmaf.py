"""VMAF of a sequence, by the libvmaf in FFmpeg, frame by frame through pipes.

FFmpeg runs as a program of its own: two threads write the pictures, one each, and two more read
the scores and the complaints. Nothing is written to disk and no more than a few frames wait.

VMAF's models see luma alone, so pictures are sent as 8-bit BT.709 luma of limited range, with grey
as their colour. They compare what moves: the first frame counts as standing still (identical
pictures score 97.43 there and 100 after it), and a single frame's score means little.
"""

from __future__ import annotations

import json
import os
import queue
import subprocess
import threading
from dataclasses import dataclass
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtsr_cli.core.errors import (
    MetricError,
    MetricUnavailableError,
    ShapeMismatchError,
    did_you_mean,
)

MODEL_HD, MODEL_4K = "vmaf_v0.6.1", "vmaf_4k_v0.6.1"
"""A picture seen from 3 times its height at 1080 rows, from 1.5 times its height at 2160."""

MODELS = (MODEL_HD, "vmaf_v0.6.1neg", MODEL_4K, "vmaf_4k_v0.6.1neg")
"""Those built into libvmaf that take 8-bit luma; neg does not reward sharpening."""

ROWS_4K = 2160
"""Rows from which `MODEL_4K` is the model."""

LUMA_WEIGHTS = (0.2126, 0.7152, 0.0722)
"""Of display-encoded R, G, B [ITU-R BT.709-6, item 3.2]."""

LUMA_BLACK, LUMA_SPAN = 16.0, 219.0
"""Code of black, and codes from black to white [ITU-R BT.709-6, item 4.6]."""

GREY = 128
"""Code of no colour in either chroma plane."""

MIN_SIDE_PX = 32
"""Of a smaller picture little is left at the coarsest scale; below 20 libvmaf crashes."""

WAITING_FRAMES = 2
"""Pictures that wait for FFmpeg, of each input."""

RGB = 3
INSTALL_COMMAND = "pip install imageio-ffmpeg"
LAST_COMPLAINTS = 600
"""Characters of FFmpeg's messages that an error repeats."""

ByteImage = NDArray[np.uint8]


@dataclass(frozen=True)
class VmafScores:
    """VMAF of a sequence, 0 (unwatchable) to 100 (not told apart).

    Attributes:
        frames: one score a frame.
        model: the name in libvmaf.
        build: versions of libvmaf and FFmpeg, which move scores by hundredths of a point.
    """

    frames: tuple[float, ...]
    model: str
    build: str


def choose_model(height: int) -> str:
    """Return the model for pictures of so many rows."""
    return MODEL_4K if height >= ROWS_4K else MODEL_HD


def limited_range_luma(picture: ByteImage) -> ByteImage:
    """8-bit limited-range BT.709 luma (height, width) of display-encoded RGB (height, width, 3).

    Y = round(16 + 219 (0.2126 R + 0.7152 G + 0.0722 B) / 255)
    """
    weights = np.asarray(LUMA_WEIGHTS, dtype=np.float32) * np.float32(LUMA_SPAN / 255.0)
    rounded = picture.astype(np.float32) @ weights + np.float32(LUMA_BLACK + 0.5)
    return rounded.astype(np.uint8)


class _Feed(threading.Thread):
    """Writes pictures to a pipe; once nobody reads it, takes and drops them."""

    def __init__(self, pipe: int, grey: bytes) -> None:
        super().__init__(daemon=True)
        self.broken = False
        self.ended = False
        self._pipe = pipe
        self._grey = grey
        self._waiting: queue.Queue[bytes | None] = queue.Queue(WAITING_FRAMES)

    def put(self, plane: ByteImage) -> None:
        """Hand over a copy of a luma plane, waiting for room."""
        self._waiting.put(plane.tobytes())

    def end(self) -> None:
        """End the input, unless it has ended."""
        if not self.ended:
            self._waiting.put(None)
            self.ended = True

    def run(self) -> None:
        try:
            for plane in iter(self._waiting.get, None):
                self._write(plane)
                self._write(self._grey)
        finally:
            os.close(self._pipe)

    def _write(self, content: bytes) -> None:
        view = memoryview(content)
        while view and not self.broken:
            try:
                view = view[os.write(self._pipe, view) :]
            except OSError:
                self.broken = True


class _Reader(threading.Thread):
    """Reads a pipe to its end."""

    def __init__(self, pipe: int) -> None:
        super().__init__(daemon=True)
        self.content = b""
        self._pipe = pipe

    def run(self) -> None:
        with os.fdopen(self._pipe, "rb") as stream:
            self.content = stream.read()


def describe_too_small(size: tuple[int, int]) -> str:
    """Say why pictures of (height, width) have no VMAF; "" where they have one."""
    if min(size) >= MIN_SIDE_PX:
        return ""
    return f"VMAF: {size[1]} x {size[0]} pixels are too few, it needs at least {MIN_SIDE_PX} a side"


class Vmaf:
    """A running VMAF of one sequence: pictures are added as they come, `finish` has the scores.

        with Vmaf((1080, 1920)) as vmaf:
            for test, ref in pairs:
                vmaf.add(test, ref)
            scores = vmaf.finish()

    Leaving the context ends FFmpeg, whatever happened. Of an odd height or width the last row or
    column is left out, since the format has none.
    """

    def __init__(self, size: tuple[int, int], model: str = MODEL_HD) -> None:
        """Prepare a comparison of pictures of `size` = (height, width).

        Raises:
            MetricError: there is no such model, or the pictures are smaller than 32 pixels.
        """
        if too_small := describe_too_small(size):
            raise MetricError(too_small)
        if model not in MODELS:
            raise MetricError(f"VMAF: there is no model '{model}'{did_you_mean(model, MODELS)}")
        self._size = size
        self._even = (size[0] // 2 * 2, size[1] // 2 * 2)
        self._model = model
        self._added = 0

    def __enter__(self) -> Vmaf:
        """Start FFmpeg.

        Raises:
            MetricUnavailableError: it is not installed, or does not start.
        """
        program, self._version = find_ffmpeg()
        (test_out, test_in), (ref_out, ref_in), (log_out, log_in), (said_out, said_in) = (
            os.pipe() for _ in range(4)
        )
        try:
            self._child = subprocess.Popen(
                _list_arguments(program, self._even, self._model, (test_out, ref_out, log_in)),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=said_in,
                pass_fds=(test_out, ref_out, log_in),
            )
        except OSError as error:
            _close(test_in, ref_in, log_out, said_out)
            raise MetricUnavailableError(f"VMAF: {program} does not start: {error}") from error
        finally:
            # open here, the child's ends would keep the pipes alive when it is gone
            _close(test_out, ref_out, log_in, said_in)
        grey = bytes([GREY]) * (self._even[0] * self._even[1] // 2)
        self._feeds = (_Feed(test_in, grey), _Feed(ref_in, grey))
        self._log, self._said = _Reader(log_out), _Reader(said_out)
        for thread in (*self._feeds, self._log, self._said):
            thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End FFmpeg and wait until it, and every thread, is gone."""
        self._child.kill()
        self._wait()

    def add(self, test: ByteImage, ref: ByteImage) -> None:
        """Add a frame: display-encoded 8-bit RGB (height, width, 3), copied before it returns.

        Raises:
            ShapeMismatchError: a picture is not of the size that was announced.
            MetricError: FFmpeg has ended.
        """
        for picture in (test, ref):
            _check(picture, (*self._size, RGB))
        self.add_luma(limited_range_luma(test), limited_range_luma(ref))

    def add_luma(self, test: ByteImage, ref: ByteImage) -> None:
        """Add a frame of 8-bit limited-range BT.709 luma (height, width). Errors as of `add`."""
        for plane in (test, ref):
            _check(plane, self._size)
        if any(feed.ended or feed.broken for feed in self._feeds):
            self._wait()
            raise self._failure()
        height, width = self._even
        for feed, plane in zip(self._feeds, (test, ref), strict=True):
            feed.put(plane[:height, :width])
        self._added += 1

    def finish(self) -> VmafScores:
        """Wait for the scores of all frames that were added.

        Raises:
            MetricError: there were none, or FFmpeg failed.
        """
        if not self._added:
            raise MetricError("VMAF: there is no frame to compare")
        if self._wait() != 0:
            raise self._failure()
        try:
            scores = self._scores(json.loads(self._log.content))
        except (ValueError, KeyError) as error:
            raise MetricError(f"VMAF: FFmpeg's scores cannot be read: {error}") from error
        if len(scores.frames) != self._added:
            raise MetricError(f"VMAF: {len(scores.frames)} scores for {self._added} frames")
        return scores

    def _wait(self) -> int:
        """End the inputs, wait for FFmpeg and every thread, return FFmpeg's exit status."""
        for feed in self._feeds:
            feed.end()
        status = self._child.wait()
        for thread in (*self._feeds, self._log, self._said):
            thread.join()
        return status

    def _failure(self) -> MetricError:
        said = self._said.content.decode(errors="replace").strip()[-LAST_COMPLAINTS:]
        return MetricError(
            f"VMAF: FFmpeg ended after at most {self._added} frames with status "
            f"{self._child.returncode}: {said or 'it said nothing'}"
        )

    def _scores(self, log: dict[str, Any]) -> VmafScores:
        return VmafScores(
            frames=tuple(frame["metrics"]["vmaf"] for frame in log["frames"]),
            model=self._model,
            build=f"libvmaf {log['version']} in FFmpeg {self._version}",
        )


def _check(picture: ByteImage, shape: tuple[int, ...]) -> None:
    if picture.shape != shape or picture.dtype != np.uint8:
        raise ShapeMismatchError(
            f"VMAF compares 8-bit pictures of one size: {shape} uint8 (height first) was "
            f"announced, {picture.shape} {picture.dtype} came"
        )


def _close(*descriptors: int) -> None:
    for descriptor in descriptors:
        os.close(descriptor)


def find_ffmpeg() -> tuple[str, str]:
    """Return the path and the version of the FFmpeg that imageio-ffmpeg brings along.

    Raises:
        MetricUnavailableError: it is not installed; names the command that helps.
    """
    if os.name == "nt":
        raise MetricUnavailableError("VMAF: Windows cannot hand its pipes to FFmpeg")
    try:
        import imageio_ffmpeg

        return imageio_ffmpeg.get_ffmpeg_exe(), imageio_ffmpeg.get_ffmpeg_version()
    except (ImportError, RuntimeError) as error:
        raise MetricUnavailableError(
            f"VMAF: FFmpeg with libvmaf is not installed; get it with `{INSTALL_COMMAND}`"
        ) from error


def _list_arguments(
    program: str, even: tuple[int, int], model: str, pipes: tuple[int, int, int]
) -> list[str]:
    """FFmpeg's command line; `pipes`: what it reads test and reference from, writes scores to."""
    test, ref, log = pipes
    raw = f"-f rawvideo -pix_fmt yuv420p -color_range tv -video_size {even[1]}x{even[0]}".split()
    options = f"model=version={model}:n_threads=1:log_fmt=json:log_path=/dev/fd/{log}"
    return [
        *(program, "-hide_banner", "-nostdin", "-v", "error", "-filter_complex_threads", "1"),
        *(*raw, "-i", f"pipe:{test}"),
        *(*raw, "-i", f"pipe:{ref}"),
        *("-filter_complex", f"[0:v][1:v]libvmaf={options}", "-f", "null", "-"),
    ]
