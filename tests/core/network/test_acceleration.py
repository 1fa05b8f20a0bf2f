"""Networks for inference are the same function as built."""

from __future__ import annotations

import torch
from torch import nn

from rtsr_cli.core.network.acceleration import accelerate_network
from rtsr_cli.core.network.blocks import (
    InvertedResidual,
    make_conv3,
    make_normalised_conv3,
    make_separable_conv,
)


def network() -> nn.Module:
    """Every block with a batch norm, its statistics and weights at random."""
    torch.manual_seed(5)
    layers = nn.Sequential(
        make_normalised_conv3(3, 16),
        make_separable_conv(16, 8),
        InvertedResidual(8),
        nn.BatchNorm2d(8),
        make_conv3(8, 4),
    )
    for module in layers.modules():
        if isinstance(module, nn.BatchNorm2d):
            for tensor, low, high in (
                (module.running_mean, -0.5, 0.5),
                (module.running_var, 0.3, 3.0),
                (module.weight.data, 0.3, 2.0),
                (module.bias.data, -0.5, 0.5),
            ):
                assert tensor is not None
                tensor.uniform_(low, high)
    return layers


def test_outputs_are_equal_within_rounding() -> None:
    slow, image = network().eval(), torch.rand(2, 3, 9, 11)
    with torch.inference_mode():
        expected, found = slow(image), accelerate_network(slow)(image)
    assert float((found - expected).abs().max() / expected.abs().max()) < 1e-5


def test_batch_norms_go_where_a_convolution_stands_before_them() -> None:
    left = [m for m in accelerate_network(network()).modules() if isinstance(m, nn.BatchNorm2d)]
    # the one that follows a block, not a layer
    assert len(left) == 1


def test_weights_are_frozen_and_have_their_channels_last() -> None:
    fast = accelerate_network(network())
    assert not fast.training
    assert not any(p.requires_grad for p in fast.parameters())
    assert all(
        m.weight.is_contiguous(memory_format=torch.channels_last)
        for m in fast.modules()
        if isinstance(m, nn.Conv2d)
    )


def test_the_network_itself_is_left_as_it_was() -> None:
    built = network()
    before = {name: tensor.clone() for name, tensor in built.state_dict().items()}
    accelerate_network(built)
    assert built.training
    after = built.state_dict()
    assert before.keys() == after.keys()
    assert all(torch.equal(tensor, after[name]) for name, tensor in before.items())
