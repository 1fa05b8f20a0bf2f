"""Other readings of camera matrices, which are tried where they fail as given.

Transposed, inverted, other axes of the camera or of the world, another frame's. Of each reading
there are two kinds: worldToNDC may be right by itself (it was made by the renderer), or it was made
of the wrong worldToCamera (worldToNDC = worldToCamera . P, with a projection that is right). Where
it is made here, of a field of view, it is of the second kind, and a declaration makes it anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rtsr_cli.core.captures.measuring.camera_structure import (
    SIGNED_AXES,
    CameraMatrices,
    Matrix4,
    are_mirrored,
    are_projections,
    describe_axes,
    find_axes,
    find_view_fault,
    is_sound,
    measure_reach,
)
from rtsr_cli.core.frames.camera_convention import AXES, CameraWord

Cameras = Mapping[int, CameraMatrices]
"""By frame number."""

Change = Callable[[Matrix4], Matrix4]


@dataclass(frozen=True, kw_only=True)
class CameraReading:
    """A way to read the matrices.

    Attributes:
        text: what they look like then.
        words: what would have to be declared; none where no declaration says it.
        cameras: as they would be, by frame.
        undoes: words of a convention that it takes back, if they are declared.
        mirrors_world: the world is of another handedness, or of other axes, which only positions
            and normals tell.
        of_neighbour: they belong to another frame.
        world: axes A of other ways to name the world's, p_given = p_world . A; None of others.
    """

    text: str
    words: tuple[CameraWord, ...] = ()
    cameras: Cameras
    mirrors_world: bool = False
    of_neighbour: bool = False
    undoes: tuple[CameraWord, ...] = ()
    world: Matrix4 | None = None


def _invert(matrix: Matrix4) -> Matrix4:
    try:
        return np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full((4, 4), np.nan)


def _widen(axes: Sequence[Sequence[float]]) -> Matrix4:
    matrix = np.eye(4)
    matrix[:3, :3] = axes
    return matrix


_ORDERS: tuple[tuple[str, tuple[CameraWord, ...], Change], ...] = (
    ("", (), lambda m: m),
    ("transposed (made for column vectors)", (CameraWord.COLUMN_VECTORS,), lambda m: m.T),
    (
        "inverted (camera to world)",
        (CameraWord.CAMERA_TO_WORLD,),
        _invert,
    ),
    (
        "transposed and inverted (camera to world, for column vectors)",
        (CameraWord.COLUMN_VECTORS, CameraWord.CAMERA_TO_WORLD),
        lambda m: _invert(m).T,
    ),
)

_SWAP_XY = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))

_FLIPS: tuple[tuple[str, tuple[tuple[float, ...], ...]], ...] = (
    ("x", ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))),
    ("y", ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0))),
    ("z", ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))),
)

_CAMERA_AXES: tuple[Matrix4, ...] = tuple(
    _widen(axes) for axes in (*(f for _, f in _FLIPS), _SWAP_XY, *list(AXES.values())[1:])
)

_WORLD_AXES: tuple[tuple[str, Matrix4], ...] = (
    *((f"of a mirrored world (its {name} axis flipped)", _widen(axes)) for name, axes in _FLIPS),
    ("of a mirrored world (its x and y swapped)", _widen(_SWAP_XY)),
)


def _name_world(axes: Matrix4) -> str:
    """Say which of the matrices' own axes the world's x, y and z are."""
    own = (f"{'-' if row.min() < 0 else ''}{'xyz'[np.abs(row).argmax()]}" for row in axes[:3, :3])
    kind = "a mirrored world" if np.linalg.det(axes) < 0.0 else "a world of other axes"
    return f"of {kind} (x, y, z of the world are their {', '.join(own)})"


def list_worlds(given: Cameras) -> list[CameraReading]:
    """Readings with every other way to name the axes of the world, which motion cannot tell.

    Those that do not mirror come first, then those that change least.
    """
    first = next(iter(given.values())).view

    def measure_oddness(axes: Matrix4) -> tuple[bool, float, float]:
        return bool(are_mirrored(axes @ first)), -float(np.trace(np.abs(axes))), -axes.sum()

    return [
        CameraReading(
            text=_name_world(axes),
            cameras={n: CameraMatrices(axes @ m.view, axes @ m.ndc) for n, m in given.items()},
            mirrors_world=True,
            world=axes,
        )
        for axes in sorted(SIGNED_AXES[1:], key=measure_oddness)
    ]


def list_readings(given: Cameras, step: int, *, of_lens: bool = False) -> list[CameraReading]:
    """Sound readings other than the one as given, the simplest first.

    Args:
        given: matrices of consecutive frames, as memory would take them.
        step: numbers from a frame to the next.
        of_lens: whether clip space is made of worldToCamera and a field of view.
    """
    found: dict[tuple[tuple[int, bytes], ...], CameraReading] = {}
    for reading in _list_all(given, step, of_lens=of_lens):
        own = {n: m.digits for n, m in reading.cameras.items()}
        if any(given[n].digits != digits for n, digits in own.items()):
            found.setdefault(tuple(own.items()), reading)
    return list(found.values())


def _list_all(given: Cameras, step: int, *, of_lens: bool) -> Iterator[CameraReading]:
    yield from _list_axes("", (), given, of_lens=of_lens)
    yield from _list_neighbours(given, step)
    for text, words, change in _ORDERS:
        for cameras in _list_pairs(given, change, of_lens=of_lens):
            sound = _keep_sound(cameras)
            if text and sound:
                yield CameraReading(text=text, words=words, cameras=sound, undoes=words)
            yield from _list_axes(text, words, cameras, of_lens=of_lens)
    yield from _list_ndc_flips(given)


def _list_pairs(given: Cameras, change: Change, *, of_lens: bool) -> Iterator[Cameras]:
    """Matrices with the view changed, and clip space changed alike, kept, or made anew."""
    if any(find_view_fault(change(m.view)) for m in given.values()):
        return
    if not of_lens:
        yield {n: CameraMatrices(change(m.view), m.ndc) for n, m in given.items()}
        yield {n: CameraMatrices(change(m.view), change(m.ndc)) for n, m in given.items()}
        yield {n: CameraMatrices(change(m.view), m.ndc.T) for n, m in given.items()}
    built = {n: m.projection for n, m in given.items()}
    if all(are_projections(p, measure_reach(given[n].view)) for n, p in built.items()):
        yield {
            n: CameraMatrices(change(m.view), change(m.view) @ built[n]) for n, m in given.items()
        }


def _keep_sound(cameras: Cameras) -> Cameras:
    return cameras if all(is_sound(m) for m in cameras.values()) else {}


def _join(*texts: str) -> str:
    return "; ".join(text for text in texts if text)


def _list_axes(
    text: str, words: tuple[CameraWord, ...], cameras: Cameras, *, of_lens: bool
) -> Iterator[CameraReading]:
    """Readings with other axes of the camera, and of the world."""
    first = next(iter(cameras.values()))
    if find_view_fault(first.view):
        return
    axes = find_axes(first)
    if axes is None:
        return
    if not is_sound(first):
        yield _turn_camera(text, words, cameras, axes)
        return
    for other in _CAMERA_AXES:
        reading = _turn_camera(text, words, cameras, other, built=True)
        yield reading if of_lens else replace(reading, words=())
    if text:
        return
    swap = _widen(_SWAP_XY)
    turned = {n: CameraMatrices(m.view @ swap, m.ndc @ swap) for n, m in cameras.items()}
    yield CameraReading(
        text=f"{_describe_turn(swap)}, in clip space too", cameras=_keep_sound(turned)
    )
    for name, world in _WORLD_AXES:
        turned = {n: CameraMatrices(world @ m.view, world @ m.ndc) for n, m in cameras.items()}
        yield CameraReading(text=name, cameras=_keep_sound(turned), mirrors_world=True, world=world)


def _turn_camera(
    text: str, words: tuple[CameraWord, ...], cameras: Cameras, axes: Matrix4, built: bool = False
) -> CameraReading:
    turned = {
        n: CameraMatrices(m.view @ axes, m.view @ axes @ m.projection if built else m.ndc)
        for n, m in cameras.items()
    }
    named = next((w for w, a in AXES.items() if np.array_equal(_widen(a), axes)), None)
    return CameraReading(
        text=_join(text, _describe_turn(axes)),
        words=() if named is None else (*words, named),
        cameras=_keep_sound(turned),
        # each of these turns is its own inverse
        undoes=() if named in {None, CameraWord.UNREAL} else (*words, named),
    )


def _describe_turn(axes: Matrix4) -> str:
    flipped = next((n for n, flip in _FLIPS if np.array_equal(_widen(flip), axes)), "")
    if np.array_equal(_widen(_SWAP_XY), axes):
        return "its x and y axes swapped"
    looks = f"a camera that {describe_axes(axes)}"
    return f"its {flipped} axis flipped ({looks})" if flipped else looks


def _list_neighbours(given: Cameras, step: int) -> Iterator[CameraReading]:
    """Matrices that were written with the frame before, or after, their own."""
    for offset, where in ((step, "after"), (-step, "before")):
        moved = {n: given[n + offset] for n in given if n + offset in given}
        yield CameraReading(
            text=f"those of another frame: each frame's own are in the frame {where} it",
            cameras=_keep_sound(moved),
            of_neighbour=True,
        )


def _list_ndc_flips(given: Cameras) -> Iterator[CameraReading]:
    """Clip space whose y grows downwards."""
    flip = _widen(_FLIPS[1][1])
    turned = {n: CameraMatrices(m.view, m.ndc @ flip) for n, m in given.items()}
    yield CameraReading(
        text="of a clip space whose y grows downwards",
        words=(CameraWord.NDC_Y_DOWN,),
        undoes=(CameraWord.NDC_Y_DOWN,),
        cameras=_keep_sound(turned),
    )
