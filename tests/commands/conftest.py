"""Running commands, and small variations of the sample frames."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from numpy.typing import NDArray

from rtsr_cli.cli import group
from rtsr_cli.core.captures.measuring import decision
from rtsr_cli.core.captures.measuring.measured_storage import StorageMeasurement
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.files.pixel_window import PixelWindow
from rtsr_cli.core.files.provenance import digest_values
from rtsr_cli.core.frames.conventions import Conventions

Planes = dict[str, NDArray[Any]]
Change = Callable[[Planes, int], None]
SIZE = (32, 48)
"""Height and width of the LR crop: 128 x 192 at the target size."""


@pytest.fixture(scope="session", autouse=True)
def measured_once() -> Iterator[None]:
    """Measure the conventions of equal files once: most tests are about something else."""
    known: dict[str, StorageMeasurement] = {}
    measure = decision.measure_storage

    def remembered(
        reader: FrameReader, presumed: Conventions, **options: Any
    ) -> StorageMeasurement:
        files = sorted(p for s in reader.frames.streams.values() for p in s.files.values())
        stats = [(str(p.resolve()), p.stat().st_mtime_ns, p.stat().st_size) for p in files]
        cameras = [reader.camera_values(n) for n in reader.numbers]
        key = digest_values(stats, reader.declaration, repr(presumed), cameras, repr(options))
        if key not in known:
            known[key] = measure(reader, presumed, **options)
        return known[key]

    patch = pytest.MonkeyPatch()
    patch.setattr(decision, "measure_storage", remembered)
    yield
    patch.undo()


@pytest.fixture
def rtsr() -> Callable[..., Result]:
    """Run `rtsr` with arguments of any type."""

    def run(*args: object) -> Result:
        return CliRunner().invoke(group, [str(a) for a in args])

    return run


def crop_frames(source: Path, target: Path, scale: int, count: int) -> None:
    """Copy the top left corner of the first frames."""
    for number in range(1, count + 1):
        path = source / f"frame.{number:04d}.exr"
        header = read_header(path)
        planes = read_channels(path, header.channels)
        rows, columns = (slice(0, side * scale) for side in SIZE)
        cropped = {name: plane[rows, columns] for name, plane in planes.items()}
        write_exr(target / path.name, cropped, attributes=header.attributes)


@pytest.fixture(scope="session")
def small_shot(sample_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four frames of a corner of the sample: lr/, hr/ and reference/ for 4x."""
    shot = tmp_path_factory.mktemp("small")
    for folder, scale in (("lr", 1), ("hr", 4), ("reference", 4)):
        crop_frames(sample_root / folder, shot / folder, scale, 4)
    shutil.copy(sample_root / "capture.toml", shot)
    return shot


@pytest.fixture(scope="session")
def small_capture(small_shot: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same frames as one HR capture, radiance and G-buffer in one file."""
    folder = tmp_path_factory.mktemp("capture")
    for path in sorted((small_shot / "hr").iterdir()):
        header = read_header(path)
        planes = read_channels(path, header.channels)
        planes |= read_channels(small_shot / "reference" / path.name, "RGB")
        write_exr(folder / path.name, planes, attributes=header.attributes)
    return folder


@pytest.fixture(scope="session")
def textured(sample_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four frames of a textured part of the sample, in its place on the image plane."""
    folder = tmp_path_factory.mktemp("textured")
    place = PixelWindow(left=144, top=112, width=192, height=128)
    display = PixelWindow(left=0, top=0, width=480, height=288)
    rows, columns = slice(112, 240), slice(144, 336)
    for path in sorted((sample_root / "hr").glob("*.exr"))[:4]:
        header = read_header(path)
        planes = dict(read_channels(path, header.channels))
        planes |= read_channels(sample_root / "reference" / path.name, "RGB")
        cropped = {name: plane[rows, columns] for name, plane in planes.items()}
        write_exr(
            folder / path.name,
            cropped,
            attributes=header.attributes,
            data_window=place,
            display_window=display,
        )
    return folder


@pytest.fixture
def changed(tmp_path: Path) -> Callable[[Path, Change], Path]:
    """Copy a folder of frames with `change(planes, number)` applied to each."""

    def copy(source: Path, change: Change) -> Path:
        target = tmp_path / f"changed_{source.name}"
        for path in sorted(source.glob("*.exr")):
            header = read_header(path)
            planes = {k: v.copy() for k, v in read_channels(path, header.channels).items()}
            change(planes, int(path.stem.split(".")[-1]))
            write_exr(target / path.name, planes, attributes=header.attributes)
        return target

    return copy


def rgb(path: Path) -> NDArray[np.float32]:
    """Load R, G, B as 3 x h x w."""
    planes = read_channels(path, "RGB")
    return np.stack([planes[c].astype(np.float32) for c in "RGB"])


@pytest.fixture
def load_rgb() -> Callable[[Path], NDArray[np.float32]]:
    """Return the loader of R, G, B."""
    return rgb


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a folder by relative path."""
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()
    }


@pytest.fixture
def files_of() -> Callable[[Path], dict[str, bytes]]:
    """Return the reader of a folder's bytes."""
    return contents
