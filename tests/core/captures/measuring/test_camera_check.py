"""Camera matrices of eight wrong kinds, in a room of which everything is known exactly."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from rtsr_cli.core.captures.measuring.camera_check import CameraFinding, check_cameras
from rtsr_cli.core.captures.measuring.camera_evidence import (
    CameraEvidence,
    list_likely_depths,
    list_units,
)
from rtsr_cli.core.captures.measuring.camera_hypotheses import Cameras
from rtsr_cli.core.captures.measuring.camera_measurement import are_of_camera
from rtsr_cli.core.captures.measuring.camera_structure import CameraMatrices
from rtsr_cli.core.captures.measuring.geometry_finder import StoredGeometry
from rtsr_cli.core.captures.measuring.normal_evidence import NormalEvidence
from rtsr_cli.core.captures.measuring.position_evidence import PositionEvidence
from rtsr_cli.core.captures.measuring.vector_evidence import VectorEvidence
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.camera_convention import (
    CameraConvention,
    CameraWord,
    StoredMatrices,
    matrices_to_memory,
)
from rtsr_cli.core.frames.conventions import DepthConvention, DepthKind
from rtsr_cli.core.frames.motion import MotionConvention
from rtsr_cli.core.frames.vector_length import normalize_vectors

Array = NDArray[np.float64]
SIZE = (40, 64)
VIEW = View(display=SIZE)
LOW, HIGH = np.array([-4.0, -3.0, 0.0]), np.array([4.0, 5.0, 3.0])
FRAMES = (1, 2, 3, 4)
SWAP = np.eye(4)[[1, 0, 2, 3]]


def make_camera(number: int, *, flat: bool = False, infinite: bool = False) -> CameraMatrices:
    """A camera on a bent path that speeds up, turning and tilting as it goes."""
    t = 0.05 * number + 0.02 * number * number
    yaw, pitch = 0.3 + 0.5 * t, -0.15 + 0.2 * t
    forward = np.array(
        [-math.sin(yaw) * math.cos(pitch), math.cos(yaw) * math.cos(pitch), math.sin(pitch)]
    )
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    view = np.eye(4)
    view[:3, :3] = np.stack([right, np.cross(right, forward), -forward], axis=1)
    view[3, :3] = -np.array([0.5 + t, -1.0 + 0.7 * t, 1.4 - 0.2 * t]) @ view[:3, :3]
    lens = np.zeros((4, 4))
    lens[0, 0], lens[1, 1] = (0.4, 0.64) if flat else (1.1, 1.76)
    lens[2, :3] = 0.1, -0.05, 0.0 if infinite else -1.0
    lens[3, 2] = 0.1 if infinite else -0.1
    lens[2, 3] = -1.0
    if flat:
        lens[2], lens[3] = (0.0, 0.0, -0.05, 0.0), (0.1, -0.05, 0.0, 1.0)
    return CameraMatrices(view, view @ lens)


def cast(camera: CameraMatrices) -> tuple[Array, Array]:
    """World positions and normals of the walls, (3, h, w), through the inverse of clip space."""
    height, width = SIZE
    y, x = np.mgrid[0:height, 0:width] + 0.5
    ndc = 2.0 * x / width - 1.0, 1.0 - 2.0 * y / height
    to_world = np.linalg.inv(camera.ndc)
    ends = []
    for z in (0.3, 0.6):
        clip = np.stack([*ndc, np.full(SIZE, z), np.ones(SIZE)], -1) @ to_world
        ends.append(clip[..., :3] / clip[..., 3:])
    forward = -camera.view[:3, 2]
    ray = ends[1] - ends[0]
    ray *= np.sign(ray @ forward)[..., None]
    start = ends[0]
    eye = np.linalg.inv(camera.view)[3, :3]
    # from the plane through the camera on, whatever the lens
    start = start - ray * (((start - eye) @ forward) / (ray @ forward))[..., None]
    walls = np.where(ray > 0, HIGH, LOW)
    times = (walls - start) / np.where(ray == 0, 1e-12, ray)
    axis = times.argmin(-1)
    position = start + ray * times.min(-1)[..., None]
    normal = np.eye(3)[axis] * -np.sign(np.take_along_axis(ray, axis[..., None], -1))
    return np.moveaxis(position, -1, 0), np.moveaxis(normal, -1, 0)


def project(position: Array, camera: CameraMatrices) -> Array:
    clip = np.einsum("ihw,ij->jhw", position, camera.ndc[:3]) + camera.ndc[3][:, None, None]
    x = (clip[0] / clip[3] * 0.5 + 0.5) * SIZE[1]
    y = (0.5 - 0.5 * clip[1] / clip[3]) * SIZE[0]
    return np.stack([x, y])


@dataclass(frozen=True)
class Room:
    """True cameras, and what the frames hold."""

    cameras: dict[int, CameraMatrices]
    frames: dict[int, StoredGeometry]
    normals: dict[int, torch.Tensor]

    def evidence(self, kind: str, given: Cameras) -> tuple[CameraEvidence, ...]:
        if kind == "positions":
            frames = {n: replace(f, motion_px=None) for n, f in self.frames.items()}
            units = list_units(1.0)
            first = PositionEvidence(frames=frames, units=units, thinning=1)
            return (replace(first, units=list_units(first.choose_unit(given))),)
        if kind == "motion":
            moved = {n: f for n, f in self.frames.items() if f.motion_px is not None}
            vectors = VectorEvidence(
                frames={MotionConvention(): moved},
                step=1,
                depths=list_likely_depths(DepthConvention()),
                thinning=1,
            )
            return (vectors.hold(given),)
        if kind == "normals":
            return (NormalEvidence(frames=self.frames, normals=self.normals).hold(given),)
        return ()


def build(**lens: bool) -> Room:
    cameras = {n: make_camera(n, **lens) for n in FRAMES}
    frames, normals = {}, {}
    for number, camera in cameras.items():
        position, normal = cast(camera)
        depth = -(np.einsum("ihw,i->hw", position, camera.view[:3, 2]) + camera.view[3, 2])
        motion = None
        if number - 1 in cameras:
            apart = project(position, cameras[number - 1]) - project(position, camera)
            motion = torch.from_numpy(apart).float()[None]
        frames[number] = StoredGeometry(
            depth=torch.from_numpy(depth).float()[None, None],
            motion_px=motion,
            position=torch.from_numpy(position).float()[None],
            camera=CameraMetadata(),
            previous=CameraMetadata(),
            view=VIEW,
        )
        normals[number] = torch.from_numpy(normal).float()[None]
    return Room(cameras, frames, normals)


@pytest.fixture(scope="module")
def room() -> Room:
    return build()


def check(room: Room, given: Cameras, *kinds: str, **options: Any) -> CameraFinding:
    evidence = tuple(e for kind in kinds for e in room.evidence(kind, given))
    return check_cameras(given, evidence, step=1, convention=CameraConvention(**options))


FLIPS = {axis: np.diag([*(-1.0 if axis == a else 1.0 for a in "xyz"), 1.0]) for axis in "xyz"}

Spoil = Callable[[CameraMatrices], CameraMatrices]


def rebuild(turn: Callable[[Array], Array]) -> Spoil:
    """Change the view, and make clip space of it with the right projection."""
    return lambda m: CameraMatrices(turn(m.view), turn(m.view) @ m.projection)


def keep(turn: Callable[[Array], Array]) -> Spoil:
    """Change the view alone."""
    return lambda m: CameraMatrices(turn(m.view), m.ndc)


WRONG: Mapping[str, tuple[Spoil, str]] = {
    "transposed": (lambda m: CameraMatrices(m.view.T, m.ndc.T), "transposed"),
    "transposed, clip space kept": (keep(lambda v: v.T), "transposed"),
    "inverse": (keep(np.linalg.inv), "camera to world"),
    "inverse, rebuilt": (rebuild(np.linalg.inv), "camera to world"),
    **{f"{a} flipped": (keep(lambda v, f=f: v @ f), f"its {a} axis") for a, f in FLIPS.items()},
    **{
        f"{a} flipped, rebuilt": (rebuild(lambda v, f=f: v @ f), f"its {a} axis")
        for a, f in FLIPS.items()
    },
    "x and y swapped": (keep(lambda v: v @ SWAP), "x and y axes swapped"),
    "x and y swapped, rebuilt": (rebuild(lambda v: v @ SWAP), "x and y axes swapped"),
    "x and y swapped, each": (
        lambda m: CameraMatrices(m.view @ SWAP, m.ndc @ SWAP),
        "x and y axes swapped, in clip space too",
    ),
    "mitsuba": (keep(lambda v: v @ np.diag([-1.0, 1, -1, 1])), "looks along +z, x left, y up"),
    "opencv": (keep(lambda v: v @ np.diag([1.0, -1, -1, 1])), "looks along +z, x right, y down"),
}


@pytest.mark.parametrize("kind", ["positions", "motion"])
@pytest.mark.parametrize("name", WRONG)
def test_wrong_matrices_are_refused_with_what_they_look_like(
    room: Room, name: str, kind: str
) -> None:
    spoil, text = WRONG[name]
    found = check(room, {n: spoil(m) for n, m in room.cameras.items()}, kind)
    assert text in found.unfit
    assert "docs/frames.md" in found.unfit
    assert not found.certain


@pytest.mark.parametrize("kind", ["positions", "motion"])
@pytest.mark.parametrize("offset", [1, -1])
def test_matrices_of_another_frame_are_refused(room: Room, kind: str, offset: int) -> None:
    given = {n: make_camera(n + offset) for n in room.cameras}
    assert "of another frame" in check(room, given, kind).unfit


@pytest.mark.parametrize("kinds", [("positions",), ("motion",), ("motion", "normals")])
@pytest.mark.parametrize("spoil", [None, WRONG["z flipped, rebuilt"][0]], ids=["frame 1", "z"])
def test_one_wrong_frame_is_named_and_no_shift_of_all_is_claimed(
    room: Room, kinds: tuple[str, ...], spoil: Spoil | None
) -> None:
    wrong = room.cameras[1] if spoil is None else spoil(room.cameras[4])
    found = check(room, {**room.cameras, 4: wrong}, *kinds)
    assert "those of frame 4 do not agree" in found.unfit
    assert "the frame before it" not in found.unfit
    assert not found.fits


def test_positions_of_another_frame_are_named_where_motion_agrees_with_the_camera(
    room: Room,
) -> None:
    frames = dict(room.frames)
    frames[4] = replace(frames[4], position=frames[2].position)
    spoilt = replace(room, frames=frames)
    found = check(spoilt, room.cameras, "positions", "motion", "normals")
    assert "world positions of frame 4" in found.foreign_positions
    assert not found.unfit
    assert found.fits
    # without motion it may as well be the camera
    alone = check(spoilt, room.cameras, "positions")
    assert "those of frame 4 do not agree" in alone.unfit
    assert alone.single
    # a camera of another frame is no buffer's fault
    wrong = check(room, {**room.cameras, 4: room.cameras[2]}, "positions", "motion")
    assert not wrong.foreign_positions
    assert wrong.unfit


def test_of_two_frames_that_disagree_none_is_named(room: Room) -> None:
    """Motion from frame 2 to 3 and from 3 to 4 disagrees: most of what is measured."""
    found = check(room, {**room.cameras, 3: room.cameras[1]}, "motion")
    assert "unverified" in found.doubt


class TwoReadings:
    """Vectors that fit the given matrices nearly when read one way, and a neighbour's exactly
    when read the other, as of a camera that went straight on and stood still before."""

    name = "motion with depth"
    unit = "px of motion"
    tells_world, tells_step = False, True
    slack, factor, limit, sure = 0.02, 4.0, 0.1, 0.025

    def __init__(self, given: Cameras) -> None:
        self.given = given

    def view_nearby(self, given: Cameras) -> None:
        """Nothing is seen of cameras beside."""

    def measure(self, cameras: Cameras, *, closely: bool) -> dict[int, float]:
        if cameras is self.given:
            return {2: 0.016}
        return {2: 1.0 if closely else 0.0}


def test_the_other_sense_of_vectors_is_tried_with_the_cameras_of_neighbours(room: Room) -> None:
    evidence = (TwoReadings(room.cameras),)
    found = check_cameras(room.cameras, evidence, step=1, convention=CameraConvention())
    assert found.likenesses == "those of a neighbouring frame"


class OneFrameEach:
    """Vectors that fit the given matrices in one frame, badly, and a neighbour's in another."""

    name = "motion with depth"
    unit = "px of motion"
    tells_world, tells_step = False, True
    slack, factor, limit, sure = 0.02, 4.0, 0.1, 0.025

    def view_nearby(self, given: Cameras) -> None:
        """Nothing is seen of cameras beside."""

    def measure(self, cameras: Cameras, *, closely: bool) -> dict[int, float]:
        del closely
        return {max(cameras): 0.0} if min(cameras) > 1 else {min(cameras): 1.5}


