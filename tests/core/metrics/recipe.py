"""Deterministic test images for the metric oracles.

Only integer arithmetic, numpy's frozen legacy generator (RandomState) and
exact binary fractions are used, so the arrays are bit-identical on every
platform and numpy version; each JSON file states their SHA-256.
"""

import hashlib

import numpy as np


def _tri(v, period):
    """Integer triangle wave 0..255 of the given period."""
    v = np.mod(v, period)
    half = period // 2
    return np.where(v < half, v * 255 // half, (period - v) * 255 // (period - half)).astype(
        np.int64
    )


def ldr_reference(h=192, w=256):
    """uint8 HxWx3: smooth ramps, checkers and seeded block noise."""
    y, x = np.mgrid[0:h, 0:w].astype(np.int64)
    r = _tri(2 * x + y, 192)
    g = _tri(x - 2 * y + 4096, 128)
    b = (((x // 8) + (y // 8)) % 2) * 160 + 48
    img = np.stack([r, g, b], -1)
    rs = np.random.RandomState(1234)
    blocks = rs.randint(0, 256, size=(h // 8, w // 8, 3)).astype(np.int64)
    blocks = np.repeat(np.repeat(blocks, 8, 0), 8, 1)
    img[:, w // 2 :] = (img[:, w // 2 :] + 3 * blocks[:, w // 2 :]) // 4
    return img.astype(np.uint8)


def ldr_test(ref):
    """uint8: four quadrants, each with its own distortion of `ref`."""
    h, w, _ = ref.shape
    r = ref.astype(np.int64)
    out = r.copy()
    p = np.pad(r, ((1, 1), (1, 1), (0, 0)), mode="edge")
    box = sum(p[i : i + h, j : j + w] for i in range(3) for j in range(3)) // 9
    out[: h // 2, : w // 2] = box[: h // 2, : w // 2]  # top left: 3x3 blur
    noise = np.random.RandomState(77).randint(-12, 13, size=ref.shape)
    out[: h // 2, w // 2 :] = (r + noise)[: h // 2, w // 2 :]  # top right: noise
    out[h // 2 :, : w // 2] = np.roll(r, 2, axis=1)[h // 2 :, : w // 2]  # bottom left: shift by 2
    out[h // 2 :, w // 2 :] = (r * 9 // 10 + 10)[h // 2 :, w // 2 :]  # bottom right: contrast
    return np.clip(out, 0, 255).astype(np.uint8)


def hdr_reference(h=192, w=256):
    """float32 linear HxWx3: the LDR pattern scaled by 2**k, k = -6..+6 in column bands."""
    base = (ldr_reference(h, w).astype(np.float64) + 1.0) / 256.0
    k = np.arange(w) * 13 // w - 6
    return (base * np.ldexp(1.0, k)[None, :, None]).astype(np.float32)


def hdr_test(ref):
    """float32: multiplicative noise m/64 (m in -8..8), plus one 4x4 firefly of 256.0."""
    m = np.random.RandomState(4321).randint(-8, 9, size=ref.shape).astype(np.float64)
    out = ref.astype(np.float64) * (1.0 + m / 64.0)
    out[40:44, 60:64] = 256.0
    return out.astype(np.float32)


def luma_sequence(frames=6, h=192, w=320, distort=False):
    """uint8 frames x H x W: luma of a pattern that pans 3 px right and 1 px down per frame."""
    out = []
    rs = np.random.RandomState(99)
    tex = rs.randint(0, 256, size=(h // 4 + 16, w // 4 + 16)).astype(np.int64)
    tex = np.repeat(np.repeat(tex, 4, 0), 4, 1)
    y, x = np.mgrid[0:h, 0:w].astype(np.int64)
    for t in range(frames):
        yy, xx = y + t, x + 3 * t
        f = (_tri(xx + 2 * yy, 160) + tex[yy, xx]) // 2
        f = f * 219 // 255 + 16
        if distort:
            p = np.pad(f, 1, mode="edge")
            f = sum(p[i : i + h, j : j + w] for i in range(3) for j in range(3)) // 9
            f = f + np.random.RandomState(500 + t).randint(-4, 5, size=f.shape)
        out.append(np.clip(f, 16, 235))
    return np.stack(out).astype(np.uint8)


def sha256(a):
    return hashlib.sha256(np.ascontiguousarray(a).tobytes()).hexdigest()
