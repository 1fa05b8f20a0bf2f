"""Options and requests: the same names, the same defaults, and no torch for either."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import MISSING, fields
from importlib import import_module
from pathlib import Path
from typing import Any

import click
import pytest

from rtsr_cli.api import PLACES, UpscaleRequest
from rtsr_cli.commands import options as opt
from rtsr_cli.core.choices import JitterMode, MissingPolicy
from rtsr_cli.core.errors import RequestError

MINIMAL: dict[str, tuple[str, list[str]]] = {
    "DemodulateRequest": ("demodulate", ["a", "b"]),
    "EvaluateRequest": ("evaluate", ["a", "b"]),
    "ExportRequest": ("export", ["fusesr", "a"]),
    "ExtrapolateRequest": ("extrapolate", ["a", "b"]),
    "InspectRequest": ("inspect", ["a"]),
    "LabelRequest": ("label", ["a", "b", "--kind", "vrs"]),
    "PrecomputeLutRequest": ("precompute-lut", ["a.exr"]),
    "PredictVrsRequest": ("predict-vrs", ["a", "b"]),
    "SynthRequest": ("synth", ["a"]),
    "TrainRequest": ("train", ["fusesr", "a", "--out", "run"]),
    "UpscaleRequest": ("upscale", ["a", "b"]),
}
"""Request -> the command that makes it, and the least that has to be said."""

PRINTING = {"as_json"}
"""Options that say how a command prints, which no request knows."""


def request_of(name: str) -> Any:
    return getattr(import_module(PLACES[name]), name)


def command_of(name: str) -> click.Command:
    module = import_module(f"rtsr_cli.commands.{MINIMAL[name][0].replace('-', '_')}")
    command: click.Command = module.command
    return command


def test_every_request_of_the_api_is_made_by_a_command() -> None:
    assert {name for name in PLACES if name.endswith("Request")} == set(MINIMAL)


@pytest.mark.parametrize("name", MINIMAL)
def test_options_and_fields_have_the_same_names(name: str) -> None:
    options = {p.name for p in command_of(name).params if p.expose_value} - PRINTING
    assert options == {field.name for field in fields(request_of(name))}


@pytest.mark.parametrize("name", MINIMAL)
def test_what_is_not_said_is_the_default_of_the_request(name: str) -> None:
    command, request = command_of(name), request_of(name)
    with command.make_context(command.name, list(MINIMAL[name][1])) as ctx:
        made = opt.request_from(request, ctx.params)
    required = {f.name: getattr(made, f.name) for f in fields(request) if f.default is MISSING}
    said = {"out_folder": Path("run")} if name == "TrainRequest" else {}
    assert made == request(**required, **said)
    for field in fields(request):
        if field.name not in required and field.name not in said:
            assert type(getattr(made, field.name)) is type(field.default), field.name


@pytest.mark.parametrize("name", MINIMAL)
def test_options_that_a_request_has_a_value_for_show_it(name: str) -> None:
    command, request = command_of(name), request_of(name)
    defaults = {f.name: f.default for f in fields(request)}
    with command.make_context(command.name, list(MINIMAL[name][1])) as ctx:
        for param in command.params:
            default = defaults.get(param.name or "", MISSING)
            if default is MISSING or default is None or param.multiple:
                continue
            assert param.type_cast_value(ctx, param.get_default(ctx)) == default, param.name


@pytest.mark.parametrize("name", MINIMAL)
def test_a_request_module_imports_neither_torch_nor_what_reads_frames(name: str) -> None:
    heavy = "{'torch', 'numpy', 'OpenEXR', 'OpenImageIO', 'pydantic', 'click'}"
    code = f"import sys, {PLACES[name]}; sys.exit(', '.join({heavy} & set(sys.modules)) or 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_words_are_the_members_and_paths_that_they_name(tmp_path: Path) -> None:
    request = UpscaleRequest(
        in_folder=str(tmp_path),  # type: ignore[arg-type]
        out_folder=tmp_path,
        simulate_lr=2,
        jitter="halton",  # type: ignore[arg-type]
        on_missing="skip",  # type: ignore[arg-type]
    )
    assert request.in_folder == tmp_path
    assert request.jitter is JitterMode.HALTON
    assert request.on_missing is MissingPolicy.SKIP


def test_a_word_that_is_no_member_is_refused_with_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match=r"jitter is 'haltn', did you mean 'halton'\?"):
        UpscaleRequest(
            in_folder=tmp_path,
            out_folder=tmp_path,
            simulate_lr=2,
            jitter="haltn",  # type: ignore[arg-type]
        )


@pytest.mark.parametrize("values", [{"jobs": 0}, {"shard": (3, 2)}, {"scale": 99}])
def test_numbers_beyond_their_range_are_refused(tmp_path: Path, values: dict[str, Any]) -> None:
    with pytest.raises(RequestError, match=next(iter(values))):
        UpscaleRequest(in_folder=tmp_path, out_folder=tmp_path, **values)


def test_frame_numbers_may_be_any_collection(tmp_path: Path) -> None:
    for numbers in ([1, 2], (1, 2), range(1, 3)):
        request = UpscaleRequest(in_folder=tmp_path, out_folder=tmp_path, frames=numbers)  # type: ignore[arg-type]
        assert request.frames == frozenset({1, 2})
