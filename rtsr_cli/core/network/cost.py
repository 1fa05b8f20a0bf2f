"""What a network costs: parameters, and multiply-accumulates of its convolutions.

One multiply-accumulate (MAC) is one multiplication and one addition; biases, norms, activations
and warps are left out, as publications leave them out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import torch
from torch import Tensor, nn

from rtsr_cli.core.errors import ConfigError
from rtsr_cli.core.frames.buffers import BUFFER_SPECS, Buffer, GBuffer
from rtsr_cli.core.frames.camera import CameraMetadata, View
from rtsr_cli.core.frames.sequence import Frame
from rtsr_cli.core.shapes import Size
from rtsr_cli.core.system import FrameWindow, System


def count_parameters(network: nn.Module) -> int:
    """Trained numbers; running statistics of batch norms are none."""
    return sum(parameter.numel() for parameter in network.parameters())


def count_macs(system: System, config: Any, scale: int, lr_size: Size) -> int:
    """Multiply-accumulates of one frame without a state: past frames are encoded anew.

        MAC = output values * input channels / groups * kernel height * kernel width

    Inputs are prepared from a uniform frame; the network then passes shapes alone, unless what it
    does depends on values (`needs_values`).

    Args:
        system: one with a network.
        config: of the system.
        scale: S.
        lr_size: (height, width) of the LR frame.

    Raises:
        ConfigError: the system has no network.
    """
    if system.learning is None:
        raise ConfigError(f"system '{system.name}' has no network")
    network = system.build(config, scale).eval()
    device = "cpu" if getattr(network, "needs_values", False) else "meta"
    network.to(device)
    counted: list[int] = []
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            module.register_forward_hook(_make_counter(counted))
    with torch.inference_mode():
        inputs = system.learning.prepare(config, make_uniform_window(system, scale, lr_size))
        network({name: tensor.to(device) for name, tensor in inputs.items()}, None)
    return sum(counted)


def _make_counter(counted: list[int]) -> Callable[[nn.Conv2d, Any, Tensor], None]:
    """Return a hook that appends a convolution's MACs."""

    def count(convolution: nn.Conv2d, _: Any, output: Tensor) -> None:
        counted.append(output.numel() * convolution.weight[0].numel())

    return count


def make_uniform_window(system: System, scale: int, lr_size: Size) -> FrameWindow:
    """Return a full window of the buffers that a system declares, all of them one."""
    hr_size = (lr_size[0] * scale, lr_size[1] * scale)

    def make_lr(age: int) -> Frame:
        buffers = system.lr_inputs if system.is_rendered(age) else system.unshaded_inputs
        return _make_uniform_frame(-age, buffers, lr_size)

    return FrameWindow(
        lr=tuple(make_lr(age) for age in range(system.history_frames + 1)),
        hr=_make_uniform_frame(0, system.hr_inputs, hr_size) if system.hr_inputs else None,
        scale=scale,
    )


def _make_uniform_frame(number: int, buffers: Iterable[Buffer], size: Size) -> Frame:
    planes = {b: torch.ones(1, BUFFER_SPECS[b].channels, *size) for b in buffers}
    return Frame(
        number=number,
        gbuffer=GBuffer(planes, "uniform"),
        camera=CameraMetadata(),
        view=View(display=size),
    )
