from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rtsr_cli.core.captures.channel_matching import bind_layout
from rtsr_cli.core.captures.layout_detection import detect_layout
from rtsr_cli.core.captures.layouts import ChannelPlace, Component, Layout, name_components
from rtsr_cli.core.captures.presets import LAYOUTS
from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.errors import FrameFolderError, LayerChoiceError
from rtsr_cli.core.files.exr import write_exr
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer

LAYER = "View Layer 1"


def spread(*groups: tuple[str, str]) -> list[str]:
    return [f"{name}.{letter}" for name, letters in groups for letter in letters]


BLENDER_CHANNELS = [
    f"{LAYER}.{channel}"
    for channel in spread(
        ("Combined", "RGBA"),
        ("Depth", "Z"),
        ("Normal", "XYZ"),
        ("Vector", "XYZW"),
        ("Position", "XYZ"),
        ("albedo", "RGB"),
        ("metallic", "X"),
        ("roughness", "X"),
        ("emission", "RGB"),
        ("Object Index", "X"),
    )
]

RTSR_CHANNELS = [
    *"RGBA",
    *spread(("albedo", "RGB"), ("normal", "XYZ"), ("motion", "XY"), ("emission", "RGB")),
    *("depth.Z", "metallic", "roughness", "objectid"),
]


def test_blender_channels_are_found_below_a_view_layer_with_spaces() -> None:
    layout, binding = detect_layout({"render": BLENDER_CHANNELS}, LAYOUTS.values(), "shot")
    assert layout.name == "blender"
    assert set(binding) == {
        Buffer.COLOR, Buffer.ALPHA, Buffer.DEPTH, Buffer.NORMAL, Buffer.MOTION, Buffer.FORWARD,
        Buffer.POSITION, Buffer.ALBEDO, Buffer.METALLIC, Buffer.ROUGHNESS, Buffer.EMISSION,
        Buffer.OBJECT_ID,
    }  # fmt: skip
    assert [c.channel for c in binding[Buffer.COLOR]] == [f"{LAYER}.Combined.{c}" for c in "RGB"]
    assert binding[Buffer.OBJECT_ID][0].channel == f"{LAYER}.Object Index.X"


def test_buffers_of_two_view_layers_are_never_mixed() -> None:
    channels = [f"A.Combined.{c}" for c in "RGB"]
    channels += [f"B.Combined.{c}" for c in "RGB"] + [f"B.Normal.{c}" for c in "XYZ"]
    binding = bind_layout(LAYOUTS["blender"], {"render": channels}, "B")
    assert {c.channel.split(".")[0] for parts in binding.values() for c in parts} == {"B"}
    binding = bind_layout(LAYOUTS["blender"], {"render": channels}, "A")
    assert set(binding) == {Buffer.COLOR}


def test_two_view_layers_are_a_choice_for_the_user() -> None:
    channels = [f"{layer}.Combined.{c}" for layer in ("Z [2]", "A [1]") for c in "RGB"]
    with pytest.raises(LayerChoiceError, match=r"'color' is in 2 layers .*'A \[1\]', 'Z \[2\]'"):
        bind_layout(LAYOUTS["blender"], {"render": channels})
    binding = bind_layout(LAYOUTS["blender"], {"render": channels}, "Z [2]")
    assert [c.channel for c in binding[Buffer.COLOR]] == [f"Z [2].Combined.{c}" for c in "RGB"]


def test_view_layers_in_files_of_their_own_are_a_choice_too() -> None:
    streams = {
        "fg": [f"Fore.Combined.{c}" for c in "RGB"],
        "bg": [f"Back.Combined.{c}" for c in "RGB"],
    }
    with pytest.raises(LayerChoiceError, match="'Back', 'Fore'"):
        bind_layout(LAYOUTS["blender"], streams)
    assert bind_layout(LAYOUTS["blender"], streams, "Fore")[Buffer.COLOR][0].stream == "fg"


def test_what_the_compositor_made_is_no_second_view_layer() -> None:
    channels = [*BLENDER_CHANNELS, *(f"Composite.Combined.{c}" for c in "RGBA")]
    binding = bind_layout(LAYOUTS["blender"], {"render": channels})
    assert [c.channel for c in binding[Buffer.COLOR]] == [f"{LAYER}.Combined.{c}" for c in "RGB"]
    binding = bind_layout(LAYOUTS["blender"], {"render": channels}, "Composite")
    assert [c.channel for c in binding[Buffer.COLOR]] == [f"Composite.Combined.{c}" for c in "RGB"]


