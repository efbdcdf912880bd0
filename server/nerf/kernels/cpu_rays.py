"""Rays on the CPU: compositing with its gradient, and Adam.

Symbols: sample i stands for ``ds_i`` path units (see ``server.nerf.space``) around path position
``s_i``; ``alpha_i = 1 - exp(-sigma_i ds_i)``,
``T_i = prod_{j<i} (1 - alpha_j)``, ``w_i = T_i alpha_i``. Samples are packed: ray r owns rows
``starts[r]`` to ``starts[r + 1]``.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange


@njit(cache=True, fastmath=True)
def composite(starts, sigmas, rgbs, ts, dss, background, image, depths, opacities):
    """Write colour ``(rays, 3)``, mean depth along the ray in scene units, and opacity."""
    for r in range(len(starts) - 1):
        light = np.float32(1.0)
        red = green = blue = depth = np.float32(0.0)
        for k in range(starts[r], starts[r + 1]):
            through = np.exp(-sigmas[k] * dss[k])
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


# Gradients smaller than this share of a ray's own are zero: what lies deep behind a surface would
# otherwise end in denormal numbers, with which a processor is a hundred times slower.
_LEAST_SHARE = np.float32(1e-7)
# Numbers that Adam treats at once, and parallel parts of its work.
_ADAM_BLOCK = 64
_ADAM_PARTS = 16
# Sums of gradients below this are none; their squares would be denormal.
_LEAST_GRADIENT = np.float32(1e-16)


@njit(cache=True, fastmath=True, inline="always")
def _flushed(gradient, scale):
    return gradient if abs(gradient) > scale * _LEAST_SHARE else np.float32(0.0)


@njit(cache=True, fastmath=True)
def _ray_loss(lo, hi, sigmas, rgbs, ts, ss, trusts, dss, backdrop, target, gain, distance, delta,
              distortion, surface, reach, scale, weights, dsigmas, drgbs, dgain):  # fmt: skip
    """Loss of one ray and its gradients; returns loss and squared error, both unscaled."""
    light = np.float32(1.0)
    pixel = np.zeros(3, np.float32)
    for k in range(lo, hi):
        through = np.exp(-sigmas[k] * dss[k])
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
    spread = missed = np.float32(0.0)
    knows = distance > np.float32(0.0)
    reach *= max(distance, np.float32(1e-6))
    behind_w = behind_ws = np.float32(0.0)
    remaining = light
    for k in range(hi - 1, lo - 1, -1):
        w = weights[k]
        front_w, front_ws = total_w - behind_w - w, total_ws - behind_ws - w * ss[k]
        apart = ss[k] * front_w - front_ws + behind_ws - ss[k] * behind_w
        spread += w * apart + w * w * dss[k] / np.float32(3.0)
        q = slope[0] * rgbs[k, 0] + slope[1] * rgbs[k, 1] + slope[2] * rgbs[k, 2]
        q += scale * distortion * (np.float32(2.0) * apart + np.float32(2.0 / 3.0) * w * dss[k])
        if knows:
            near = max(np.float32(1.0) - abs(ts[k] - distance) / reach, np.float32(0.0))
            missed -= w * near
            q -= scale * surface * near
        for c in range(3):
            drgbs[k, c] = _flushed(trusts[k] * slope[c] * w, scale)
        # T_{k+1}, the light that passes sample k, is what is left plus all weights behind it.
        dsigmas[k] = _flushed(trusts[k] * dss[k] * ((remaining + behind_w) * q - tail), scale)
        tail += w * q
        behind_w += w
        behind_ws += w * ss[k]
    if knows:
        missed += np.float32(1.0)
    return loss + distortion * spread + surface * missed, square


@njit(cache=True, parallel=True, fastmath=True)
def loss_gradients(starts, sigmas, rgbs, ts, ss, trusts, dss, backdrops, targets, gains, pictures,
                   distances, delta, distortion, surface, reach, weights, dsigmas, drgbs,
                   gain_grads, sums):  # fmt: skip
    """Composite every ray, compare it with its pixel, and differentiate by densities and colours.

    The loss is the mean over rays of the Huber loss summed over channels, plus ``distortion``
    times mip-NeRF 360's distortion loss (equation 15) in path units, plus ``surface`` times the
    light that is not taken near a ray's known surface (``server.nerf.rendering``).

    Args:
        starts: ``(rays + 1,)`` first sample of every ray.
        sigmas: ``(n,)`` per path unit.
        rgbs: ``(n, 3)``.
        ts: ``(n,)`` distances along the ray, scene units.
        ss: ``(n,)`` path positions.
        trusts: ``(n,)`` factor of the gradients of each sample.
        dss: ``(n,)`` path length of every sample.
        backdrops: ``(rays, 3)`` colour behind everything.
        targets: ``(rays, 3)`` pixels in [0, 1].
        gains: ``(pictures, 3)`` exposure gains.
        pictures: ``(rays,)`` picture of every ray.
        distances: ``(rays,)`` of a known surface, scene units; 0 where none is known.
        delta: Huber's delta.
        distortion: Weight of the distortion loss.
        surface: Weight of the light that is taken elsewhere than at known surfaces.
        reach: How far from one light counts in part, share of its distance.
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
                starts[r], starts[r + 1], sigmas, rgbs, ts, ss, trusts, dss, backdrops[r],
                targets[r], gains[pictures[r]], distances[r], delta, distortion, surface, reach,
                scale, weights, dsigmas, drgbs, gain_grads[chunk, pictures[r]],
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
    size = len(values)
    blocks = (size + _ADAM_BLOCK - 1) // _ADAM_BLOCK
    for part in prange(_ADAM_PARTS):
        total = np.empty(_ADAM_BLOCK, np.float32)
        for block in range(blocks * part // _ADAM_PARTS, blocks * (part + 1) // _ADAM_PARTS):
            start = block * _ADAM_BLOCK
            count = min(_ADAM_BLOCK, size - start)
            # Most blocks of the table saw no sample: finding that out must cost next to nothing.
            largest = np.float32(0.0)
            for n in range(count):
                total[n] = grads[0, start + n]
            for chunk in range(1, len(grads)):
                for n in range(count):
                    total[n] += grads[chunk, start + n]
            for n in range(count):
                largest = max(largest, abs(total[n]))
            if largest <= _LEAST_GRADIENT:
                continue
            for chunk in range(len(grads)):
                grads[chunk, start : start + count] = np.float32(0.0)
            for n in range(count):
                at, g = start + n, total[n]
                touched = abs(g) > _LEAST_GRADIENT
                m = beta_1 * mean[at] + (np.float32(1.0) - beta_1) * g
                v = beta_2 * variance[at] + (np.float32(1.0) - beta_2) * g * g
                push = (m / correction_1) / (np.sqrt(v / correction_2) + np.float32(1e-15))
                value = values[at]
                mean[at] = m if touched else mean[at]
                variance[at] = v if touched else variance[at]
                values[at] = value - rate * (push + decay * value) if touched else value
