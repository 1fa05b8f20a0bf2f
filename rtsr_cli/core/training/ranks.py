"""Several processes that train one network: who this one is, and what they tell each other.

`torchrun` starts them and says by RANK, WORLD_SIZE and LOCAL_RANK which is which. Every process
computes the gradient of its own samples; their mean is everyone's, so that weights stay equal and
N processes with batch B make the step of one with batch N B. Batches are normalised by each
process' own statistics; the running ones, like all buffers, are the mean of everyone's. The first
process alone writes files and talks.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta

import torch
import torch.distributed as dist
from torch import nn

from rtsr_cli.core.errors import ConfigError

PATIENCE = timedelta(hours=2)
"""How long a process waits for the others: one may still decode frames, or judge them."""


@dataclass(frozen=True)
class ProcessRanks:
    """This process among those that train together.

    Attributes:
        rank: from 0.
        count: of processes.
    """

    rank: int = 0
    count: int = 1

    @property
    def first(self) -> bool:
        """Tell whether this process is the one that writes."""
        return self.rank == 0

    def share(self, number: int) -> bool:
        """Tell whether item `number` of a list is this process' work."""
        return number % self.count == self.rank

    def average_gradients(self, network: nn.Module) -> None:
        """Replace every gradient by its mean over the processes."""
        if self.count == 1:
            return
        for parameter in network.parameters():
            if parameter.requires_grad:
                if parameter.grad is None:
                    parameter.grad = torch.zeros_like(parameter)
                dist.all_reduce(parameter.grad)
                parameter.grad /= self.count

    def average_buffers(self, network: nn.Module) -> None:
        """Replace every statistic that is no parameter by its mean over the processes."""
        buffers = [buffer for buffer in network.buffers() if buffer.is_floating_point()]
        if self.count == 1 or not buffers:
            return
        together = torch.cat([buffer.detach().flatten().float() for buffer in buffers])
        dist.all_reduce(together)
        together /= self.count
        start = 0
        for buffer in buffers:
            buffer.copy_(together[start : start + buffer.numel()].view_as(buffer))
            start += buffer.numel()

    def any(self, here: bool, device: torch.device) -> bool:
        """Tell whether something is true of any process."""
        if self.count == 1:
            return here
        flag = torch.tensor([float(here)], device=device)
        dist.all_reduce(flag)
        return bool(flag.item())

    def mean(self, values: Iterable[float], device: torch.device) -> list[float]:
        """Means over the processes."""
        listed = list(values)
        if self.count == 1:
            return listed
        tensor = torch.tensor(listed, dtype=torch.float64, device=device)
        dist.all_reduce(tensor)
        return [float(value) for value in tensor / self.count]

    def wait(self) -> None:
        """Wait until every process is here."""
        if self.count > 1:
            dist.barrier()


ALONE = ProcessRanks()


def resolve_local_device(name: str) -> str:
    """Device of this process: the GPU of its number where `cuda` is meant."""
    number = os.environ.get("LOCAL_RANK")
    return f"cuda:{number}" if name == "cuda" and number is not None else name


@contextmanager
def join_processes(device: torch.device) -> Iterator[ProcessRanks]:
    """Join the processes that torchrun started; without it this one is alone.

    Raises:
        ConfigError: the others cannot be reached.
    """
    count = int(os.environ.get("WORLD_SIZE", "1"))
    if count == 1:
        yield ALONE
        return
    if device.type == "cuda":
        torch.cuda.set_device(device)
    try:
        dist.init_process_group("nccl" if device.type == "cuda" else "gloo", timeout=PATIENCE)
    except (RuntimeError, ValueError) as error:
        raise ConfigError(
            f"the {count} processes of this run cannot reach each other ({error}); start them with "
            "torchrun"
        ) from error
    try:
        yield ProcessRanks(dist.get_rank(), count)
    finally:
        dist.destroy_process_group()