def test_passes_of_one_renderer_are_ranked() -> None:
    passes = ("DiffCol", "albedo", "Combined")
    streams = {"render": [f"{LAYER}.{p}.{c}" for p in passes for c in "RGB"]}
    binding = bind_layout(LAYOUTS["blender"], streams)
    assert binding[Buffer.ALBEDO][0].channel == f"{LAYER}.albedo.R"


def test_what_denoisers_take_for_albedo_is_none_as_it_holds_reflections() -> None:
    passes = ("Denoising Albedo", "Combined")
    streams = {"render": [f"{LAYER}.{p}.{c}" for p in passes for c in "RGB"]}
    assert Buffer.ALBEDO not in bind_layout(LAYOUTS["blender"], streams)


AOVS = ("albedo.R", "albedo.G", "albedo.B", "metallic.X", "roughness.X")


@pytest.mark.parametrize(
    ("lacking", "computed"),
    [("", False), ("albedo.R", True), ("roughness.X", True), ("Position.X", True)],
)
def test_base_colour_metallic_and_roughness_come_before_sums_of_passes(
    lacking: str, computed: bool
) -> None:
    colors = [f"{p}.{c}" for p in ("Combined", "Diffuse Color", "Glossy Color") for c in "RGB"]
    vectors = [f"{p}.{c}" for p in ("Normal", "Position") for c in "XYZ"]
    names = [f"{LAYER}.{n}" for n in (*colors, *vectors, "Depth.Z", *AOVS) if n != lacking]
    assert (Buffer.MATERIAL in bind_layout(LAYOUTS["blender"], {"render": names})) is computed
    named = [*names, *(f"{LAYER}.material.{c}" for c in "RGB")]
    material = bind_layout(LAYOUTS["blender"], {"render": named})[Buffer.MATERIAL]
    assert material[0].channel == f"{LAYER}.material.R"


@pytest.mark.parametrize(
    ("passes", "material", "emission"),
    [
        (
            ("Diffuse Color", "Glossy Color", "Emission", "Environment"),
            "Diffuse Color.RGB + Glossy Color.RGB",
            "Emission.RGB + Environment.RGB",
        ),
        (
            ("Diffuse Color", "Glossy Color", "Transmission Color", "Environment"),
            "Diffuse Color.RGB + Glossy Color.RGB + Transmission Color.RGB",
            "Environment.RGB",
        ),
        (
            ("DiffCol", "GlossCol", "Emit", "Env"),
            "DiffCol.RGB + GlossCol.RGB",
            "Emit.RGB + Env.RGB",
        ),
        (
            ("DiffCol", "GlossCol", "TransCol", "Emit"),
            "DiffCol.RGB + GlossCol.RGB + TransCol.RGB",
            "Emit.RGB",
        ),
        (
            ("material", "emission", "Diffuse Color", "Glossy Color", "Emission", "Environment"),
            "material.RGB",
            "emission.RGB",
        ),
    ],
)
def test_passes_of_blender_are_added_up(
    passes: tuple[str, ...], material: str, emission: str
) -> None:
    names = [f"{LAYER}.{p}.{c}" for p in ("Combined", *passes) for c in "RGB"]
    binding = bind_layout(LAYOUTS["blender"], {"render": names})
    said = [
        binding[b].describe(streams=False).replace(f"{LAYER}.", "")
        for b in (Buffer.MATERIAL, Buffer.EMISSION)
    ]
    assert said == [material, emission]


@pytest.mark.parametrize(
    ("channels", "buffer", "layers"),
    [
        ([*"RGB", "beauty.R", "beauty.G", "beauty.B"], Buffer.COLOR, ("unnamed", "beauty")),
        (spread(("rgba", "RGB"), ("beauty", "RGB")), Buffer.COLOR, ("rgba", "beauty")),
        ([*"RGB", *spread(("albedo", "RGB"), ("Albedo", "RGB"))], Buffer.ALBEDO,
         ("albedo", "Albedo")),
        ([*"RGB", *spread(("normal", "XYZ"), ("N", "XYZ"))], Buffer.NORMAL, ("normal", "N")),
        ([*"RGB", "depth.Z", "Depth.Z"], Buffer.DEPTH, ("depth", "Depth")),
    ],
)  # fmt: skip
def test_two_groups_of_one_meaning_are_a_choice_for_the_user(
    channels: list[str], buffer: Buffer, layers: tuple[str, ...]
) -> None:
    with pytest.raises(LayerChoiceError, match=f"shot: buffer '{buffer}' is in 2 layers") as caught:
        detect_layout({"f": channels}, LAYOUTS.values(), "shot")
    assert caught.value.layers == layers
    assert "--layer" in str(caught.value)
    for layer in layers:
        _, binding = detect_layout({"f": channels}, LAYOUTS.values(), "shot", layer)
        held = {c.channel.rpartition(".")[0] or "unnamed" for c in binding[buffer]}
        assert held == {layer}


