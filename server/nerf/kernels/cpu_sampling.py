"""Where along a ray to look: importance sampling by the densities a grid remembers.

A ray is cut into bins of equal path length (``server.nerf.space``). Each bin that cameras can see
gets the share of light that the remembered densities would absorb there, mixed with an even share;
the samples are spread over the bins by that distribution. Every sample stands for the stretch of
path between its neighbours, ``ds_i``, so the samples of a ray cover all of it that can be seen and
an empty-looking stretch is still looked at: the grid decides how closely, never where a ray ends.

Symbols: ``t`` scene units along the ray, ``s`` path units over seen bins only, ``norm`` is
``max(1, |x|)`` and ``ds = dt / norm``.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

_BINS = 160


@njit(cache=True, fastmath=True, inline="always")
def _fold(x, norm):
    """Return one coordinate of ``u``; inside the object's cube ``norm`` is 1 and nothing folds."""
    fold = (np.float32(2.0) - np.float32(1.0) / norm) / norm
    return (x * fold + np.float32(2.0)) * np.float32(0.25)


@njit(cache=True)
def _entry(origin, direction):
    """Return where a ray enters the object's cube, scene units; infinite where it misses it."""
    enter, leave = np.float32(0.0), np.float32(np.inf)
    for axis in range(3):
        slope = direction[axis]
        if abs(slope) < np.float32(1e-9):
            slope = np.float32(1e-9)
        a, b = (np.float32(-1.0) - origin[axis]) / slope, (np.float32(1.0) - origin[axis]) / slope
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    return enter if enter < leave else np.float32(np.inf)


@njit(cache=True)
def _survey(origin, direction, near, far, length, memory, seen, edges, norms, shares, even):
    """Write edge ``t``, ``norm`` and share of every bin; unseen bins have share -1.

    Returns the number of bins.
    """
    cells = memory.shape[0]
    if far <= np.float32(1.0):
        near = max(near, _entry(origin, direction))
        # The cube's own face must not end the ray where it begins.
        far = np.float32(1.0) + length
    t, light, total, count, visible = near, np.float32(1.0), np.float32(0.0), 0, 0
    ox, oy, oz = origin[0], origin[1], origin[2]
    dx, dy, dz = direction[0], direction[1], direction[2]
    one = np.float32(1.0)
    while count < _BINS:
        x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
        norm = max(max(abs(x), abs(y)), max(abs(z), one))
        if not norm <= far:
            break
        middle = t + np.float32(0.5) * length * norm
        x, y, z = ox + middle * dx, oy + middle * dy, oz + middle * dz
        inner = max(max(abs(x), abs(y)), max(abs(z), one))
        i = min(int(_fold(x, inner) * cells), cells - 1)
        j = min(int(_fold(y, inner) * cells), cells - 1)
        k = min(int(_fold(z, inner) * cells), cells - 1)
        edges[count], norms[count] = t, norm
        if seen[i, j, k]:
            through = np.exp(-memory[i, j, k] * length)
            shares[count] = light * (one - through)
            light *= through
            visible += 1
        else:
            shares[count] = np.float32(-1.0)
        t += length * norm
        count += 1
    # A surface may lie in the next bin: each takes the largest share of itself and its neighbours.
    before = np.float32(0.0)
    for b in range(count):
        own = shares[b]
        after = shares[b + 1] if b + 1 < count else np.float32(0.0)
        if own >= 0.0:
            shares[b] = max(own, max(before, after)) + np.float32(1e-5)
            total += shares[b]
        before = max(own, np.float32(0.0))
    for b in range(count):
        if shares[b] >= 0.0:
            shares[b] = (one - even) * shares[b] / total + even / np.float32(visible)
    return count


