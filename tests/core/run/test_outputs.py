from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.captures.regions import OutputWindows
from rtsr_cli.core.choices import MissingPolicy
from rtsr_cli.core.errors import OutputError
from rtsr_cli.core.files.atomic_write import check_writable
from rtsr_cli.core.files.exr import read_channels, read_header, write_exr
from rtsr_cli.core.files.exr_checksum import CHECKSUM
from rtsr_cli.core.files.ownership import refuse_foreign
from rtsr_cli.core.files.pixel_window import PixelWindow
from rtsr_cli.core.files.png import encode_png, write_png
from rtsr_cli.core.files.provenance import STAMP
from rtsr_cli.core.run.outputs import (
    OutputFrame,
    OutputState,
    find_output,
    name_output,
    read_output_state,
    read_picture_state,
)

STAMPED = {STAMP: "now"}
NOISE = np.random.default_rng(1).random((40, 40), np.float32)


@pytest.mark.parametrize(
    ("pattern", "number", "expected"),
    [
        ("frame.{:04d}.exr", 7, "frame.0007.exr"),
        ("{:04d}.exr", 5, "0005.exr"),
        ("img{:03d}.exr", 12, "img012.exr"),
        ("a_{:04d}.exr", 3, "a_0003.exr"),
        ("shot-{:04d}.exr", 3, "shot-0003.exr"),
        ("{:04d}.exr", -2, "-002.exr"),
        ("a_{:04d}.exr", -2, "a_-002.exr"),
        ("a.{:04d}.exr", -2, "a.-002.exr"),
        ("{:d}.EXR", 1234567, "1234567.exr"),
        ("v002.beauty {:d}.exr", 4, "v002.beauty 4.exr"),
    ],
)
def test_outputs_keep_base_name_and_digits(
    tmp_path: Path,
    write_frames: Callable[..., Path],
    open_folder: Callable[..., FrameReader],
    pattern: str,
    number: int,
    expected: str,
) -> None:
    reader = open_folder(write_frames(tmp_path, [number], name=pattern))
    assert name_output(reader, number) == expected


def test_a_frame_that_another_stands_in_for_has_its_own_number(
    tmp_path: Path, write_frames: Callable[..., Path], open_folder: Callable[..., FrameReader]
) -> None:
    write_frames(tmp_path, [8, 10])
    reader = open_folder(tmp_path, on_missing=MissingPolicy.HOLD)
    assert [name_output(reader, n) for n in reader.numbers] == [
        "frame.0008.exr",
        "frame.0009.exr",
        "frame.0010.exr",
    ]


def test_an_output_that_is_there_with_another_separator_is_the_frames(
    tmp_path: Path, write_frames: Callable[..., Path], open_folder: Callable[..., FrameReader]
) -> None:
    reader = open_folder(write_frames(tmp_path / "in", [7, 8, 9], name="shot_{:04d}.exr"))
    out = tmp_path / "out"
    out.mkdir()
    (out / "shot.0007.exr").touch()
    (out / "shot_0008.exr").touch()
    (out / "shot.0008.exr").touch()
    names = ["shot.0007.exr", "shot_0008.exr", "shot_0009.exr"]
    assert [find_output(out, reader, n).name for n in (7, 8, 9)] == names


def test_only_a_file_with_the_expected_stamp_is_done(tmp_path: Path) -> None:
    plane = {"Y": np.zeros((2, 2), np.float16)}
    write_exr(tmp_path / "ours.exr", plane, attributes={STAMP: "now"})
    write_exr(tmp_path / "theirs.exr", plane)
    assert read_output_state(tmp_path / "ours.exr", "now") is OutputState.DONE
    assert read_output_state(tmp_path / "ours.exr", "later") is OutputState.FOREIGN
    assert read_output_state(tmp_path / "theirs.exr", "now") is OutputState.FOREIGN
    assert read_output_state(tmp_path / "none.exr", "now") is OutputState.ABSENT


@pytest.mark.parametrize("share", [0.999, 0.7, 0.5])
def test_an_output_that_was_cut_is_damaged_and_not_done(tmp_path: Path, share: float) -> None:
    path = tmp_path / "a.exr"
    write_exr(
        path, {"Y": np.random.default_rng(1).random((40, 40), np.float32)}, attributes=STAMPED
    )
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])
    assert read_output_state(path, "now") is OutputState.DAMAGED
    assert read_output_state(path, "later") is OutputState.FOREIGN


