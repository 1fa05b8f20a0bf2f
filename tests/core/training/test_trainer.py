from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.choices import Precision
from rtsr_cli.core.errors import CheckpointError, TrainingError
from rtsr_cli.core.training.clips import Clip
from rtsr_cli.core.training.config import Optimiser, Schedule, TrainingConfig
from rtsr_cli.core.training.sampler import SampleDrawer
from rtsr_cli.core.training.samples import SampleTask
from rtsr_cli.core.training.trainer import (
    Trainer,
    TrainingProgress,
    TrainingRun,
    scheduled_rate,
    train,
)
from tests.core.training.conftest import make_clip

CONFIG = TrainingConfig(
    steps=6,
    batch=2,
    crop=8,
    warmup=2,
    validate_every=4,
    save_every=2,
    log_every=1,
    validation_frames=1,
    precision=Precision.FP32,
)


class Kept:
    """Weights by file name, as they were last kept."""

    def __init__(self) -> None:
        self.files: dict[str, dict[str, Tensor]] = {}

    def keep(
        self, name: str, tensors: Mapping[str, Tensor], step: int, scores: Mapping[str, float]
    ) -> None:
        del step, scores
        self.files[name] = {k: t.detach().clone() for k, t in tensors.items()}


def make_run(
    folder: Path, task: SampleTask, config: TrainingConfig = CONFIG, clips: list[Clip] | None = None
) -> tuple[TrainingRun, Kept]:
    kept = Kept()
    default = [make_clip(), make_clip(name="v/w", validation=True)]
    run = TrainingRun(
        folder=folder,
        task=task,
        config=config,
        clips=default if clips is None else clips,
        device=torch.device("cpu"),
        workers=2,
        keep=kept.keep,
    )
    return run, kept


def network(task: SampleTask) -> torch.nn.Module:
    torch.manual_seed(3)
    return task.system.build(task.config, task.scale)


def run_all(run: TrainingRun) -> list[TrainingProgress]:
    return list(train(run, network(run.task)))


def test_a_run_that_was_cut_off_ends_as_one_that_was_not(tmp_path: Path, task: SampleTask) -> None:
    whole, kept = make_run(tmp_path / "whole", task)
    run_all(whole)
    cut, _ = make_run(tmp_path / "cut", task)
    # the fourth report is that of step 4; the third step is done again after the state of step 2
    list(itertools.islice(train(cut, network(task)), 3))
    again, kept_again = make_run(tmp_path / "cut", task)
    reports = run_all(again)
    assert reports[0].step == 3
    for name, tensor in kept.files["last.safetensors"].items():
        assert torch.equal(tensor, kept_again.files["last.safetensors"][name]), name


def test_a_finished_run_has_nothing_left_to_do(tmp_path: Path, task: SampleTask) -> None:
    run, _ = make_run(tmp_path, task)
    run_all(run)
    assert run_all(make_run(tmp_path, task)[0]) == []


def test_training_brings_the_loss_down_on_one_crop(tmp_path: Path) -> None:
    from rtsr_cli.core.training.augmentation import NO_AUGMENTATION
    from rtsr_cli.models import load_system

    system = load_system("fusesr-fast")
    task = SampleTask(system=system, config=system.config(), scale=4)
    config = replace(
        CONFIG, steps=40, crop=99, batch=1, learning_rate=2e-3, augmentation=NO_AUGMENTATION,
        validate_every=99, save_every=99,
    )  # fmt: skip
    run, _ = make_run(tmp_path, task, config, [make_clip(frames=1)])
    losses = [progress.losses["loss"] for progress in run_all(run)]
    assert losses[-1] < 0.97 * losses[0]


def test_accumulated_passes_are_one_batch(tmp_path: Path, task: SampleTask) -> None:
    """Of equal samples, so that batch norm sees the same statistics either way."""
    run, _ = make_run(tmp_path, task)
    sample = SampleDrawer(run.clips, task, CONFIG).make(0)
    gradients = []
    for batches in ([[sample, sample]], [[sample], [sample]]):
        trainer = Trainer(run, network(task))
        trainer.advance(batches)
        parameters = trainer.network.parameters()
        gradients.append([p.grad.clone() for p in parameters if p.grad is not None])
    assert max(float(gradient.abs().max()) for gradient in gradients[0]) > 1e-5
    for one, two in zip(*gradients, strict=True):
        assert torch.allclose(one, two, rtol=1e-3, atol=1e-6)


def test_a_loss_that_is_not_finite_names_the_frame_and_keeps_the_state(
    tmp_path: Path, task: SampleTask
) -> None:
    bad = make_clip(name="bad/one")
    bad.hr["color"][:] = math.nan
    run, _ = make_run(tmp_path, task, clips=[bad])
    with pytest.raises(TrainingError, match=r"bad/one, frame \d, crop of 8 x 8 LR pixels"):
        run_all(run)
    assert (tmp_path / "state" / "state.json").is_file()


def test_the_state_of_another_network_is_refused(tmp_path: Path) -> None:
    from rtsr_cli.models import load_system

    for name in ("fusesr-fast", "fusesr"):
        system = load_system(name)
        task = SampleTask(system=system, config=system.config(), scale=4)
        run, _ = make_run(tmp_path, task)
        if name == "fusesr":
            with pytest.raises(CheckpointError, match="another network"):
                run_all(run)
        else:
            run_all(run)


def test_a_validation_reports_scores_and_frames(tmp_path: Path, task: SampleTask) -> None:
    run, kept = make_run(tmp_path, task)
    reports = run_all(run)
    judged = [report for report in reports if report.scores]
    assert [report.step for report in judged] == [4, 6]
    assert judged[0].best
    assert set(judged[0].scores) == {"psnr", "ssim", "flip"}
    assert judged[0].frames[0].clip.facts.name == "v/w"
    assert set(kept.files) == {"best.safetensors", "last.safetensors"}


def test_the_learning_rate_warms_up_and_falls() -> None:
    config = replace(CONFIG, steps=100, warmup=10, learning_rate=1.0, final_rate=0.1)
    assert scheduled_rate(config, 0) == pytest.approx(0.1)
    assert scheduled_rate(config, 9) == pytest.approx(1.0)
    assert scheduled_rate(config, 10) == pytest.approx(1.0)
    assert scheduled_rate(config, 55) == pytest.approx(0.55)
    assert scheduled_rate(config, 100) == pytest.approx(0.1)
    halved = replace(config, schedule=Schedule.HALVE)
    assert scheduled_rate(halved, 49) == 1.0
    assert scheduled_rate(halved, 50) == 0.5
    assert scheduled_rate(replace(config, schedule=Schedule.CONSTANT), 99) == 1.0


@pytest.mark.parametrize(
    "changed", [{"optimiser": Optimiser.ADAMW}, {"ema": 0.0}, {"accumulate": 2}]
)
def test_every_way_of_training_resumes_exactly(tmp_path: Path, changed: dict[str, object]) -> None:
    from rtsr_cli.models import load_system

    system = load_system("fusesr-fast")
    task = SampleTask(system=system, config=system.config(), scale=4)
    config = replace(CONFIG, **changed)  # type: ignore[arg-type]
    whole, kept = make_run(tmp_path / "whole", task, config)
    run_all(whole)
    cut, _ = make_run(tmp_path / "cut", task, config)
    list(itertools.islice(train(cut, network(task)), 3))
    again, kept_again = make_run(tmp_path / "cut", task, config)
    run_all(again)
    for name, tensor in kept.files["last.safetensors"].items():
        assert torch.equal(tensor, kept_again.files["last.safetensors"][name]), name
