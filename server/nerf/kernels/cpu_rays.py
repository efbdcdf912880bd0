"""Rays on the CPU: marching through occupied cells, cutting, compositing with its gradient.

Symbols: ray ``r(t) = o + t d`` in scene units; sample i covers ``ds_i`` path units (see
``server.nerf.space``) around path position ``s_i``; ``alpha_i = 1 - exp(-sigma_i ds_i)``,
``T_i = prod_{j<i} (1 - alpha_j)``, ``w_i = T_i alpha_i``. Samples are packed: ray r owns rows
``starts[r]`` to ``starts[r + 1]``.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, fastmath=True)
def _march_ray(origin, direction, state, step, occupancy, t_out, s_out):
    """Write ``t`` and ``s`` of a ray's next samples in occupied cells; return their number.

    ``state`` is ``t`` and ``s`` of the next candidate; ``t`` is infinite once the ray has left.
    """
    cells = occupancy.shape[0]
    ox, oy, oz = origin[0], origin[1], origin[2]
    dx, dy, dz = direction[0], direction[1], direction[2]
    # The folded cube's last layer of cells is left out: it lies beyond any room.
    far = np.float32(cells) / np.float32(4.0)
    quarter = np.float32(0.25) * np.float32(cells)
    two, one = np.float32(2.0), np.float32(1.0)
    count = 0
    t, s = state[0], state[1]
    while count < len(t_out):
        x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
        norm = max(max(abs(x), abs(y)), max(abs(z), one))
        # Written so that an infinite t, whose norm may be NaN, ends the ray too.
        if not norm <= far:
            t = np.float32(np.inf)
            break
        fold = (two - one / norm) / norm
        ix = int((x * fold + two) * quarter)
        iy = int((y * fold + two) * quarter)
        iz = int((z * fold + two) * quarter)
        if occupancy[ix, iy, iz]:
            t_out[count] = t
            s_out[count] = s
            count += 1
        t += step * norm
        s += step
    state[0], state[1] = t, s
    return count


@njit(cache=True)
def start_rays(origins, directions, near, jitters, step, states):
    """Write the first candidate ``t, s`` of every ray to ``states`` ``(rays, 2)``.

    Args:
        origins: ``(rays, 3)`` scene units.
        directions: ``(rays, 3)`` unit.
        near: Start of every ray, scene units.
        jitters: ``(rays,)`` share of a step by which a ray's samples are shifted.
        step: Path units per sample.
        states: Written.
    """
    for r in range(len(origins)):
        norm = np.float32(1.0)
        for axis in range(3):
            norm = max(norm, abs(origins[r, axis] + near * directions[r, axis]))
        states[r, 0] = near + jitters[r] * step * norm
        states[r, 1] = jitters[r] * step


@njit(cache=True, parallel=True)
def march(origins, directions, active, states, step, occupancy, ts, ss, counts, chunks):
    """March some rays on to their next samples in occupied cells.

    Not compiled with fast mathematics: a ray that has left is marked by an infinite ``t``.

    Args:
        origins: ``(rays, 3)`` scene units.
        directions: ``(rays, 3)`` unit.
        active: Rays ``(m,)`` to march.
        states: ``(rays, 2)``, see ``start_rays``; moved on.
        step: Path units per sample.
        occupancy: bool ``(cells, cells, cells)`` over ``u``.
        ts: ``(m, slots)``, written.
        ss: ``(m, slots)``, written.
        counts: ``(m,)``, written.
        chunks: Number of parallel parts.
    """
    rays = len(active)
    for chunk in prange(chunks):
        for k in range(rays * chunk // chunks, rays * (chunk + 1) // chunks):
            r = active[k]
            counts[k] = _march_ray(
                origins[r], directions[r], states[r], step, occupancy, ts[k], ss[k]
            )


@njit(cache=True, fastmath=True)
def pack(origins, directions, active, ts, counts, points):
    """Write the points ``u`` of the marched samples, one ray behind the other."""
    out = 0
    for k in range(len(active)):
        r = active[k]
        for slot in range(counts[k]):
            t = ts[k, slot]
            x = origins[r, 0] + t * directions[r, 0]
            y = origins[r, 1] + t * directions[r, 1]
            z = origins[r, 2] + t * directions[r, 2]
            norm = max(max(abs(x), abs(y)), max(abs(z), np.float32(1.0)))
            fold = (np.float32(2.0) - np.float32(1.0) / norm) / norm
            points[out, 0] = (x * fold + np.float32(2.0)) * np.float32(0.25)
            points[out, 1] = (y * fold + np.float32(2.0)) * np.float32(0.25)
            points[out, 2] = (z * fold + np.float32(2.0)) * np.float32(0.25)
            out += 1


@njit(cache=True)
def absorb(active, counts, sigmas, step, transmittance, least_weight, light, states, keep):
    """Let light through the marched samples: mark which to keep, and which rays have ended.

    Args:
        active: Rays ``(m,)``.
        counts: Samples ``(m,)`` of each.
        sigmas: Their densities, one ray behind the other.
        step: Path units per sample.
        transmittance: A ray ends when less light than this is left.
        least_weight: Samples of less weight are dropped; 0 keeps all (training needs them).
        light: Light ``(rays,)`` left of every ray, changed.
        states: ``t`` of rays that end is made infinite.
        keep: bool, as long as ``sigmas``, written.
    """
    n = 0
    for k in range(len(active)):
        r = active[k]
        left = light[r]
        for _ in range(counts[k]):
            through = np.exp(-sigmas[n] * step)
            keep[n] = left >= transmittance and left * (np.float32(1.0) - through) >= least_weight
            left *= through
            n += 1
        light[r] = left
        if left < transmittance:
            states[r, 0] = np.inf


@njit(cache=True)
def place(active, counts, keep, points, ts, ss, ends, out_points, out_ts, out_ss, out_rays):
    """Append the kept samples of one wave behind those of earlier waves of the same rays.

    ``ends`` ``(rays,)`` is the next free row of every ray, moved on; the other arguments are those
    of ``march``, ``pack`` and ``absorb`` and the packed arrays they go to.
    """
    n = 0
    for k in range(len(active)):
        r = active[k]
        for slot in range(counts[k]):
            if keep[n]:
                row = ends[r]
                for axis in range(3):
                    out_points[row, axis] = points[n, axis]
                out_ts[row], out_ss[row], out_rays[row] = ts[k, slot], ss[k, slot], r
                ends[r] = row + 1
            n += 1


@njit(cache=True, fastmath=True)
def composite(starts, sigmas, rgbs, ts, step, background, image, depths, opacities):
    """Write colour ``(rays, 3)``, mean depth along the ray in scene units, and opacity."""
    for r in range(len(starts) - 1):
        light = np.float32(1.0)
        red = green = blue = depth = np.float32(0.0)
        for k in range(starts[r], starts[r + 1]):
            through = np.exp(-sigmas[k] * step)
            weight = light * (np.float32(1.0) - through)
            red += weight * rgbs[k, 0]
            green += weight * rgbs[k, 1]
            blue += weight * rgbs[k, 2]
            depth += weight * ts[k]
            light *= through
        opacity = np.float32(1.0) - light
        image[r, 0] = red + light * background[0]
        image[r, 1] = green + light * background[1]
        image[r, 2] = blue + light * background[2]
        depths[r] = depth / max(opacity, np.float32(1e-6))
        opacities[r] = opacity


@njit(cache=True, fastmath=True)
def _ray_loss(lo, hi, sigmas, rgbs, ss, trusts, step, backdrop, target, gain, delta, distortion,
              scale, weights, dsigmas, drgbs, dgain):  # fmt: skip
    """Loss of one ray and its gradients; returns loss and squared error, both unscaled."""
    light = np.float32(1.0)
    pixel = np.zeros(3, np.float32)
    for k in range(lo, hi):
        through = np.exp(-sigmas[k] * step)
        weights[k] = light * (np.float32(1.0) - through)
        for c in range(3):
            pixel[c] += weights[k] * rgbs[k, c]
        light *= through
    loss = square = np.float32(0.0)
    slope = np.empty(3, np.float32)
    for c in range(3):
        pixel[c] += light * backdrop[c]
        error = pixel[c] * gain[c] - target[c]
        square += error * error
        if abs(error) < delta:
            loss += np.float32(0.5) * error * error
            bend = error
        else:
            loss += delta * (abs(error) - np.float32(0.5) * delta)
            bend = delta * np.sign(error)
        # Gain is exp(log gain), so its derivative is the shown pixel itself.
        dgain[c] += scale * bend * pixel[c] * gain[c]
        slope[c] = scale * bend * gain[c]
    total_w = total_ws = np.float32(0.0)
    for k in range(lo, hi):
        total_w += weights[k]
        total_ws += weights[k] * ss[k]
    # One sweep from the back: q_k is dL/dw_k, tail the sum of w_j q_j over j > k.
    tail = light * (slope[0] * backdrop[0] + slope[1] * backdrop[1] + slope[2] * backdrop[2])
    spread = np.float32(0.0)
    behind_w = behind_ws = np.float32(0.0)
    remaining = light
    for k in range(hi - 1, lo - 1, -1):
        w = weights[k]
        front_w, front_ws = total_w - behind_w - w, total_ws - behind_ws - w * ss[k]
        apart = ss[k] * front_w - front_ws + behind_ws - ss[k] * behind_w
        spread += w * apart + w * w * step / np.float32(3.0)
        q = slope[0] * rgbs[k, 0] + slope[1] * rgbs[k, 1] + slope[2] * rgbs[k, 2]
        q += scale * distortion * (np.float32(2.0) * apart + np.float32(2.0 / 3.0) * w * step)
        for c in range(3):
            drgbs[k, c] = trusts[k] * slope[c] * w
        # T_{k+1}, the light that passes sample k, is what is left plus all weights behind it.
        dsigmas[k] = trusts[k] * step * ((remaining + behind_w) * q - tail)
        tail += w * q
        behind_w += w
        behind_ws += w * ss[k]
    return loss + distortion * spread, square


@njit(cache=True, parallel=True, fastmath=True)
def loss_gradients(starts, sigmas, rgbs, ss, trusts, step, backdrops, targets, gains, pictures,
                   delta, distortion, weights, dsigmas, drgbs, gain_grads, sums):  # fmt: skip
    """Composite every ray, compare it with its pixel, and differentiate by densities and colours.

    The loss is the mean over rays of the Huber loss summed over channels, plus ``distortion``
    times mip-NeRF 360's distortion loss (equation 15) in path units.

    Args:
        starts: ``(rays + 1,)`` first sample of every ray.
        sigmas: ``(n,)`` per path unit.
        rgbs: ``(n, 3)``.
        ss: ``(n,)`` path positions.
        trusts: ``(n,)`` factor of the gradients of each sample.
        step: Path units per sample.
        backdrops: ``(rays, 3)`` colour behind everything.
        targets: ``(rays, 3)`` pixels in [0, 1].
        gains: ``(pictures, 3)`` exposure gains.
        pictures: ``(rays,)`` picture of every ray.
        delta: Huber's delta.
        distortion: Weight of the distortion loss.
        weights: ``(n,)``, written.
        dsigmas: ``(n,)``, written.
        drgbs: ``(n, 3)``, written.
        gain_grads: ``(chunks, pictures, 3)``, added to; by log gain.
        sums: ``(chunks, 2)`` loss and squared error, written.
    """
    rays = len(starts) - 1
    chunks = len(sums)
    scale = np.float32(1.0 / rays)
    for chunk in prange(chunks):
        loss = square = 0.0
        for r in range(rays * chunk // chunks, rays * (chunk + 1) // chunks):
            a, b = _ray_loss(
                starts[r], starts[r + 1], sigmas, rgbs, ss, trusts, step, backdrops[r], targets[r],
                gains[pictures[r]], delta, distortion, scale, weights, dsigmas, drgbs,
                gain_grads[chunk, pictures[r]],
            )  # fmt: skip
            loss += a
            square += b
        sums[chunk, 0], sums[chunk, 1] = loss, square


@njit(cache=True, parallel=True, fastmath=True)
def adam_step(
    values, grads, mean, variance, rate, beta_1, beta_2, correction_1, correction_2, decay
):
    """Sum the gradients of all chunks, take one Adam step, and clear them.

    Numbers without gradient are left alone, moments included: most table rows are untouched in
    any one step.

    Args:
        values: ``(n,)`` parameters, changed.
        grads: ``(chunks, n)``, summed and zeroed.
        mean: First moments ``(n,)``.
        variance: Second moments ``(n,)``.
        rate: Step length.
        beta_1: Decay of the first moment.
        beta_2: Decay of the second moment.
        correction_1: ``1 - beta_1^step``.
        correction_2: ``1 - beta_2^step``.
        decay: Share of ``rate`` by which touched values shrink.
    """
    for n in prange(len(values)):
        total = np.float32(0.0)
        for chunk in range(len(grads)):
            total += grads[chunk, n]
            grads[chunk, n] = np.float32(0.0)
        if total != np.float32(0.0):
            mean[n] = beta_1 * mean[n] + (np.float32(1.0) - beta_1) * total
            variance[n] = beta_2 * variance[n] + (np.float32(1.0) - beta_2) * total * total
            push = (mean[n] / correction_1) / (
                np.sqrt(variance[n] / correction_2) + np.float32(1e-15)
            )
            values[n] -= rate * (push + decay * values[n])