def test_readings_that_share_no_frame_are_compared_all_the_same(room: Room) -> None:
    given = {n: camera for n, camera in room.cameras.items() if n in (1, 2, 3)}
    found = check_cameras(given, (OneFrameEach(),), step=1, convention=CameraConvention())
    assert "each frame's own are in the frame before it" in found.unfit
    assert "write each frame's own" in found.unfit


class FewWays:
    """Normals that fit the camera's axes better than the matrices' world, as another does."""

    limit, slack = 70.0, 8.0

    def __init__(self, given: Cameras, best: float) -> None:
        self.given, self.best = given, best

    def measure(self, cameras: Cameras, *, closely: bool) -> dict[int, float]:
        del closely
        if cameras is self.given:
            return {1: 82.0}
        mirrored = np.diag([1.0, 1.0, -1.0, 1.0]) @ self.given[1].view
        return {1: self.best if np.allclose(cameras[1].view, mirrored) else 99.0}

    def measure_in_camera(self, cameras: Cameras) -> float:
        del cameras
        return 66.0


@pytest.mark.parametrize(("best", "of_camera"), [(38.0, False), (66.0, True), (90.0, True)])
def test_normals_of_another_world_are_not_taken_for_the_camera_s(
    room: Room, best: float, of_camera: bool
) -> None:
    given = {1: room.cameras[min(room.cameras)]}
    evidence: Any = FewWays(given, best)
    assert are_of_camera(evidence, given) == of_camera