@njit(cache=True)
def _spread(count, edges, norms, shares, length, jitters, ts, ss, dss):
    """Write distance, path position and path length of a ray's samples, one per stratum."""
    slots = len(ts)
    one = np.float32(1.0)
    b, passed, s = 0, np.float32(0.0), np.float32(0.0)
    last_s, last_t = np.float32(0.0), edges[0] if count else np.float32(0.0)
    for n in range(slots):
        # First the sample, then the far edge of its stratum; both move the same pointer on.
        for half in range(2):
            goal = (n + (jitters[n] if half == 0 else one)) / np.float32(slots)
            while b < count and (shares[b] < 0.0 or passed + shares[b] < goal):
                if shares[b] >= 0.0:
                    passed += shares[b]
                    s += length
                b += 1
            if b < count:
                part = min(max((goal - passed) / shares[b], np.float32(0.0)), one)
                at_s, at_t = s + part * length, edges[b] + part * length * norms[b]
                last_t = at_t
            else:
                at_s, at_t = s, last_t
            if half == 0:
                ts[n], ss[n] = at_t, at_s
            else:
                dss[n] = at_s - last_s
                last_s = at_s


@njit(cache=True, parallel=True)
def sample_paths(
    origins, directions, near, far, length, memory, seen, even, jitters, ts, ss, dss, points, chunks
):
    """Spread the samples of every ray and fold them into the scene cube.

    Args:
        origins: ``(rays, 3)`` scene units.
        directions: ``(rays, 3)`` unit.
        near: Start of every ray, scene units.
        far: Largest coordinate that a ray reaches, scene units; 1 for the object's cube alone.
        length: Path units per bin.
        memory: Remembered density ``(cells, cells, cells)`` per path unit, over ``u``.
        seen: Which cells hold anything that cameras see, bool.
        even: Share of the samples that is spread evenly, in (0, 1].
        jitters: ``(rays, slots)`` place of each sample in its stratum, in [0, 1).
        ts: ``(rays, slots)`` scene units, written.
        ss: ``(rays, slots)`` path units, written.
        dss: ``(rays, slots)`` path units, written; zero where a ray sees nothing.
        points: ``(rays * slots, 3)`` ``u``, written.
        chunks: Number of parallel parts.
    """
    rays, slots = ts.shape
    for chunk in prange(chunks):
        edges, norms = np.empty(_BINS, np.float32), np.empty(_BINS, np.float32)
        shares = np.empty(_BINS, np.float32)
        for r in range(rays * chunk // chunks, rays * (chunk + 1) // chunks):
            count = _survey(
                origins[r], directions[r], near, far, length, memory, seen, edges, norms, shares,
                even,
            )  # fmt: skip
            _spread(count, edges, norms, shares, length, jitters[r], ts[r], ss[r], dss[r])
            for n in range(slots):
                t = ts[r, n]
                x = origins[r, 0] + t * directions[r, 0]
                y = origins[r, 1] + t * directions[r, 1]
                z = origins[r, 2] + t * directions[r, 2]
                norm = max(max(abs(x), abs(y)), max(abs(z), np.float32(1.0)))
                row = r * slots + n
                points[row, 0] = _fold(x, norm)
                points[row, 1] = _fold(y, norm)
                points[row, 2] = _fold(z, norm)


@njit(cache=True)
def keep_visible(slots, sigmas, dss, transmittance, least_weight, keep, counts):
    """Mark the samples that show in a rendering.

    Args:
        slots: Samples per ray.
        sigmas: ``(rays * slots,)`` densities.
        dss: ``(rays * slots,)`` path lengths.
        transmittance: Nothing is kept behind where less light than this is left.
        least_weight: Samples of less weight are dropped.
        keep: bool ``(rays * slots,)``, written.
        counts: ``(rays,)`` kept samples of each ray, written.
    """
    for r in range(len(counts)):
        light, kept = np.float32(1.0), 0
        for n in range(r * slots, (r + 1) * slots):
            through = np.exp(-sigmas[n] * dss[n])
            weight = light * (np.float32(1.0) - through)
            keep[n] = light >= transmittance and weight >= least_weight
            kept += keep[n]
            light *= through
        counts[r] = kept
