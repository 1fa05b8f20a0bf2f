from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from rtsr_cli.core.captures.reader import FrameReader
from rtsr_cli.core.choices import MissingPolicy, NonfinitePolicy
from rtsr_cli.core.errors import FrameFolderError, OutputError
from rtsr_cli.core.files.exr import read_channels, write_exr
from rtsr_cli.core.frames.buffers import Buffer
from rtsr_cli.core.frames.selection import Selection, Shard
from rtsr_cli.core.imaging.resampling import upsample_nearest
from rtsr_cli.core.pairs.real_pairs import open_real_pairs
from rtsr_cli.core.pairs.sources import PairSource
from rtsr_cli.core.run.events import Status
from rtsr_cli.core.run.frame_pairs import PairJob, PairReading
from rtsr_cli.core.run.outputs import PREVIEW_SUFFIX
from rtsr_cli.core.run.plan import FrameOutputs, plan_shot
from rtsr_cli.core.run.prediction import NetworkRun
from rtsr_cli.core.run.shot_runs import run_shot
from rtsr_cli.core.run.system_inputs import (
    check_system,
    measure_history_reach,
    resolve_system_inputs,
)
from rtsr_cli.core.system import FrameWindow, Prediction, State, System, build_baseline
from rtsr_cli.core.upscale.reconstruction import Reconstruction


@dataclass(frozen=True, kw_only=True)
class DummyConfig:
    """Nothing to set."""


def average_so_far(network: object, window: FrameWindow, state: State) -> Prediction:
    """Half of this frame and half of the state: depends on every frame since the reset."""
    color = window.current.gbuffer[Buffer.COLOR]
    mixed = color if state is None else (color + state) / 2
    return Prediction(image=upsample_nearest(mixed, window.scale), state=mixed)


def mean_of_window(network: object, window: FrameWindow, state: State) -> Prediction:
    mean = torch.stack([frame.gbuffer[Buffer.COLOR] for frame in window.lr]).mean(0)
    return Prediction(image=upsample_nearest(mean, window.scale))


RECURRENT = System(
    name="recurrent",
    summary="running average",
    citation="-",
    lr_inputs=(Buffer.COLOR,),
    recurrent=True,
    preroll_frames=2,
    config=DummyConfig,
    build=build_baseline,
    predict=average_so_far,
)
WINDOWED = replace(
    RECURRENT, name="windowed", recurrent=False, history_frames=2, predict=mean_of_window
)
EVERYTHING = Selection()

ALONE = replace(WINDOWED, name="alone", history_frames=0)

Plan = Callable[..., PairJob]


@pytest.fixture
def source(
    tmp_path: Path, write_frames: Callable[..., Path], open_folder: Callable[..., FrameReader]
) -> Callable[..., PairSource]:
    """Radiance of the given frames, to be doubled in size."""

    def make(numbers: tuple[int, ...] = (1, 2, 3, 4, 5, 6), **options: Any) -> PairSource:
        write_frames(tmp_path / "in", numbers, size=(4, 6), only=("R", "G", "B"))
        return open_real_pairs(open_folder(tmp_path / "in", **options), None, 2)

    return make


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    """Plan a shot into `out`."""

    def make(
        source: PairSource,
        system: System = ALONE,
        *,
        out: str = "out",
        config: object = None,
        selection: Selection = EVERYTHING,
        overwrite: bool = False,
        previews: bool = False,
    ) -> PairJob:
        inputs = resolve_system_inputs(system, NonfinitePolicy.ERROR)
        check_system(system, source, inputs)
        reading = PairReading(source=source, inputs=inputs)
        planned = plan_shot(
            reading.of_shot("."),
            FrameOutputs(
                folder=tmp_path / out,
                command="upscale",
                pictures=(PREVIEW_SUFFIX,) if previews else (),
            ),
            settings=config,
            selection=selection,
            overwrite=overwrite,
            history=measure_history_reach(system),
        )
        run = NetworkRun(system=system, network=system.build(DummyConfig(), source.scale))
        work = Reconstruction(run, source, previews=previews, debug=False)
        return PairJob(planned, reading, work, history_frames=system.history_frames)

    return make


