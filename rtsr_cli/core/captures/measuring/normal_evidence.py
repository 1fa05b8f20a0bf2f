"""Normals against camera matrices: whether they stand on the surfaces that depth shows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import torch
from torch import Tensor

from rtsr_cli.core.captures.measuring.camera_evidence import (
    SURFACE_DEPTHS,
    Errors,
    bind_camera,
    list_near_depths,
    mean_error,
    pick_best,
)
from rtsr_cli.core.captures.measuring.camera_hypotheses import Cameras
from rtsr_cli.core.captures.measuring.camera_refinement import NearbyView, Residuals, keep_rows
from rtsr_cli.core.captures.measuring.camera_structure import CameraMatrices
from rtsr_cli.core.captures.measuring.geometry_finder import (
    LEAST_POINTS,
    StoredGeometry,
    find_surface,
    read_metres,
)
from rtsr_cli.core.frames.camera import (
    is_orthographic,
    place_in_camera_space,
)
from rtsr_cli.core.frames.camera_convention import AXES
from rtsr_cli.core.frames.conventions import DepthConvention
from rtsr_cli.core.frames.vector_length import normalize_vectors, vector_length
from rtsr_cli.core.shapes import Vector3

LEAST_TOLD = 1e-3
"""Share of what the best told axis of a rotation is told by, up to which another is not told."""

ALIKE = math.cos(math.radians(12.0))
"""Cosine of a normal and the surface that it stands on; bumps lean it."""

LEAST_LEAN = 0.5
"""Degrees by which normals of 8 bits, and those of surfaces, may lean."""


@dataclass(frozen=True, eq=False)
class NormalEvidence:
    """Normals stand on the surfaces that depth shows.

    Attributes:
        frames: thinned.
        normals: unit or zero, as stored; by frame.
        depths: readings of depth, to try; the likeliest first.
        known: surfaces that were found already.
    """

    frames: Mapping[int, StoredGeometry]
    normals: Mapping[int, Vector3]
    depths: tuple[DepthConvention, ...] = SURFACE_DEPTHS
    known: dict[object, tuple[Tensor, Tensor] | None] = field(default_factory=dict)

    name = "normals with depth"
    unit = "% of the surfaces elsewhere"
    tells_world = True
    tells_step = False
    tells_lens = False
    slack = 8.0
    factor = 1.1
    limit = 70.0
    sure = 25.0

    def measure(self, cameras: Cameras, *, closely: bool) -> Errors:
        """Share of the normals that do not stand on their surfaces, in per cent.

        Bumps and edges have their share in it whatever the camera is.
        """
        depths = self.depths[:1] if closely else self.depths
        trials = [self._measure(cameras, depth) for depth in depths]
        return trials[pick_best(trials)]

    def hold(self, cameras: Cameras) -> NormalEvidence:
        """Put the reading of depth first under which matrices fit best."""
        best = self.depths[pick_best([self._measure(cameras, d) for d in self.depths])]
        return replace(self, depths=tuple(dict.fromkeys((best, *self.depths))))

    def _measure(self, cameras: Cameras, depth: DepthConvention) -> Errors:
        found = {}
        for number in self.frames.keys() & cameras.keys():
            rotation = torch.tensor(cameras[number].view[:3, :3])
            share = self._measure_share(number, cameras[number], depth, (rotation,))
            if share is not None:
                found[number] = share
        return found

    def view_nearby(self, given: Cameras) -> NearbyView:
        """How far normals lean from their surfaces, degrees."""
        frame = next(iter(self.frames.values()))
        width = round(frame.view.display[1] * frame.thinned)
        return NearbyView(
            measure=partial(self._list_residuals, given=given, depth=self.depths[0]),
            others=[
                partial(self._list_residuals, given=given, depth=other)
                for other in list_near_depths(given)
            ],
            given=given,
            unit="degrees from their surfaces",
            width=width,
            floor=LEAST_LEAN,
        )

    def _list_residuals(
        self, cameras: Cameras, given: Cameras, depth: DepthConvention
    ) -> Residuals:
        """Normals less those of surfaces, degrees; of other lenses these are scaled, not found."""
        found = {}
        for number in self.frames.keys() & cameras.keys():
            surfaces = self._find_surfaces(number, given[number], depth)
            if surfaces is None:
                continue
            normal, own = (keep_rows(part).double() for part in surfaces)
            scale = np.diag(cameras[number].projection)[:2] / np.diag(given[number].projection)[:2]
            # points are x / P00, so that what stands on them is n P00
            own = normalize_vectors(own * torch.tensor([*scale, 1.0], dtype=own.dtype))
            turn = torch.tensor(cameras[number].view[:3, :3])
            found[number] = (normalize_vectors(normal @ turn) - own) * (180.0 / math.pi)
        return found

    def measure_in_camera(self, cameras: Cameras) -> float:
        """The same for normals in the camera's own axes, however those are named."""
        turns = tuple(torch.tensor(a, dtype=torch.float64) for a in AXES.values())
        errors = []
        for number in self.frames.keys() & cameras.keys():
            camera = cameras[number]
            shares = [self._measure_share(number, camera, d, turns) for d in self.depths]
            errors += [min((s for s in shares if s is not None), default=math.inf)]
        return mean_error(errors)

    def measure_axes(self, cameras: Cameras, axes: Tensor) -> Tensor | None:
        """The same for normals whose axes are named otherwise, w of them, by the best depth each.

        Args:
            cameras: the matrices.
            axes: A, w x 3 x 3: n_world = n . A; the last leads to the camera's own.
        """
        trials = []
        for depth in self.depths:
            found = []
            for number in self.frames.keys() & cameras.keys():
                surfaces = self._find_surfaces(number, cameras[number], depth)
                if surfaces is not None:
                    normal, own = (keep_rows(part).double() for part in surfaces)
                    turn = normalize_vectors(torch.tensor(cameras[number].view[:3, :3]))
                    turns = torch.cat([axes[:-1] @ turn, axes[-1:]])
                    cosines = torch.einsum("ni,wij,nj->nw", normalize_vectors(normal), turns, own)
                    found.append(100.0 * (cosines < ALIKE).double().mean(0))
            trials += [torch.stack(found).mean(0)] if found else []
        return torch.stack(trials).min(0).values if trials else None

    def measure_lean(self, cameras: Cameras, axes: Tensor) -> Tensor | None:
        """How far normals lean from their surfaces as a whole, degrees, w of them.

        The rotation w that is left between normals n and those of surfaces g, by least squares:
        w x n = g - n, so sum(1 - n n') w = sum(n x g). Bumps and noise lean to all sides, so that
        readings a few degrees apart are told from each other, as shares of pixels do not.

        Args:
            cameras, axes: as for `measure_axes`.
        """
        found: dict[float, Tensor] = {}
        for depth in self.depths:
            leans, apart = [], []
            for number in self.frames.keys() & cameras.keys():
                surfaces = self._find_surfaces(number, cameras[number], depth)
                if surfaces is None:
                    continue
                normal, own = (keep_rows(part).double() for part in surfaces)
                turn = normalize_vectors(torch.tensor(cameras[number].view[:3, :3]))
                turns = torch.cat([axes[:-1] @ turn, axes[-1:]])
                turned = torch.einsum("ni,wij->wnj", normalize_vectors(normal), turns)
                # of any reading: none chooses the pixels that it is judged by
                alike = ((turned * own).sum(-1) >= ALIKE).any(0)
                apart.append(1.0 - float(alike.double().mean()))
                leans.append(_find_rotation(turned[:, alike], own[alike]))
            if leans:
                found.setdefault(mean_error(apart), torch.stack(leans).mean(0))
        return found[min(found)] if found else None

    def _measure_share(
        self,
        number: int,
        camera: CameraMatrices,
        depth: DepthConvention,
        turns: Sequence[Tensor],
    ) -> float | None:
        """Per cent of the normals that are apart for the best of turns, n_camera = n . turn."""
        surfaces = self._find_surfaces(number, camera, depth)
        if surfaces is None:
            return None
        normal, own = surfaces
        cosines = [(normalize_vectors(normal @ turn.to(normal)) * own).sum(1) for turn in turns]
        return min(100.0 * float((c < ALIKE).float().mean()) for c in cosines)

    def _find_surfaces(
        self, number: int, camera: CameraMatrices, depth: DepthConvention
    ) -> tuple[Tensor, Tensor] | None:
        """Normals as stored, and those of the surfaces in camera space, n x 3; made once."""
        key = (number, depth, np.round(camera.projection, 5).tobytes())
        if key not in self.known:
            frame = self.frames[number]
            frame = replace(frame, camera=bind_camera(frame.camera, camera))
            self.known[key] = _pair_normals(frame, self.normals[number], depth)
        return self.known[key]


