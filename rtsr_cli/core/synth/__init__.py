"""Analytic scenes with exact buffers: `random_scene(seed)`, `render_frame(scene, number, size)`."""

from __future__ import annotations

from rtsr_cli.core.synth.exposure import random_scene
from rtsr_cli.core.synth.render import render_frame, render_reference
from rtsr_cli.core.synth.scene import Scene

__all__ = ["Scene", "random_scene", "render_frame", "render_reference"]