def run(job: PairJob) -> dict[int, Status]:
    return {event.number: event.status for event in run_shot(job, 2)}


def contents(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in sorted(folder.glob("*.exr"))}


def test_the_first_run_has_every_frame_to_do(source: Callable[..., PairSource], plan: Plan) -> None:
    planned = plan(source())
    assert planned.plan.selected == planned.plan.order == (1, 2, 3, 4, 5, 6)
    assert planned.plan.pending == {1, 2, 3, 4, 5, 6}


def test_planning_writes_nothing(
    source: Callable[..., PairSource], plan: Plan, tmp_path: Path
) -> None:
    plan(source())
    assert not (tmp_path / "out").exists()


def test_a_second_run_has_nothing_to_do(source: Callable[..., PairSource], plan: Plan) -> None:
    assert set(run(plan(source())).values()) == {Status.WRITTEN}
    again = plan(source())
    assert again.plan.pending == frozenset()
    assert again.plan.order == ()
    assert set(run(again).values()) == {Status.KEPT}


@pytest.mark.parametrize("system", [ALONE, WINDOWED, RECURRENT], ids=lambda s: s.name)
def test_run_again_only_what_is_missing_is_written_and_its_bytes_are_the_same(
    source: Callable[..., PairSource], plan: Plan, tmp_path: Path, system: System
) -> None:
    run(plan(source(), system))
    before = contents(tmp_path / "out")
    for name in ("frame.0002.exr", "frame.0005.exr"):
        (tmp_path / "out" / name).unlink()
    again = plan(source(), system)
    assert again.plan.pending == {2, 5}
    statuses = run(again)
    assert {n for n, status in statuses.items() if status is Status.WRITTEN} == {2, 5}
    assert contents(tmp_path / "out") == before


def test_missing_outputs_pull_in_the_history_they_need_and_no_more(
    source: Callable[..., PairSource], plan: Plan, tmp_path: Path
) -> None:
    for system, order in ((ALONE, (5,)), (WINDOWED, (3, 4, 5)), (RECURRENT, (1, 2, 3, 4, 5))):
        run(plan(source(), system, out=system.name))
        (tmp_path / system.name / "frame.0005.exr").unlink()
        assert plan(source(), system, out=system.name).plan.order == order


@pytest.mark.parametrize("system", [ALONE, WINDOWED, RECURRENT], ids=lambda s: s.name)
def test_a_changed_input_makes_the_outputs_that_depend_on_it_stale(
    source: Callable[..., PairSource],
    plan: Plan,
    tmp_path: Path,
    write_frames: Callable[..., Path],
    system: System,
) -> None:
    run(plan(source(), system))
    frames = source()

    def brighter(_: int, channels: dict[str, Any]) -> dict[str, Any]:
        return {name: plane + 1 for name, plane in channels.items()}

    write_frames(tmp_path / "in", [2], size=(4, 6), only=("R", "G", "B"), change=brighter)
    with pytest.raises(OutputError, match=r"frame\.0002\.exr.*--overwrite"):
        plan(frames, system)
    stale = plan(frames, system, overwrite=True).plan.pending
    depends = {"alone": {2}, "windowed": {2, 3, 4}, "recurrent": {2, 3, 4, 5, 6}}
    assert stale == depends[system.name]


def test_another_config_makes_every_output_stale(
    source: Callable[..., PairSource], plan: Plan
) -> None:
    run(plan(source(), config={"a": 1}))
    assert plan(source(), config={"a": 1}).plan.pending == frozenset()
    with pytest.raises(OutputError, match=r"and 5 more"):
        plan(source(), config={"a": 2})


def test_a_foreign_file_is_in_the_way_until_it_may_be_replaced(
    source: Callable[..., PairSource], plan: Plan, tmp_path: Path
) -> None:
    write_exr(tmp_path / "out" / "frame.0003.exr", {"R": np.zeros((8, 12), np.float16)})
    with pytest.raises(OutputError, match=r"frame\.0003\.exr: rtsr upscale did not write this"):
        plan(source())
    assert plan(source(), overwrite=True).plan.pending == {1, 2, 3, 4, 5, 6}


