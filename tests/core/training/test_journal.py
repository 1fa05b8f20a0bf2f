from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import torch

from rtsr_cli.core.training.curves import PlottedCurve, add_label, plot_curves
from rtsr_cli.core.training.journal import Journal


def test_rows_stand_under_their_columns(tmp_path: Path) -> None:
    journal = Journal(tmp_path, resume_step=None)
    journal.log(10, {"loss": 0.5, "psnr": None})
    journal.log(20, {"loss": 0.25, "psnr": 30.125})
    journal.close()
    assert (tmp_path / "log.csv").read_text().split() == [
        "step,loss,psnr",
        "10,0.5,",
        "20,0.25,30.125",
    ]
    assert (tmp_path / "curves.png").is_file()


def test_a_resumed_run_drops_the_rows_it_will_write_again(tmp_path: Path) -> None:
    first = Journal(tmp_path, resume_step=None)
    for step in (1, 2, 3):
        first.log(step, {"loss": step})
    Journal(tmp_path, resume_step=2).log(3, {"loss": 9})
    assert (tmp_path / "log.csv").read_text().split() == ["step,loss", "1,1", "2,2", "3,9"]


def test_a_new_run_starts_a_new_table(tmp_path: Path) -> None:
    Journal(tmp_path, resume_step=None).log(1, {"loss": 1})
    Journal(tmp_path, resume_step=None)
    assert (tmp_path / "log.csv").read_text().split() == ["step"]


def test_a_picture_shows_every_panel_and_flip(tmp_path: Path) -> None:
    panels = {name: torch.rand(1, 3, 32, 40) for name in ("LR", "output", "reference")}
    Journal(tmp_path, resume_step=None).picture(5, "court-3", panels)
    read = oiio.ImageBuf(str(tmp_path / "pictures" / "step-000005-court-3.png"))
    assert (read.spec().width, read.spec().height) == (4 * 40 + 3 * 4, 32 + 16)


def test_a_curve_goes_from_corner_to_corner() -> None:
    image = plot_curves([PlottedCurve("loss", np.array([[0.0, 1.0], [100.0, 0.0]]))])
    blue = (image == np.array([31, 119, 180], np.uint8)).all(-1)
    rows, columns = blue.nonzero()
    assert rows[columns.argmin()] < 30
    assert rows[columns.argmax()] > 190
    assert columns.min() == 70
    assert columns.max() == 627


def test_a_label_is_ink_on_white() -> None:
    image = add_label(np.zeros((4, 60, 3), np.uint8), "lr")
    assert image.shape == (20, 60, 3)
    assert set(np.unique(image[:16])) == {40, 255}