def test_a_byte_that_flipped_in_the_pixels_is_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_exr(path, {"Y": np.zeros((40, 40), np.float32)}, attributes=STAMPED, compression="none")
    content = bytearray(path.read_bytes())
    content[-7] ^= 1
    path.write_bytes(content)
    # nothing but the checksum tells: such a file can be decoded
    assert read_channels(path, ["Y"])["Y"].any()
    assert read_output_state(path, "now") is OutputState.DAMAGED


@pytest.mark.parametrize("damaged", [False, True])
def test_an_output_of_a_version_without_checksums_is_decoded(tmp_path: Path, damaged: bool) -> None:
    path = tmp_path / "a.exr"
    write_exr(
        path, {"Y": np.random.default_rng(1).random((40, 40), np.float32)}, attributes=STAMPED
    )
    content = path.read_bytes().replace(CHECKSUM.encode(), b"rtsr:other")
    path.write_bytes(content[:-200] if damaged else content)
    expected = OutputState.DAMAGED if damaged else OutputState.DONE
    assert read_output_state(path, "now") is expected


def test_what_is_no_file_or_leads_nowhere_is_foreign(tmp_path: Path) -> None:
    (tmp_path / "folder.exr").mkdir()
    (tmp_path / "link.exr").symlink_to(tmp_path / "nowhere")
    os.mkfifo(tmp_path / "pipe.exr")
    for name in ("folder.exr", "link.exr", "pipe.exr"):
        assert read_output_state(tmp_path / name, "now") is OutputState.FOREIGN


def test_a_picture_is_done_if_it_is_whole_and_rtsrs(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    assert read_picture_state(path) is OutputState.ABSENT
    write_png(path, np.random.default_rng(1).integers(0, 255, (9, 9, 3), dtype=np.uint8))
    content = path.read_bytes()
    assert read_picture_state(path) is OutputState.DONE
    path.write_bytes(content[:-5])
    assert read_picture_state(path) is OutputState.DAMAGED
    path.write_bytes(content[:-30] + b"x" + content[-29:])
    assert read_picture_state(path) is OutputState.DAMAGED
    path.write_bytes(encode_png(np.zeros((1, 1, 3), np.uint8)))
    assert read_picture_state(path) is OutputState.FOREIGN


def test_foreign_files_are_refused_with_the_first_and_the_count(tmp_path: Path) -> None:
    refuse_foreign([], "rtsr upscale")
    paths = [tmp_path / "a.exr", tmp_path / "b.exr", tmp_path / "c.exr"]
    with pytest.raises(OutputError, match=r"a\.exr and 2 more: rtsr upscale .*--overwrite"):
        refuse_foreign(paths, "rtsr upscale")


def test_a_folder_that_cannot_be_made_is_refused_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot write here"):
        check_writable(tmp_path / "file" / "out")
    check_writable(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []


def frame(path: Path, **fields: object) -> OutputFrame:
    defaults: dict[str, object] = {
        "color": torch.full((1, 3, 4, 6), 0.5),
        "alpha": None,
        "attributes": {"owner": "me"},
        "windows": OutputWindows(
            region=PixelWindow(left=2, top=1, width=6, height=4),
            display=PixelWindow(left=0, top=0, width=9, height=9),
            kept=PixelWindow(left=2, top=1, width=6, height=4),
        ),
    }
    return OutputFrame(path=path, **{**defaults, **fields})  # type: ignore[arg-type]


def test_an_output_is_half_rgb_in_its_window_with_its_attributes(tmp_path: Path) -> None:
    frame(tmp_path / "a.exr").write()
    header = read_header(tmp_path / "a.exr")
    assert header.channels == {"R", "G", "B"}
    assert header.data_window == PixelWindow(left=2, top=1, width=6, height=4)
    assert header.display_window == PixelWindow(left=0, top=0, width=9, height=9)
    assert header.attributes["owner"] == "me"
    assert read_channels(tmp_path / "a.exr", ["R"])["R"].dtype == np.float16
    assert [p.name for p in tmp_path.iterdir()] == ["a.exr"]


def test_alpha_preview_and_debug_pictures_are_written_where_asked(tmp_path: Path) -> None:
    frame(
        tmp_path / "a.exr",
        alpha=torch.full((1, 1, 4, 6), 0.25),
        previews=True,
        debug={"mask": torch.ones(1, 1, 2, 3), "lighting": torch.ones(1, 3, 4, 6)},
    ).write()
    assert float(read_channels(tmp_path / "a.exr", ["A"])["A"][0, 0]) == 0.25
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    debug = read_header(tmp_path / "debug" / "a.exr")
    assert debug.channels == {"mask.Y", "lighting.R", "lighting.G", "lighting.B"}
    assert (debug.data_window.width, debug.data_window.height) == (6, 4)
