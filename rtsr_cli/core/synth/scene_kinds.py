"""Every kind of place, and the scene of a seed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rtsr_cli.core.synth.indoor_scenes import draw_hall, draw_room
from rtsr_cli.core.synth.outdoor_scenes import draw_field, draw_plaza, draw_street
from rtsr_cli.core.synth.scene import Scene
from rtsr_cli.core.synth.scene_builder import Rng

ARRANGEMENTS: tuple[Callable[[int, Rng], Scene], ...] = (
    draw_plaza,
    draw_room,
    draw_street,
    draw_hall,
    draw_field,
)


def arrange_scene(seed: int) -> Scene:
    """Scene of a seed, exposure not set; seeds that follow each other go through the places."""
    rng = np.random.default_rng([seed, 20])
    return ARRANGEMENTS[seed % len(ARRANGEMENTS)](seed, rng)
