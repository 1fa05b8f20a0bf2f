"""The motion-convention finder on a texture whose movement is known exactly."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.jitter_finder import JitterVerdict, find_jitter
from rtsr_cli.core.captures.measuring.motion_finder import find_centre, find_motion
from rtsr_cli.core.captures.measuring.motion_finding import MotionFinding
from rtsr_cli.core.captures.measuring.motion_trials import MotionEvidence, normalise_picture
from rtsr_cli.core.frames.motion import Axes, MotionConvention, MotionDirection, MotionUnit, YAxis

SIZE = (96, 128)
PLACES = {0: (0.0, 0.0), 1: (3.4, -1.7), 2: (5.1, 1.2), 3: (10.3, 0.9)}
"""Where the texture lies in each frame: uneven steps, so that past and future differ."""

P, C = MotionDirection.PREVIOUS_MINUS_CURRENT, MotionDirection.CURRENT_MINUS_PREVIOUS
N = MotionDirection.NEXT_MINUS_CURRENT


def texture(x: Tensor, y: Tensor) -> Tensor:
    """Three channels of waves of many directions, none repeating within the frame."""
    waves = torch.Generator().manual_seed(3)
    total = []
    for _ in range(3):
        value = torch.zeros_like(x)
        for _ in range(6):
            angle, length, phase = torch.rand(3, generator=waves).tolist()
            direction = 2 * math.pi * angle
            k = 2 * math.pi / (5.0 + 25.0 * length)
            along = x * math.cos(direction) + y * math.sin(direction)
            value = value + torch.sin(k * along + 6.28 * phase)
        total.append(value)
    return torch.stack(total)[None]


def frame(place: tuple[float, float], jitter: tuple[float, float] = (0.0, 0.0)) -> Tensor:
    y, x = torch.meshgrid(
        torch.arange(SIZE[0]) + jitter[1], torch.arange(SIZE[1]) + jitter[0], indexing="ij"
    )
    return texture(x - place[0], y - place[1])


def field(vector: tuple[float, float]) -> Tensor:
    return torch.tensor(vector).view(1, 2, 1, 1).expand(1, 2, *SIZE).clone()


def to_previous(number: int) -> tuple[float, float]:
    if number == 0:
        return 1.0, 1.0
    now, then = PLACES[number], PLACES[number - 1]
    return then[0] - now[0], then[1] - now[1]


def stored_as(motion_px: Tensor, convention: MotionConvention) -> Tensor:
    """Invert `MotionConvention.pixels`."""
    x, y = convention.factors(SIZE)
    stored = motion_px / torch.tensor([x, y]).view(1, 2, 1, 1)
    stored = stored if convention.axes is Axes.XY else stored.flip(1)
    return stored + convention.zero


def found(convention: MotionConvention, **changes: Tensor) -> MotionFinding:
    frames = {}
    for number, place in PLACES.items():
        vector = to_previous(number)
        if convention.direction.to_next:
            there = PLACES.get(number + 1, (place[0] + 1.0, place[1]))
            vector = (there[0] - place[0], there[1] - place[1])
        if convention.file_offset == 1:
            vector = to_previous(number - 1) if number else (2.0, 1.0)
        frames[number] = MotionEvidence(
            features=normalise_picture(frame(place)),
            nearest=None,
            stored=changes.get(f"stored{number}", stored_as(field(vector), convention)),
        )
    return find_motion(frames, screen=SIZE)


@pytest.mark.parametrize(
    "convention",
    [
        MotionConvention(),
        MotionConvention(direction=C),
        MotionConvention(direction=C, y_axis=YAxis.UP),
        MotionConvention(y_axis=YAxis.UP),
        MotionConvention(axes=Axes.YX),
        MotionConvention(unit=MotionUnit.UV),
        MotionConvention(unit=MotionUnit.UV, direction=C, y_axis=YAxis.UP),
        MotionConvention(unit=MotionUnit.NDC),
        MotionConvention(unit=MotionUnit.NDC, y_axis=YAxis.UP),
        MotionConvention(scale=4.0),
        MotionConvention(scale=0.25),
        MotionConvention(unit=MotionUnit.UV, zero=0.5),
        MotionConvention(unit=MotionUnit.UV, scale=2.0, zero=0.5),
        MotionConvention(direction=N),
        MotionConvention(direction=MotionDirection.CURRENT_MINUS_NEXT, unit=MotionUnit.UV),
        MotionConvention(file_offset=1),
    ],
    ids=str,
)
def test_the_convention_that_the_files_have_wins_alone(convention: MotionConvention) -> None:
    finding = found(convention)
    assert finding.best is not None
    assert finding.best.convention == convention
    if not convention.direction.to_next:
        assert finding.ties == (finding.best,)
    assert finding.best.error < 0.25 * finding.unmoved_error


def test_in_a_uniform_field_vectors_to_the_next_frame_tie_with_those_of_the_next_file() -> None:
    finding = found(MotionConvention(direction=N))
    assert {c.convention for c in finding.ties} == {
        MotionConvention(direction=N),
        MotionConvention(direction=C, file_offset=-1),
    }


def test_horizontal_motion_leaves_the_sign_of_y_tied() -> None:
    level = {
        n: MotionEvidence(
            features=normalise_picture(frame((3.0 * n + n * n, 0.0))),
            nearest=None,
            stored=field((-3.0 - (2 * n - 1), 0.0)),
        )
        for n in range(4)
    }
    finding = find_motion(level, screen=SIZE)
    tied = {c.convention for c in finding.ties}
    assert {MotionConvention(), MotionConvention(y_axis=YAxis.UP)} <= tied


def test_vectors_that_are_all_zero_give_no_candidate() -> None:
    still = {
        n: MotionEvidence(
            features=normalise_picture(frame((0.0, 0.0))), nearest=None, stored=field((0.0, 0.0))
        )
        for n in range(3)
    }
    finding = find_motion(still, screen=SIZE)
    assert finding.best is None
    assert finding.moving == 0.0


def test_vectors_that_have_nothing_to_do_with_the_pictures_are_not_explained() -> None:
    noise = torch.Generator().manual_seed(1)
    changes = {f"stored{n}": 20 * torch.randn(1, 2, *SIZE, generator=noise) for n in PLACES}
    finding = found(MotionConvention(), **changes)
    assert finding.candidates
    assert finding.best is None


def test_a_convention_that_is_included_is_judged_whatever_the_screening_says() -> None:
    wrong = MotionConvention(direction=C, unit=MotionUnit.UV, jittered=True)
    frames = {
        n: MotionEvidence(
            features=normalise_picture(frame(p)), nearest=None, stored=field(to_previous(n))
        )
        for n, p in PLACES.items()
    }
    finding = find_motion(frames, screen=SIZE, include=(wrong,))
    judged = finding.of(wrong)
    assert judged is not None
    assert judged.margin > 0.5


def test_jitter_that_the_vectors_contain_is_found_as_an_offset() -> None:
    jitter = {0: (0.0, 0.0), 1: (0.3, -0.2), 2: (-0.4, 0.1), 3: (0.1, 0.4)}
    frames = {}
    for n, place in PLACES.items():
        vector = to_previous(n)
        before = jitter[max(n - 1, 0)]
        contained = (vector[0] - before[0] + jitter[n][0], vector[1] - before[1] + jitter[n][1])
        frames[n] = MotionEvidence(
            features=normalise_picture(frame(place)), nearest=None, stored=field(contained)
        )
    finding = find_motion(frames, screen=SIZE)
    assert finding.best is not None
    assert finding.best.convention == MotionConvention()
    for triple, offset in zip(finding.triples, finding.best.offsets_px, strict=True):
        before = jitter[triple - 1]
        expected = (before[0] - jitter[triple][0], before[1] - jitter[triple][1])
        assert offset == pytest.approx(expected, abs=0.05)


def test_declared_jitter_of_the_pictures_is_accounted_for() -> None:
    jitter = {0: (0.0, 0.0), 1: (0.3, -0.2), 2: (-0.4, 0.1), 3: (0.1, 0.4)}

    def search(sign: float) -> MotionFinding:
        return find_motion(
            {
                n: MotionEvidence(
                    features=normalise_picture(frame(place, jitter[n])),
                    nearest=None,
                    stored=field(to_previous(n)),
                    jitter_px=(sign * jitter[n][0], sign * jitter[n][1]),
                )
                for n, place in PLACES.items()
            },
            screen=SIZE,
        )

    right, wrong = search(1.0), search(-1.0)
    between = [
        (jitter[t][0] - jitter[t - 1][0], jitter[t][1] - jitter[t - 1][1]) for t in right.triples
    ]
    assert right.best is not None
    assert wrong.best is not None
    consistent = find_jitter(right.best.offsets_px, between)
    assert consistent.verdict is JitterVerdict.CONSISTENT
    negated = [(-x, -y) for x, y in between]
    assert find_jitter(wrong.best.offsets_px, negated).verdict is JitterVerdict.WRONG_SIGN


@pytest.mark.parametrize(
    ("slope", "verdict"),
    [
        (0.02, JitterVerdict.CONSISTENT),
        (-0.95, JitterVerdict.IN_VECTORS),
        (1.1, JitterVerdict.IN_VECTORS_INVERTED),
        (-2.0, JitterVerdict.WRONG_SIGN),
        (0.5, JitterVerdict.UNKNOWN),
    ],
)
def test_offsets_are_judged_by_their_share_of_the_declared_jitter(
    slope: float, verdict: JitterVerdict
) -> None:
    between = [(0.4, -0.3), (-0.5, 0.2)]
    offsets = [(slope * x, slope * y) for x, y in between]
    assert find_jitter(offsets, between).verdict is verdict


def test_offsets_without_declared_jitter_are_named() -> None:
    none = [(0.0, 0.0)] * 2
    assert find_jitter([(0.4, 0.0), (-0.3, 0.1)], none).verdict is JitterVerdict.UNDECLARED
    assert find_jitter([(0.3, 0.3), (0.3, 0.3)], none).verdict is JitterVerdict.CONSTANT_OFFSET
    assert find_jitter([(0.05, 0.0), (0.0, 0.1)], none).verdict is JitterVerdict.CONSISTENT


def test_a_centre_of_one_half_is_seen_and_small_vectors_are_not_taken_for_it() -> None:
    vectors = torch.linspace(-0.2, 0.3, 100).view(1, 2, 5, 10)
    assert find_centre(0.5 + vectors) == 0.5
    assert find_centre(vectors) == 0.0
    assert find_centre(vectors.abs() * 0.1) == 0.0


def test_jitter_is_no_part_of_the_hypothesis() -> None:
    finding = found(MotionConvention())
    assert finding.of(replace(MotionConvention(), jittered=True)) == finding.best


def test_alike_vectors_of_neighbouring_files_are_no_tie_and_the_frames_own_win() -> None:
    steady = {
        n: MotionEvidence(
            features=normalise_picture(frame((3.0 * n, 2.0 * n))),
            nearest=None,
            stored=field((-3.0, -2.0)),
        )
        for n in range(4)
    }
    finding = find_motion(steady, screen=SIZE)
    assert finding.best is not None
    assert finding.best.convention.file_offset == 0
    tied = {c.convention for c in finding.ties}
    assert MotionConvention() in tied
    assert MotionConvention(file_offset=1) not in tied
    assert MotionConvention(file_offset=-1) not in tied
