from __future__ import annotations

import pytest
import torch

from rtsr_cli.core.errors import MissingBufferError, ShapeMismatchError
from rtsr_cli.core.frames.buffers import (
    BUFFER_SPECS,
    RADIANCE_BUFFERS,
    SKY_DEPTH_M,
    Buffer,
    GBuffer,
    Resampling,
    sky_mask,
)

WHERE = "shots/a, frame 7"


@pytest.fixture
def gbuffer() -> GBuffer:
    """Depth counts 0 to 11, colour is 100, 200, 300 plus that."""
    depth = torch.arange(12.0).view(1, 1, 3, 4)
    color = depth + torch.tensor([100.0, 200.0, 300.0]).view(1, 3, 1, 1)
    return GBuffer({Buffer.COLOR: color, Buffer.DEPTH: depth}, WHERE)


def test_a_missing_buffer_is_named_with_the_frame_and_what_is_there(gbuffer: GBuffer) -> None:
    with pytest.raises(MissingBufferError) as caught:
        gbuffer[Buffer.NORMAL]
    message = str(caught.value)
    assert message.startswith(WHERE)
    assert "'normal' is missing" in message
    assert "color, depth" in message


def test_an_empty_gbuffer_says_that_it_holds_nothing() -> None:
    with pytest.raises(MissingBufferError, match="nothing"):
        GBuffer({}, WHERE)[Buffer.COLOR]


def test_two_sizes_are_refused_with_both_buffers_as_width_by_height() -> None:
    buffers = {Buffer.COLOR: torch.zeros(1, 3, 2, 5), Buffer.DEPTH: torch.zeros(1, 1, 2, 4)}
    with pytest.raises(ShapeMismatchError) as caught:
        GBuffer(buffers, WHERE)
    assert WHERE in str(caught.value)
    assert "'color' is 5 x 2" in str(caught.value)
    assert "'depth' is 4 x 2" in str(caught.value)


def test_a_wrong_channel_count_is_refused_with_both_counts() -> None:
    with pytest.raises(ShapeMismatchError, match="'motion' has 3 channels, expected 2"):
        GBuffer({Buffer.MOTION: torch.zeros(1, 3, 2, 2)}, WHERE)


def test_a_gbuffer_does_not_change_with_the_mapping_it_was_made_of() -> None:
    source = {Buffer.DEPTH: torch.zeros(1, 1, 2, 2)}
    gbuffer = GBuffer(source, WHERE)
    source[Buffer.NOV] = torch.zeros(1, 1, 2, 2)
    assert list(gbuffer) == [Buffer.DEPTH]


def test_buffers_cannot_be_put_into_a_gbuffer(gbuffer: GBuffer) -> None:
    with pytest.raises(TypeError):
        gbuffer.buffers[Buffer.NOV] = torch.zeros(1, 1, 3, 4)  # type: ignore[index]
    with pytest.raises(AttributeError):
        gbuffer.where = "elsewhere"  # type: ignore[misc]


def test_adding_buffers_leaves_the_original_alone(gbuffer: GBuffer) -> None:
    more = gbuffer.with_buffers({Buffer.NOV: torch.ones(1, 1, 3, 4)})
    assert Buffer.NOV in more
    assert Buffer.NOV not in gbuffer
    assert len(gbuffer) == 2


def test_a_crop_keeps_the_named_rows_and_columns(gbuffer: GBuffer) -> None:
    crop = gbuffer.crop(1, 2, (2, 2))
    assert crop.size == (2, 2)
    assert crop[Buffer.DEPTH][0, 0].tolist() == [[6.0, 7.0], [10.0, 11.0]]
    assert crop[Buffer.COLOR][0, 2].tolist() == [[306.0, 307.0], [310.0, 311.0]]
    assert crop.where == WHERE


def test_stacking_follows_the_order_asked_for(gbuffer: GBuffer) -> None:
    stacked = gbuffer.stack((Buffer.DEPTH, Buffer.COLOR))
    assert stacked[0, :, 0, 1].tolist() == [1.0, 101.0, 201.0, 301.0]


def test_stacking_a_buffer_that_is_not_there_names_it(gbuffer: GBuffer) -> None:
    with pytest.raises(MissingBufferError, match="'roughness' is missing"):
        gbuffer.stack((Buffer.DEPTH, Buffer.ROUGHNESS))


def test_only_keeps_what_is_there_and_asks_for_no_more(gbuffer: GBuffer) -> None:
    assert list(gbuffer.only((Buffer.DEPTH, Buffer.NORMAL))) == [Buffer.DEPTH]


def test_sky_begins_at_the_largest_half() -> None:
    depth = torch.tensor([0.0, 65503.0, SKY_DEPTH_M, float("inf")]).view(1, 1, 1, 4)
    assert sky_mask(depth).flatten().tolist() == [0.0, 0.0, 1.0, 1.0]


def test_every_buffer_has_a_specification_with_a_name_for_each_channel() -> None:
    assert set(BUFFER_SPECS) == set(Buffer)
    assert all(len(spec.component_names) == spec.channels for spec in BUFFER_SPECS.values())


def test_values_that_a_mean_would_falsify_are_resampled_by_samples() -> None:
    sampled = {b for b, spec in BUFFER_SPECS.items() if spec.resampling is Resampling.SAMPLE}
    assert {Buffer.DEPTH, Buffer.MOTION, Buffer.OBJECT_ID, Buffer.POSITION} <= sampled
    assert not {Buffer.COLOR, Buffer.ALBEDO, Buffer.NORMAL} & sampled


def test_radiance_is_colour_lighting_and_alpha() -> None:
    assert {Buffer.COLOR, Buffer.LIGHTING, Buffer.ALPHA} == RADIANCE_BUFFERS
