"""A run over some frames opens the files that it needs."""

from __future__ import annotations

from pathlib import Path

import pytest

from rtsr_cli.core.captures.measuring import decision, measurement
from rtsr_cli.core.files.exr import ExrHeader
from rtsr_cli.core.files.header_cache import HeaderCache
from rtsr_cli.core.frames.selection import Selection
from rtsr_cli.core.pairs.opening import ReadOptions, open_pairs

FRAMES = 40


@pytest.fixture
def long_shot(sample_root: Path, tmp_path: Path) -> Path:
    """Frames 1 to 40 at both resolutions: links to the few of the sample."""
    for folder in ("lr", "hr"):
        sources = sorted((sample_root / folder).glob("*.exr"))
        (tmp_path / "in" / folder).mkdir(parents=True)
        for number in range(1, FRAMES + 1):
            link = tmp_path / "in" / folder / f"frame.{number:04d}.exr"
            link.symlink_to(sources[(number - 1) % len(sources)])
    return tmp_path / "in"


def test_what_is_not_needed_stays_closed(long_shot: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Path] = []
    read = HeaderCache.read

    def count(cache: HeaderCache, path: Path) -> ExrHeader:
        opened.append(path)
        return read(cache, path)

    monkeypatch.setattr(HeaderCache, "read", count)
    # other tests remember measurements, for which they read every camera
    monkeypatch.setattr(decision, "measure_storage", measurement.measure_storage)
    options = ReadOptions(selection=Selection(frames=frozenset({2, 3})))
    ((_, pairs),) = open_pairs(long_shot, options, hr_folder=long_shot / "hr")
    lr = {int(path.stem.split(".")[1]) for path in opened if path.parent.name == "lr"}
    # those before, the selected ones, the one after; and those that conventions are measured on
    assert lr >= {1, 2, 3, 4}
    assert len(set(opened)) == len(opened) < FRAMES // 2
    assert pairs.reader.numbers == tuple(range(1, FRAMES + 1))
    camera = pairs.reader.cameras[30]
    assert camera.has_matrices
    assert opened[-1].name == "frame.0030.exr"
