"""Below a layer's or view's name every buffer is found that is found without it, in each layout."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rtsr_cli.core.captures.capture_file import CaptureDeclaration
from rtsr_cli.core.captures.layers import BoundLayers, bind_layers
from rtsr_cli.core.captures.layouts import SCOPE, Layout
from rtsr_cli.core.captures.presets import LAYOUTS
from rtsr_cli.core.files.exr import read_header, write_exr


def list_names(layout: Layout) -> set[str]:
    """Channels of the first way to store each buffer, where one file may hold them all."""
    names: set[str] = set()
    for components in layout.buffers.values():
        places = [t.place for c in components for t in c.sum_of(0).terms]
        if all(p.file == "*" and not p.is_pattern and SCOPE not in p.channel for p in places):
            names |= {p.channel for p in places}
    return names


def bind(path: Path, names: set[str], layout: Layout | None, layer: str | None) -> BoundLayers:
    write_exr(path, dict.fromkeys(sorted(names), np.ones((4, 4), np.float32)))
    headers = {"f": read_header(path)}
    return bind_layers(layout, CaptureDeclaration(), headers, "here", layer)


IN_ONE_FILE = [name for name, layout in LAYOUTS.items() if len(list_names(layout)) > 1]


def test_layouts_of_one_file_are_tried() -> None:
    assert "rtsr" in IN_ONE_FILE


@pytest.mark.parametrize("layer", ["left", "Fore ground", "a.b"])
@pytest.mark.parametrize("name", IN_ONE_FILE)
def test_every_buffer_is_found_below_a_layer(tmp_path: Path, name: str, layer: str) -> None:
    layout = LAYOUTS[name]
    names = list_names(layout)
    plain = bind(tmp_path / "plain.exr", names, layout, None).binding
    twins = {"left": "right"}.get(layer, "other")
    both = {f"{prefix}.{n}" for n in names for prefix in (layer, twins)}
    found = bind(tmp_path / "both.exr", both, layout, layer)
    assert found.layer == layer
    assert set(found.binding) == set(plain)
    for buffer, bound in found.binding.items():
        assert [c.channel for c in bound] == [f"{layer}.{c.channel}" for c in plain[buffer]]


def test_rtsrs_own_names_are_every_buffer() -> None:
    assert len(list_names(LAYOUTS["rtsr"])) >= len(LAYOUTS["rtsr"].buffers)


@pytest.mark.parametrize("layer", ["left", "Fore ground"])
def test_the_layout_is_detected_below_a_layer(tmp_path: Path, layer: str) -> None:
    names = {f"{layer}.{n}" for n in list_names(LAYOUTS["rtsr"])}
    found = bind(tmp_path / "frame.exr", names, None, layer)
    assert found.layout.name == "rtsr"
    assert set(found.binding) == set(LAYOUTS["rtsr"].buffers)
