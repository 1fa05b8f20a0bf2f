from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from rtsr_cli.core.captures.capture_file import CaptureDeclaration, validate_content
from rtsr_cli.core.errors import ConfigError


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            'motion.unit = "pixel"',
            "motion.unit: 'pixel' is not known, did you mean 'pixels'? (allowed: pixels, uv, ndc)",
        ),
        ('scale = "four"', "scale: 'four' is not a whole number"),
        ("scale = 0", "scale: 0 is out of range (allowed: 1 or more)"),
        ("depth.unit = -1.0", "depth.unit: -1.0 is out of range (allowed: more than 0)"),
        ("depth.unit = [1]", "depth.unit: [1] is not a number"),
        ("jitter_px = [0.1, 3.0]", "jitter_px.1: 3.0 is out of range (allowed: 1 or less)"),
        ("motion.jittered = 7", "motion.jittered: 7 is not true or false"),
        ("motion = 3", "motion: 3 is not a table"),
        ("layout = 3", "layout: 3 is not text"),
        ("camera_cuts = 3", "camera_cuts: 3 is not a list"),
        ("motion.zero = inf", "motion.zero: inf is not a finite number"),
        ("normal.sky = [0, 0]", "normal.sky.2: is missing"),
        (f'scale = "{500 * "x"}"', "scale: 'xxxxxxxx"),
        ('buffers.depth = [""]', "buffers.depth.0.channel: is empty"),
        (
            'motion.directon = "x"',
            "motion.directon: no such field, did you mean 'direction'? (there are: unit, ",
        ),
    ],
)
def test_every_message_is_one_short_line_with_file_and_key(text: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        validate_content(CaptureDeclaration, tomllib.loads(text), Path("my.toml"))
    said = str(caught.value)
    assert said.startswith(f"my.toml: {message}")
    assert "\n" not in said
    assert "pydantic" not in said
    assert "Input should" not in said
    assert len(said) < 200