def _find_rotation(normals: Tensor, surfaces: Tensor) -> Tensor:
    """The angle of the rotation from normals, w x n x 3, to those of surfaces, n x 3, degrees."""
    square = torch.einsum("wni,wnj->wij", normals, normals)
    count = torch.eye(3, dtype=normals.dtype) * normals.shape[1]
    moment = torch.linalg.cross(normals, surfaces.expand_as(normals)).sum(1)
    # what turns about all normals at once no normal tells: the shortest rotation
    inverse = torch.linalg.pinv(count - square, rtol=LEAST_TOLD, hermitian=True)
    rotation = torch.einsum("wij,wj->wi", inverse, moment)
    return vector_length(rotation)[:, 0] * (180.0 / math.pi)


def _pair_normals(
    frame: StoredGeometry, normal: Vector3, depth: DepthConvention
) -> tuple[Tensor, Tensor] | None:
    surfaces = _find_surface_normals(frame, depth)
    if surfaces is None:
        return None
    own, known = surfaces
    inner = normal[..., 1:-1, 1:-1]
    known = known & (vector_length(inner) > 0.0)
    if int(known.sum()) < LEAST_POINTS:
        return None
    places = known[0, 0]
    return inner[0, :, places].T, own[0, :, places].T


def _find_surface_normals(
    frame: StoredGeometry, depth: DepthConvention
) -> tuple[Vector3, Tensor] | None:
    """Normals of the surfaces that depths show, in camera space, and where they are known."""
    metres = read_metres(frame, depth)
    points = None if metres is None else place_in_camera_space(metres, frame.camera, frame.view)
    if metres is None or points is None or min(metres.shape[-2:]) < 3:
        return None
    there = find_surface(frame, metres)
    across = points[..., 1:-1, 2:] - points[..., 1:-1, :-2]
    down = points[..., 2:, 1:-1] - points[..., :-2, 1:-1]
    normal = normalize_vectors(torch.linalg.cross(across, down, dim=1))
    middle = points[..., 1:-1, 1:-1]
    projection = frame.camera.projection
    if projection is not None and is_orthographic(projection):
        middle = torch.zeros_like(middle)
        middle[:, 2] = -1.0
    away = (normal * middle).sum(1, keepdim=True) > 0.0
    known = there[..., 1:-1, 1:-1] & there[..., 1:-1, 2:] & there[..., 1:-1, :-2]
    known &= there[..., 2:, 1:-1] & there[..., :-2, 1:-1]
    return torch.where(away, -normal, normal), known & torch.isfinite(normal).all(1, keepdim=True)
