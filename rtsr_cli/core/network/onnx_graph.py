"""A graph of a network, computed by onnxruntime from an exported file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from rtsr_cli.core.errors import CheckpointError, ConfigError
from rtsr_cli.core.system import Tensors

QUIET = 3
"""Level of onnxruntime's log: errors alone, which are raised anyway."""

TYPES = {"tensor(float)": torch.float32, "tensor(float16)": torch.float16}


def import_onnxruntime() -> Any:
    """Import the library of the extra `export`.

    Raises:
        ConfigError: it is not installed; says how it gets there.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise ConfigError("onnxruntime is not installed: pip install 'rtsr[export]'") from error
    return onnxruntime


class OnnxGraph:
    """An exported file as the function that it stands for, on the processor."""

    def __init__(self, source: Path | bytes) -> None:
        """Load a file, or what one holds.

        Args:
            source: path, or content.

        Raises:
            ConfigError: onnxruntime is not installed.
            CheckpointError: it takes no such file.
        """
        runtime = import_onnxruntime()
        options = runtime.SessionOptions()
        options.intra_op_num_threads = torch.get_num_threads()
        options.log_severity_level = QUIET
        name = source if isinstance(source, Path) else "the exported graph"
        try:
            content = source.read_bytes() if isinstance(source, Path) else source
            self._session = runtime.InferenceSession(
                content, options, providers=["CPUExecutionProvider"]
            )
        # its own errors have no other base
        except Exception as error:
            raise CheckpointError(f"{name}: cannot be read as a graph ({error})") from error
        self._types = {put.name: TYPES[put.type] for put in self._session.get_inputs()}
        self._outputs = [put.name for put in self._session.get_outputs()]

    def __call__(self, tensors: Tensors) -> dict[str, Tensor]:
        """Compute; what comes out is of single precision."""
        fed = {
            name: tensors[name].detach().to("cpu", kind).contiguous().numpy()
            for name, kind in self._types.items()
        }
        made = self._session.run(self._outputs, fed)
        return {
            name: torch.from_numpy(array).float()
            for name, array in zip(self._outputs, made, strict=True)
        }
