"""Every kind of place, and the scene of a seed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rtsr_cli.core.synth.building import Rng
from rtsr_cli.core.synth.indoors import hall, room
from rtsr_cli.core.synth.outdoors import field_of_things, plaza, street
from rtsr_cli.core.synth.scene import Scene

ARRANGEMENTS: tuple[Callable[[int, Rng], Scene], ...] = (plaza, room, street, hall, field_of_things)


def arranged(seed: int) -> Scene:
    """Scene of a seed, exposure not set; seeds that follow each other go through the places."""
    rng = np.random.default_rng([seed, 20])
    return ARRANGEMENTS[seed % len(ARRANGEMENTS)](seed, rng)
