"""Settings of a training run: defaults, a file's, and single ones; and whether a run may go on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.files.ownership import is_own
from rtsr_cli.core.settings import (
    SettingsSource,
    parse_assignments,
    read_toml,
    resolve_settings,
    to_plain,
)
from rtsr_cli.core.system import System
from rtsr_cli.core.training.config import DataConfig, TrainingConfig
from rtsr_cli.core.training.request import TrainRequest

CONFIG_FILE = "config.toml"

TABLES = ("network", "training", "data")
"""Tables of settings; beside them stands the name of the system."""

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


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """Every setting of a run, defaults filled in.

    Attributes:
        system: what is trained.
        network: config of the system.
        training: how it is trained.
        data: which shots.
    """

    system: System
    network: Any
    training: TrainingConfig
    data: DataConfig

    @property
    def plain(self) -> dict[str, Any]:
        """What config.toml holds."""
        tables = {name: to_plain(getattr(self, name)) for name in TABLES}
        return {"system": self.system.name, **tables}


def resolve_request(system: System, request: TrainRequest) -> RunSettings:
    """Return the settings of a request: defaults < its file < its assignments < its scale.

    Raises:
        ConfigError: a setting is unknown or unfit, is of another system, or the run that is gone
            on with has others.
    """
    settings = resolve_sources(system, _list_sources(request))
    scale = settings.training.scale
    if system.scales and scale not in system.scales:
        made_for = ", ".join(f"{s}x" for s in system.scales)
        raise ConfigError(f"system '{system.name}' is made for {made_for}, not {scale}x")
    if request.out_folder is not None:
        refuse_other_settings(settings, request.out_folder / CONFIG_FILE)
    return settings


def resolve_sources(system: System, sources: Sequence[SettingsSource]) -> RunSettings:
    """Return the settings of the network, the training and the data, later sources winning.

    Raises:
        ConfigError: a setting is unknown or unfit; lists them all.
    """
    own = SettingsSource(
        f"defaults of {system.name}", {} if system.learning is None else system.learning.defaults
    )
    return RunSettings(
        system=system,
        network=resolve_settings(system.config, *_list_tables(sources, "network")),
        training=resolve_settings(TrainingConfig, own, *_list_tables(sources, "training")),
        data=resolve_settings(DataConfig, *_list_tables(sources, "data")),
    )


def _list_sources(request: TrainRequest) -> list[SettingsSource]:
    assignments = list(request.assignments)
    if request.scale is not None:
        assignments.append(f"training.scale={request.scale}")
    sources = [] if request.config_file is None else [read_toml(request.config_file)]
    sources.append(parse_assignments(assignments))
    for source in sources:
        unknown = source.values.keys() - {"system", *TABLES}
        if unknown:
            raise ConfigError(
                f"{source.name}: there is no table '{min(unknown)}' (there are: "
                f"{', '.join(TABLES)})"
            )
        named = source.values.get("system", request.system)
        if named != request.system:
            raise ConfigError(f"{source.name}: is of system '{named}', not '{request.system}'")
    return sources


def _list_tables(sources: Sequence[SettingsSource], table: str) -> list[SettingsSource]:
    """One table of every source."""
    tables = []
    for source in sources:
        values = source.values.get(table, {})
        if not isinstance(values, Mapping):
            raise ConfigError(f"{source.name}: '{table}' is a table of settings, not a value")
        tables.append(SettingsSource(f"{source.name} [{table}]", values))
    return tables


def refuse_other_settings(settings: RunSettings, path: Path) -> None:
    """Hold a run that is gone on with to its settings; what it does not name is the default.

    Args:
        settings: what is asked for now.
        path: config.toml of the run, if it was begun.

    Raises:
        ConfigError: they are others; names them.
    """
    if not is_own(path):
        # nothing was begun there; what stands in its place is refused, or to be replaced
        return
    system, stored = settings.system, read_toml(path)
    if stored.values.get("system", system.name) != system.name:
        raise ConfigError(f"{path}: the run there is of another system; choose another --out")
    before = _flatten(resolve_sources(system, [stored]).plain)
    now = _flatten(settings.plain)
    changed = sorted(k for k in now if before[k] != now[k] and k not in MAY_CHANGE)
    if changed:
        listed = ", ".join(f"{k} is {before.get(k)!r}, not {now.get(k)!r}" for k in changed)
        raise ConfigError(
            f"{path}: the run there has other settings ({listed}); give the same to go on, or "
            "choose another --out"
        )


def _flatten(values: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= _flatten(value, f"{above}{name}.")
        else:
            flat[f"{above}{name}"] = value
    return flat