@pytest.mark.parametrize("kinds", [("positions",), ("motion", "normals"), ("normals",)])
@pytest.mark.parametrize("axis", "xyz")
def test_a_world_of_the_other_handedness_is_refused(
    room: Room, axis: str, kinds: tuple[str, ...]
) -> None:
    flip = FLIPS[axis]
    given = {n: CameraMatrices(flip @ m.view, flip @ m.ndc) for n, m in room.cameras.items()}
    assert f"mirrored world (its {axis} axis flipped)" in check(room, given, *kinds).unfit


def roughen(room: Room, share: float) -> Room:
    """The room with normal maps: a share of its normals leans anywhere."""
    chooser = torch.Generator().manual_seed(2)
    normals = {}
    for number, normal in room.normals.items():
        leaning = torch.rand(1, 1, *SIZE, generator=chooser) < share
        anywhere = torch.randn(1, 3, *SIZE, generator=chooser)
        normals[number] = torch.where(leaning, normalize_vectors(anywhere), normal)
    return replace(room, normals=normals)


@pytest.mark.parametrize("axis", "xyz")
def test_rough_normals_tell_handedness_where_motion_agrees(room: Room, axis: str) -> None:
    rough, flip = roughen(room, 0.4), FLIPS[axis]
    given = {n: CameraMatrices(flip @ m.view, flip @ m.ndc) for n, m in room.cameras.items()}
    unfit = check(rough, given, "motion", "normals").unfit
    assert f"mirrored world (its {axis} axis flipped)" in unfit
    assert "of the world that positions and normals are in" in unfit
    assert check(rough, given, "normals").unfit == ""
    assert check(rough, room.cameras, "motion", "normals").unfit == ""


