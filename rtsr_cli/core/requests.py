"""What every request checks; imports no torch, as commands read their defaults from requests."""

from __future__ import annotations

import math
from typing import Any

from rtsr_cli.core.errors import RequestError


def check_ranges(request: Any, **ranges: tuple[float, float]) -> None:
    """Hold numbers of a request to be from the least to the most that they may be.

    Args:
        request: a dataclass; fields that are None are left out.
        ranges: field -> (least, most), `math.inf` where there is no most.

    Raises:
        RequestError: one is not; names it.
    """
    for name, (least, most) in ranges.items():
        value = getattr(request, name)
        if value is not None and not (least <= value <= most and math.isfinite(value)):
            upper = "on" if most == math.inf else f"to {most:g}"
            raise RequestError(f"{name} is {value}: a number from {least:g} {upper}")


def check_shard(shard: tuple[int, int] | None) -> None:
    """Hold a part (i, n) to be one of n.

    Raises:
        RequestError: it is not.
    """
    if shard is not None and not 1 <= shard[0] <= shard[1]:
        raise RequestError(f"shard is {shard[0]}/{shard[1]}: parts go from 1/n to n/n")