BLENDER_5 = [
    f"{LAYER}.{channel}"
    for channel in spread(
        ("Combined", "RGBA"),
        ("Depth", "V"),
        ("Normal", "XYZ"),
        ("Diffuse Color", "RGB"),
        ("Glossy Color", "RGB"),
        ("Emission", "RGB"),
        ("roughness", "V"),
        ("Object Index", "V"),
    )
]


def test_names_of_blender_5_are_known() -> None:
    layout, binding = detect_layout({"render": BLENDER_5}, LAYOUTS.values(), "shot")
    assert layout.name == "blender"
    held = {b: parts[0].channel.removeprefix(f"{LAYER}.") for b, parts in binding.items()}
    assert held == {
        Buffer.COLOR: "Combined.R", Buffer.ALPHA: "Combined.A", Buffer.DEPTH: "Depth.V",
        Buffer.NORMAL: "Normal.X", Buffer.ALBEDO: "Diffuse Color.R",
        Buffer.SPECULAR: "Glossy Color.R", Buffer.EMISSION: "Emission.R",
        Buffer.MATERIAL: "Diffuse Color.R",
        Buffer.ROUGHNESS: "roughness.V", Buffer.OBJECT_ID: "Object Index.V",
    }  # fmt: skip


def test_glossy_colour_stands_in_for_metallic_only() -> None:
    streams = {"render": [*BLENDER_5, f"{LAYER}.metallic.X"]}
    _, binding = detect_layout(streams, LAYOUTS.values(), "shot")
    assert Buffer.METALLIC in binding
    assert Buffer.SPECULAR not in binding


@pytest.mark.parametrize(
    ("streams", "grey"),
    [
        ({"f": ["Y"]}, True),
        ({"f": ["Y", "A", "Z", "normal.X", "normal.Y", "normal.Z"]}, True),
        ({"f": ["R", "G", "B", "Y"]}, False),
        ({"f": ["X", "Y", "depth.Z"]}, False),
        ({"depth": ["Y"], "f": ["R", "G", "B"]}, False),
    ],
)
def test_luminance_alone_is_grey_radiance(streams: dict[str, list[str]], grey: bool) -> None:
    binding = bind_layout(LAYOUTS["rtsr"], streams)
    channels = [c.channel for c in binding.get(Buffer.COLOR, ())]
    assert (channels == ["Y"] * 3) is grey


def test_two_groups_that_one_pattern_fits_are_a_choice_for_the_user() -> None:
    streams = {"f": [*"RGB", *spread(("alb1", "RGB"), ("alb2", "RGB"))]}
    with pytest.raises(LayerChoiceError, match="'alb1', 'alb2'"):
        bind_layout(LAYOUTS["mitsuba"], streams)
    binding = bind_layout(LAYOUTS["mitsuba"], streams, "alb2")
    assert binding[Buffer.ALBEDO][0].channel == "alb2.R"


def test_rtsr_channels_are_found_by_their_exact_names() -> None:
    layout, binding = detect_layout({"frame": RTSR_CHANNELS}, LAYOUTS.values(), "shot")
    assert layout.name == "rtsr"
    assert [c.channel for c in binding[Buffer.MOTION]] == ["motion.X", "motion.Y"]
    assert [c.channel for c in binding[Buffer.COLOR]] == ["R", "G", "B"]


def test_blender_vectors_turn_y_and_the_forward_pair_changes_both_signs(
    tmp_path: Path, open_folder: Callable[..., FrameReader]
) -> None:
    stored = {"X": 2.0, "Y": 3.0, "Z": 5.0, "W": 7.0}
    channels = {f"{LAYER}.Vector.{c}": np.full((2, 2), v, np.float32) for c, v in stored.items()}
    channels |= {f"{LAYER}.Combined.{c}": np.ones((2, 2), np.float16) for c in "RGB"}
    write_exr(tmp_path / "0001.exr", channels)
    frame = open_folder(tmp_path).read(1, (Buffer.MOTION, Buffer.FORWARD))
    # previous pair: y up, so (X, -Y); next pair: position now minus position there, y up: (-Z, +W)
    assert frame.gbuffer[Buffer.MOTION][0, :, 0, 0].tolist() == [2.0, -3.0]
    assert frame.gbuffer[Buffer.FORWARD][0, :, 0, 0].tolist() == [-5.0, 7.0]