def test_a_lost_preview_is_written_again(
    source: Callable[..., PairSource], plan: Plan, tmp_path: Path
) -> None:
    run(plan(source(), previews=True))
    (tmp_path / "out" / "frame.0004.png").unlink()
    assert plan(source(), previews=True).plan.pending == {4}
    assert plan(source()).plan.pending == frozenset()


def test_a_damaged_output_counts_as_foreign(
    source: Callable[..., PairSource], plan: Plan, tmp_path: Path
) -> None:
    run(plan(source()))
    (tmp_path / "out" / "frame.0001.exr").write_bytes(b"half")
    with pytest.raises(OutputError, match=r"frame\.0001\.exr"):
        plan(source())


def test_outputs_never_replace_their_own_inputs(
    source: Callable[..., PairSource], plan: Plan
) -> None:
    with pytest.raises(OutputError, match="would replace its own input"):
        plan(source(), out="in", overwrite=True)


def test_selected_frames_alone_are_written_and_history_reads_the_others(
    source: Callable[..., PairSource], plan: Plan
) -> None:
    planned = plan(source(), WINDOWED, selection=Selection(frames=frozenset({4, 99})))
    assert planned.plan.selected == (4,)
    assert planned.plan.order == (2, 3, 4)
    assert planned.plan.stamps.starts == {4: 2}


def test_a_selected_frame_equals_the_one_of_the_whole_run(
    source: Callable[..., PairSource], plan: Plan, tmp_path: Path
) -> None:
    run(plan(source(), RECURRENT, out="whole"))
    chosen = Selection(frames=frozenset({4}))
    run(plan(source(), RECURRENT, out="part", selection=chosen))
    name = "frame.0004.exr"
    assert contents(tmp_path / "part") == {name: contents(tmp_path / "whole")[name]}


def test_history_starts_again_at_a_cut_and_after_a_gap(
    source: Callable[..., PairSource], plan: Plan
) -> None:
    frames = source((1, 2, 3, 4, 6, 7), on_missing=MissingPolicy.SKIP, capture={"camera_cuts": [3]})
    assert plan(frames, RECURRENT).plan.stamps.starts == {1: 1, 2: 1, 3: 3, 4: 3, 6: 6, 7: 6}
    assert plan(frames, WINDOWED).plan.stamps.starts == {1: 1, 2: 1, 3: 3, 4: 3, 6: 6, 7: 6}


def test_what_is_computed_after_a_cut_knows_nothing_of_what_was_before(
    source: Callable[..., PairSource], plan: Plan, tmp_path: Path, analytic_channels: Any
) -> None:
    run(plan(source(capture={"camera_cuts": [4]}), RECURRENT))
    found = read_channels(tmp_path / "out" / "frame.0004.exr", ["R"])["R"]
    assert (found[::2, ::2] == analytic_channels(4, (4, 6))["R"]).all()


@settings(max_examples=60, deadline=None)
@given(numbers=st.lists(st.integers(-5, 50), unique=True, max_size=30), count=st.integers(1, 9))
def test_shards_are_disjoint_complete_and_nearly_equal(numbers: list[int], count: int) -> None:
    numbers.sort()
    parts = [Shard(index=i, count=count).part(numbers) for i in range(1, count + 1)]
    assert [n for part in parts for n in part] == numbers
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


def test_shards_split_what_is_selected(source: Callable[..., PairSource], plan: Plan) -> None:
    chosen = frozenset({2, 3, 5, 6})
    parts = [
        plan(source(), selection=Selection(frames=chosen, shard=Shard(index=i, count=2)))
        for i in (1, 2)
    ]
    assert [part.plan.selected for part in parts] == [(2, 3), (5, 6)]


