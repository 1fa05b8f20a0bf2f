"""`rtsr train` after parsing: settings, clips, the loop, and what it leaves behind."""

from __future__ import annotations

import logging
import os
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from tqdm import tqdm

from rtsr_cli import __version__
from rtsr_cli.commands.basics import LOG, device_named
from rtsr_cli.commands.options import emit
from rtsr_cli.commands.stopping import unwinding
from rtsr_cli.core.errors import CheckpointError, ConfigError, FrameFolderError
from rtsr_cli.core.io.atomic import check_writable, write_atomically
from rtsr_cli.core.learning.clips import SUFFIX, Clip, read_clips, total_frames
from rtsr_cli.core.learning.config import DataConfig, TrainingConfig
from rtsr_cli.core.learning.crops import Task, make_task
from rtsr_cli.core.learning.journal import Journal
from rtsr_cli.core.learning.loop import STATE_FOLDER, Progress, Run, train
from rtsr_cli.core.learning.packing import pack
from rtsr_cli.core.learning.ranks import Ranks, joined, local_device
from rtsr_cli.core.learning.sampling import check_sizes
from rtsr_cli.core.learning.state import saved_step
from rtsr_cli.core.learning.validating import (
    Judged,
    judge_of,
    judged,
    mean_scores,
    panels,
    validation_frames,
)
from rtsr_cli.core.memory import keep_freed
from rtsr_cli.core.settings import (
    Source,
    parse_assignments,
    read_toml,
    resolve,
    to_plain,
    to_toml,
)
from rtsr_cli.core.system import System
from rtsr_cli.core.weights import load_into, read_weights, save_weights
from rtsr_cli.models import load_system

CONFIG_FILE = "config.toml"

BASELINE = "demod-bicubic"
"""What pictures and validation show beside the network."""

MAX_NAMED = 40
"""Shots that weights name; more are counted."""

MAY_CHANGE = frozenset(
    {
        "training.validate_every",
        "training.save_every",
        "training.log_every",
        "training.validation_frames",
        "data.workers",
    }
)
"""Settings that change nothing of what a run computes: it may go on with others."""


def run_train(chosen: Mapping[str, Any]) -> int:
    """Train or pack; return the exit code."""
    system = load_system(chosen["system"])
    settings = _resolved(system, _tables(chosen))
    network_config, training, data = settings
    if system.scales and training.scale not in system.scales:
        made_for = ", ".join(f"{s}x" for s in system.scales)
        raise ConfigError(f"system '{system.name}' is made for {made_for}, not {training.scale}x")
    task = make_task(system, network_config, training)
    plain = _plain(system, settings)
    if chosen["out_folder"] is not None:
        _refuse_other_settings(system, chosen["out_folder"] / CONFIG_FILE, plain)
    if chosen["dry_run"]:
        LOG.info("%s", to_toml(plain))
        return 0
    # before frames are decoded: weights that do not fit are told at once
    network = _first_network(chosen, task, training)
    device = torch.device(local_device(device_named(chosen["device"])))
    with joined(device) as ranks:
        if not ranks.first:
            LOG.setLevel(logging.ERROR)
        clips = _clips(chosen, task, data, ranks)
        if chosen["pack_file"] is not None:
            count = pack(chosen["pack_file"], clips, task, training, crops=chosen["pack_crops"])
            LOG.info("%s: %d clips packed", chosen["pack_file"], count)
            return 0
        folder = chosen["out_folder"]
        if ranks.first:
            check_writable(folder)
            write_atomically(folder / CONFIG_FILE, lambda p: _write(p, to_toml(plain)))
        run = Run(
            folder=folder,
            task=task,
            config=training,
            clips=clips,
            device=device,
            workers=data.workers or max(1, min(8, os.cpu_count() or 1)),
            keep=_Keeper(folder, system, plain, clips).keep,
            ranks=ranks,
        )
        keep_freed()
        with unwinding():
            return _follow(chosen, run, network) if ranks.first else _accompany(run, network)


def _accompany(run: Run, network: nn.Module) -> int:
    """Do the work of a process that is not the first, silently."""
    for _ in train(run, network):
        pass
    return 0


def _resolved(system: System, tables: Sequence[Source]) -> tuple[Any, TrainingConfig, DataConfig]:
    """Settings of the network, the training and the data, defaults filled in."""
    return (
        resolve(system.config, *_parts(tables, "network")),
        resolve(TrainingConfig, _own_defaults(system), *_parts(tables, "training")),
        resolve(DataConfig, *_parts(tables, "data")),
    )


