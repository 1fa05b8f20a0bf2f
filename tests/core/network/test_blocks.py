"""Blocks that networks are built from."""

from __future__ import annotations

import pytest
import torch
import torch.nn.functional as F
from torch import nn

from rtsr_cli.core.network.blocks import (
    InvertedResidual,
    ResidualBlock,
    continue_borders,
    make_conv3,
    make_normalised_conv3,
    make_separable_conv,
    pixel_unshuffle,
)

BLOCKS = {
    "conv3": (make_conv3(4, 6), (9 * 4 + 1) * 6),
    "normalised": (make_normalised_conv3(4, 6), (9 * 4 + 1) * 6 + 2 * 6),
    "separable": (make_separable_conv(4, 6), 10 * 4 + 5 * 6 + 2 * 6),
    "residual": (ResidualBlock(4), 2 * (9 * 4 + 1) * 4),
    "inverted residual": (InvertedResidual(4), 9 * 4 + 2 * 4 + 4 * 4 + 2 * 4),
}


@pytest.mark.parametrize("name", BLOCKS)
def test_a_block_keeps_the_size_and_has_its_parameters(name: str) -> None:
    block, parameters = BLOCKS[name]
    assert block.eval()(torch.rand(2, 4, 5, 7)).shape[2:] == (5, 7)
    assert sum(p.numel() for p in block.parameters()) == parameters


@pytest.mark.parametrize("block", [ResidualBlock(4), InvertedResidual(4)])
def test_a_block_whose_last_layer_gives_nothing_is_the_identity(block: nn.Module) -> None:
    convolutions = [m for m in block.modules() if isinstance(m, nn.Conv2d)]
    nn.init.zeros_(convolutions[-1].weight)
    if convolutions[-1].bias is not None:
        nn.init.zeros_(convolutions[-1].bias)
    image = torch.rand(1, 4, 5, 6)
    kept = image.clone()
    assert torch.equal(block.eval()(image), image)
    assert torch.equal(image, kept)


@pytest.mark.parametrize("block", [ResidualBlock(4), InvertedResidual(4)])
def test_a_residual_block_passes_gradients_past_its_layers(block: nn.Module) -> None:
    for parameter in block.parameters():
        nn.init.zeros_(parameter)
    image = torch.rand(2, 4, 5, 6, requires_grad=True)
    block(image).sum().backward()
    assert image.grad is not None
    assert torch.equal(image.grad, torch.ones_like(image))


@pytest.mark.parametrize("memory_format", [torch.contiguous_format, torch.channels_last])
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_unshuffling_is_that_of_torch_in_any_format(
    memory_format: torch.memory_format, dtype: torch.dtype
) -> None:
    image = torch.rand(2, 3, 12, 8)
    like = torch.zeros(2, 5, 3, 2, dtype=dtype).to(memory_format=memory_format)
    small = pixel_unshuffle(image, 4, like=like)
    assert torch.equal(small, F.pixel_unshuffle(image, 4).to(dtype))
    assert small.is_contiguous(memory_format=memory_format)


def test_borders_are_repeated_up_to_multiples() -> None:
    image = torch.rand(1, 2, 5, 8)
    larger = continue_borders(image, 4)
    assert larger.shape == (1, 2, 8, 8)
    assert torch.equal(larger[:, :, :5], image)
    assert torch.equal(larger[:, :, 5:], image[:, :, 4:].expand(-1, -1, 3, -1))
    assert continue_borders(larger, 4) is larger
