from __future__ import annotations

from rtsr_cli.core.errors import did_you_mean


def test_a_near_miss_is_suggested_and_everything_listed() -> None:
    assert did_you_mean("blendr", ["rtsr", "blender"]) == (
        ", did you mean 'blender'? (there are: rtsr, blender)"
    )
    assert did_you_mean("zzz", ["rtsr", "blender"]) == " (there are: rtsr, blender)"
    assert did_you_mean("zzz", []) == ""