@pytest.mark.parametrize(
    ("turn", "world", "axes"),
    [
        (np.eye(4)[[0, 2, 1, 3]], "a mirrored world", "x, z, y"),
        (
            np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]),
            "a world of other axes",
            "x, z, -y",
        ),
    ],
)
def test_a_world_whose_axes_are_named_otherwise_is_refused(
    room: Room, turn: Array, world: str, axes: str
) -> None:
    given = {n: CameraMatrices(turn @ m.view, turn @ m.ndc) for n, m in room.cameras.items()}
    named = "x, y, z of the world are their "
    assert f"like that of {world} ({named}{axes})" in check(room, given, "positions").unfit
    # walls that are not in view leave open which way an axis points
    assert named in check(room, given, "motion", "normals").unfit


def test_normals_cannot_tell_a_neighbour_and_say_so(room: Room) -> None:
    found = check(room, room.cameras, "normals")
    assert found.certain
    assert found.likenesses == "those of a neighbouring frame, or ones of a lens 3 % longer"


def test_motion_cannot_tell_handedness_of_the_world_and_says_so(room: Room) -> None:
    flip = FLIPS["x"]
    given = {n: CameraMatrices(flip @ m.view, flip @ m.ndc) for n, m in room.cameras.items()}
    found = check(room, given, "motion")
    assert found.undecided[0] == "of a mirrored world"
    assert not found.certain


@pytest.mark.parametrize("name", WRONG)
def test_where_nothing_can_tell_matrices_are_refused_by_form_or_unverified(
    room: Room, name: str
) -> None:
    found = check(room, {n: WRONG[name][0](m) for n, m in room.cameras.items()})
    assert found.unfit or "unverified" in found.doubt
    assert not found.fits


@pytest.mark.parametrize("lens", [{}, {"flat": True}, {"infinite": True}])
@pytest.mark.parametrize(
    "kinds", [("positions",), ("motion",), ("normals",), ("motion", "normals")]
)
def test_right_matrices_are_verified(lens: dict[str, bool], kinds: tuple[str, ...]) -> None:
    room = build(**lens)
    found = check(room, room.cameras, *kinds)
    assert (found.unfit, found.doubt) == ("", "")
    assert found.certain
    assert len(found.proofs) == len(kinds)


@pytest.mark.parametrize("kinds", [("positions",), ("normals",)])
def test_a_single_frame_is_verified_where_positions_or_normals_are(
    room: Room, kinds: tuple[str, ...]
) -> None:
    one = Room({2: room.cameras[2]}, {2: room.frames[2]}, {2: room.normals[2]})
    assert check(one, one.cameras, *kinds).certain


