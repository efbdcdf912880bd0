"""Both MLPs on the CPU: fused numba, forward and analytic backward, equal to ``server.nerf.field``.

A block of ``LANES`` points passes all layers while its activations are in the first-level cache.
The backward pass computes them again rather than storing them. Symbols: ``x`` encoded features,
``h`` hidden units of the density MLP, ``g`` geometry features, ``v`` inputs of the colour MLP
(``g`` and the spherical harmonics), ``p`` and ``q`` its hidden units.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from server.nerf.kernels.cpu import LANES, chunk_blocks

_LEAST_SLOPE = np.float32(1e-14)


@njit(cache=True, fastmath=True)
def _multiply(W, x, y):
    """Write ``y = W x`` for ``W`` ``(outputs, inputs)`` and ``x`` ``(inputs, LANES)``.

    Four rows by four columns of ``W`` at a time: each load then serves four products.
    """
    outputs, inputs = W.shape
    y[:outputs, :] = 0.0
    whole = outputs - outputs % 4
    for o in range(0, whole, 4):
        for i in range(0, inputs - 3, 4):
            a0, a1, a2, a3 = W[o, i], W[o, i + 1], W[o, i + 2], W[o, i + 3]
            b0, b1, b2, b3 = W[o + 1, i], W[o + 1, i + 1], W[o + 1, i + 2], W[o + 1, i + 3]
            c0, c1, c2, c3 = W[o + 2, i], W[o + 2, i + 1], W[o + 2, i + 2], W[o + 2, i + 3]
            d0, d1, d2, d3 = W[o + 3, i], W[o + 3, i + 1], W[o + 3, i + 2], W[o + 3, i + 3]
            for n in range(LANES):
                x0, x1, x2, x3 = x[i, n], x[i + 1, n], x[i + 2, n], x[i + 3, n]
                y[o, n] += a0 * x0 + a1 * x1 + a2 * x2 + a3 * x3
                y[o + 1, n] += b0 * x0 + b1 * x1 + b2 * x2 + b3 * x3
                y[o + 2, n] += c0 * x0 + c1 * x1 + c2 * x2 + c3 * x3
                y[o + 3, n] += d0 * x0 + d1 * x1 + d2 * x2 + d3 * x3
        for i in range(inputs - inputs % 4, inputs):
            a0, b0, c0, d0 = W[o, i], W[o + 1, i], W[o + 2, i], W[o + 3, i]
            for n in range(LANES):
                y[o, n] += a0 * x[i, n]
                y[o + 1, n] += b0 * x[i, n]
                y[o + 2, n] += c0 * x[i, n]
                y[o + 3, n] += d0 * x[i, n]
    for o in range(whole, outputs):
        for i in range(inputs):
            a0 = W[o, i]
            for n in range(LANES):
                y[o, n] += a0 * x[i, n]


@njit(cache=True, fastmath=True)
def _multiply_back(W, x, dy, dx, dW):
    """Add ``dy x^T`` to ``dW`` and write ``dx = W^T dy``; shapes as in ``_multiply``."""
    outputs, inputs = W.shape
    _multiply(W.T, dy, dx)
    for o in range(0, outputs - 1, 2):
        for i in range(0, inputs - 3, 4):
            s0 = s1 = s2 = s3 = t0 = t1 = t2 = t3 = np.float32(0.0)
            for n in range(LANES):
                y0, y1 = dy[o, n], dy[o + 1, n]
                x0, x1, x2, x3 = x[i, n], x[i + 1, n], x[i + 2, n], x[i + 3, n]
                s0, s1, s2, s3 = s0 + y0 * x0, s1 + y0 * x1, s2 + y0 * x2, s3 + y0 * x3
                t0, t1, t2, t3 = t0 + y1 * x0, t1 + y1 * x1, t2 + y1 * x2, t3 + y1 * x3
            for k, s, t in ((0, s0, t0), (1, s1, t1), (2, s2, t2), (3, s3, t3)):
                dW[o, i + k] += s
                dW[o + 1, i + k] += t
    for o in range(outputs):
        # The last inputs, and the last output where their number is odd.
        start = 0 if o == outputs - 1 and outputs % 2 else inputs - inputs % 4
        for i in range(start, inputs):
            s0 = np.float32(0.0)
            for n in range(LANES):
                s0 += dy[o, n] * x[i, n]
            dW[o, i] += s0


@njit(cache=True, fastmath=True)
def _rectify(x, rows):
    for r in range(rows):
        for n in range(LANES):
            x[r, n] = max(x[r, n], np.float32(0.0))


@njit(cache=True, fastmath=True)
def _rectify_back(x, dx, rows):
    for r in range(rows):
        for n in range(LANES):
            dx[r, n] = dx[r, n] if x[r, n] > np.float32(0.0) else np.float32(0.0)


@njit(cache=True, fastmath=True)
def _densities_chunk(features, count, D1, D2, bias, top, sigmas, first, last):
    h = np.empty((D1.shape[0], LANES), np.float32)
    g = np.empty((1, LANES), np.float32)
    for block in range(first, last):
        _multiply(D1, features[block], h)
        _rectify(h, D1.shape[0])
        _multiply(D2[:1], h, g)
        start = block * LANES
        for n in range(min(LANES, count - start)):
            sigmas[start + n] = np.exp(min(g[0, n] + bias, top))


@njit(cache=True, parallel=True, fastmath=True)
def densities_forward(features, count, D1, D2, bias, top, sigmas, chunks):
    """Write the density of the first ``count`` points of ``features`` to ``sigmas``."""
    blocks = (count + LANES - 1) // LANES
    for chunk in prange(chunks):
        first, last = chunk_blocks(blocks, chunks, chunk)
        _densities_chunk(features, count, D1, D2, bias, top, sigmas, first, last)


@njit(cache=True, fastmath=True)
def _forward_block(x, sh, ray_ids, start, lanes, D1, D2, C1, C2, h, v, p, q):
    """Pass one block through both MLPs up to the second hidden layer of the colour MLP."""
    G = D2.shape[0]
    _multiply(D1, x, h)
    _rectify(h, D1.shape[0])
    _multiply(D2, h, v)
    for n in range(LANES):
        ray = ray_ids[start + min(n, lanes - 1)]
        for k in range(sh.shape[1]):
            v[G + k, n] = sh[ray, k]
    _multiply(C1, v, p)
    _rectify(p, C1.shape[0])
    _multiply(C2, p, q)
    _rectify(q, C2.shape[0])


@njit(cache=True, fastmath=True)
def _shade_chunk(features, count, sh, ray_ids, D1, D2, C1, C2, C3, bias, top, sigmas, rgbs, lo, hi):
    h = np.empty((D1.shape[0], LANES), np.float32)
    v = np.empty((C1.shape[1], LANES), np.float32)
    p = np.empty((C1.shape[0], LANES), np.float32)
    q = np.empty((C2.shape[0], LANES), np.float32)
    c = np.empty((3, LANES), np.float32)
    one = np.float32(1.0)
    for block in range(lo, hi):
        start = block * LANES
        lanes = min(LANES, count - start)
        _forward_block(features[block], sh, ray_ids, start, lanes, D1, D2, C1, C2, h, v, p, q)
        _multiply(C3, q, c)
        for n in range(lanes):
            sigmas[start + n] = np.exp(min(v[0, n] + bias, top))
        for k in range(3):
            for n in range(lanes):
                rgbs[start + n, k] = one / (one + np.exp(-c[k, n]))


@njit(cache=True, parallel=True, fastmath=True)
def shade_forward(
    features, count, sh, ray_ids, D1, D2, C1, C2, C3, bias, top, sigmas, rgbs, chunks
):
    """Write density and colour of the first ``count`` points.

    Args:
        features: ``(blocks, L F, LANES)``.
        count: Number of points.
        sh: Spherical harmonics ``(rays, B)`` of every ray's direction.
        ray_ids: Ray ``(n,)`` of every point.
        D1: Density layer 1.
        D2: Density layer 2.
        C1: Colour layer 1.
        C2: Colour layer 2.
        C3: Colour layer 3.
        bias: Added to the log density.
        top: Upper limit of the log density.
        sigmas: ``(n,)``, written.
        rgbs: ``(n, 3)``, written.
        chunks: Number of parallel parts.
    """
    blocks = (count + LANES - 1) // LANES
    for chunk in prange(chunks):
        lo, hi = chunk_blocks(blocks, chunks, chunk)
        _shade_chunk(
            features, count, sh, ray_ids, D1, D2, C1, C2, C3, bias, top, sigmas, rgbs, lo, hi
        )


@njit(cache=True, fastmath=True)
def _backward_chunk(
    features, count, sh, ray_ids, D1, D2, C1, C2, C3, bias, top,
    sigmas, rgbs, dsigmas, drgbs, features_grad, dD1, dD2, dC1, dC2, dC3, lo, hi,
):  # fmt: skip
    G = D2.shape[0]
    h = np.empty((D1.shape[0], LANES), np.float32)
    v = np.empty((C1.shape[1], LANES), np.float32)
    p = np.empty((C1.shape[0], LANES), np.float32)
    q = np.empty((C2.shape[0], LANES), np.float32)
    dh, dv, dp, dq = np.empty_like(h), np.empty_like(v), np.empty_like(p), np.empty_like(q)
    dc = np.empty((3, LANES), np.float32)
    one = np.float32(1.0)
    for block in range(lo, hi):
        start = block * LANES
        lanes = min(LANES, count - start)
        _forward_block(features[block], sh, ray_ids, start, lanes, D1, D2, C1, C2, h, v, p, q)
        # Lanes beyond the last point carry no gradient.
        dc[:, lanes:] = 0.0
        for n in range(lanes):
            for k in range(3):
                c = rgbs[start + n, k]
                slope = drgbs[start + n, k] * c * (one - c)
                # A saturated colour leaves next to nothing, which must not end in denormal numbers.
                dc[k, n] = slope if abs(slope) > _LEAST_SLOPE else np.float32(0.0)
        _multiply_back(C3, q, dc, dq, dC3)
        _rectify_back(q, dq, C2.shape[0])
        _multiply_back(C2, p, dq, dp, dC2)
        _rectify_back(p, dp, C1.shape[0])
        _multiply_back(C1, v, dp, dv, dC1)
        for n in range(lanes):
            if v[0, n] + bias < top:
                dv[0, n] += dsigmas[start + n] * sigmas[start + n]
        _multiply_back(D2, h, dv[:G], dh, dD2)
        _rectify_back(h, dh, D1.shape[0])
        _multiply_back(D1, features[block], dh, features_grad[block], dD1)


@njit(cache=True, parallel=True, fastmath=True)
def shade_backward(
    features, count, sh, ray_ids, D1, D2, C1, C2, C3, bias, top,
    sigmas, rgbs, dsigmas, drgbs, features_grad, dD1, dD2, dC1, dC2, dC3,
):  # fmt: skip
    """Turn gradients of densities and colours into those of features and layers.

    Arguments as in ``shade_forward``, whose ``sigmas`` and ``rgbs`` are inputs here; ``dsigmas``
    ``(n,)`` and ``drgbs`` ``(n, 3)`` are the incoming gradients, ``features_grad`` is written, and
    ``dD1`` .. ``dC3``, each with a leading axis of chunks, are added to.
    """
    chunks = len(dD1)
    blocks = (count + LANES - 1) // LANES
    for chunk in prange(chunks):
        lo, hi = chunk_blocks(blocks, chunks, chunk)
        _backward_chunk(
            features, count, sh, ray_ids, D1, D2, C1, C2, C3, bias, top,
            sigmas, rgbs, dsigmas, drgbs, features_grad,
            dD1[chunk], dD2[chunk], dC1[chunk], dC2[chunk], dC3[chunk], lo, hi,
        )  # fmt: skip
