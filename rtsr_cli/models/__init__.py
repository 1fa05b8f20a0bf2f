"""The systems, a row each; none is imported before it is asked for.

A new system is its module or folder and one row in `ROWS`. What is trained is a folder: `__init__`
(what it is, `SYSTEMS`), `config`, `inputs`, `network`, `loss`, and `published` where this project
departs from the publication. A baseline has no network and no loss: one file.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from rtsr_cli.core.choices import InputCondition, SystemTask
from rtsr_cli.core.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from rtsr_cli.core.system import System


@dataclass(frozen=True, kw_only=True)
class SystemRow:
    """What is known of a system without importing it; a test holds rows to declarations.

    Attributes:
        name: what users type.
        module: of this package, that declares it.
        task: what it predicts.
        trainable: whether it has a network.
        rank: place in the order of preference of its task, 1 = first; None = only by name. The
            order is that of measured quality (docs/results.md, "What changes with jitter?").
        when: what inputs must be like for it to be preferred; where they are not, only by name.
    """

    name: str
    module: str
    task: SystemTask = SystemTask.UPSCALE
    trainable: bool = False
    rank: int | None = None
    when: tuple[InputCondition, ...] = ()


ROWS = (
    SystemRow(name="bicubic", module="bicubic", rank=9),
    SystemRow(name="demod-bicubic", module="bicubic", rank=6),
    SystemRow(name="demod-guided", module="guided", rank=5),
    SystemRow(
        name="demod-temporal", module="temporal", rank=2, when=(InputCondition.TRUSTED_MOTION,)
    ),
    SystemRow(
        name="gather",
        module="gather",
        trainable=True,
        rank=1,
        when=(InputCondition.TRUSTED_MOTION, InputCondition.POINT_SAMPLES),
    ),
    SystemRow(
        name="taau",
        module="taau",
        rank=8,
        when=(InputCondition.TRUSTED_MOTION, InputCondition.JITTER),
    ),
    SystemRow(name="fusesr", module="fusesr", trainable=True, rank=3),
    SystemRow(name="fusesr-fast", module="fusesr", trainable=True, rank=4),
    SystemRow(name="fusesr-direct", module="fusesr", trainable=True),
    SystemRow(name="nsrd", module="nsrd", trainable=True),
    SystemRow(
        name="cgts",
        module="cgts",
        trainable=True,
        rank=7,
        when=(InputCondition.TRUSTED_MOTION, InputCondition.JITTER),
    ),
    SystemRow(name="warp", module="extrapolation", task=SystemTask.EXTRAPOLATE, rank=3),
    SystemRow(name="warp-guided", module="extrapolation", task=SystemTask.EXTRAPOLATE, rank=2),
    SystemRow(
        name="extranet",
        module="extranet",
        task=SystemTask.EXTRAPOLATE,
        trainable=True,
        rank=1,
    ),
    SystemRow(
        name="rt-percept",
        module="rt_percept",
        task=SystemTask.PREDICT_VRS,
        trainable=True,
        rank=1,
    ),
)
"""Every system, in the order of listings."""


def list_system_names(task: SystemTask | None = None) -> tuple[str, ...]:
    """Names of the systems, those of a task or all, without importing one."""
    return tuple(row.name for row in ROWS if task is None or row.task is task)


def list_upscaler_names() -> tuple[str, ...]:
    """Names of the systems that `upscale` takes, without importing one."""
    return list_system_names(SystemTask.UPSCALE)


def list_rate_predictor_names() -> tuple[str, ...]:
    """Names of the systems that `predict-vrs` takes, best first, without importing one."""
    best = list_preferred_names(SystemTask.PREDICT_VRS)
    return (*best, *(n for n in list_system_names(SystemTask.PREDICT_VRS) if n not in best))


def list_extrapolator_names() -> tuple[str, ...]:
    """Names of the systems that `extrapolate` takes, without importing one."""
    return list_system_names(SystemTask.EXTRAPOLATE)


def list_trainable_names() -> tuple[str, ...]:
    """Names of the systems that `train` takes, without importing one."""
    return tuple(row.name for row in ROWS if row.trainable)


def list_preferred_names(task: SystemTask) -> tuple[str, ...]:
    """Names of a task's systems by preference, without importing one."""
    ranked = [(row.rank, row.name) for row in ROWS if row.task is task and row.rank is not None]
    return tuple(name for _, name in sorted(ranked))


PREFERENCE = list_preferred_names(SystemTask.UPSCALE)
"""What `upscale` uses by default: the first of these that inputs, scale and weights allow."""


CONDITIONS = {row.name: row.when for row in ROWS if row.when}
"""What inputs must be like for a system to be preferred, by its name."""


def load_system(name: str) -> System:
    """Import a system's module and return its declaration.

    Raises:
        ConfigError: there is no such system; suggests one.
    """
    modules = {row.name: row.module for row in ROWS}
    if name not in modules:
        raise ConfigError(f"no system is called '{name}'{did_you_mean(name, modules)}")
    systems: tuple[System, ...] = import_module(f"{__name__}.{modules[name]}").SYSTEMS
    return next(system for system in systems if system.name == name)