def clear_sky(room: Room, value: float) -> Room:
    """Put one value over a third of the depth."""
    frames = {n: replace(f, depth=f.depth.clone()) for n, f in room.frames.items()}
    for frame in frames.values():
        frame.depth[..., : SIZE[0] // 3, :] = value
    return replace(room, frames=frames)


@pytest.mark.parametrize("sky", [math.nan, math.inf, -math.inf, 0.0, -1.0, 65504.0])
@pytest.mark.parametrize("kind", ["motion", "normals"])
def test_whatever_the_sky_s_depth_is_cameras_are_checked_by_the_rest(
    room: Room, kind: str, sky: float
) -> None:
    cleared = clear_sky(room, sky)
    assert check(cleared, room.cameras, kind).certain
    spoil, text = WRONG["transposed, clip space kept"]
    assert text in check(cleared, {n: spoil(m) for n, m in room.cameras.items()}, kind).unfit


def test_vectors_of_the_sky_that_are_no_numbers_do_not_end_the_check(room: Room) -> None:
    frames = dict(room.frames)
    for number, frame in frames.items():
        if frame.motion_px is not None:
            motion = frame.motion_px.clone()
            motion[..., : SIZE[0] // 3, :] = math.nan
            frames[number] = replace(frame, motion_px=motion)
    cleared = clear_sky(replace(room, frames=frames), math.nan)
    assert check(cleared, room.cameras, "motion").certain


def test_a_camera_that_stands_still_is_not_verified_by_motion(room: Room) -> None:
    still = dict.fromkeys(room.cameras, room.cameras[1])
    frames = {n: replace(room.frames[1], motion_px=torch.zeros(1, 2, *SIZE)) for n in room.cameras}
    found = check(Room(still, frames, room.normals), still, "motion")
    assert found.unfit == ""
    assert not found.certain


def test_normals_prove_nothing_where_motion_does_not_agree(room: Room) -> None:
    chooser = torch.Generator().manual_seed(1)
    frames = {
        n: replace(f, motion_px=6.0 * torch.rand(1, 2, *SIZE, generator=chooser) - 3.0)
        for n, f in room.frames.items()
        if f.motion_px is not None
    }
    other = replace(room, frames={**room.frames, **frames})
    found = check(other, room.cameras, "motion", "normals")
    assert "motion with depth" in found.doubt
    assert not found.certain


def test_movers_on_a_third_of_the_picture_do_not_count(room: Room) -> None:
    frames = {}
    for number, frame in room.frames.items():
        motion = None if frame.motion_px is None else frame.motion_px.clone()
        if motion is not None:
            motion[..., : SIZE[1] // 3] += 3.0
        frames[number] = replace(frame, motion_px=motion)
    assert check(replace(room, frames=frames), room.cameras, "motion").fits


@pytest.mark.parametrize(
    ("words", "spoil"),
    [
        (("column-vectors",), lambda m: (m.view.T, m.ndc.T)),
        (("mitsuba",), lambda m: (m.view @ np.diag([-1.0, 1, -1, 1]), m.ndc)),
        (("opencv",), lambda m: (m.view @ np.diag([1.0, -1, -1, 1]), m.ndc)),
        (("directx",), lambda m: (m.view @ np.diag([1.0, 1, -1, 1]), m.ndc)),
        (
            ("column-vectors", "mitsuba", "camera-to-world"),
            lambda m: (np.linalg.inv(m.view @ np.diag([-1.0, 1, -1, 1])).T, m.ndc.T),
        ),
        (("ndc-y-down",), lambda m: (m.view, m.ndc @ np.diag([1.0, -1, 1, 1]))),
    ],
)
def test_a_declared_convention_is_converted_and_confirmed(
    room: Room, words: tuple[str, ...], spoil: Callable[[CameraMatrices], tuple[Array, Array]]
) -> None:
    convention = CameraConvention(words=frozenset(CameraWord(word) for word in words))
    given = {}
    for number, matrices in room.cameras.items():
        view, ndc = (torch.from_numpy(np.ascontiguousarray(m)) for m in spoil(matrices))
        view, ndc = matrices_to_memory(StoredMatrices(view=view, ndc=ndc), convention)
        assert view is not None
        assert ndc is not None
        given[number] = CameraMatrices(view.numpy(), ndc.numpy())
        assert np.allclose(given[number].view, matrices.view)
        assert np.allclose(given[number].ndc, matrices.ndc)
    assert check(room, given, "positions").certain


def test_unreal_axes_are_converted() -> None:
    convention = CameraConvention(words=frozenset({CameraWord.UNREAL}))
    view, _ = matrices_to_memory(StoredMatrices(view=torch.eye(4).double()), convention)
    assert view is not None
    # x forward, y right, z up: (2, 3, 5) lies 3 to the right, 5 up, 2 ahead
    point = torch.tensor([2.0, 3.0, 5.0, 1.0], dtype=torch.float64) @ view
    assert point.tolist() == [3.0, 5.0, -2.0, 1.0]


@pytest.mark.parametrize("kinds", [("positions",), ("motion",), ("motion", "normals")])
def test_one_camera_in_all_frames_is_named_where_positions_or_motion_tell(
    room: Room, kinds: tuple[str, ...]
) -> None:
    found = check(room, dict.fromkeys(room.cameras, room.cameras[1]), *kinds)
    assert "one frame's matrices in every frame?" in found.doubt
    assert found.stuck
    assert not found.fits


def test_normals_cannot_tell_whether_one_camera_in_all_frames_is_right(room: Room) -> None:
    still = dict.fromkeys(room.cameras, room.cameras[1])
    frames = dict.fromkeys(room.cameras, room.frames[1])
    normals = dict.fromkeys(room.cameras, room.normals[1])
    found = check(Room(still, frames, normals), still, "normals")
    assert found.likenesses == ("those of a neighbouring frame, or those of another field of view")


def test_a_lens_that_nothing_moves_under_is_told_by_positions_and_normals(room: Room) -> None:
    """A wider lens on a camera that rests: vectors of 0 fit any, and surfaces lean."""
    wider = np.diag([0.8, 0.8, 1.0, 1.0])
    right = room.cameras[1]
    wrong = CameraMatrices(right.view, right.ndc @ wider)
    still = dict.fromkeys(room.cameras, wrong)
    frames = dict.fromkeys(room.cameras, room.frames[1])
    normals = dict.fromkeys(room.cameras, room.normals[1])
    resting = Room(dict.fromkeys(room.cameras, right), frames, normals)
    found = check(resting, still, "normals")
    assert found.beside
    assert "another focal length" in found.doubt
    assert not check(resting, still, "positions").fits


class FloorAlone:
    """Normals of which all stand on a floor: they tell which way is up, and nothing else."""

    name, unit = "normals with depth", "% of the surfaces elsewhere"
    tells_world, tells_step, tells_lens = True, False, False
    slack, factor, limit, sure = 8.0, 1.1, 70.0, 25.0

    def __init__(self, right: Cameras) -> None:
        self.right = right

    def view_nearby(self, given: Cameras) -> None:
        """Nothing is seen of cameras beside."""

    def measure(self, cameras: Cameras, *, closely: bool) -> dict[int, float]:
        del closely
        same = np.diag([0.0, 1.0, 0.0])
        return {
            n: 40.0
            if np.allclose(m.view[:3, :3] @ same, self.right[n].view[:3, :3] @ same)
            else 90.0
            for n, m in cameras.items()
        }


@pytest.mark.parametrize("axis", "xz")
def test_what_mirrors_is_unverified_where_what_does_not_agrees_as_well(
    room: Room, axis: str
) -> None:
    evidence = (FloorAlone(room.cameras),)
    given = {n: WRONG[f"{axis} flipped, rebuilt"][0](m) for n, m in room.cameras.items()}
    found = check_cameras(given, evidence, step=1, convention=CameraConvention())
    assert not found.fits
    assert "normals with depth cannot tell them from ones that look like its x axis" in found.doubt
    assert "They mirror" in found.doubt
    right = check_cameras(room.cameras, evidence, step=1, convention=CameraConvention())
    assert right.fits


def test_what_is_there_and_tells_nothing_is_said_with_the_reason(room: Room) -> None:
    said = check_cameras(
        room.cameras, (), step=1, convention=CameraConvention(), silent=("normals are odd",)
    ).doubt
    assert "what is there cannot tell: normals are odd." in said
    assert "that takes" not in said
    tiny = {n: replace(f, depth=f.depth * math.nan) for n, f in room.frames.items()}
    few = check(replace(room, frames=tiny), room.cameras, "normals").doubt
    assert "normals with depth are of too few pixels" in few


def test_what_could_tell_is_named_where_nothing_does(room: Room) -> None:
    doubt = check(room, room.cameras).doubt
    assert "depth with normals of the world that face several ways" in doubt
    assert "the files hold nothing" not in doubt


def test_of_normals_in_another_order_their_channels_are_named_too(room: Room) -> None:
    turn = np.diag([1.0, -1.0, 1.0, 1.0])
    given = {n: CameraMatrices(turn @ m.view, turn @ m.ndc) for n, m in room.cameras.items()}
    assert "order x, y, z ([buffers] normal, position)" in check(room, given, "normals").unfit


def test_normals_of_another_world_that_refuse_no_matrices_are_named(
    room: Room, monkeypatch: pytest.MonkeyPatch
) -> None:
    rough = roughen(room, 0.25)
    swap = np.eye(4)[[0, 2, 1, 3]]
    given = {n: CameraMatrices(swap @ m.view, swap @ m.ndc) for n, m in room.cameras.items()}
    assert check(rough, given, "motion", "normals").unfit
    # evidence too weak to refuse by
    monkeypatch.setattr(NormalEvidence, "factor", 4.0)
    found = check(rough, given, "motion", "normals")
    assert found.fits
    assert "normals with depth of frames 1-4 do not agree" in found.contradiction
    assert "x, z, y" in found.contradiction
    assert not check(rough, room.cameras, "motion", "normals").contradiction


SHORT = MotionConvention(scale=0.1)


def make_vectors(
    vectors: Mapping[int, torch.Tensor], scales: Mapping[MotionConvention, float], **options: Any
) -> VectorEvidence:
    """Vectors of the room's frames, by readings that differ in a factor."""
    frame = StoredGeometry(
        depth=torch.full((1, 1, *SIZE), 4.0) + torch.rand(1, 1, *SIZE),
        motion_px=None,
        position=None,
        camera=CameraMetadata(),
        previous=CameraMetadata(),
        view=VIEW,
    )
    return VectorEvidence(
        frames={
            motion: {n: replace(frame, motion_px=scale * v) for n, v in vectors.items()}
            for motion, scale in scales.items()
        },
        step=1,
        depths=list_likely_depths(DepthConvention()),
        thinning=1,
        **options,
    )


def check_still(room: Room, evidence: VectorEvidence) -> CameraFinding:
    still = dict.fromkeys(room.cameras, room.cameras[1])
    return check_cameras(still, (evidence.hold(still),), step=1, convention=CameraConvention())


def test_vectors_that_may_be_short_agree_with_no_camera_that_rests(room: Room) -> None:
    """What moves by 0.3 px moves by 0.03 px in another reading that pictures do not rule out."""
    torch.manual_seed(1)
    vectors = {n: 0.3 * torch.randn(1, 2, *SIZE).sign() for n in (2, 3, 4)}
    for scales in ({MotionConvention(): 1.0, SHORT: 0.1}, {SHORT: 0.1, MotionConvention(): 1.0}):
        found = check_still(room, make_vectors(vectors, scales))
        assert found.stuck
        assert found.disputed
        assert not found.fits
        assert "all frames looked at (2-4)" in found.doubt


def test_a_camera_rests_though_most_of_the_picture_moves(room: Room) -> None:
    vectors = {n: torch.zeros(1, 2, *SIZE) for n in (2, 3, 4)}
    for image in vectors.values():
        image[..., : SIZE[1] * 7 // 10] = torch.randn(2, 1, SIZE[1] * 7 // 10)
    found = check_still(room, make_vectors(vectors, {MotionConvention(): 1.0}))
    assert not found.doubt or not found.stuck
    assert not found.disputed


@pytest.mark.parametrize(("shifts", "stuck"), [((0.3, 0.3, 0.3), True), ((0.3, -0.2, 0.1), False)])
def test_a_pan_under_one_camera_is_named_and_jitter_tells_nothing(
    room: Room, shifts: tuple[float, ...], stuck: bool
) -> None:
    vectors = {
        n: torch.tensor([shift, 0.5 * shift]).view(1, 2, 1, 1).expand(1, 2, *SIZE)
        for n, shift in zip((2, 3, 4), shifts, strict=True)
    }
    found = check_still(room, make_vectors(vectors, {MotionConvention(): 1.0}))
    assert found.stuck == stuck
    assert not found.fits
    assert "unverified" in found.doubt


def test_coarse_vectors_are_held_to_their_digits(room: Room) -> None:
    """Right matrices, and vectors in steps of 0.8 px: as UV of half floats around 0.5."""
    moved = {n: f for n, f in room.frames.items() if f.motion_px is not None}
    coarse = {n: replace(f, motion_px=(f.motion_px / 0.8).round() * 0.8) for n, f in moved.items()}  # type: ignore[operator]
    evidence = VectorEvidence(
        frames={MotionConvention(): coarse},
        step=1,
        depths=list_likely_depths(DepthConvention()),
        thinning=1,
    )
    assert max(evidence.measure(room.cameras, closely=False).values()) > evidence.limit
    known = replace(evidence, roundings_px={MotionConvention(): 0.4})
    right = check_cameras(
        room.cameras, (known.hold(room.cameras),), step=1, convention=CameraConvention()
    )
    assert right.fits
    # where little more than rounding is left of what moves, nothing is told
    blind = replace(evidence, roundings_px={MotionConvention(): 1.2})
    assert not blind.measure(room.cameras, closely=False)


def test_coarse_depths_are_held_to_their_digits(room: Room) -> None:
    """Device depths of half floats, near 1 where surfaces are far."""
    device = DepthConvention(kind=DepthKind.DEVICE)
    frames = {}
    for number, frame in room.frames.items():
        if frame.motion_px is not None:
            # P of the room: z = d - 0.1, w = d
            stored = 1.0 - 0.1 / frame.depth
            frames[number] = replace(frame, depth=stored.half().float())
    evidence = VectorEvidence(
        frames={MotionConvention(): frames}, step=1, depths=(device,), thinning=1
    ).hold(room.cameras)
    assert evidence.depth_px > 0.01
    fine = VectorEvidence(
        frames={MotionConvention(): {n: room.frames[n] for n in frames}},
        step=1,
        depths=(DepthConvention(),),
        thinning=1,
    ).hold(room.cameras)
    assert fine.depth_px < 1e-3


def test_positions_that_fit_one_frame_closely_fit_all_of_them_so(room: Room) -> None:
    """A slow camera, and the first frame's matrices in all: less than a pixel is off."""
    slow = {n: make_camera(1.0 + 0.3 * (n - 1)) for n in FRAMES}  # type: ignore[arg-type]
    frames = {
        n: replace(room.frames[n], position=torch.from_numpy(cast(camera)[0]).float()[None])
        for n, camera in slow.items()
    }
    evidence = PositionEvidence(frames=frames, units=list_units(1.0), thinning=1)
    given = dict.fromkeys(slow, slow[1])
    errors = evidence.measure(given, closely=False)
    assert 0.1 < max(errors.values()) < 0.75
    found = check_cameras(given, (evidence.hold(given),), step=1, convention=CameraConvention())
    assert found.stuck
    assert "0 px from their pixels in frame" in found.doubt
    # the camera of another frame is no error of a camera beside
    assert "same in all frames" in found.doubt
    assert "a camera beside" not in found.doubt
    right = check_cameras(slow, (evidence.hold(slow),), step=1, convention=CameraConvention())
    assert right.fits


def test_samples_anywhere_in_their_pixels_are_no_other_frames(room: Room) -> None:
    torch.manual_seed(4)
    frames = {}
    for number, camera in room.cameras.items():
        position = torch.from_numpy(cast(camera)[0]).float()[None]
        right, down = (
            (position - position.roll(-1, dim)).abs().clamp(max=0.1)
            * (torch.rand(1, 1, *SIZE) - 0.5)
            for dim in (3, 2)
        )
        frames[number] = replace(room.frames[number], position=position + right + down)
    evidence = PositionEvidence(frames=frames, units=list_units(1.0), thinning=1)
    held = evidence.hold(room.cameras)
    assert held.least > 0.05
    found = check_cameras(room.cameras, (held,), step=1, convention=CameraConvention())
    assert found.fits


def test_half_positions_are_held_to_their_digits(room: Room) -> None:
    far = 2000.0
    frames, cameras = {}, {}
    for number, camera in room.cameras.items():
        move = np.eye(4)
        move[3, 0] = -far
        cameras[number] = CameraMatrices(move @ camera.view, move @ camera.ndc)
        position = room.frames[number].position
        assert position is not None
        moved = position + torch.tensor([far, 0.0, 0.0]).view(1, 3, 1, 1)
        frames[number] = replace(room.frames[number], position=moved.half().float())
    evidence = PositionEvidence(frames=frames, units=list_units(1.0), thinning=1).hold(cameras)
    assert evidence.rounding_px > 0.75
    found = check_cameras(cameras, (evidence,), step=1, convention=CameraConvention())
    assert found.fits


def test_the_world_that_normals_are_of_is_named_whatever_motion_says(room: Room) -> None:
    """Readings of the camera's axes, which motion rules out, are none of the world's; and of worlds
    the one that fits best is named, not one that mirrors and fits a little better than as given."""
    for turn in (
        np.eye(4)[[0, 2, 1, 3]] @ np.diag([1.0, -1.0, 1.0, 1.0]),
        np.eye(4)[[2, 0, 1, 3]],
        np.diag([1.0, -1.0, -1.0, 1.0]),
    ):
        given = {n: CameraMatrices(turn @ m.view, turn @ m.ndc) for n, m in room.cameras.items()}
        found = check(room, given, "motion", "normals")
        assert found.normal_world is not None
        assert np.array_equal(found.normal_world @ turn, np.eye(4))


def test_one_wrong_frame_leaves_open_whether_the_others_are_neighbours(room: Room) -> None:
    even = {n: make_camera(1.0 + 0.15 * n) for n in range(7)}  # type: ignore[arg-type]
    frames = {}
    for number in FRAMES[1:]:
        position = cast(even[number])[0]
        apart = project(position, even[number - 1]) - project(position, even[number])
        depth = -(
            np.einsum("ihw,i->hw", position, even[number].view[:3, 2]) + even[number].view[3, 2]
        )
        frames[number] = replace(
            room.frames[number],
            depth=torch.from_numpy(depth).float()[None, None],
            motion_px=torch.from_numpy(apart).float()[None],
        )
    evidence = VectorEvidence(
        frames={MotionConvention(): frames},
        step=1,
        depths=list_likely_depths(DepthConvention()),
        thinning=1,
    )
    given = {1: even[2], 2: even[3], 3: even[4], 4: even[3]}
    found = check_cameras(given, (evidence.hold(given),), step=1, convention=CameraConvention())
    assert "those of frame 4 do not agree" in found.unfit
    assert "or are all a neighbouring frame's" in found.unfit


def turn(axis: int, degrees: float) -> Array:
    one, other = (i for i in range(3) if i != axis)
    matrix = np.eye(4)
    matrix[one, one] = matrix[other, other] = math.cos(math.radians(degrees))
    matrix[one, other] = math.sin(math.radians(degrees))
    matrix[other, one] = -matrix[one, other]
    return matrix


def scale_lens(factor: float) -> Array:
    return np.diag([factor, factor, 1.0, 1.0])


def step_aside(x: float, z: float) -> Array:
    matrix = np.eye(4)
    matrix[3, 0], matrix[3, 2] = x, z
    return matrix


BESIDE = {
    "pitch": (turn(0, 1.7), np.eye(4)),
    "yaw": (turn(1, -1.7), np.eye(4)),
    "roll": (turn(2, 1.7), np.eye(4)),
    "focal length": (np.eye(4), scale_lens(1.03)),
    "moved": (step_aside(0.1, 0.2), np.eye(4)),
}
"""What is said of cameras that are a little off -> how they move, and what their lens becomes."""


def put_beside(cameras: Cameras, name: str) -> dict[int, CameraMatrices]:
    moved, lens = BESIDE[name]
    return {
        n: CameraMatrices(m.view @ moved, m.view @ moved @ m.projection @ lens)
        for n, m in cameras.items()
    }


@pytest.mark.parametrize("kind", ["positions", "motion", "normals"])
@pytest.mark.parametrize("name", BESIDE)
def test_cameras_a_little_off_are_unverified_and_named(room: Room, kind: str, name: str) -> None:
    found = check(room, put_beside(room.cameras, name), kind)
    if kind == "normals" and name == "moved":
        # which way a surface faces is alike from a step aside
        assert found.fits
        return
    if kind == "normals" and name == "focal length":
        assert not found.fits or "of a lens 3 % longer" in found.likenesses
        return
    assert found.beside
    assert found.disputed
    assert not found.fits
    assert f"{name}" in found.doubt
    assert "a camera beside the one that rendered" in found.doubt


def store(room: Room, kind: str) -> Room:
    """What frames hold, in halves, in steps, or where samples are anywhere in their pixels."""
    frames = {}
    for number, frame in room.frames.items():
        motion, depth = frame.motion_px, frame.depth
        if kind == "half":
            motion, depth = (None if x is None else x.half().float() for x in (motion, depth))
        elif kind == "steps":
            motion = None if motion is None else (motion * 256.0).round() / 256.0
            depth = (depth * 512.0).round() / 512.0
        else:
            shift = torch.tensor([0.4, -0.3]) * (-1) ** number
            motion = None if motion is None else motion + shift.view(1, 2, 1, 1)
        assert depth is not None
        frames[number] = replace(frame, motion_px=motion, depth=depth)
    return replace(room, frames=frames)


@pytest.mark.parametrize("kind", ["half", "steps", "jitter"])
def test_what_storage_leaves_is_no_other_camera(room: Room, kind: str) -> None:
    stored = store(room, kind)
    right = check(stored, room.cameras, "motion")
    assert right.fits
    assert not right.beside
    assert not any("degrees" in text for text in right.undecided)
    assert check(stored, put_beside(room.cameras, "yaw"), "motion").beside


def test_a_camera_that_only_goes_straight_on_leaves_its_lens_untold(room: Room) -> None:
    """Points of known depth move alike by any lens then, pixels beside pixels."""
    straight = {n: CameraMatrices(*_go_on(room.cameras[1], 0.1 * n)) for n in FRAMES}
    frames = {}
    for number, camera in straight.items():
        position, _ = cast(camera)
        depth = -(np.einsum("ihw,i->hw", position, camera.view[:3, 2]) + camera.view[3, 2])
        before = straight.get(number - 1)
        motion = None if before is None else project(position, before) - project(position, camera)
        frames[number] = replace(
            room.frames[number],
            depth=torch.from_numpy(depth).float()[None, None],
            motion_px=None if motion is None else torch.from_numpy(motion).float()[None],
        )
    found = check(Room(straight, frames, room.normals), straight, "motion")
    assert found.fits
    assert "of a lens 3 % longer" in found.undecided


def _go_on(camera: CameraMatrices, way: float) -> tuple[Array, Array]:
    moved = step_aside(0.0, way)
    return camera.view @ moved, camera.view @ moved @ camera.projection
