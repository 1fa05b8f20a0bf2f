"""The split-sum table of the specular lobe: integrate it, keep it, look it up.

    F = (1 - m) * c + F0 * A + B,    F0 = lerp(0.04, c, m)               [Karis 2013, NSRD 2024]
    A = int rho/Fresnel * (1 - Fc) * (n.i) di,    B = the same with Fc,    Fc = (1 - o.h)^5

`rho` is Cook-Torrance with GGX `D`, Schlick's Fresnel, `G = G1(n.o) G1(n.i)` with
`G1(v) = v / (v (1 - k) + k)` and the denominator `4 (n.o)(n.i)`.

**Conventions.** A table is `1 2 size size`: channels (A, B), column = NoV, row = roughness, both
growing, texel centres at `(i + 0.5) / size`. Roughness is what the file holds; `LutConvention`
says how it becomes `alpha` and `k`. Dividing and multiplying must use the same convention.

**Method.** The integral over half vectors is split where reflections begin to go below the horizon,
so each part is smooth and a Gauss-Legendre product rule converges fast. The table itself is smooth
in (sqrt(NoV), roughness): it is integrated on a Chebyshev grid and evaluated at the texels. All in
NumPy and one thread: thousands of small arrays gain nothing from sharing out, and lose much where
the cores are busy.

References:
    B. Karis, Real Shading in Unreal Engine 4, SIGGRAPH 2013 course.
    B. Walter et al., Microfacet Models for Refraction through Rough Surfaces, EGSR 2007 (GGX).
"""

from __future__ import annotations

import functools
import math
import threading

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from rtsr_cli.core.choices import LutConvention
from rtsr_cli.core.errors import ShapeMismatchError
from rtsr_cli.core.imaging.row_strips import cut_pixels
from rtsr_cli.core.shapes import Image, Plane

Array = NDArray[np.float64]

DEFAULT_SIZE = 512
"""Texels a side. Bilinear look-ups for NoV >= 0.01 are then within 1.1e-3 of the integral, against
3.3e-3 with 256 and 1.8e-2 with 128, and looking up a frame costs the same (`benchmarks/lut.py`)."""

DEFAULT_SAMPLES = 1024
"""Quadrature nodes of one integral; the quadrature error is then below 2e-5."""

MIN_SIZE = 2
MIN_SAMPLES = 16

_GRID = 64
"""Chebyshev nodes an axis: 48 reach 1e-5 for NoV >= 0.01, 64 hold 2e-4 down to NoV = 0.001."""

_MAX_SUM = float(1.0 - np.finfo(np.float32).eps)
"""Bound of A + B: the lobe loses energy, whatever interpolation and rounding say."""

_TABLE_ROWS = 256
"""Rows of the table that are evaluated in float64 at a time."""

_STRIP_PIXELS = 1 << 20
"""Pixels looked up at a time, 16 MiB with their coordinates. Smaller strips are no faster, and on
two threads of a busy machine far slower: the threads wait for each other after every step."""


_TABLE_LOCK = threading.Lock()
"""Readers of several frames ask for the table at once; one makes it."""


def lobe_parameters(roughness: Array, convention: LutConvention) -> tuple[Array, Array]:
    """Return `alpha` and `k` of a roughness in 0..1, any shape."""
    if convention is LutConvention.KARIS:
        alpha = np.square(roughness)
        return alpha, alpha / 2
    return roughness, np.square(roughness + 1) / 8


