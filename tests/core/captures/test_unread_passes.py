"""What a layout knows and does not read is named alike in every run."""

from __future__ import annotations

from itertools import permutations

from rtsr_cli.core.captures.layouts import Layout, UnreadPass


def test_the_first_component_is_named_in_whatever_order_channels_come() -> None:
    unread = (UnreadPass(name="*Specular.[RGB]", why="it is no F0"),)
    layout = Layout(name="", description="", buffers={}, unread=unread)
    for names in permutations(["Specular.R", "Specular.G", "Specular.B", "A"]):
        found = list(layout.list_unread({"beauty": names}))
        assert found == ["Specular.R", "Specular.G", "Specular.B"]
