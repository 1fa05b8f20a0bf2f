"""Names for tensor shapes. Images are NCHW float32, linear HDR unless a name says so."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, TypeAlias

from torch import Tensor

if TYPE_CHECKING or find_spec("jaxtyping"):
    from jaxtyping import Float, Int
else:
    # training from packed crops runs where little but torch is installed

    class _Shaped:
        """Stands in for jaxtyping: any tensor, whatever its shape."""

        def __getitem__(self, shape: Any) -> type[Tensor]:
            return Tensor

    Float = Int = _Shaped()

Image: TypeAlias = Float[Tensor, "n c h w"]
"""Any image; channels by the caller's contract."""

Color: TypeAlias = Float[Tensor, "n 3 h w"]
"""Linear scene-referred RGB unless the variable's suffix names another space."""

Vector3: TypeAlias = Float[Tensor, "n 3 h w"]
"""World-space directions or positions (x, y, z)."""

MotionPx: TypeAlias = Float[Tensor, "n 2 h w"]
"""(dx, dy) in pixels of its own resolution, x right, y down, previous minus current."""

Plane: TypeAlias = Float[Tensor, "n 1 h w"]
"""One value a pixel (depth in metres, roughness, a cosine, ...)."""

Mask: TypeAlias = Float[Tensor, "n 1 h w"]
"""0 or 1 (or a filtered share between them); the variable's name says what 1 means."""

IdMap: TypeAlias = Int[Tensor, "n 1 h w"]
"""Object ids, int32 holding the file's 32 unsigned bits; compared, never interpolated."""

TileMap: TypeAlias = Float[Tensor, "n c th tw"]
"""One value a tile."""

PixelMap: TypeAlias = Float[Tensor, "n h w"]
"""An error or a score of every pixel, all channels together."""

Scores: TypeAlias = Float[Tensor, " n"]
"""One figure an image."""

Size: TypeAlias = tuple[int, int]
"""(height, width)."""
