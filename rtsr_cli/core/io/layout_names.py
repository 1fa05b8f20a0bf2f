"""Names of the layout presets, apart from their declarations so that usage errors need no torch."""

from __future__ import annotations

LAYOUT_NAMES = ("rtsr", "blender")
"""Every preset, in the order of listings."""