def integrate_split_sum(
    nov: Array,
    roughness: Array,
    *,
    samples: int = DEFAULT_SAMPLES,
    convention: LutConvention = LutConvention.KARIS,
) -> Array:
    """Integrate A and B for every pair of a view cosine and a roughness.

        A + B = int_0^pi/2 sin(2 psi) 1/pi int_0^phi_max G (o.h) / ((n.h)(n.o)) dphi dpsi
        tan(theta_h) = alpha tan(psi),    n.i = 2 (o.h)(n.h) - n.o

    `sin(2 psi) dpsi` is the share of GGX half vectors, D (n.h) dh; an azimuth counts once for both
    sides of the plane of incidence.

    Below `theta_h = (pi/2 - theta_o) / 2` every azimuth reflects above the horizon, above
    `(pi/2 + theta_o) / 2` none does; between, `phi_max` is where n.i = 0.

    Args:
        nov: view cosines, one axis of m values inside (0, 1), any order.
        roughness: one axis of r values in (0, 1], any order.
        samples: quadrature nodes of one integral, at most; half of them lie in each band.
        convention: meaning of `roughness`.

    Returns:
        A and B as float64, `2 r m`.
    """
    cos_o = np.asarray(nov, np.float64)[None, :]
    alpha, k = lobe_parameters(np.asarray(roughness, np.float64)[:, None], convention)
    theta_o = np.arccos(cos_o)
    psi_cut = np.arctan(np.tan((np.pi / 2 - theta_o) / 2) / alpha)
    psi_end = np.arctan(np.tan((np.pi / 2 + theta_o) / 2) / alpha)
    num_azimuth = round(math.sqrt(samples / 2))
    polar, polar_weights = _gauss_legendre(samples // (2 * num_azimuth))
    azimuth_rule = _gauss_legendre(num_azimuth)
    eased = np.square(np.sin(np.pi / 2 * polar))
    eased_weights = polar_weights * np.pi / 2 * np.sin(np.pi * polar)
    nodes = [(psi_cut * x, psi_cut * w) for x, w in zip(polar, polar_weights, strict=True)]
    width = psi_end - psi_cut
    nodes += [(psi_cut + width * x, width * w) for x, w in zip(eased, eased_weights, strict=True)]
    total = np.zeros((2, *psi_cut.shape))
    for psi, weight in nodes:
        tan_h = alpha * np.tan(psi)
        cos_h = 1 / np.sqrt(1 + np.square(tan_h))
        ring = _integrate_azimuth(cos_o, k, cos_h, tan_h * cos_h, azimuth_rule=azimuth_rule)
        total += ring * (np.sin(2 * psi) * weight / (cos_h * (cos_o * (1 - k) + k)))
    return total


def _integrate_azimuth(
    cos_o: Array, k: Array, cos_h: Array, sin_h: Array, *, azimuth_rule: tuple[Array, Array]
) -> Array:
    """1/pi int_0^phi_max (o.h) G1(n.i) dphi, times (1 - Fc) and times Fc, stacked in front.

    o.h = cos_o cos_h + sin_o sin_h cos(phi)
    """
    offset = cos_o * cos_h
    amplitude = np.sqrt(1 - np.square(cos_o)) * sin_h
    phi_max = np.arccos(((cos_o / (2 * cos_h) - offset) / amplitude).clip(-1, 1))
    whole, with_fresnel = np.zeros_like(offset), np.zeros_like(offset)
    for position, weight in zip(*azimuth_rule, strict=True):
        voh = offset + amplitude * np.cos(phi_max * position)
        noi = np.maximum(2 * cos_h * voh - cos_o, 0)
        value = voh * noi / (noi * (1 - k) + k) * weight
        complement = 1 - voh
        whole += value
        with_fresnel += value * np.square(np.square(complement)) * complement
    ring: Array = np.stack((whole - with_fresnel, with_fresnel)) * (phi_max / np.pi)
    return ring


def _gauss_legendre(count: int) -> tuple[Array, Array]:
    """Nodes and weights of the Gauss-Legendre rule on 0..1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (nodes + 1) / 2, weights / 2


def _chebyshev_grid(targets: Array, count: int) -> tuple[Array, Array]:
    """Return Chebyshev nodes over the range of `targets` and the matrix from nodes to targets.

        f(x) = sum_j f(x_j) * 2/N * sum'_d T_d(x_j) T_d(x),    T_d(x) = cos(d acos(x))

    The prime halves the term of degree 0.
    """
    low, high = targets.min(), targets.max()
    degrees = np.arange(count)
    node_angles = (degrees + 0.5) * (np.pi / count)
    target_angles = np.arccos(((targets - low) / (high - low) * 2 - 1).clip(-1, 1))
    scale = np.where(degrees == 0, 1.0, 2.0) / count
    matrix = (np.cos(target_angles[:, None] * degrees) * scale) @ np.cos(
        degrees[:, None] * node_angles
    )
    return low + (high - low) * (np.cos(node_angles) + 1) / 2, matrix


def _clamp_table(table: Array) -> Array:
    """Hold A >= 0, B >= 0 and A + B < 1 against interpolation and rounding."""
    total = table.sum(axis=0).clip(0, _MAX_SUM)
    with_fresnel = np.minimum(table[1].clip(min=0), total)
    return np.stack((total - with_fresnel, with_fresnel))


def integrate_lut(
    size: int = DEFAULT_SIZE,
    samples: int = DEFAULT_SAMPLES,
    convention: LutConvention = LutConvention.KARIS,
) -> Image:
    """Make the table, `1 2 size size`, float32.

    Args:
        size: texels a side, at least 2.
        samples: quadrature nodes of one integral, at least 16.
        convention: meaning of the roughness axis.

    Returns:
        A and B; column = NoV, row = roughness.

    Raises:
        ValueError: `size` or `samples` is too small.
    """
    if size < MIN_SIZE or samples < MIN_SAMPLES:
        raise ValueError(f"size must be >= {MIN_SIZE} and samples >= {MIN_SAMPLES}")
    centres = (np.arange(size) + 0.5) / size
    sqrt_nov_nodes, to_columns = _chebyshev_grid(np.sqrt(centres), _GRID)
    roughness_nodes, to_rows = _chebyshev_grid(centres, _GRID)
    nodes = integrate_split_sum(
        np.square(sqrt_nov_nodes), roughness_nodes, samples=samples, convention=convention
    )
    table = np.empty((2, size, size), np.float32)
    for top in range(0, size, _TABLE_ROWS):
        rows = slice(top, top + _TABLE_ROWS)
        table[:, rows] = _clamp_table(to_rows[rows] @ nodes @ to_columns.T)
    return torch.from_numpy(table)[None]


@functools.cache
def _default_table(convention: LutConvention, device: str) -> Image:
    with torch.inference_mode(mode=False):
        return integrate_lut(convention=convention).to(device)


def load_default_lut(convention: LutConvention, device: torch.device | str = "cpu") -> Image:
    """Return the default table of a convention; made once a device, never to be written to."""
    with _TABLE_LOCK:
        return _default_table(convention, str(device))


def sample_lut(lut: Image, nov: Plane, roughness: Plane) -> Image:
    """Look A and B up, bilinearly between texel centres, coordinates clamped to the outer centres.

    Works through the frame in strips, so that memory beyond the result stays at some 16 MiB.

    Args:
        lut: a table of `integrate_lut`, on the device of `nov`.
        nov: view cosine, 0..1.
        roughness: in the convention of `lut`, 0..1.

    Returns:
        A and B, `n 2 h w`.

    Raises:
        ShapeMismatchError: `nov` and `roughness` differ in shape.
    """
    if nov.shape != roughness.shape:
        raise ShapeMismatchError(
            f"NoV is {tuple(nov.shape)} but roughness is {tuple(roughness.shape)}: "
            "bring both to one resolution"
        )
    count, _, height, width = nov.shape
    tables = lut.expand(count, -1, -1, -1)
    sampled = nov.new_empty(count, 2, height, width)
    for rows in cut_pixels((height, count * width), _STRIP_PIXELS):
        strip = slice(rows.start, rows.stop)
        position = torch.cat((nov[:, :, strip], roughness[:, :, strip]), dim=1).mul_(2).sub_(1)
        sampled[:, :, strip] = functional.grid_sample(
            tables,
            position.movedim(1, -1),
            mode="bilinear",
            padding_mode="border",
            align_corners=False,
        )
    return sampled
