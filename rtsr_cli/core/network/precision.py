"""Number formats of networks, and which one a device computes in."""

from __future__ import annotations

from pathlib import Path

import torch

from rtsr_cli.core.choices import Precision

DTYPES = {Precision.BF16: torch.bfloat16, Precision.FP16: torch.float16}


def resolve_precision(wanted: Precision, device: torch.device) -> Precision:
    """Resolve `auto`: the half format that the device has instructions for, else float32."""
    if wanted is not Precision.AUTO:
        return wanted
    if device.type == "cuda":
        return Precision.BF16 if torch.cuda.is_bf16_supported() else Precision.FP16
    return Precision.BF16 if device.type == "cpu" and has_bf16_instructions() else Precision.FP32


def has_bf16_instructions() -> bool:
    """Tell whether this processor has bf16 instructions; without them bf16 is slower."""
    try:
        flags = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="ignore")
    except OSError:
        return False
    return "avx512_bf16" in flags or "amx_bf16" in flags
