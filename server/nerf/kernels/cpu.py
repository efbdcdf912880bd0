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
def _find_corners(points, count, block, layout, rows, weights):
    """Fill table rows and weights ``(8, LANES)`` of the cell around each point of ``block``."""
    resolution, offset, entries, dense = layout
    side = resolution + 1
    mask = entries - 1
    top = np.float32(resolution - 1)
    one = np.float32(1.0)
    for lane in range(LANES):
        n = min(block * LANES + lane, count - 1)
        px = points[n, 0] * np.float32(resolution)
        py = points[n, 1] * np.float32(resolution)
        pz = points[n, 2] * np.float32(resolution)
        cx = min(max(np.floor(px), np.float32(0.0)), top)
        cy = min(max(np.floor(py), np.float32(0.0)), top)
        cz = min(max(np.floor(pz), np.float32(0.0)), top)
        wx, wy, wz = px - cx, py - cy, pz - cz
        ix, iy, iz = np.int64(cx), np.int64(cy), np.int64(cz)
        w00, w10 = (one - wy) * (one - wz), wy * (one - wz)
        w01, w11 = (one - wy) * wz, wy * wz
        weights[0, lane], weights[1, lane] = (one - wx) * w00, wx * w00
        weights[2, lane], weights[3, lane] = (one - wx) * w10, wx * w10
        weights[4, lane], weights[5, lane] = (one - wx) * w01, wx * w01
        weights[6, lane], weights[7, lane] = (one - wx) * w11, wx * w11
        if dense:
            row = offset + ix + side * (iy + side * iz)
            rows[0, lane], rows[1, lane] = row, row + 1
            rows[2, lane], rows[3, lane] = row + side, row + side + 1
            row += side * side
            rows[4, lane], rows[5, lane] = row, row + 1
            rows[6, lane], rows[7, lane] = row + side, row + side + 1
        else:
            y0, y1 = iy * HASH_Y, (iy + 1) * HASH_Y
            z0, z1 = iz * HASH_Z, (iz + 1) * HASH_Z
            rows[0, lane] = offset + ((ix ^ y0 ^ z0) & mask)
            rows[1, lane] = offset + (((ix + 1) ^ y0 ^ z0) & mask)
            rows[2, lane] = offset + ((ix ^ y1 ^ z0) & mask)
            rows[3, lane] = offset + (((ix + 1) ^ y1 ^ z0) & mask)
            rows[4, lane] = offset + ((ix ^ y0 ^ z1) & mask)
            rows[5, lane] = offset + (((ix + 1) ^ y0 ^ z1) & mask)
            rows[6, lane] = offset + ((ix ^ y1 ^ z1) & mask)
            rows[7, lane] = offset + (((ix + 1) ^ y1 ^ z1) & mask)


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
            _find_corners(points, count, block, layout[level], rows, weights)
            for f in range(width):
                out = features[block, level * width + f]
                for lane in range(LANES):
                    total = np.float32(0.0)
                    for corner in range(8):
                        total += weights[corner, lane] * flat[rows[corner, lane] * width + f]
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
def _scatter_chunk(points, count, layout, window, features_grad, table_grad, first, last):
    width = table_grad.shape[1]
    flat = table_grad.reshape(-1)
    rows = np.empty((8, LANES), np.int32)
    weights = np.empty((8, LANES), np.float32)
    for level in range(len(layout)):
        if window[level] == 0.0:
            continue
        for block in range(first, last):
            _find_corners(points, count, block, layout[level], rows, weights)
            lanes = min(LANES, count - block * LANES)
            for lane in range(lanes):
                for corner in range(8):
                    row = rows[corner, lane] * width
                    weight = weights[corner, lane] * window[level]
                    for f in range(width):
                        flat[row + f] += weight * features_grad[block, level * width + f, lane]


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