def test_a_shard_of_a_recurrent_system_prerolls_and_goes_no_further_back(
    source: Callable[..., PairSource], plan: Plan
) -> None:
    frames = source(tuple(range(1, 11)))
    planned = plan(frames, RECURRENT, selection=Selection(shard=Shard(index=2, count=2)))
    assert planned.plan.selected == (6, 7, 8, 9, 10)
    assert planned.plan.order == (4, 5, 6, 7, 8, 9, 10)
    assert set(planned.plan.stamps.starts.values()) == {4}


def test_a_preroll_ends_at_a_cut(source: Callable[..., PairSource], plan: Plan) -> None:
    frames = source(tuple(range(1, 11)), capture={"camera_cuts": [5, 8]})
    planned = plan(frames, RECURRENT, selection=Selection(shard=Shard(index=2, count=2)))
    assert planned.plan.order == (5, 6, 7, 8, 9, 10)
    assert planned.plan.stamps.starts == {6: 5, 7: 5, 8: 8, 9: 8, 10: 8}


def test_the_first_shard_equals_the_whole_run_and_the_second_comes_near(
    source: Callable[..., PairSource], plan: Plan, tmp_path: Path
) -> None:
    run(plan(source(), RECURRENT, out="whole"))
    for index in (1, 2):
        part = Selection(shard=Shard(index=index, count=2))
        run(plan(source(), RECURRENT, out=f"part{index}", selection=part))
    assert sorted([*contents(tmp_path / "part1"), *contents(tmp_path / "part2")]) == sorted(
        contents(tmp_path / "whole")
    )

    def red(folder: str, number: int) -> Any:
        path = tmp_path / folder / f"frame.{number:04d}.exr"
        return read_channels(path, ["R"])["R"].astype(float)

    assert (red("part1", 3) == red("whole", 3)).all()
    deviations = [abs(red("part2", n) - red("whole", n)).max() for n in (4, 5, 6)]
    assert all(later < earlier for earlier, later in pairwise(deviations))


def test_the_stamp_of_a_shard_that_starts_elsewhere_is_another(
    source: Callable[..., PairSource], plan: Plan
) -> None:
    part = Selection(shard=Shard(index=2, count=2))
    run(plan(source(), RECURRENT, selection=part))
    with pytest.raises(OutputError, match=r"frame\.0004\.exr and 2 more"):
        plan(source(), RECURRENT)


def test_a_system_that_lacks_its_inputs_is_refused_with_what_is_missing(
    source: Callable[..., PairSource], plan: Plan, tmp_path: Path
) -> None:
    demanding = replace(ALONE, lr_inputs=(Buffer.COLOR, Buffer.MOTION), hr_inputs=(Buffer.NORMAL,))
    with pytest.raises(FrameFolderError) as caught:
        plan(source(), demanding)
    message = str(caught.value)
    assert message.startswith(str(tmp_path / "in"))
    assert "'alone' cannot run, missing: lr motion, hr frames" in message
    assert "has: color" in message


def test_a_system_made_for_other_scales_is_refused_with_them(
    source: Callable[..., PairSource], plan: Plan
) -> None:
    with pytest.raises(FrameFolderError, match="made for 4x, 8x, not 2x"):
        plan(source(), replace(ALONE, scales=(4, 8)))


def test_one_bad_frame_fails_alone_and_history_restarts_after_it(
    source: Callable[..., PairSource],
    plan: Plan,
    tmp_path: Path,
    write_frames: Callable[..., Path],
    analytic_channels: Any,
) -> None:
    frames = source()

    def broken(_: int, channels: dict[str, Any]) -> dict[str, Any]:
        channels["R"][1, 1] = float("nan")
        return channels

    write_frames(tmp_path / "in", [3], size=(4, 6), only=("R", "G", "B"), change=broken)
    statuses = run(plan(frames, RECURRENT))
    assert statuses.pop(3) is Status.FAILED
    assert set(statuses.values()) == {Status.WRITTEN}
    found = read_channels(tmp_path / "out" / "frame.0004.exr", ["R"])["R"]
    assert (found[::2, ::2] == analytic_channels(4, (4, 6))["R"]).all()
