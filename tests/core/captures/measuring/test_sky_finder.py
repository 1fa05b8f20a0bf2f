"""What is sky, by every way that renderers write it."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.sky_finder import SkyFinding, find_sky, mark_sky
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.conventions import (
    FARTHEST_M,
    Conventions,
    DepthConvention,
    DepthKind,
    NormalConvention,
    SkyRule,
    depth_to_metres,
)

SIZE = (40, 60)
ABOVE = 0.25
"""Share of the pixels that are sky."""


def scene(sky: float) -> dict[Buffer, Tensor]:
    """Hills of 4 to 8 m below a sky whose depth is stored as `sky`."""
    torch.manual_seed(1)
    depth = 4.0 + 4.0 * torch.rand(1, 1, *SIZE)
    depth[..., :10, :] = sky
    normal = torch.nn.functional.normalize(torch.randn(1, 3, *SIZE), dim=1)
    normal[..., :10, :] = 0.0
    number = torch.ones(1, 1, *SIZE)
    number[..., :10, :] = 0.0
    return {Buffer.DEPTH: depth, Buffer.NORMAL: normal, Buffer.OBJECT_ID: number}


def find(frame: dict[Buffer, Tensor], **depth: object) -> SkyFinding:
    return find_sky([frame], Conventions(depth=DepthConvention(**depth)))  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [math.inf, 65504.0, 1e10])
def test_far_depth_is_sky_as_it_always_was(value: float) -> None:
    finding = find(scene(value))
    assert finding.share == pytest.approx(ABOVE)
    assert finding.sky is None
    assert finding.impossible == 0.0


@pytest.mark.parametrize("value", [0.0, 6.5504, math.inf])
def test_normals_of_0_are_sky_beside_a_marker_as_they_are_read(value: float) -> None:
    marker = NormalConvention(sky=(-1.0, -1.0, -1.0))
    conventions = Conventions(normal=marker)
    known = scene(value)
    finding = find_sky([known], conventions)
    assert finding.share == pytest.approx(ABOVE)
    assert finding.rule == "normals of (-1.0, -1.0, -1.0) or 0"
    sky = mark_sky(known, conventions)
    assert sky is not None
    assert torch.equal(sky, known[Buffer.OBJECT_ID] == 0.0)
    # normals that were not rendered on surfaces of several depths are no sky
    missing = scene(value)
    missing[Buffer.NORMAL][..., 10:20, :] = 0.0
    missing[Buffer.NORMAL][..., :10, :] = -1.0
    finding = find_sky([missing], conventions)
    assert finding.share == pytest.approx(ABOVE)
    assert finding.rule == "normals of (-1.0, -1.0, -1.0)"


@pytest.mark.parametrize("others", [-math.inf, math.inf])
def test_depth_of_minus_infinity_is_sky_where_rays_miss_and_said_on_surfaces(others: float) -> None:
    known = scene(-math.inf)
    finding = find(known)
    assert finding.share == pytest.approx(ABOVE)
    assert finding.rule.endswith("; -inf in 25.0%")
    assert (finding.lost, finding.impossible) == (0.0, 0.0)
    # depth alone tells a region from scattered pixels
    plain = find({Buffer.DEPTH: known[Buffer.DEPTH]})
    assert (plain.share, plain.lost) == (pytest.approx(ABOVE), 0.0)

    known = scene(others)
    scattered = torch.zeros(1, 1, *SIZE, dtype=torch.bool)
    scattered[..., 12::4, ::4] = True
    known[Buffer.DEPTH][scattered] = -math.inf
    share = float(scattered.float().mean())
    finding = find(known)
    assert finding.lost == pytest.approx(share)
    assert finding.share == pytest.approx(ABOVE + share)
    assert find({Buffer.DEPTH: scene(9.0)[Buffer.DEPTH]}).lost == 0.0

    block = scene(others)
    block[Buffer.DEPTH][..., 20:25, 10:30] = -math.inf
    if others > 0:
        assert find(block).lost == pytest.approx(100 / 2400)


@pytest.mark.parametrize("value", [0.0, -1.0])
@pytest.mark.parametrize("marks", [(), (Buffer.NORMAL,), (Buffer.NORMAL, Buffer.OBJECT_ID)])
@pytest.mark.parametrize("kind", [DepthKind.PLANAR, DepthKind.RAY])
def test_regions_of_depth_that_no_surface_has_are_sky(
    value: float, marks: tuple[Buffer, ...], kind: DepthKind
) -> None:
    known = scene(value)
    finding = find({b: known[b] for b in (Buffer.DEPTH, *marks)}, kind=kind)
    assert finding.sky == value
    assert finding.share == pytest.approx(ABOVE)
    assert finding.impossible == 0.0


@pytest.mark.parametrize("marks", [(), (Buffer.NORMAL,), (Buffer.NORMAL, Buffer.OBJECT_ID)])
@pytest.mark.parametrize("kind", [DepthKind.PLANAR, DepthKind.RAY])
@pytest.mark.parametrize("normal", [0.0, math.nan])
def test_regions_of_depth_that_is_no_number_are_sky(
    marks: tuple[Buffer, ...], kind: DepthKind, normal: float
) -> None:
    known = scene(math.nan)
    known[Buffer.NORMAL][..., :10, :] = normal
    finding = find({b: known[b] for b in (Buffer.DEPTH, *marks)}, kind=kind)
    assert finding.sky is SkyRule.NAN
    assert finding.share == pytest.approx(ABOVE)
    assert finding.impossible == 0.0


def test_depth_that_is_no_number_on_surfaces_is_no_sky() -> None:
    known = scene(math.inf)
    known[Buffer.DEPTH][..., 20:30, :] = math.nan
    known[Buffer.OBJECT_ID][..., 20:30, :] = 7.0
    finding = find(known)
    assert finding.sky is None
    assert finding.impossible == pytest.approx(0.25)


@pytest.mark.parametrize("value", [10.0, 1000.0])
@pytest.mark.parametrize("mark", [Buffer.NORMAL, Buffer.OBJECT_ID])
def test_the_far_plane_is_sky_where_another_buffer_says_so(value: float, mark: Buffer) -> None:
    known = scene(value)
    assert find({b: known[b] for b in (Buffer.DEPTH, mark)}).sky == value
    assert find({Buffer.DEPTH: known[Buffer.DEPTH]}).sky is None


def test_a_wall_that_faces_the_camera_is_no_sky() -> None:
    known = scene(9.0)
    known[Buffer.NORMAL][:, 2, :10] = 1.0
    assert find({b: known[b] for b in (Buffer.DEPTH, Buffer.NORMAL)}).share == 0.0


@pytest.mark.parametrize("value", [0.0, -3.0, math.nan])
def test_scattered_impossible_values_are_no_sky_and_are_counted(value: float) -> None:
    known = scene(math.inf)
    torch.manual_seed(2)
    spoilt = torch.rand(1, 1, *SIZE) < 0.04
    spoilt[..., :10, :] = False
    known[Buffer.DEPTH][spoilt] = value
    finding = find(known)
    assert finding.sky is None
    assert finding.share == pytest.approx(ABOVE)
    assert finding.impossible == pytest.approx(float(spoilt.float().mean()))


@pytest.mark.parametrize("value", [0.0, -3.0, math.nan])
@pytest.mark.parametrize("mark", [Buffer.NORMAL, Buffer.OBJECT_ID])
def test_values_of_the_sky_that_are_scattered_over_surfaces_are_counted_apart(
    value: float, mark: Buffer
) -> None:
    known = scene(value)
    clean = {b: known[b].clone() for b in (Buffer.DEPTH, mark)}
    assert find(clean).strewn == 0.0
    torch.manual_seed(2)
    spoilt = torch.rand(1, 1, *SIZE) < 0.02
    spoilt[..., :12, :] = False
    known[Buffer.DEPTH][spoilt] = value
    finding = find({b: known[b] for b in (Buffer.DEPTH, mark)})
    assert finding.sky is not None
    assert finding.strewn == pytest.approx(float(spoilt.float().mean()), rel=0.1)


def test_holes_through_which_the_sky_is_seen_are_not_scattered() -> None:
    known = scene(0.0)
    torch.manual_seed(2)
    holes = torch.rand(1, 1, *SIZE) < 0.04
    for image in known.values():
        image[holes.expand_as(image)] = 0.0
    assert find(known).sky == 0.0
    assert find(known).strewn == 0.0


def test_impossible_values_on_surfaces_are_no_sky() -> None:
    known = scene(math.inf)
    known[Buffer.DEPTH][..., 20:30, :] = 0.0
    known[Buffer.OBJECT_ID][..., 20:30, :] = 7.0
    finding = find(known)
    assert finding.sky is None
    assert finding.impossible == pytest.approx(0.25)


@pytest.mark.parametrize(("reverse", "clear"), [(True, 0.0), (False, 1.0)])
def test_device_depth_is_sky_at_its_far_end(reverse: bool, clear: float) -> None:
    known = scene(clear)
    known[Buffer.DEPTH][..., 10:, :] = 0.3
    finding = find(known, kind=DepthKind.DEVICE, reversed=reverse)
    assert finding.share == pytest.approx(ABOVE)
    assert (finding.sky, finding.impossible) == (None, 0.0)


def test_a_declaration_wins() -> None:
    assert find(scene(0.0), sky=SkyRule.NONE).share == 0.0
    assert find(scene(-1.0), sky=0.0).share == pytest.approx(ABOVE)
    assert find(scene(5.0), sky=SkyRule.NORMAL).share == pytest.approx(ABOVE)
    assert find(scene(5.0), sky=SkyRule.OBJECT_ID).share == pytest.approx(ABOVE)
    assert find(scene(0.0), sky=SkyRule.FAR).share == 0.0


def test_normals_that_mark_the_sky_are_its_rule() -> None:
    known = scene(3.0)
    known[Buffer.NORMAL][..., :10, :] = -1.0
    conventions = Conventions(normal=NormalConvention(sky=(-1.0, -1.0, -1.0)))
    assert find_sky([known], conventions).share == pytest.approx(ABOVE)


def test_without_depth_normals_of_0_are_sky() -> None:
    known = scene(0.0)
    assert find({Buffer.NORMAL: known[Buffer.NORMAL]}).share == pytest.approx(ABOVE)


ROWS: list[tuple[DepthConvention, list[float], list[float]]] = [
    (DepthConvention(sky=0.0), [0.0, -1.0, 2.0], [SKY_DEPTH_M, SKY_DEPTH_M, 2.0]),
    (DepthConvention(sky=-1.0), [0.0, -1.0, 2.0], [0.0, SKY_DEPTH_M, 2.0]),
    (DepthConvention(sky=100.0, unit_m=0.01), [99.0, 100.0, 2.0], [0.99, SKY_DEPTH_M, 0.02]),
    (DepthConvention(sky=SkyRule.FAR), [0.0, 1e10, math.inf], [0.0, SKY_DEPTH_M, SKY_DEPTH_M]),
    (DepthConvention(sky=SkyRule.NAN), [math.nan, 1e10, 2.0], [SKY_DEPTH_M, SKY_DEPTH_M, 2.0]),
    (DepthConvention(sky=SkyRule.NONE), [1.0, 65504.0, math.inf], [1.0, FARTHEST_M, FARTHEST_M]),
]


@pytest.mark.parametrize(("convention", "stored", "expected"), ROWS)
def test_depth_in_memory(
    convention: DepthConvention, stored: list[float], expected: list[float]
) -> None:
    view, plane = View(display=(1, 3)), torch.tensor(stored).view(1, 1, 1, 3)
    metres = depth_to_metres(plane, convention, CameraMetadata(), view, where="a test")
    assert torch.allclose(metres.flatten(), torch.tensor(expected))


@pytest.mark.parametrize("marker", [Buffer.NORMAL, Buffer.OBJECT_ID])
def test_a_pass_that_is_0_everywhere_marks_no_sky(marker: Buffer) -> None:
    """The farthest wall shares one depth; that its normals are 0 means nothing if all are."""
    known = scene(20.0)
    frame = {Buffer.DEPTH: known[Buffer.DEPTH], marker: known[marker]}
    assert find(frame).sky == 20.0
    frame[marker] = torch.zeros_like(known[marker])
    assert find(frame).sky is None
    assert find(frame).share == 0.0


def clear_to(frame: dict[Buffer, Tensor]) -> dict[Buffer, Tensor]:
    """Normals and ids of the sky that are one value, though none of 0."""
    frame[Buffer.NORMAL][..., :10, :] = torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1)
    frame[Buffer.OBJECT_ID][..., :10, :] = 7.0
    return frame


def test_a_far_plane_on_which_all_is_one_value_is_sky() -> None:
    known = clear_to(scene(1000.0))
    assert find(known).sky == 1000.0
    assert find(known).share == pytest.approx(ABOVE)
    # nothing but depth: no more than said
    alone = find({Buffer.DEPTH: known[Buffer.DEPTH]})
    assert alone.sky is None
    assert alone.unmarked == (pytest.approx(ABOVE), 1000.0)


@pytest.mark.parametrize("value", [9.0, 1037.5], ids=["just behind", "no round number"])
def test_a_wall_of_one_normal_and_one_id_is_no_sky(value: float) -> None:
    found = find(clear_to(scene(value)))
    assert (found.sky, found.unmarked) == (None, None)


def test_objects_before_the_farthest_depth_are_no_sky() -> None:
    known = clear_to(scene(1000.0))
    known[Buffer.OBJECT_ID][..., :5, :] = 3.0
    assert find(known).sky is None


WITHIN = 6.0
"""A depth that the hills of `scene` lie before and behind."""


def with_material(frame: dict[Buffer, Tensor]) -> dict[Buffer, Tensor]:
    """Grey hills; what has no normal has no material."""
    albedo = torch.full((1, 3, *SIZE), 0.5)
    albedo[..., :10, :] = 0.0
    return {**frame, Buffer.ALBEDO: albedo}


@pytest.mark.parametrize("value", [WITHIN, 8.5])
def test_a_depth_among_the_surfaces_is_skys_where_normals_of_0_have_it(value: float) -> None:
    known = scene(value)
    for frame in (known, with_material(known), {b: known[b] for b in known if b != "objectid"}):
        finding = find(frame)
        assert finding.sky is SkyRule.NORMAL
        assert finding.share == pytest.approx(ABOVE)
        assert f"a depth of {value:g}" in finding.rule


def test_ids_of_0_mark_such_a_depth_where_nothing_else_is_there_either() -> None:
    known = with_material(scene(WITHIN))
    known[Buffer.NORMAL][..., :10, :] = torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1)
    assert find(known).sky is SkyRule.OBJECT_ID
    # a wall that faces the camera, and has no id
    known[Buffer.ALBEDO][..., :10, :] = 0.5
    assert find(known).sky is None
    assert find(known).cleared is None


def test_without_a_mark_such_a_depth_is_said_with_the_line_that_declares_it() -> None:
    known = with_material(scene(WITHIN))
    del known[Buffer.OBJECT_ID]
    known[Buffer.NORMAL][..., :10, :] = torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1)
    finding = find(known)
    assert finding.sky is None
    assert finding.cleared is not None
    assert finding.cleared.normal == (0.0, 0.0, 1.0)
    assert finding.cleared.share == pytest.approx(ABOVE)
    del known[Buffer.NORMAL]
    finding = find(known)
    assert finding.cleared is not None
    assert finding.cleared.normal is None
    assert finding.cleared.beyond > 0.3


def test_surfaces_without_normals_at_several_depths_are_no_sky() -> None:
    known = with_material(scene(WITHIN))
    known[Buffer.DEPTH][..., :10, :] = 5.0 + torch.rand(10, SIZE[1])
    finding = find(known)
    assert finding.sky is None
    assert finding.cleared is None


def test_packed_normals_of_0_are_no_vectors_of_0() -> None:
    known = scene(WITHIN)
    known[Buffer.NORMAL] = known[Buffer.NORMAL] * 0.5 + 0.5
    known[Buffer.NORMAL][..., :10, :] = 0.0
    del known[Buffer.OBJECT_ID]
    finding = find(with_material(known))
    assert finding.sky is None
    assert finding.cleared is not None
    assert finding.cleared.normal == (0.0, 0.0, 0.0)