def _own_defaults(system: System) -> Source:
    """Settings of the training that a system has others of."""
    values = {} if system.learning is None else system.learning.defaults
    return Source(f"defaults of {system.name}", values)


def _plain(system: System, settings: tuple[Any, TrainingConfig, DataConfig]) -> dict[str, Any]:
    """What config.toml holds."""
    tables = zip(("network", "training", "data"), map(to_plain, settings), strict=True)
    return {"system": system.name, **dict(tables)}


def _tables(chosen: Mapping[str, Any]) -> list[Source]:
    sources = [] if chosen["config_file"] is None else [read_toml(chosen["config_file"])]
    sources.append(parse_assignments(chosen["assignments"]))
    for source in sources:
        unknown = source.values.keys() - {"system", "network", "training", "data"}
        if unknown:
            raise ConfigError(
                f"{source.name}: there is no table '{min(unknown)}' (there are: network, training, "
                "data)"
            )
        named = source.values.get("system", chosen["system"])
        if named != chosen["system"]:
            raise ConfigError(f"{source.name}: is of system '{named}', not '{chosen['system']}'")
    return sources


def _parts(sources: Sequence[Source], table: str) -> list[Source]:
    found = []
    for source in sources:
        values = source.values.get(table, {})
        if not isinstance(values, Mapping):
            raise ConfigError(f"{source.name}: '{table}' is a table of settings, not a value")
        found.append(Source(f"{source.name} [{table}]", values))
    return found


def _refuse_other_settings(system: System, path: Path, plain: Mapping[str, Any]) -> None:
    """Hold a run that is gone on with to its settings; what it does not name is the default.

    Raises:
        ConfigError: they are others; names them.
    """
    if not path.is_file():
        return
    stored = read_toml(path)
    if stored.values.get("system", system.name) != system.name:
        raise ConfigError(f"{path}: the run there is of another system; choose another --out")
    before, now = _flat(_plain(system, _resolved(system, [stored]))), _flat(plain)
    changed = sorted(k for k in now if before[k] != now[k] and k not in MAY_CHANGE)
    if changed:
        listed = ", ".join(f"{k} is {before.get(k)!r}, not {now.get(k)!r}" for k in changed)
        raise ConfigError(
            f"{path}: the run there has other settings ({listed}); give the same to go on, or "
            "choose another --out"
        )