def test_a_buffer_with_a_channel_missing_is_not_bound() -> None:
    binding = bind_layout(
        LAYOUTS["rtsr"], {"frame": ["R", "G", "B", "motion.X", "normal.X", "normal.Y"]}
    )
    assert set(binding) == {Buffer.COLOR}


def test_two_sequences_of_one_folder_that_hold_the_same_buffer_are_refused_by_name() -> None:
    streams = {"beauty_v1": RTSR_CHANNELS, "beauty_v2": RTSR_CHANNELS}
    with pytest.raises(FrameFolderError, match=r"'color' is in 2 .*'beauty_v1', 'beauty_v2'"):
        bind_layout(LAYOUTS["rtsr"], streams)


def test_two_sequences_that_hold_different_buffers_are_bound_together() -> None:
    binding = bind_layout(LAYOUTS["rtsr"], {"beauty": ["R", "G", "B"], "z": ["depth.Z"]})
    assert binding[Buffer.COLOR][0].stream == "beauty"
    assert binding[Buffer.DEPTH][0].stream == "z"


def test_channels_that_no_layout_knows_are_listed_with_the_choices() -> None:
    with pytest.raises(FrameFolderError) as caught:
        detect_layout({"frame": ["foo.x", "bar"]}, LAYOUTS.values(), "/shots/a")
    message = str(caught.value)
    assert message.startswith("/shots/a")
    assert "bar, foo.x" in message
    assert "--layout" in message
    assert all(name in message for name in LAYOUTS)


def test_a_long_list_of_unknown_channels_is_cut() -> None:
    with pytest.raises(FrameFolderError, match=r"\.\.\.\)"):
        detect_layout({"frame": [f"x{i:02d}" for i in range(40)]}, LAYOUTS.values(), "shot")


def test_two_layouts_that_explain_as_much_are_a_choice_for_the_user() -> None:
    streams = {"frame": [*"RGB", *(f"Layer.Combined.{c}" for c in "RGB")]}
    with pytest.raises(FrameFolderError, match=r"layouts rtsr, blender fit .* --layout"):
        detect_layout(streams, LAYOUTS.values(), "shot")


def test_the_layout_that_explains_more_buffers_wins() -> None:
    streams = {"frame": [*RTSR_CHANNELS, *(f"Layer.Combined.{c}" for c in "RGB")]}
    assert detect_layout(streams, LAYOUTS.values(), "shot")[0].name == "rtsr"


def test_patterns_of_a_component_are_tried_in_order() -> None:
    layout = Layout(
        name="own",
        description="",
        buffers={
            Buffer.DEPTH: (
                Component(places=(ChannelPlace(channel="Z"), ChannelPlace(channel="depth.*"))),
            )
        },
    )
    assert bind_layout(layout, {"f": ["depth.V", "Z"]})[Buffer.DEPTH][0].channel == "Z"
    assert bind_layout(layout, {"f": ["depth.V"]})[Buffer.DEPTH][0].channel == "depth.V"


def test_a_component_takes_its_stream_by_pattern() -> None:
    layout = Layout(
        name="own",
        description="",
        buffers={
            Buffer.DEPTH: (Component(places=(ChannelPlace(channel="R", file="SceneDepth/*"),)),)
        },
    )
    binding = bind_layout(layout, {"BaseColor/": ["R"], "SceneDepth/": ["R"]})
    assert binding[Buffer.DEPTH][0].stream == "SceneDepth/"


def test_names_of_components_join_prefix_and_letter() -> None:
    channels = [
        tuple(p.channel for p in c.places) for c in name_components(Buffer.MOTION, "mv", "")
    ]
    assert channels == [("mv.X", "X"), ("mv.Y", "Y")]
    assert [p.channel for p in name_components(Buffer.NOV, "nov")[0].places] == ["nov"]


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_a_preset_declares_as_many_components_as_its_buffers_have_channels(layout: Layout) -> None:
    for buffer, components in layout.buffers.items():
        assert len(components) == BUFFER_SPECS[buffer].channels, buffer
