"""The systems, by name; none is imported before it is asked for.

A new system is its file and one line in `SYSTEM_MODULES`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from rtsr_cli.core.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from rtsr_cli.core.system import System

SYSTEM_MODULES = {
    "bicubic": "bicubic",
    "demod-bicubic": "bicubic",
    "demod-guided": "guided",
    "taau": "taau",
    "fusesr": "fusesr",
    "fusesr-fast": "fusesr",
    "fusesr-direct": "fusesr",
    "nsrd": "nsrd",
    "rt-percept": "rt_percept",
}
"""System name -> module of this package; the order is that of listings."""

TRAINABLE = ("fusesr", "fusesr-fast", "fusesr-direct", "nsrd", "rt-percept")
"""Systems with a network; a test holds them to their declarations."""

OTHER_TASKS = ("rt-percept",)
"""Systems that do not upscale; a test holds them to their declarations."""

PREFERENCE = ("fusesr", "fusesr-fast", "demod-guided", "demod-bicubic", "bicubic")
"""What `upscale` uses by default: the first of these that inputs, scale and weights allow."""


def system_names() -> tuple[str, ...]:
    """Every system's name, without importing one."""
    return tuple(SYSTEM_MODULES)


def upscaler_names() -> tuple[str, ...]:
    """Names of the systems that `upscale` takes, without importing one."""
    return tuple(name for name in SYSTEM_MODULES if name not in OTHER_TASKS)


def rate_predictor_names() -> tuple[str, ...]:
    """Names of the systems that `predict-vrs` takes, best first, without importing one."""
    return OTHER_TASKS


def trainable_names() -> tuple[str, ...]:
    """Names of the systems that `train` takes, without importing one."""
    return TRAINABLE


def load_system(name: str) -> System:
    """Import a system's module and return its declaration.

    Raises:
        ConfigError: there is no such system; suggests one.
    """
    if name not in SYSTEM_MODULES:
        raise ConfigError(f"no system is called '{name}'{did_you_mean(name, SYSTEM_MODULES)}")
    module = import_module(f"rtsr_cli.models.{SYSTEM_MODULES[name]}")
    systems: tuple[System, ...] = module.SYSTEMS
    return next(system for system in systems if system.name == name)
