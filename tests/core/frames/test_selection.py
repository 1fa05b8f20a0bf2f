from __future__ import annotations

import pytest

from rtsr_cli.core.captures.layout_names import LAYOUT_NAMES, PAIR_LAYOUTS
from rtsr_cli.core.captures.presets import LAYOUTS
from rtsr_cli.core.frames.selection import format_ranges


@pytest.mark.parametrize(
    ("numbers", "written"),
    [
        ([1, 2, 3, 7], "1-3, 7"),
        ([-3, -2, -1, 0, 1, 2], "-3..2"),
        ([-5, -3, -2, 4, 5], "-5, -3..-2, 4-5"),
        ([], ""),
    ],
)
def test_ranges_read_one_way_only(numbers: list[int], written: str) -> None:
    assert format_ranges(numbers) == written


def test_the_names_known_without_torch_are_those_of_the_presets() -> None:
    assert tuple(LAYOUTS) == LAYOUT_NAMES
    assert tuple(name for name, layout in LAYOUTS.items() if layout.tree) == PAIR_LAYOUTS
