from __future__ import annotations

from rtsr_cli.core.errors import did_you_mean, find_nearest


def test_a_near_miss_is_suggested_and_everything_listed() -> None:
    assert did_you_mean("blendr", ["rtsr", "blender"]) == (
        ", did you mean 'blender'? (there are: rtsr, blender)"
    )
    assert did_you_mean("zzz", ["rtsr", "blender"]) == " (there are: rtsr, blender)"
    assert did_you_mean("zzz", []) == ""


def test_of_many_names_the_five_nearest_are_listed() -> None:
    names = [f"ViewLayer.{p}.{c}" for p in ("Diffuse Color", "Glossy Color", "Emission",
             "Normal", "Position", "Shadow Catcher", "Volume", "UV") for c in "RGB"]  # fmt: skip
    assert did_you_mean("ViewLayer.Glosy Color.R", names) == (
        ", did you mean 'ViewLayer.Glossy Color.R'? (nearest of 24: ViewLayer.Glossy Color.R, "
        "ViewLayer.Glossy Color.G, ViewLayer.Glossy Color.B, ViewLayer.Diffuse Color.R, "
        "ViewLayer.Diffuse Color.G)"
    )


def test_a_layer_that_was_left_out_is_no_difference() -> None:
    names = [f"{layer}.{p}.R" for layer in ("ViewLayer", "Other") for p in "abcdefg"]
    assert find_nearest("g.R", names, 2) == ["ViewLayer.g.R", "Other.g.R"]


def test_letters_the_other_way_round_are_near() -> None:
    assert did_you_mean("gf", ["ViewLayer", "fg"]).startswith(", did you mean 'fg'?")
