"""Names of the layout presets, apart from their declarations so that usage errors need no torch."""

from __future__ import annotations

LAYOUT_NAMES = (
    "rtsr", "blender", "extranet", "nss", "nsrd", "mitsuba", "falcor", "unreal-mrq",
    "unity", "nuke",
)  # fmt: skip
"""Every preset, in the order of listings: those checked on files, then those from documentation."""

PAIR_LAYOUTS = ("nss", "nsrd")
"""Those of data sets that keep two resolutions in folders of their own."""

LAYOUT_SUFFIX = ".toml"
"""A layout whose name ends so is a file of the user's."""
