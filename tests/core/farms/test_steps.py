"""Steps of a job: what is pinned first, divided, and put together; and an engine's words for it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rtsr_cli.core.errors import RequestError
from rtsr_cli.core.farms.commands import Argument, FarmCommand, FarmJob, PathPart, TaskPart
from rtsr_cli.core.farms.openjd import write_openjd
from rtsr_cli.core.farms.slurm import write_slurm
from rtsr_cli.core.farms.steps import plan_job

IN = Argument(option=None, value="/in", field="in_folder", path="In", frames=True)
OUT = Argument(option=None, value="/out", field="out_folder", path="Out", written=True)
UPSCALE = FarmCommand(name="upscale", arguments=(IN, OUT))
EVALUATE = FarmCommand(
    name="evaluate",
    arguments=(
        Argument(option=None, value="/out", field="tests", path="Test"),
        Argument(option="--ref", value="/in", field="reference", path="Ref", frames=True),
        Argument(option="--output", value="/r.json", field="outputs", path="Output",
                 folder=False, written=True),
        Argument(option="--fail-under", value="psnr>3", field="fail_under"),
    ),
)  # fmt: skip
SYNTH = FarmCommand(name="synth", arguments=(OUT,), frames=(1, 2, 3, 4, 9))


def test_what_is_read_is_pinned_once_and_before_all_else() -> None:
    job = plan_job([UPSCALE, EVALUATE], 4)
    assert [s.name for s in job.steps] == ["pin", "upscale", "evaluate", "merge"]
    assert [s.divided for s in job.steps] == [False, True, True, False]
    assert job.steps[0].words == (("farm",), ("pin",), (PathPart("In"),))


def test_declarations_that_are_named_need_no_pin_and_ways_of_reading_are_kept() -> None:
    named = Argument(option="--capture", value="/c.toml", field="capture_file", path="Capture")
    job = plan_job([FarmCommand(name="upscale", arguments=(IN, OUT, named))], 4)
    assert [s.name for s in job.steps] == ["upscale"]
    layer = Argument(option="--layer", value="left", field="layer")
    job = plan_job([FarmCommand(name="upscale", arguments=(IN, OUT, layer))], 4)
    assert job.steps[0].words[-2:] == (("--layer",), ("left",))


def test_equal_paths_are_one_and_say_all_that_is_done_there() -> None:
    paths = plan_job([UPSCALE, EVALUATE], 4).paths
    assert list(paths) == ["In", "Out", "Output"]
    flow = {name: (path.read, path.written) for name, path in paths.items()}
    # capture.toml is written into what is read
    assert flow == {"In": (True, True), "Out": (True, True), "Output": (False, True)}
    assert not paths["Output"].folder


def test_parts_of_a_report_are_judged_without_demands_and_merged_with_them() -> None:
    _, _, evaluate, merge = plan_job([UPSCALE, EVALUATE], 4).steps
    part = (PathPart("Output"), ".parts/of-", TaskPart.COUNT, "/part-", TaskPart.NUMBER, ".json")
    assert evaluate.words[-4:] == (
        ("--shard",), (TaskPart.NUMBER, "/", TaskPart.COUNT), ("--output",), part,
    )  # fmt: skip
    assert not [word for word in evaluate.words if word == ("--fail-under",)]
    assert merge.words == (
        ("evaluate",), ("--merge",), part[:3], ("--output",), (PathPart("Output"),),
        ("--fail-under",), ("psnr>3",),
    )  # fmt: skip


def test_frames_are_divided_where_there_are_no_shards() -> None:
    (step,) = plan_job([SYNTH], 2).steps
    assert step.ranges == ("1-2", "3-4,9")
    assert step.words[-2:] == (("--frames",), (TaskPart.FRAMES,))
    with pytest.raises(RequestError, match="9 tasks for 5 frames of synth"):
        plan_job([SYNTH], 9)


def test_steps_of_one_name_are_numbered() -> None:
    other = Argument(option=None, value="/in2", field="in_folder", path="In", frames=True)
    second = FarmCommand(name="upscale", arguments=(other, OUT))
    names = [s.name for s in plan_job([UPSCALE, second, UPSCALE], 4).steps]
    assert names == ["pin", "upscale", "pin2", "upscale2", "upscale3"]


def test_a_template_is_an_index_range_however_many_tasks_there_are() -> None:
    template = json.loads(write_openjd(plan_job([UPSCALE], 5000), "x"))
    (space,) = template["steps"][1]["parameterSpace"]["taskParameterDefinitions"]
    assert space["range"] == "1-{{Param.Tasks}}"
    tasks = next(p for p in template["parameterDefinitions"] if p["name"] == "Tasks")
    assert tasks["default"] == 5000
    many = FarmCommand(name="synth", arguments=(OUT,), frames=tuple(range(2000)))
    with pytest.raises(RequestError, match="a template lists 1024 at most"):
        write_openjd(plan_job([many], 1025), "x")


@pytest.mark.parametrize("text", ["{{x}}", "a\nb"])
def test_words_that_a_template_would_take_for_its_own_are_refused(text: str) -> None:
    glob = Argument(option="--passthrough", value=text, field="passthrough")
    job = plan_job([FarmCommand(name="upscale", arguments=(IN, OUT, glob))], 2)
    with pytest.raises(RequestError, match="a template cannot hold"):
        write_openjd(job, "x")


def test_words_that_a_shell_would_take_for_its_own_are_quoted() -> None:
    paths = (Argument(option=None, value="/in; rm $x", field="in_folder", path="In"), OUT)
    job: FarmJob = plan_job([FarmCommand(name="upscale", arguments=paths)], 2)
    assert "path_in='/in; rm $x'\n" in write_slurm(job, "x")
    bad = Argument(option="--passthrough", value="a\nb", field="passthrough")
    with pytest.raises(RequestError, match="ends of lines"):
        write_slurm(plan_job([FarmCommand(name="upscale", arguments=(*paths, bad))], 2), "x")


def test_a_relative_path_is_that_of_where_the_job_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    here = Argument(option=None, value="shots", field="in_folder", path="In", frames=True)
    job = plan_job([FarmCommand(name="upscale", arguments=(here, OUT))], 2)
    assert job.paths["In"].path == tmp_path / "shots"
