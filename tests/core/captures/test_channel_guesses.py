from __future__ import annotations

import pytest

from rtsr_cli.core.captures.channel_guesses import guess_buffers, list_named
from rtsr_cli.core.frames.buffers import Buffer


@pytest.mark.parametrize(
    ("channels", "buffer", "places"),
    [
        ("Lit.r Lit.g Lit.b", Buffer.COLOR, ("Lit.r", "Lit.g", "Lit.b")),
        ("mo.y mo.x", Buffer.MOTION, ("mo.x", "mo.y")),
        ("mvX mvY", Buffer.MOTION, ("mvX", "mvY")),
        ("motion_y motion_x", Buffer.MOTION, ("motion_x", "motion_y")),
        ("velocity.u velocity.v", Buffer.MOTION, ("velocity.u", "velocity.v")),
        (
            "worldPos.x worldPos.y worldPos.z",
            Buffer.POSITION,
            ("worldPos.x", "worldPos.y", "worldPos.z"),
        ),
        (
            "base_col.r base_col.g base_col.b",
            Buffer.ALBEDO,
            ("base_col.r", "base_col.g", "base_col.b"),
        ),
        ("smoothness", Buffer.ROUGHNESS, ("smoothness",)),
        ("viewz.V", Buffer.DEPTH, ("viewz.V",)),
        ("SceneDepth", Buffer.DEPTH, ("SceneDepth",)),
        ("zbuf", Buffer.DEPTH, ("zbuf",)),
        ("mat.R mat.G mat.B", Buffer.MATERIAL, ("mat.R", "mat.G", "mat.B")),
        ("object_id", Buffer.OBJECT_ID, ("object_id",)),
    ],
)
def test_names_are_understood(channels: str, buffer: Buffer, places: tuple[str, ...]) -> None:
    assert guess_buffers({"shot": channels.split()}) == {buffer: places}


@pytest.mark.parametrize("name", ["split.r split.g split.b", "grid", "smoke.x smoke.y", "k.x k.y"])
def test_short_words_inside_of_others_mean_nothing(name: str) -> None:
    assert guess_buffers({"shot": name.split()}) == {}


BLENDER_PASSES = (
    "Denoising Albedo",
    "Denoising Normal",
    "Glossy Direct",
    "Glossy Indirect",
    "Glossy Color",
    "Transmission Direct",
    "Shadow Catcher",
)


@pytest.mark.parametrize("name", BLENDER_PASSES)
def test_passes_of_light_and_of_denoisers_are_no_surface(name: str) -> None:
    channels = [f"ViewLayer.{name}.{c}" for c in "RGB"]
    assert not {Buffer.ALBEDO, Buffer.NORMAL, Buffer.ROUGHNESS, Buffer.METALLIC} & set(
        guess_buffers({"shot": channels})
    )


@pytest.mark.parametrize(
    "name", ["MaterialMask", "CryptoMaterial00", "material_index", "matte", "Material AO"]
)
def test_a_material_is_called_that_and_nothing_else(name: str) -> None:
    assert Buffer.MATERIAL not in guess_buffers({"shot": [f"{name}.{c}" for c in "RGB"]})


def test_roughness_of_a_lobe_is_roughness() -> None:
    found = guess_buffers({"shot": ["specular_roughness"]})
    assert found == {Buffer.ROUGHNESS: ("specular_roughness",)}


def test_the_name_of_the_files_tells_what_their_plain_channels_are() -> None:
    found = guess_buffers({"beauty": ["R", "G", "B"], "mv": ["R", "G"], "zdepth": ["R"]})
    assert found[Buffer.COLOR] == ("beauty:R", "beauty:G", "beauty:B")
    assert found[Buffer.MOTION] == ("mv:R", "mv:G")
    assert found[Buffer.DEPTH] == ("zdepth:R",)


@pytest.mark.parametrize(
    "names", [["coat_roughness"], ["sheen.roughness"], ["depthOfField"], ["lens.DOF"]]
)
def test_coats_and_lenses_are_no_surface_and_no_depth(names: list[str]) -> None:
    assert guess_buffers({"shot": names}) == {}


def test_speed_is_motion() -> None:
    found = guess_buffers({"shot": ["speed.X", "speed.Y"]})
    assert found == {Buffer.MOTION: ("speed.X", "speed.Y")}


def test_names_speak_for_buffers_whatever_they_hold() -> None:
    named = list_named({"shot": ["metalness.R", "metalness.G", "metalness.B", "coat_roughness"]})
    assert Buffer.METALLIC in named
    assert Buffer.ROUGHNESS not in named
