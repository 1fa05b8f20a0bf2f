"""Lighting gathered over frames: what history is worth, and what ends it."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from rtsr_cli.core.frames.buffers import Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.imaging.guided_enlargement import upsample_guided_and_fit
from rtsr_cli.core.imaging.guided_kernel import GuidedSamples
from rtsr_cli.core.lighting.lighting import encode_lighting, guide_window, unalign_image
from rtsr_cli.core.lighting.lighting_history import (
    CarriedLighting,
    EnlargedLighting,
    GatheredLighting,
    HistoryWeights,
    age_worth,
    blend_history,
    carry_history,
    describe_window,
    enlarge_frame,
    find_surface_motion,
    gather_lighting,
    measure_shared_change,
    split_enlarged,
)
from rtsr_cli.core.system import FrameWindow, Tensors

SCALE = 4
HEIGHT, WIDTH = 24, 32
PHASES = ((0, 0), (2, 2), (1, 3), (3, 1))
"""HR pixel of each block that LR samples of successive frames are."""


def pick(image: Tensor, phase: tuple[int, int]) -> Tensor:
    return image[..., phase[1] :: SCALE, phase[0] :: SCALE]


def make_window(
    light: Tensor,
    phase: tuple[int, int] = (2, 2),
    *,
    surface: Tensor | None = None,
    exposure: float = 1.0,
    scale_k: float = 1.0,
    reactive: Tensor | None = None,
    hr_motion: bool = True,
    motion: tuple[float, float] = (0.0, 0.0),
    tilt: Tensor | None = None,
) -> FrameWindow:
    """A wall that faces the camera; `surface` numbers what is on it, `tilt` turns it sideways."""
    plane = torch.ones(1, 1, HEIGHT, WIDTH)
    ids = torch.zeros_like(plane) if surface is None else surface
    normal = torch.zeros(1, 3, HEIGHT, WIDTH)
    normal[:, 2] = 1.0
    if tilt is not None:
        normal = torch.cat([tilt.sin(), 0.0 * plane, tilt.cos()], dim=1)
    hr = {
        Buffer.MATERIAL: 0.5 * torch.ones(1, 3, HEIGHT, WIDTH),
        Buffer.SKY: 0.0 * plane,
        Buffer.NORMAL: normal,
        # what is in front is nearer, too
        Buffer.DEPTH: 4.0 - 2.0 * ids,
        Buffer.OBJECT_ID: (ids + 1).to(torch.int32),
        Buffer.MOTION: torch.tensor(motion).view(1, 2, 1, 1).expand(1, 2, HEIGHT, WIDTH) * 1.0,
    }
    lr = {buffer: pick(tensor, phase) for buffer, tensor in hr.items()}
    lr[Buffer.MOTION] = lr[Buffer.MOTION] / SCALE
    lr[Buffer.LIGHTING] = pick(light, phase) * exposure
    lr[Buffer.LIGHTING_MASK] = torch.ones_like(lr[Buffer.SKY])
    lr[Buffer.COLOR] = lr[Buffer.LIGHTING] * lr[Buffer.MATERIAL]
    if reactive is not None:
        lr[Buffer.REACTIVE] = pick(reactive, phase)
    if not hr_motion:
        del hr[Buffer.MOTION]
    jitter = tuple((p + 0.5) / SCALE - 0.5 for p in phase)

    def frame(buffers: dict[Buffer, Tensor], jitter_px: tuple[float, float]) -> Frame:
        gbuffer = GBuffer(buffers, "wall")
        camera = CameraMetadata(jitter_px=jitter_px, pre_exposure=exposure)
        view = View(display=gbuffer.size)
        return Frame(number=1, gbuffer=gbuffer, camera=camera, view=view, lighting_scale=scale_k)

    return FrameWindow(
        lr=(frame(lr, (jitter[0], jitter[1])),), hr=frame(hr, (0.0, 0.0)), scale=SCALE
    )


def gather(windows: list[FrameWindow], weights: HistoryWeights | None = None) -> GatheredLighting:
    gathered = None
    for window in windows:
        before = None if gathered is None else gathered.history
        gathered = gather_lighting(
            describe_window(window), before, weights or HistoryWeights(), finish=keep_encoded
        )
    assert gathered is not None
    return gathered


def keep_encoded(inputs: Tensors, encoded: Tensor) -> Tensor:
    del inputs
    return encoded


def flat(value: float) -> Tensor:
    return torch.full((1, 3, HEIGHT, WIDTH), value)


def encoded(value: float, scale_k: float = 1.0) -> float:
    return float(encode_lighting(torch.tensor(value), torch.tensor(scale_k)))


def test_a_sample_fits_itself_best() -> None:
    window = make_window(flat(1.0))
    small, large = guide_window(window)
    mask = torch.ones(1, 1, HEIGHT // SCALE, WIDTH // SCALE)
    mask[..., 2, 3] = 0.0
    nothing = torch.zeros(1, 1, HEIGHT, WIDTH)
    _, fit = upsample_guided_and_fit(
        GuidedSamples(
            values=mask, mask=mask, small=small, large=large, scale=SCALE, fallback=nothing
        )
    )
    counted = torch.tensor([[SCALE * y + 2, SCALE * x + 2] for y, x in mask[0, 0].nonzero()])
    torch.testing.assert_close(
        fit[0, 0][counted[:, 0], counted[:, 1]], torch.ones(len(counted)), rtol=0, atol=1e-5
    )
    # exp(-d^2 / (2 s^2)), s = 0.7 LR pixels: one HR pixel away, and a whole block
    assert float(fit[0, 0, 6, 7]) == pytest.approx(0.9382, abs=1e-3)
    assert float(fit[0, 0, 10, 14]) == pytest.approx(0.3604, abs=1e-3)


def test_what_few_samples_hit_is_kept() -> None:
    """A post two pixels wide: samples of two frames are on it, of the last frame none."""
    surface = torch.zeros(1, 1, HEIGHT, WIDTH)
    surface[..., 12:14] = 1.0
    light = torch.where(surface > 0, 4.0, 1.0).expand(1, 3, -1, -1)
    windows = [make_window(light, phase, surface=surface) for phase in PHASES]
    post = unalign_image(windows[-1], gather(windows).encoded)[..., 12:14]
    torch.testing.assert_close(post, torch.full_like(post, encoded(4.0)), rtol=0, atol=0.01)
    alone = unalign_image(windows[-1], gather(windows[-1:]).encoded)[..., 12:14]
    assert float((alone - encoded(4.0)).abs().min()) > 0.5


def test_a_change_of_light_is_followed() -> None:
    """d = e(2) - e(1) everywhere, so that t = 1: c' (h + b d) + n g over c' + n."""
    weights = HistoryWeights(change_spread=0.8)
    first, second = make_window(flat(1.0)), make_window(flat(2.0))
    before = gather([first], weights)
    after = gather([first, second], weights)
    step = encoded(2.0) - encoded(1.0)
    spread = weights.change_spread**2 / (1.0 + weights.change_agreed)
    worth = before.worth * weights.age / (1.0 + step**2 / spread)
    share = worth / (worth + before.worth)
    expected = encoded(2.0) - (1.0 - weights.change) * step * share
    torch.testing.assert_close(after.encoded[:, :1], expected, rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(after.worth, worth + before.worth, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize(
    ("worth", "agreement", "fit", "believed"),
    [
        (1.0, 0.0, 1.0, 1.0),
        (2.0, 0.0, 1.0, 1.0),
        (8.0, 0.0, 1.0, 0.25),
        (8.0, 0.75, 1.0, 0.75),
        (1.0, 0.75, 1.0, 1.0),
        (1.0, 0.0, 0.5, 1.0),
        (1.0, 0.0, 0.25, 0.5),
        (8.0, 0.0, 0.01, 0.005),
        (1.0, 0.5, 0.0, 0.5),
        (1.0, 0.0, 0.0, 0.0),
    ],
)
def test_of_a_change_against_a_settled_history_less_is_believed(
    worth: float, agreement: float, fit: float, believed: float
) -> None:
    """Where this frame is worth nothing: h + b max(min(1, fit / v) min(1, m / c), t) d is shown."""
    one, weights = torch.ones(1, 3, 2, 2), HistoryWeights(change_worth=2.0, change_fit=0.5)
    plane = one[:, :1]
    frame = EnlargedLighting(
        encoded=3.0 * one,
        fit=fit * plane,
        change=0.4 * one,
        seen=plane,
        agreement=agreement * plane,
    )
    history = CarriedLighting(encoded=one, worth=worth * plane)
    shown = blend_history(frame, history, fresh=0.0 * plane, share=0.5, weights=weights)
    torch.testing.assert_close(shown, (1.0 + 0.5 * believed * 0.4) * one)


@pytest.mark.parametrize(("second", "agreement"), [(0.4, 1.0), (0.2, 0.7), (-0.4, 0.0)])
def test_samples_agree_on_what_they_share(second: float, agreement: float) -> None:
    """Two samples of one weight that have changed by 0.4 and by something else."""
    first, other = (value * torch.ones(1, 3, 1, 1) for value in (0.4, second))
    one = torch.ones(1, 1, 1, 1)
    squares = [change.square().mean(1, keepdim=True) for change in (first, other)]
    enlarged = torch.cat([first, 0.5 * (first + other), one, 0.5 * sum(squares)], dim=1)
    found = split_enlarged(enlarged, one)
    torch.testing.assert_close(found.agreement, agreement * one)
    torch.testing.assert_close(found.change, 0.5 * (first + other))
    weights = HistoryWeights(age=1.0, change_agreed=3.0, change_spread=0.5)
    spread = (1.0 + 3.0 * agreement) * float(found.change[0, 0]) ** 2 / 0.25
    torch.testing.assert_close(age_worth(8.0 * one, found, weights), 8.0 / (1.0 + spread) * one)


def test_a_surface_that_was_hidden_takes_the_frame_s_samples() -> None:
    wide, narrow = (torch.zeros(1, 1, HEIGHT, WIDTH) for _ in range(2))
    wide[..., 8:24], narrow[..., 8:16] = 1.0, 1.0
    light = flat(1.0)
    before = make_window(torch.where(wide > 0, 8.0, light), surface=wide)
    now = make_window(torch.where(narrow > 0, 8.0, light), surface=narrow)
    shown = gather([before, now])
    alone = gather([now])
    came_out = (..., slice(None), slice(16, 24))
    torch.testing.assert_close(shown.encoded[came_out], alone.encoded[came_out])
    torch.testing.assert_close(shown.worth[came_out], alone.worth[came_out])


def test_reactive_pixels_take_the_frame_s_samples() -> None:
    noise = torch.rand(1, 3, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(1))
    first = make_window(1.0 + noise)
    now = make_window(flat(3.0), (1, 3), reactive=torch.ones(1, 1, HEIGHT, WIDTH))
    shown, alone = gather([first, now]), gather([now])
    torch.testing.assert_close(shown.encoded, alone.encoded)


@pytest.mark.parametrize("change", [{"exposure": 2.0}, {"scale_k": 3.0}])
def test_exposure_and_k_change_nothing_but_the_unit(change: dict[str, float]) -> None:
    light = 1.0 + torch.rand(1, 3, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(2))
    first = make_window(light, PHASES[0])
    plain = gather([first, make_window(light, PHASES[1])])
    other = gather([first, make_window(light, PHASES[1], **change)])
    exposure = change.get("exposure", 1.0)
    # the same light but for what means of logarithms differ by
    torch.testing.assert_close(
        other.history.lighting / exposure, plain.history.lighting, rtol=0.02, atol=0.0
    )


def test_motion_of_lr_samples_serves_where_hr_has_none() -> None:
    window = make_window(flat(1.0), hr_motion=False, motion=(3.0, -2.0))
    found = find_surface_motion(window)
    expected = torch.tensor([3.0, -2.0]).view(1, 2, 1, 1).expand_as(found)
    torch.testing.assert_close(found, expected)


def test_a_hr_frame_s_own_jitter_is_no_motion() -> None:
    """Two still frames, the second one's HR pixels a pixel to the right on the surface."""
    ramp = torch.linspace(1.0, 3.0, WIDTH).view(1, 1, 1, WIDTH).expand(1, 3, HEIGHT, WIDTH)
    first, second = (make_window(ramp, (2, 2)) for _ in range(2))
    hr = second.require_hr()
    moved = replace(hr, camera=replace(hr.camera, jitter_px=(1.0, 0.0)))
    carried = carry_history(gather([first]).history, describe_window(replace(second, hr=moved)))
    expected = gather([first]).encoded[..., 1:]
    torch.testing.assert_close(carried.encoded[..., :-1], expected, rtol=1e-4, atol=1e-4)