def _flat(values: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{above}{name}.")
        else:
            flat[f"{above}{name}"] = value
    return flat


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8")


def _clips(chosen: Mapping[str, Any], task: Task, data: DataConfig, ranks: Ranks) -> list[Clip]:
    """Clips of every DATA: packs as they are, folders recorded."""
    clips: list[Clip] = []
    folders = []
    for path in chosen["data"]:
        if path.suffix == SUFFIX or path.is_file():
            clips += read_clips(path)[0]
        elif not path.is_dir():
            raise FrameFolderError(f"{path}: no such folder")
        else:
            folders.append(path)
    if folders:
        from rtsr_cli.commands.recording import recorded

        clips += recorded(folders, chosen, task, data, ranks)
    judged = total_frames(c for c in clips if c.facts.validation)
    if not judged:
        clips += _judged_as_trained(clips)
        judged = total_frames(c for c in clips if c.facts.validation)
    learnt = total_frames(c for c in clips if not c.facts.validation)
    names = {c.facts.name for c in clips if not c.facts.validation}
    LOG.info("%d frames of %d shots to train on, %d to validate", learnt, len(names), judged)
    return clips


def _judged_as_trained(clips: Sequence[Clip]) -> list[Clip]:
    """Frames to judge where none is held out: those that are trained on."""
    LOG.warning(
        "Warning: no shot is held out, so validation is on training frames and will look too good"
    )
    return [replace(clip, facts=replace(clip.facts, validation=True)) for clip in clips]


def _first_network(chosen: Mapping[str, Any], task: Task, training: TrainingConfig) -> nn.Module:
    """Fresh weights by the seed, or those of --init.

    Raises:
        CheckpointError: they cannot be read, are another system's, or do not fit.
    """
    torch.manual_seed(training.seed)
    network = task.system.build(task.config, task.scale)
    if chosen["init_file"] is not None:
        weights = read_weights(chosen["init_file"])
        if weights.system != task.system.name:
            raise CheckpointError(
                f"{weights.path}: weights of '{weights.system}', not of '{task.system.name}'; give "
                "others as --init"
            )
        begun = {name: network.get_buffer(name).clone() for name in task.learning.measured}
        load_into(network, weights)
        for name, value in begun.items():
            network.get_buffer(name).copy_(value)
    return network


class _Keeper:
    """Writes weights with everything that says where they come from."""

    def __init__(
        self, folder: Path, system: System, plain: Mapping[str, Any], clips: Sequence[Clip]
    ) -> None:
        self._folder, self._system, self._plain = folder, system, plain
        trained = sorted({c.facts.name for c in clips if not c.facts.validation})
        self._about = {
            "trained_on": trained if len(trained) <= MAX_NAMED else f"{len(trained)} shots",
            "training": plain["training"],
            "rtsr": __version__,
            "revision": git_revision(),
        }

    def keep(
        self, name: str, tensors: Mapping[str, Tensor], step: int, scores: Mapping[str, float]
    ) -> None:
        """Write RUN/<name>."""
        about = {**self._about, "step": step, "validation": dict(scores)}
        save_weights(
            self._folder / name,
            tensors,
            system=self._system.name,
            scale=self._plain["training"]["scale"],
            config=self._plain["network"],
            about=about,
        )


def git_revision() -> str:
    """Revision of the source tree that runs, empty where it is none."""
    root = Path(__file__).parent.parent.parent
    if not (root / ".git").exists():
        return ""
    try:
        asked = ("git", "-C", str(root), "rev-parse", "HEAD")
        found = subprocess.run(asked, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return found.stdout.strip()


def _follow(chosen: Mapping[str, Any], run: Run, network: nn.Module) -> int:
    """Run the loop; show, log and draw what it reports."""
    config, task = run.config, run.task
    warning = check_sizes(run.clips, config)
    if warning:
        LOG.warning("Warning: %s", warning)
    frames = validation_frames(run.clips, config.validation_frames)
    enlarged = _baseline(task, frames)
    if enlarged:
        LOG.info("%s: %s", BASELINE, _listed(mean_scores(enlarged)))
    start = saved_step(run.folder / STATE_FOLDER)
    if start:
        LOG.info("going on after step %d", start)
    names = judge_of(task).names
    journal = Journal(run.folder, resume_step=start or None, score=names[0])
    with tqdm(total=config.steps, initial=start, unit="step", disable=None) as bar:
        for progress in train(run, network):
            bar.update(progress.step - bar.n)
            bar.set_postfix(loss=f"{progress.losses['loss']:.4f}")
            journal.log(progress.step, _row(progress, names))
            _tell(chosen, progress, config.steps, names)
            for judged, other in zip_longest(progress.frames, enlarged[: len(progress.frames)]):
                name = f"{judged.clip.facts.name}-{judged.clip.facts.numbers[judged.position]}"
                journal.picture(
                    progress.step,
                    name.replace("/", "-"),
                    panels(judged, other, config.picture_side),
                )
    journal.close()
    LOG.info("%s: %d steps done", run.folder, config.steps)
    return 0


def _baseline(task: Task, frames: Sequence[tuple[Clip, int]]) -> list[Judged]:
    """Judge the baseline on the frames that validation uses, if it can run on them."""
    system = load_system(BASELINE)
    if set(system.lr_inputs) - set(task.system.lr_inputs):
        return []
    if set(system.hr_inputs) - set(task.system.hr_inputs):
        return []
    network = system.build(system.config(), task.scale)
    return list(judged(system, network, task, frames))


def _row(progress: Progress, names: Sequence[str]) -> dict[str, float | None]:
    """What log.csv says of a step; scores are None where nothing was judged."""
    scores = {name: progress.scores.get(name) for name in names}
    rates = {"learning_rate": progress.learning_rate, "steps_per_s": progress.steps_per_second}
    return {"loss": progress.losses["loss"], **progress.losses, **scores, **rates}


def _tell(chosen: Mapping[str, Any], progress: Progress, steps: int, names: Sequence[str]) -> None:
    if chosen["as_json"]:
        known = {name: value for name, value in _row(progress, names).items() if value is not None}
        emit({"event": "step", "step": progress.step, **known, "best": progress.best})
        return
    if progress.scores:
        best = ", best so far" if progress.best else ""
        LOG.info(
            "step %d of %d: loss %.4f, %.2f steps/s, %s%s",
            progress.step,
            steps,
            progress.losses["loss"],
            progress.steps_per_second,
            _listed(progress.scores),
            best,
        )


def _listed(scores: Mapping[str, float]) -> str:
    units = {"psnr": " dB"}
    return ", ".join(f"{name} {value:.4f}{units.get(name, '')}" for name, value in scores.items())
