"""The hash encoding on the CPU: numba, forward and backward, equal to ``server.nerf.encoding``.

Layout: points are worked on in blocks of ``LANES``; features lie as ``(blocks, L F, LANES)``, so
that the inner loops run over lanes and vectorise. The level loop is the outer one: one level's
table stays in the cache while all points of a chunk pass.

Parallelism: points are cut into as many chunks as there are gradient tables; every chunk adds into
its own table, so that no two threads write the same number and equal seeds give equal results.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from server.nerf.config import FieldConfig
from server.nerf.encoding import HASH_Y, HASH_Z, grid_levels

FloatArray = NDArray[np.float32]

LANES = 64


def level_layout(config: FieldConfig) -> NDArray[np.int64]:
    """Return ``(L, 4)``: resolution, offset, entries, dense of every level."""
    return np.array(
        [(v.resolution, v.offset, v.entries, int(v.dense)) for v in grid_levels(config)], np.int64
    )


@njit(cache=True, fastmath=True)
def chunk_blocks(blocks, chunks, chunk):
    """Return first and last-plus-one block of ``chunk`` of ``chunks``."""
    return blocks * chunk // chunks, blocks * (chunk + 1) // chunks


@njit(cache=True, fastmath=True)
def _find_corners(points, count, block, level, width, rows, weights):
    """Fill table places and weights ``(8, LANES)`` of the cell around each point of ``block``.

    A place is the index of a row's first number in the flat table. All whole numbers have 32 bits,
    so that hashing vectorises twice as wide; the hash keeps low bits only, which wrap alike.
    """
    resolution, offset, entries, dense = level
    scale = np.float32(resolution)
    top = np.float32(resolution - 1)
    one = np.float32(1.0)
    for lane in range(LANES):
        n = min(block * LANES + lane, count - 1)
        px, py, pz = points[n, 0] * scale, points[n, 1] * scale, points[n, 2] * scale
        cx = min(max(np.floor(px), np.float32(0.0)), top)
        cy = min(max(np.floor(py), np.float32(0.0)), top)
        cz = min(max(np.floor(pz), np.float32(0.0)), top)
        wx, wy, wz = px - cx, py - cy, pz - cz
        w00, w10 = (one - wy) * (one - wz), wy * (one - wz)
        w01, w11 = (one - wy) * wz, wy * wz
        weights[0, lane], weights[1, lane] = (one - wx) * w00, wx * w00
        weights[2, lane], weights[3, lane] = (one - wx) * w10, wx * w10
        weights[4, lane], weights[5, lane] = (one - wx) * w01, wx * w01
        weights[6, lane], weights[7, lane] = (one - wx) * w11, wx * w11
        # Cells wait in the first rows for their places.
        rows[0, lane], rows[1, lane], rows[2, lane] = np.int32(cx), np.int32(cy), np.int32(cz)
    step, base = np.int32(width), np.int32(offset * width)
    if dense:
        side = np.int32(resolution + 1)
        dy, dz = np.int32(side * step), np.int32(side * side * step)
        for lane in range(LANES):
            ix, iy, iz = rows[0, lane], rows[1, lane], rows[2, lane]
            row = np.int32(base + np.int32(ix * step) + np.int32(iy * dy) + np.int32(iz * dz))
            for corner in range(8):
                shift = (corner & 1) * step + ((corner >> 1) & 1) * dy + (corner >> 2) * dz
                rows[corner, lane] = row + np.int32(shift)
    else:
        mask, prime_y, prime_z = np.uint32(entries - 1), np.uint32(HASH_Y), np.uint32(HASH_Z)
        for lane in range(LANES):
            x0, y0 = np.uint32(rows[0, lane]), np.uint32(np.uint32(rows[1, lane]) * prime_y)
            z0 = np.uint32(np.uint32(rows[2, lane]) * prime_z)
            for corner in range(8):
                x = np.uint32(x0 + np.uint32(corner & 1))
                y = np.uint32(y0 + prime_y * np.uint32((corner >> 1) & 1))
                z = np.uint32(z0 + prime_z * np.uint32(corner >> 2))
                entry = np.int32((x ^ y ^ z) & mask)
                rows[corner, lane] = base + np.int32(entry * step)


@njit(cache=True, fastmath=True)
def _encode_chunk(points, count, table, layout, window, features, first, last):
    width = table.shape[1]
    flat = table.reshape(-1)
    rows = np.empty((8, LANES), np.int32)
    weights = np.empty((8, LANES), np.float32)
    for level in range(len(layout)):
        if window[level] == 0.0:
            for block in range(first, last):
                features[block, level * width : (level + 1) * width, :] = 0.0
            continue
        for block in range(first, last):
            _find_corners(points, count, block, layout[level], width, rows, weights)
            for f in range(width):
                out = features[block, level * width + f]
                for lane in range(LANES):
                    total = np.float32(0.0)
                    for corner in range(8):
                        total += weights[corner, lane] * flat[rows[corner, lane] + f]
                    out[lane] = total * window[level]


@njit(cache=True, parallel=True, fastmath=True)
def encode_forward(points, count, table, layout, window, features, chunks):
    """Encode the first ``count`` of ``points`` ``(n, 3)`` into ``features``.

    Args:
        points: ``u``, float32 in ``[0, 1]``.
        count: How many of them; lanes beyond repeat the last point.
        table: ``(rows, F)`` float32.
        layout: See ``level_layout``.
        window: Weight ``(L,)`` float32 of every level.
        features: ``(blocks, L F, LANES)`` float32, written.
        chunks: Number of parallel parts.
    """
    blocks = (count + LANES - 1) // LANES
    for chunk in prange(chunks):
        first, last = chunk_blocks(blocks, chunks, chunk)
        _encode_chunk(points, count, table, layout, window, features, first, last)


@njit(cache=True, fastmath=True)
def _scatter_pair(grad, f, lanes, share, rows, weights, flat):
    """Add the gradient of features ``f`` and ``f + 1`` of one block and level; two at a time."""
    for lane in range(lanes):
        g0, g1 = grad[f, lane] * share, grad[f + 1, lane] * share
        for corner in range(8):
            row, weight = rows[corner, lane] + f, weights[corner, lane]
            flat[row] += weight * g0
            flat[row + 1] += weight * g1


@njit(cache=True, fastmath=True)
def _scatter_chunk(points, count, layout, window, features_grad, table_grad, first, last):
    width = table_grad.shape[1]
    flat = table_grad.reshape(-1)
    rows = np.empty((8, LANES), np.int32)
    weights = np.empty((8, LANES), np.float32)
    for level in range(len(layout)):
        if window[level] == 0.0:
            continue
        for block in range(first, last):
            _find_corners(points, count, block, layout[level], width, rows, weights)
            lanes = min(LANES, count - block * LANES)
            grad = features_grad[block, level * width : (level + 1) * width]
            for f in range(0, width - 1, 2):
                _scatter_pair(grad, f, lanes, window[level], rows, weights, flat)
            if width % 2:
                f = width - 1
                for lane in range(lanes):
                    g = grad[f, lane] * window[level]
                    for corner in range(8):
                        flat[rows[corner, lane] + f] += weights[corner, lane] * g


@njit(cache=True, parallel=True, fastmath=True)
def encode_backward(points, count, layout, window, features_grad, table_grads):
    """Add the gradient of the table to ``table_grads`` ``(chunks, rows, F)``, one per chunk.

    ``features_grad`` has the layout of ``features`` in ``encode_forward``.
    """
    chunks = len(table_grads)
    blocks = (count + LANES - 1) // LANES
    for chunk in prange(chunks):
        first, last = chunk_blocks(blocks, chunks, chunk)
        _scatter_chunk(
            points, count, layout, window, features_grad, table_grads[chunk], first, last
        )