def test_what_left_the_frame_is_not_there_when_it_comes_back() -> None:
    """Everything moves out by half the frame's width: what enters has no history."""
    first = make_window(flat(8.0))
    now = make_window(flat(1.0), motion=(WIDTH / 2.0, 0.0))
    shown, alone = gather([first, now]), gather([now])
    entered = (..., slice(None), slice(WIDTH // 2, None))
    torch.testing.assert_close(shown.encoded[entered], alone.encoded[entered])


def test_what_stands_still_forgets_how_it_began() -> None:
    """What other surfaces say of a pixel must not add up where few frames sample its own.

    Two runs of other first frames see the same still ones, of columns that are turned by 29
    degrees (w is 0.02 at most): they end alike, and shown lighting stays near that which is there.
    """
    torch.manual_seed(5)
    columns = torch.arange(WIDTH).view(1, 1, 1, WIDTH).expand(1, 1, HEIGHT, WIDTH)
    tilt = 0.5 * (columns % 4 == 3)
    light = (1.0 + 2.0 * (tilt > 0)) * torch.rand(1, 3, HEIGHT, WIDTH).mul(1.5).exp()
    phases = [PHASES[i % 4] for i in range(60)]
    still = [make_window(light, phase, tilt=tilt) for phase in phases]
    other = [make_window(4.0 * light.roll(7, -1), PHASES[3], tilt=tilt), *still]
    shown, shown_too = gather(still).encoded, gather(other).encoded
    torch.testing.assert_close(shown, shown_too, rtol=0.0, atol=2e-3)
    brightest = float(encode_lighting(light, torch.ones(1)).max())
    assert float(shown.max()) < 1.05 * brightest


def test_what_one_sample_changed_by_alone_is_its_own() -> None:
    """u is 1 where two others changed as much, 0 where none did, or the other way."""
    change = torch.zeros(1, 3, 6, 12)
    change[..., 1, 1] = 0.3  # alone
    change[..., 1:3, 4:6] = -0.2  # with three others
    change[..., 1, 9], change[..., 1, 10] = 0.4, 0.4  # with one
    change[..., 4, 1], change[..., 4, 2], change[..., 5, 1] = 0.3, -0.3, -0.3  # against two
    shared = measure_shared_change(change)[0, 0]
    assert float(shared[1, 1]) == 0.0
    torch.testing.assert_close(shared[1:3, 4:6], torch.ones(2, 2))
    torch.testing.assert_close(shared[1, 9:11], torch.full((2,), 0.5))
    assert float(shared[4, 1]) == 0.0
    assert float(shared[0].abs().max()) == 0.0


def test_a_pixel_does_not_agree_with_its_own_sample_alone() -> None:
    """A thing of one sample's block: no other sample tells of its pixels."""
    side, scale = 6, 4
    thing, faced = (slice(8, 12), slice(8, 12)), torch.tensor([0.0, 0.0, 1.0]).view(1, 3, 1, 1)
    away = torch.tensor([1.0, 0.0, 0.0]).view(1, 3, 1, 1)
    small, large = faced.repeat(1, 1, side, side), faced.repeat(1, 1, 24, 24)
    small[..., 2:3, 2:3], large[..., thing[0], thing[1]] = away, away
    inputs = {
        "encoded": torch.full((1, 3, side, side), 0.5),
        "mask": torch.ones(1, 1, side, side),
        **{"small_normal": small, "small_depth": torch.ones(1, 1, side, side)},
        **{"normal": large, "depth": torch.ones(1, 1, 24, 24)},
        "cubic": torch.full((1, 3, 24, 24), 0.5),
    }

    def find_agreement(changed: tuple[slice, slice]) -> float:
        history = torch.full((1, 3, 24, 24), 0.5)
        history[..., changed[0], changed[1]] = 0.9
        carried = CarriedLighting(encoded=history, worth=torch.ones(1, 1, 24, 24))
        sample = 2 * scale + scale // 2
        return float(enlarge_frame(inputs, carried).agreement[0, 0, sample, sample])

    assert find_agreement(thing) == 0.0
    assert find_agreement((slice(4, 20), slice(4, 20))) > 0.9
