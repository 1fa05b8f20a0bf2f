"""Calls of the library: events and no prints, errors and no exits."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from dataclasses import is_dataclass
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

from rtsr_cli import api
from rtsr_cli.api import (
    EvaluateRequest,
    InspectRequest,
    MetricName,
    MissingPolicy,
    PrecomputeLutRequest,
    RtsrError,
    TrainRequest,
    describe_systems,
    evaluate,
    inspect,
    precompute_lut,
    train,
)
from rtsr_cli.core.errors import RequestError

FEW_STEPS = (
    "training.steps=1",
    "training.batch=1",
    "training.crop=12",
    "training.validation_frames=1",
    "training.precision=fp32",
)


def typed_places() -> dict[str, str]:
    """Name -> module of the imports that type checkers see."""
    tree = ast.parse(Path(api.__file__).read_text(encoding="utf-8"))
    (guarded,) = (node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in guarded.body if isinstance(node, ast.ImportFrom)]
    return {alias.asname or alias.name: str(n.module) for n in imports for alias in n.names}


def test_type_checkers_see_the_same_names_in_the_same_places() -> None:
    assert typed_places() == api.PLACES


@pytest.mark.parametrize("name", api.PLACES)
def test_every_name_is_defined_where_it_is_said_to_be(name: str) -> None:
    assert getattr(api, name).__module__ == api.PLACES[name]
    assert hasattr(import_module(api.PLACES[name]), name)


@pytest.mark.parametrize("request_name", [name for name in api.PLACES if name.endswith("Request")])
def test_what_a_request_chooses_by_name_is_there_beside_it(request_name: str) -> None:
    pending = list(get_type_hints(getattr(api, request_name)).values())
    enums = set()
    while pending:
        hint = pending.pop()
        pending += get_args(hint)
        enums |= {hint} if isinstance(hint, type) and issubclass(hint, Enum) else set()
    assert {enum.__name__ for enum in enums} <= set(api.PLACES)


def test_a_name_that_is_not_there_is_no_attribute() -> None:
    with pytest.raises(AttributeError, match="has no 'upscal'"):
        _ = api.upscal


def events_of(call: Iterable[Any], capfd: pytest.CaptureFixture[str], last: str) -> list[Any]:
    """Go through a call, and hold it to be silent and to end with its summary."""
    events = list(call)
    said = capfd.readouterr()
    assert (said.out, said.err) == ("", "")
    assert all(is_dataclass(event) for event in events)
    assert type(events[-1]).__name__ == last
    return events


def test_evaluate_yields_plans_frames_and_figures(
    sample_root: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = sample_root / "reference"
    request = EvaluateRequest(
        tests=(folder,),
        reference=folder,
        metrics=(MetricName.PSNR,),
        frames=frozenset({1, 2}),
        outputs=(tmp_path / "r.json",),
        fail_under="psnr<1",
    )
    events = events_of(evaluate(request), capfd, "EvaluationDone")
    names = [type(event).__name__ for event in events]
    assert names == [
        "ComparisonPlanned", "JudgingStarted", "FrameJudged", "FrameJudged", "ResultReady",
        "ResultWritten", "EvaluationDone",
    ]  # fmt: skip
    assert events[-1].missed == ("reference: psnr is inf, demanded psnr<1",)
    assert not events[-1].passed
    assert (tmp_path / "r.json").is_file()


def test_inspect_yields_every_shot(sample_root: Path, capfd: pytest.CaptureFixture[str]) -> None:
    request = InspectRequest(in_folder=sample_root)
    events = events_of(inspect(request), capfd, "InspectionDone")
    assert [type(event).__name__ for event in events[:2]] == ["ShotsListed", "ShotInspected"]
    assert events[1].inspection.main.reader.layout.name == "rtsr"


def test_train_yields_steps(
    sample_root: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    request = TrainRequest(
        system="fusesr-fast",
        data=(sample_root,),
        out_folder=tmp_path / "run",
        assignments=FEW_STEPS,
    )
    events = events_of(train(request), capfd, "TrainingDone")
    names = [type(event).__name__ for event in events]
    assert names[0] == "TrainingPlanned"
    assert names[-4:] == ["BaselineJudged", "TrainingStarted", "TrainingStep", "TrainingDone"]
    assert (tmp_path / "run" / "best.safetensors").is_file()


def test_precompute_lut_yields_what_it_wrote(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    request = PrecomputeLutRequest(out=tmp_path / "lut.exr", size=8, preview=True)
    (written,) = events_of(precompute_lut(request), capfd, "LutWritten")
    assert written.paths == (tmp_path / "lut.exr", tmp_path / "lut.png")


def test_systems_are_described(capfd: pytest.CaptureFixture[str]) -> None:
    facts = events_of(describe_systems(), capfd, "SystemFacts")
    assert "fusesr-fast" in [system.name for system in facts]


def test_what_is_wrong_with_an_input_is_raised(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    gone = tmp_path / "gone"
    calls: list[Iterable[Any]] = [
        evaluate(EvaluateRequest(tests=(gone, tmp_path))),
        inspect(InspectRequest(in_folder=gone)),
        train(TrainRequest(system="fusesr", data=(gone,), out_folder=tmp_path / "run")),
        train(TrainRequest(system="bicubic", data=(gone,), out_folder=tmp_path / "run")),
        train(TrainRequest(system="nosuch", data=(gone,), out_folder=tmp_path / "run")),
        precompute_lut(PrecomputeLutRequest(out=gone / "lut.exr", size=8)),
    ]
    for call in calls:
        with pytest.raises(RtsrError):
            list(call)
    said = capfd.readouterr()
    assert (said.out, said.err) == ("", "")


FOLDER = Path("a")


@pytest.mark.parametrize(
    ("request_type", "values", "message"),
    [
        (EvaluateRequest, {"tests": (FOLDER,)}, "exactly two folders"),
        (EvaluateRequest, {"tests": (), "reference": FOLDER}, "at least one TEST"),
        (EvaluateRequest, {"tests": (FOLDER,), "reference": FOLDER, "merge": True}, "no --ref"),
        (EvaluateRequest, {"tests": (FOLDER, FOLDER), "metrics": ()}, "at least one metric"),
        (EvaluateRequest, {"tests": (FOLDER, FOLDER), "border": -1}, "border is -1"),
        (EvaluateRequest, {"tests": (FOLDER, FOLDER), "jobs": 0}, "a number from 1 to 64"),
        (EvaluateRequest, {"tests": (FOLDER, FOLDER), "ppd": float("nan")}, "ppd is nan"),
        (EvaluateRequest, {"tests": (FOLDER, FOLDER), "shard": (3, 2)}, "shard is 3/2"),
        (EvaluateRequest, {"tests": (FOLDER, FOLDER), "outputs": (FOLDER,)}, "ends in none of"),
        (EvaluateRequest, {"tests": (FOLDER, FOLDER), "fail_under": "x"}, "is no condition"),
        (EvaluateRequest, {"tests": (FOLDER, FOLDER), "fail_under": "vmaf>1"}, "not computed"),
        (
            EvaluateRequest,
            {"tests": (FOLDER, FOLDER), "on_missing": MissingPolicy.HOLD},
            "stands in is not judged",
        ),
        (TrainRequest, {"system": "nsrd", "data": (FOLDER,)}, "either --out RUN or --pack FILE"),
        (TrainRequest, {"system": "nsrd", "data": (), "out_folder": FOLDER}, "at least one folder"),
        (
            TrainRequest,
            {"system": "nsrd", "data": (FOLDER,), "out_folder": FOLDER, "scale": 17},
            "scale is 17",
        ),
        (PrecomputeLutRequest, {"out": FOLDER}, "must end in .exr"),
        (PrecomputeLutRequest, {"out": Path("a.exr"), "size": 1}, "size is 1"),
    ],
)
def test_choices_that_do_not_go_together_are_refused(
    request_type: Any, values: dict[str, Any], message: str
) -> None:
    with pytest.raises(RequestError, match=message):
        request_type(**values)
