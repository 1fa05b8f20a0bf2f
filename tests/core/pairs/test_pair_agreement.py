"""LR samples held against HR pixels at their places."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from rtsr_cli.core.errors import FrameFolderError
from rtsr_cli.core.frames.buffers import SKY_DEPTH_M, Buffer, GBuffer
from rtsr_cli.core.imaging.color import encode_srgb
from rtsr_cli.core.imaging.resampling import decimate
from rtsr_cli.core.pairs import pair_agreement
from rtsr_cli.core.pairs.pair_agreement import (
    FEW_STRAYS,
    MOST_STRAYS,
    TURNED,
    Misfit,
    find_misfit,
    find_other_moment,
    flip,
    measure_factor,
    measure_strays,
    measure_strays_of,
)

SIZE = (48, 96)


def render(moment: int = 0) -> GBuffer:
    """Boxes that go to the right, on a wall that leans, below some sky."""
    torch.manual_seed(3)
    rows, columns = torch.meshgrid(*(torch.arange(side) for side in SIZE), indexing="ij")
    ids = torch.zeros(SIZE, dtype=torch.int32)
    for number in range(1, 12):
        top, left = (int(torch.randint(0, side - 12, ())) for side in SIZE)
        box = (rows >= top) & (rows < top + 11) & ((columns - left - 5 * moment) % SIZE[1] < 13)
        ids[box] = number
    depth = 5.0 + 0.02 * rows + 0.01 * columns - 0.3 * ids
    depth[:6] = SKY_DEPTH_M
    albedo = torch.rand(3, 12)[:, ids.long()]
    buffers = {Buffer.DEPTH: depth[None, None], Buffer.OBJECT_ID: ids[None, None]}
    return GBuffer(buffers | {Buffer.ALBEDO: albedo[None]}, "made by a test")


def keep(gbuffer: GBuffer, scale: int, offset: tuple[int, int]) -> GBuffer:
    return gbuffer.with_buffers({b: decimate(t, scale, offset) for b, t in gbuffer.items()})


def change(gbuffer: GBuffer, **buffers: Tensor) -> GBuffer:
    return gbuffer.with_buffers({Buffer(name): image for name, image in buffers.items()})


def judge(lr: Mapping[int, GBuffer], hr: Mapping[int, GBuffer], scale: int = 4) -> Misfit | None:
    return find_misfit(lr.__getitem__, hr.__getitem__, sorted(lr), scale, stored=hr)


@pytest.mark.parametrize("scale", [2, 3, 4])
def test_samples_wherever_in_their_pixels_agree(scale: int) -> None:
    hr = render()
    for offset in ((0, 0), (scale - 1, 0), (scale // 2, scale - 1)):
        lr = keep(hr, scale, offset)
        assert measure_strays(lr, hr, scale) == 0.0
        # as rendered beside each other: no sample is a pixel
        means = {b: t for b, t in lr.items() if b is not Buffer.OBJECT_ID}
        means[Buffer.DEPTH] = means[Buffer.DEPTH] * 1.002
        assert (measure_strays(lr.with_buffers(means), hr, scale) or 0.0) <= FEW_STRAYS / 2
        assert judge({1: lr}, {1: hr}, scale) is None


@pytest.mark.parametrize("looks", list(TURNED))
def test_turned_pictures_are_named(looks: str) -> None:
    hr = render()
    found = judge({1: keep(hr, 4, (1, 2))}, {1: flip(hr, TURNED[looks])})
    assert found is not None
    assert (found.looks, found.frame) == (looks, 1)
    assert "capture.toml declares no other" in found.remedy
    assert found.strays > 2 * FEW_STRAYS


SWAP, ENCODE = (lambda t: t.flip(1)), encode_srgb


@pytest.mark.parametrize(
    ("small", "large", "looks"),
    [
        (None, SWAP, "swapped in the channels of albedo"),
        (SWAP, None, "swapped in the channels of albedo"),
        (None, ENCODE, "sRGB-encoded in albedo, and LR linear"),
        (ENCODE, None, "linear in albedo, and LR sRGB-encoded"),
    ],
)
def test_colours_of_one_size_that_are_stored_otherwise_are_named(
    small: Callable[[Tensor], Tensor] | None, large: Callable[[Tensor], Tensor] | None, looks: str
) -> None:
    hr = render()
    lr = keep(hr, 4, (1, 2))
    if small:
        lr = change(lr, albedo=small(lr[Buffer.ALBEDO]))
    if large:
        hr = change(hr, albedo=large(hr[Buffer.ALBEDO]))
    found = judge({1: lr}, {1: hr})
    assert found is not None
    assert found.looks.startswith(looks)
    assert "write albedo alike at both sizes" in found.remedy


def test_colours_that_are_stored_alike_or_unlike_for_another_reason_are_no_misfit() -> None:
    hr = change(render(), albedo=encode_srgb(render()[Buffer.ALBEDO]).flip(1))
    lr = keep(hr, 4, (1, 2))
    assert judge({1: lr}, {1: hr}) is None
    noise = 0.1 * torch.rand_like(hr[Buffer.ALBEDO])
    assert judge({1: lr}, {1: change(hr, albedo=hr[Buffer.ALBEDO] + noise)}) is None
    grey = hr[Buffer.ALBEDO].mean(1, keepdim=True).expand(-1, 3, -1, -1)
    assert judge({1: lr}, {1: change(hr, albedo=grey)}) is None
    dull = change(hr, albedo=grey)
    assert judge({1: keep(dull, 4, (1, 2))}, {1: dull}) is None
    assert judge({1: change(lr, albedo=keep(dull, 4, (1, 2))[Buffer.ALBEDO])}, {1: hr}) is None


@pytest.mark.parametrize("order", [(1, 2, 0), (2, 0, 1), (2, 1, 0), (0, 2, 1), (1, 0, 2)])
def test_every_other_order_of_the_channels_of_one_size_is_named(order: tuple[int, ...]) -> None:
    hr = render()
    lr = keep(hr, 4, (1, 2))
    back = [order.index(channel) for channel in range(3)]
    by_hr = judge({1: lr}, {1: change(hr, albedo=hr[Buffer.ALBEDO][:, list(order)])})
    by_lr = judge({1: change(lr, albedo=lr[Buffer.ALBEDO][:, back])}, {1: hr})
    assert by_hr is not None
    assert by_hr == by_lr
    said = ", ".join("RGB"[channel] for channel in order)
    assert f"its R, G, B hold {said} of LR" in by_hr.looks


@pytest.mark.parametrize("axes", ["x", "y", "z", "x, z", "x, y, z"])
@pytest.mark.parametrize("name", ["normal", "geonormal"])
def test_normals_of_one_size_that_are_negated_are_named(axes: str, name: str) -> None:
    ids = render()[Buffer.OBJECT_ID][0, 0].long()
    vectors = F.normalize(torch.randn(3, 12), dim=0)[:, ids][None]
    hr = change(render(), **{name: vectors})
    lr = keep(hr, 4, (1, 2))
    assert judge({1: lr}, {1: hr}) is None
    signs = torch.tensor([-1.0 if axis in axes else 1.0 for axis in "xyz"]).view(1, 3, 1, 1)
    found = judge({1: lr}, {1: change(hr, **{name: vectors * signs})})
    assert found is not None
    assert found.looks == f"negated in {axes} of {name}"
    assert f"write {name} alike at both sizes" in found.remedy


@pytest.mark.parametrize(("order", "said"), [((0, 2, 1), "x, z, y"), ((1, 2, 0), "y, z, x")])
def test_normals_of_one_size_whose_axes_are_swapped_are_named(
    order: tuple[int, ...], said: str
) -> None:
    torch.manual_seed(5)
    normal = F.normalize(torch.randn(1, 3, 1, 12)[..., render()[Buffer.OBJECT_ID][0, 0].long()])
    hr = change(render(), normal=normal.view(1, 3, *SIZE))
    lr = keep(hr, 4, (1, 2))
    found = judge({1: lr}, {1: change(hr, normal=hr[Buffer.NORMAL][:, list(order)])})
    assert found is not None
    assert f"of a world of other axes in normal (its x, y, z hold {said} of LR)" in found.looks


def test_normals_that_differ_for_another_reason_are_not_called_negated() -> None:
    hr = change(render(), normal=F.normalize(torch.randn(1, 3, *SIZE), dim=1))
    lr = keep(hr, 4, (1, 2))
    other = F.normalize(torch.tensor([0.3, 0.5, 0.8]), dim=0).view(1, 3, 1, 1)
    found = judge({1: lr}, {1: change(hr, normal=other.expand(1, 3, *SIZE).clone())})
    assert found is None or not found.looks


@pytest.mark.parametrize("ahead", [1, -1])
def test_frames_of_another_moment_are_named(ahead: int) -> None:
    lr = {n: keep(render(n), 4, (2, 2)) for n in (1, 2, 3)}
    found = judge(lr, {n: render(n + ahead) for n in (1, 2, 3)})
    assert found is not None
    assert f"HR frame {2 - ahead} fits LR frame 2" in found.looks
    assert "number the files of both sizes alike" in found.remedy


@pytest.mark.parametrize("doubted", [(1, 5), (2, 4, 5)])
def test_lr_files_that_are_exchanged_are_named(doubted: tuple[int, ...]) -> None:
    lr = {n: keep(render(n), 4, (2, 2)) for n in (1, 2, 3, 4, 5)}
    hr = {n: render(n) for n in lr}
    kept = dict(lr)
    assert judge(lr, hr) is None
    for one, other in zip(doubted, (*doubted[1:], doubted[0]), strict=True):
        lr[one] = kept[other]
    found = find_misfit(lr.__getitem__, hr.__getitem__, sorted(lr), 4, stored=hr, doubted=doubted)
    assert found is not None
    shown = dict(zip(doubted, (*doubted[1:], doubted[0]), strict=True))[found.frame]
    assert f"HR frame {shown} fits LR frame {found.frame}" in found.looks
    assert found.frames == doubted


@pytest.mark.parametrize("wrong", [1, 2, 5])
def test_a_single_file_of_another_moment_refuses_its_own_frame_alone(wrong: int) -> None:
    lr = {n: keep(render(n), 4, (2, 2)) for n in range(1, 16)}
    hr = {n: render(n) for n in lr}
    # as far from it as frames that are looked at lie
    far = 15 if wrong < 8 else 1
    hr[wrong] = hr[far]
    assert judge(lr, hr) is None
    doubted = () if wrong in (1, 15) else (wrong,)
    refused = find_misfit(
        lr.__getitem__, hr.__getitem__, sorted(lr), 4, stored=hr, doubted=doubted, singly=False
    )
    assert refused is not None
    assert refused.frames == (wrong,)
    own = lr[wrong], hr[wrong]
    found = find_other_moment(lr.__getitem__, hr.__getitem__, wrong, 4, own=own, stored=lr.keys())
    assert found is not None
    assert f"HR frame {wrong} fits LR frame {far}" in found.looks


def test_a_single_frame_is_held_against_those_around_it_both_ways() -> None:
    lr = {n: keep(render(n), 4, (2, 2)) for n in (1, 2, 3, 4)}
    hr = {n: render(n) for n in lr}

    def find(number: int) -> Misfit | None:
        own = lr[number], hr[number]
        return find_other_moment(
            lr.__getitem__, hr.__getitem__, number, 4, own=own, stored=lr.keys()
        )

    assert [find(n) for n in lr] == [None] * 4
    right = hr[2]
    hr[2] = hr[3]
    found = find(2)
    assert found is not None
    assert "HR frame 2 fits LR frame 3" in found.looks
    assert find(3) is None
    # boxes that came round to about the same places: nothing is unlike
    hr[2] = render(40)
    assert find(2) is None
    hr[2], lr[2] = right, lr[1]
    found = find(2)
    assert found is not None
    assert "HR frame 1 fits LR frame 2" in found.looks


@pytest.mark.parametrize("without", [(), (Buffer.DEPTH,)])
def test_a_frame_of_no_moment_of_the_sequence_is_found_by_what_both_sizes_hold(
    without: tuple[Buffer, ...],
) -> None:
    kept = {Buffer.DEPTH, Buffer.OBJECT_ID} - {*without}
    hr = {n: render(4 * n).only(kept) for n in (1, 2, 3)}
    lr = {n: keep(frame, 2, (n % 2, 1)) for n, frame in hr.items()}
    hr[2] = render(15).only(kept)

    def find(number: int) -> Misfit | None:
        own = lr[number], hr[number]
        return find_other_moment(
            lr.__getitem__, hr.__getitem__, number, 2, own=own, stored=lr.keys()
        )

    assert find(1) is find(3) is None
    found = find(2)
    assert found is not None
    assert f"in {'depth' if not without else 'object_id'}" in found.looks


def test_what_is_made_otherwise_at_one_size_is_of_its_moment() -> None:
    hr = {n: render(n) for n in (1, 2, 3)}
    lr = {n: keep(frame, 2, (1, 1)) for n, frame in hr.items()}
    far = {n: change(frame, depth=frame[Buffer.DEPTH] * 1.3) for n, frame in hr.items()}
    own = lr[2], far[2]
    assert (measure_strays(lr[2].only({Buffer.DEPTH}), far[2], 2) or 0.0) > 0.5
    found = find_other_moment(lr.__getitem__, far.__getitem__, 2, 2, own=own, stored=lr.keys())
    assert found is None


def test_means_of_pixels_movers_and_thin_things_are_of_their_moment() -> None:
    hr = {n: render(n) for n in (1, 2, 3)}
    lr = {}
    for number, frame in hr.items():
        depth = frame[Buffer.DEPTH].clone()
        # a fence between the centres of the LR samples
        depth[..., 8:, ::8] = 2.0
        hr[number] = change(frame, depth=depth)
        lr[number] = change(keep(hr[number], 4, (2, 2)), depth=F.avg_pool2d(depth, 4))
    for number in lr:
        own = lr[number], hr[number]
        found = find_other_moment(
            lr.__getitem__, hr.__getitem__, number, 4, own=own, stored=lr.keys()
        )
        assert found is None


@pytest.mark.parametrize("factor", [2.0, 0.5, 0.02])
@pytest.mark.parametrize("name", ["albedo", "material"])
def test_a_factor_on_the_colours_of_one_size_is_named(factor: float, name: str) -> None:
    colour = render()[Buffer.ALBEDO]
    hr = change(render(), **{name: colour})
    lr = keep(hr, 4, (1, 2))
    found = judge({1: lr}, {1: change(hr, **{name: factor * colour})})
    assert found is not None
    assert f"about {factor:g} x LR in {name}" in found.looks
    assert found.buffer == name
    assert found.factors == pytest.approx((factor,) * 3, rel=0.02)


@pytest.mark.parametrize("factor", [100.0, 0.01, 1000.0, 1 / 0.0254])
def test_depth_of_one_size_in_another_unit_is_named(factor: float) -> None:
    depth = render()[Buffer.DEPTH]
    hr = change(render(), depth=torch.where(depth < SKY_DEPTH_M, 1.003 * factor * depth, depth))
    found = judge({1: keep(render(), 4, (1, 2))}, {1: hr})
    assert found is not None
    assert f"about {factor:.3g} x LR in depth" in found.looks
    assert (found.buffer, found.factors) == (Buffer.DEPTH, pytest.approx((factor,)))


@pytest.mark.parametrize("tint", [(1.0, 2.0, 2.0), (1.0, 1.0, 0.4), (3.0, 0.5, 1.5)])
def test_a_factor_of_each_channel_is_named(tint: tuple[float, ...]) -> None:
    colour = render()[Buffer.ALBEDO]
    lr = keep(render(), 4, (1, 2))
    tinted = colour * torch.tensor(tint).view(1, 3, 1, 1)
    found = judge({1: lr}, {1: change(render(), albedo=tinted)})
    assert found is not None
    said = ", ".join(f"{factor:g}" for factor in tint)
    assert f"about {said} x LR in the R, G, B of albedo" in found.looks
    assert found.factors == pytest.approx(tint, rel=0.02)


@pytest.mark.parametrize("tint", [(1.05, 1.05, 1.05), (1.0, 0.9, 1.1)])
def test_a_few_per_cent_between_the_sizes_are_named(tint: tuple[float, ...]) -> None:
    """So little that most samples are within the tolerance."""
    small = render()
    large = {b: t.repeat_interleave(4, 2).repeat_interleave(4, 3) for b, t in small.items()}
    hr = small.with_buffers(large)
    lr = keep(hr, 4, (1, 2))
    changed = hr[Buffer.ALBEDO] * torch.tensor(tint).view(1, 3, 1, 1)
    found = judge({1: lr}, {1: change(hr, albedo=changed)})
    assert found is not None
    assert "x LR in" in found.looks
    assert found.factors == pytest.approx(tint, rel=0.01)


def test_colours_that_no_factor_makes_alike_have_none() -> None:
    hr = render()
    lr = keep(hr, 4, (1, 2))
    offset = change(hr, albedo=0.5 + 0.5 * hr[Buffer.ALBEDO])
    found = judge({1: lr}, {1: offset})
    assert found is None or not found.factors
    assert measure_factor(lr[Buffer.ALBEDO], hr[Buffer.ALBEDO], 4) is None


def test_textures_that_fit_the_next_frame_better_name_no_moment() -> None:
    """Between pixel centres, what is finer than HR pixels may do so."""
    own = change(render(), albedo=torch.rand(1, 3, *SIZE))
    other = change(render(), albedo=render()[Buffer.ALBEDO])
    lr = keep(render(), 4, (2, 2))
    assert (measure_strays(lr, own, 4) or 0.0) > 0.03
    assert measure_strays(lr, other, 4) == 0.0
    assert judge({1: lr}, {1: own, 2: other}) is None


def test_a_buffer_that_is_wrong_at_one_size_is_no_other_picture() -> None:
    hr = render()
    lr = keep(hr, 4, (2, 2))
    for name in ("albedo", "depth"):
        bare = change(hr, **{name: torch.zeros_like(hr[Buffer(name)])})
        assert (measure_strays(lr, bare, 4) or 0.0) > FEW_STRAYS
        assert judge({1: lr}, {1: bare}) is None
    noise = torch.rand_like(hr[Buffer.ALBEDO])
    assert judge({1: lr}, {1: change(hr, albedo=noise), 2: render(1)}) is None


def test_pictures_of_other_scenes_are_doubted_and_not_explained() -> None:
    hr = render()
    shuffled = torch.randperm(SIZE[0] * SIZE[1])
    other = {b: t.flatten(2)[..., shuffled].reshape(t.shape) + 20 for b, t in hr.items()}
    found = judge({1: keep(hr, 4, (2, 2))}, {1: hr.with_buffers(other)})
    assert found is not None
    assert found.looks == ""
    assert found.strays > MOST_STRAYS


def test_bad_values_and_sky_tell_nothing() -> None:
    hr = render()
    holes = hr[Buffer.DEPTH].clone()
    holes[..., 10:20, 10:30] = torch.nan
    lr = keep(hr, 4, (2, 2))
    assert judge({1: keep(change(hr, depth=holes), 4, (2, 2))}, {1: hr}) is None
    sky = torch.full_like(hr[Buffer.DEPTH], SKY_DEPTH_M)
    assert measure_strays(keep(change(hr, depth=sky), 4, (2, 2)), hr, 4) is None
    assert measure_strays(lr, change(hr, depth=sky), 4) == pytest.approx(1 / 3)


def test_what_cannot_be_read_is_left_to_who_reads_it() -> None:
    def fail(number: int) -> GBuffer:
        raise FrameFolderError(f"frame {number} is damaged")

    lr = keep(render(), 4, (2, 2))
    assert find_misfit(lambda number: lr, fail, [1], 4, stored=[1]) is None


def test_frames_that_misfit_alike_are_named_among_those_looked_at() -> None:
    hr = {n: render(n) for n in (1, 2, 3, 4, 5)}
    lr = {n: keep(image, 4, (2, 2)) for n, image in hr.items()}
    dims = TURNED["upside down"]
    every = judge(lr, {n: flip(image, dims) for n, image in hr.items()})
    assert every is not None
    assert every.where == "all frames looked at (1, 3, 5)"
    some = judge(lr, {n: flip(image, dims) if n in (3, 5) else image for n, image in hr.items()})
    assert some is not None
    assert some.frames == (3, 5)
    assert some.where == "frames 3, 5 (of frames 1, 3, 5, which were looked at)"
    mixed = {n: flip(image, dims if n == 3 else (-1,)) for n, image in hr.items()}
    one = judge(lr, mixed)
    assert one is not None
    assert one.where == "frame 3 (of frames 1, 3, 5, which were looked at)"
    alone = judge({3: lr[3]}, {3: flip(hr[3], dims)})
    assert alone is not None
    assert alone.where == "frame 3"


@pytest.mark.parametrize("buffer", [Buffer.DEPTH, Buffer.OBJECT_ID])
def test_of_large_frames_some_samples_tell_as_much_as_all(
    monkeypatch: pytest.MonkeyPatch, buffer: Buffer
) -> None:
    size, scale = (192, 256), 2
    # whole numbers that grow, so that a sample fits the pixels of its own block alone
    small = torch.arange(size[0] * size[1], dtype=torch.float32).view(1, 1, *size) + 1.0
    large = small.repeat_interleave(scale, 2).repeat_interleave(scale, 3)
    wrong = large.clone()
    wrong[..., : size[0] * scale // 4, :] = 60000.0
    lr = GBuffer({buffer: small}, "")
    for seen, share in ((large, 0.0), (wrong, 0.25)):
        found = []
        for enough in (1 << 10, 1 << 30):
            monkeypatch.setattr(pair_agreement, "ENOUGH_SAMPLES", enough)
            found.append(measure_strays_of(buffer, small, seen, lr, scale))
        assert found == pytest.approx([share, share], abs=0.02)
