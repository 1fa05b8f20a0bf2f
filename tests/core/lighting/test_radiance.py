"""Radiance where no lighting times material can be the picture."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from torch import Tensor
from torch.nn.functional import max_pool2d

from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.derivation import DerivationConfig, derive
from rtsr_cli.core.imaging.enlargement import enlarge_radiance
from rtsr_cli.core.imaging.resampling import decimate, sample_jitter
from rtsr_cli.core.lighting.radiance import add_undivided, find_undivided, measure_undivided
from rtsr_cli.core.system import FrameWindow
from rtsr_cli.models import load_system

SIZE = (96, 144)


def scene() -> dict[Buffer, Tensor]:
    """A plane at 4 m, a disc at 2 m before it; material everywhere."""
    torch.manual_seed(3)
    rows, columns = torch.meshgrid(torch.arange(SIZE[0]), torch.arange(SIZE[1]), indexing="ij")
    disc = ((rows - 44) ** 2 + (columns - 70) ** 2 < 900).float().view(1, 1, *SIZE)
    wave = 0.1 * torch.sin(0.07 * columns + 0.05 * rows).view(1, 1, *SIZE)
    normal = torch.zeros(1, 3, *SIZE)
    normal[:, 2:] = 1.0
    material = 0.3 + 0.4 * torch.rand(1, 3, *SIZE)
    material = torch.where(disc > 0, torch.full_like(material, 0.5), material)
    lighting = torch.where(disc > 0, 0.3 + wave, 2.0 + wave)
    return {
        Buffer.COLOR: lighting * material,
        Buffer.MATERIAL: material,
        Buffer.DEPTH: 4.0 - 2.0 * disc,
        Buffer.NORMAL: normal,
        Buffer.OBJECT_ID: disc.to(torch.int32),
    }


def frame(buffers: dict[Buffer, Tensor], jitter_px: tuple[float, float] = (0.0, 0.0)) -> Frame:
    gbuffer = GBuffer(buffers, "made by a test")
    camera = CameraMetadata(jitter_px=jitter_px)
    return Frame(number=1, gbuffer=gbuffer, camera=camera, view=View(display=gbuffer.size))


def window(
    name: str,
    known: dict[Buffer, Tensor],
    *,
    hr: Tensor | None = None,
    lr: Tensor | None = None,
    scale: int = 4,
    offset: tuple[int, int] = (2, 2),
) -> FrameWindow:
    """What a system sees of a capture with the given materials at both sizes."""
    system, config = load_system(name), DerivationConfig()
    large = dict(known)
    material = known[Buffer.MATERIAL]
    small = {**known, Buffer.MATERIAL: material if lr is None else lr}
    jitter_px = (sample_jitter(offset[0], scale), sample_jitter(offset[1], scale))
    lr_frame = frame({b: decimate(t, scale, offset) for b, t in small.items()}, jitter_px)
    del large[Buffer.COLOR]
    large[Buffer.MATERIAL] = material if hr is None else hr

    def derived(made: Frame, needs: tuple[Buffer, ...], optional: tuple[Buffer, ...]) -> Frame:
        return derive(made, {*needs, *(b for b in optional if b in made.gbuffer)}, config)

    return FrameWindow(
        lr=(derived(lr_frame, system.lr_inputs, system.lr_optional),),
        hr=derived(frame(large), system.hr_inputs, system.hr_optional),
        scale=scale,
    )


def predict(name: str, seen: FrameWindow) -> Tensor:
    system = load_system(name)
    image = system.predict(system.build(system.config(), seen.scale), seen, None).image
    assert image is not None
    return image


def squared_error(image: Tensor, truth: Tensor, where: Tensor) -> float:
    return float(((image - truth) ** 2).mean(1, keepdim=True)[where].mean())


def bicubic(seen: FrameWindow) -> Tensor:
    color = seen.current.gbuffer[Buffer.COLOR]
    return enlarge_radiance(color, seen.scale, seen.current.camera.jitter_px)


def inside(mask: Tensor, reach: int = 16) -> Tensor:
    """Pixels of a mask that no kernel sees its border from."""
    return -max_pool2d(-mask.float(), 2 * reach + 1, stride=1, padding=reach) > 0.5


SYSTEMS = ["demod-bicubic", "demod-guided"]


def zero(material: Tensor, where: Tensor) -> Tensor:
    return torch.where(where, torch.zeros_like(material), material)


@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize(
    ("scale", "offset"), [(4, (2, 2)), (4, (0, 3)), (3, (1, 1)), (2, (1, 0)), (8, (5, 2))]
)
@pytest.mark.parametrize("size", ["both", "hr", "lr"])
def test_a_surface_whose_material_is_0_is_never_worse_than_bicubic(
    name: str, scale: int, offset: tuple[int, int], size: str
) -> None:
    known = scene()
    disc = known[Buffer.OBJECT_ID] == 1
    gone = zero(known[Buffer.MATERIAL], disc)
    hr, lr = (None if size == "lr" else gone), (None if size == "hr" else gone)
    seen = window(name, known, hr=hr, lr=lr, scale=scale, offset=offset)
    image = predict(name, seen)
    truth = known[Buffer.COLOR]
    assert float(image[inside(disc).expand_as(image)].amin()) > 0.05
    assert squared_error(image, truth, disc) <= squared_error(bicubic(seen), truth, disc) * 1.00001


@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize("value", [0.0, float("nan")])
@pytest.mark.parametrize("size", ["both", "hr", "lr"])
def test_undivided_pixels_are_those_that_bicubic_writes(name: str, value: float, size: str) -> None:
    """Highlights that no sample saw, and dark surfaces around: nothing else is never worse."""
    known = scene()
    disc = known[Buffer.OBJECT_ID] == 1
    known[Buffer.COLOR][..., 1::16, 1::16] = 40.0
    gone = torch.where(disc, torch.tensor(value), known[Buffer.MATERIAL])
    hr, lr = (None if size == "lr" else gone), (None if size == "hr" else gone)
    seen = window(name, known, hr=hr, lr=lr)
    found = find_undivided(seen)
    assert found is not None
    assert found[disc].all()
    where = found.expand(-1, 3, -1, -1)
    assert torch.equal(predict(name, seen)[where], bicubic(seen)[where])


CHANNELS = [0.0, 1e-4, float("nan")]


@pytest.mark.parametrize("value", CHANNELS)
@pytest.mark.parametrize("channel", [0, 1, 2])
def test_one_channel_without_material_makes_a_pixel_undivided(value: float, channel: int) -> None:
    known = scene()
    material = known[Buffer.MATERIAL].clone()
    material[:, channel, 30:60, 40:90] = value
    known[Buffer.COLOR][:, channel, 30:60, 40:90] = 1.0
    seen = window("demod-guided", known, hr=material, lr=material)
    found = find_undivided(seen)
    assert found is not None
    assert found[..., 30:60, 40:90].all()
    assert int(found.sum()) == 30 * 50
    image = predict("demod-guided", seen)
    assert torch.allclose(image[:, channel, 40:50, 52:80], torch.ones(()), atol=1e-3)


@pytest.mark.parametrize("name", SYSTEMS)
def test_frames_whose_material_carries_everything_keep_their_pixels(name: str) -> None:
    seen = window(name, scene())
    assert find_undivided(seen) is None
    assert measure_undivided(seen) == 0.0
    image = torch.rand(1, 3, *SIZE)
    assert add_undivided(seen, image) is image


def noise(known: dict[Buffer, Tensor]) -> Tensor:
    return torch.rand_like(known[Buffer.COLOR])


def halves(known: dict[Buffer, Tensor]) -> Tensor:
    return torch.where(known[Buffer.OBJECT_ID] == 1, 0.1, 5.0).expand(1, 3, -1, -1).clone()


def disc(known: dict[Buffer, Tensor]) -> Tensor:
    return known[Buffer.OBJECT_ID] == 1


def stripes(known: dict[Buffer, Tensor]) -> Tensor:
    mask = torch.zeros_like(known[Buffer.OBJECT_ID], dtype=torch.bool)
    mask[..., ::5] = True
    return mask


def specks(known: dict[Buffer, Tensor]) -> Tensor:
    return torch.rand(1, 1, *known[Buffer.COLOR].shape[-2:]) < 0.02


def everything(known: dict[Buffer, Tensor]) -> Tensor:
    return torch.ones_like(known[Buffer.OBJECT_ID], dtype=torch.bool)


@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize("light", [noise, halves])
@pytest.mark.parametrize("where", [disc, stripes, specks, everything])
def test_no_content_makes_it_worse_than_bicubic(
    name: str,
    light: Callable[[dict[Buffer, Tensor]], Tensor],
    where: Callable[[dict[Buffer, Tensor]], Tensor],
) -> None:
    known = scene()
    known[Buffer.COLOR] = light(known)
    mask = where(known)
    gone = zero(known[Buffer.MATERIAL], mask)
    seen = window(name, known, hr=gone, lr=gone, offset=(1, 3))
    truth = known[Buffer.COLOR]
    ours, plain = (squared_error(i, truth, mask) for i in (predict(name, seen), bicubic(seen)))
    assert ours <= plain * 1.00001


def test_a_lamp_without_material_keeps_the_detail_of_its_emission() -> None:
    known = scene()
    lamp = known[Buffer.OBJECT_ID] == 1
    emission = torch.where(lamp, 4.0 * torch.rand(1, 3, *SIZE), torch.zeros(1, 3, *SIZE))
    known[Buffer.EMISSION] = emission
    known[Buffer.COLOR] = torch.where(lamp, emission, known[Buffer.COLOR])
    gone = zero(known[Buffer.MATERIAL], lamp)
    image = predict("demod-guided", window("demod-guided", known, hr=gone, lr=gone))
    own = inside(lamp).expand_as(image)
    assert torch.allclose(image[own], emission[own], atol=1e-4)


def test_emission_that_lr_frames_do_not_name_is_not_counted_twice() -> None:
    known = scene()
    lamp = known[Buffer.OBJECT_ID] == 1
    emission = torch.where(lamp, torch.full((1, 3, *SIZE), 4.0), torch.zeros(1, 3, *SIZE))
    known[Buffer.COLOR] = torch.where(lamp, emission + 0.5, known[Buffer.COLOR])
    gone = zero(known[Buffer.MATERIAL], lamp)
    seen = window("demod-guided", {**known, Buffer.EMISSION: emission}, hr=gone, lr=gone)
    lr = seen.current.gbuffer
    without = GBuffer({b: t for b, t in lr.items() if b is not Buffer.EMISSION}, "made by a test")
    seen = FrameWindow(
        lr=(Frame(number=1, gbuffer=without, camera=seen.current.camera, view=seen.current.view),),
        hr=seen.hr,
        scale=4,
    )
    image = predict("demod-guided", seen)
    assert torch.allclose(image[..., 36:52, 62:78], torch.tensor(4.5), atol=1e-2)


def test_the_share_is_that_of_the_pixels() -> None:
    known = scene()
    gone = known[Buffer.MATERIAL].clone()
    gone[..., :24, :36] = 0.0
    seen = window("demod-guided", known, hr=gone, lr=gone)
    assert measure_undivided(seen) == pytest.approx(1 / 16)


def with_lamp() -> tuple[dict[Buffer, Tensor], Tensor]:
    """The disc is a lamp before the wall."""
    known = scene()
    lamp = known[Buffer.OBJECT_ID] == 1
    known[Buffer.EMISSION] = torch.where(lamp, torch.tensor(4.0), torch.zeros(1, 3, *SIZE))
    known[Buffer.COLOR] = torch.where(lamp, known[Buffer.EMISSION], known[Buffer.COLOR])
    return known, lamp


def test_a_lamp_whose_radiance_is_its_emission_is_no_fault() -> None:
    known, lamp = with_lamp()
    gone = zero(known[Buffer.MATERIAL], lamp)
    assert measure_undivided(window("demod-guided", known, hr=gone, lr=gone)) == 0.0
    # one that reflects light as well is
    known[Buffer.COLOR] = known[Buffer.COLOR] + 2.0 * lamp
    share = measure_undivided(window("demod-guided", known, hr=gone, lr=gone))
    assert share == pytest.approx(float(lamp.float().mean()), rel=0.05)


def test_what_is_dark_without_material_is_no_fault() -> None:
    known = scene()
    hole = known[Buffer.OBJECT_ID] == 1
    known[Buffer.COLOR] = known[Buffer.COLOR].masked_fill(hole, 0.0)
    gone = zero(known[Buffer.MATERIAL], hole)
    assert measure_undivided(window("demod-guided", known, hr=gone, lr=gone)) == 0.0


def test_a_lit_surface_beside_a_lamp_is_enlarged_with_its_light() -> None:
    """Its material is lost at HR; samples of it were divided, and lamps beside were not."""
    known, lamp = with_lamp()
    gone = zero(known[Buffer.MATERIAL], lamp)
    nothing = torch.zeros_like(gone)
    seen = window("demod-guided", known, hr=nothing, lr=gone)
    image = predict("demod-guided", seen)
    beside = (max_pool2d(lamp.float(), 17, 1, 8) > 0.5) & ~lamp
    other = beside.expand_as(image)
    plain = bicubic(seen)
    emitting = (seen.require_hr().gbuffer[Buffer.EMISSION] > 0.0).any(1, keepdim=True)
    assert not bool((emitting & beside).any())
    assert torch.allclose(image[other], plain[other], atol=1e-5)


def test_what_hangs_before_a_lamp_is_no_dark_part_of_it() -> None:
    """A wire without material, between the samples: what is enlarged there is not emission."""
    known, lamp = with_lamp()
    seen = dict(known)
    wire = torch.zeros_like(lamp)
    wire[..., 30:58, 71:73] = True
    seen[Buffer.EMISSION] = known[Buffer.EMISSION].masked_fill(wire, 0.0)
    gone = zero(known[Buffer.MATERIAL], lamp)
    for depth, wanted in ((1.0, 4.0), (2.0, 0.0)):
        seen[Buffer.DEPTH] = known[Buffer.DEPTH].masked_fill(wire, depth)
        made = window("demod-guided", seen, hr=gone, lr=gone)
        image = predict("demod-guided", made)
        found = image[wire.expand_as(image)]
        torch.testing.assert_close(found, torch.full_like(found, wanted), atol=1e-3, rtol=0.0)
