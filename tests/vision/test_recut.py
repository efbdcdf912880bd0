"""Masks cut anew with known poses, on the simulated room against true silhouettes."""

import numpy as np
import pytest

from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.sim.scenes.catalogue import load_object
from server.sim.world import World
from server.stages import CameraPose
from server.vision.config import RegionConfig, SeedConfig
from server.vision.recut import MaskedPicture, recut_masks

KNOWN = np.diag([0.005**2] * 3 + [0.003**2])


def iou(a, b):
    return float((a & b).sum() / max((a | b).sum(), 1))


@pytest.fixture(scope="module")
def ring():
    """Twelve pictures round the robot dog, with their true silhouettes."""
    world = World(load_object("robot_dog"))
    views = []
    try:
        for k in range(12):
            azimuth = 2.0 * np.pi * k / 12.0
            place = np.array([1.7 * np.cos(azimuth), 1.7 * np.sin(azimuth), 0.6 + 0.2 * (k % 3)])
            T = camera_pose(place, azimuth + np.pi, TELLO_TILT_RAD)
            views.append((T, world.render(T), world.silhouette(T)))
    finally:
        world.close()
    return views


def pictures(ring, masks):
    return [
        MaskedPicture(image, mask, CameraPose("d", 0.0, T, KNOWN), TELLO_INTRINSICS)
        for (T, image, _), mask in zip(ring, masks, strict=True)
    ]


@pytest.mark.slow
def test_what_single_masks_took_along_or_lost_is_mended(ring):
    masks = [true.copy() for _, _, true in ring]
    # One lies on something behind the object, one took its surroundings along, one lost its legs,
    # one was never made.
    masks[1][:] = False
    masks[1][20:180, 100:420] = True
    ys, xs = np.nonzero(masks[4])
    masks[4][ys.min() - 60 : ys.max() + 40, xs.min() - 90 : xs.max() + 90] = True
    ys, _ = np.nonzero(masks[7])
    masks[7][(ys.min() + ys.max()) // 2 :] = False
    masks[10] = None
    told = []
    cut = recut_masks(pictures(ring, masks), RegionConfig(), SeedConfig(), told.append)
    fits = [iou(mask, true) for mask, (_, _, true) in zip(cut, ring, strict=True)]
    assert min(fits) > 0.6
    assert np.mean(fits) > 0.75
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_masks_that_have_nothing_in_common_stay(ring):
    far_apart = [np.zeros_like(true) for _, _, true in ring]
    for k, mask in enumerate(far_apart):
        mask[10 + 300 * (k % 2) : 60 + 300 * (k % 2), 10 + 400 * (k % 3) : 60 + 400 * (k % 3)] = (
            True
        )
    kept = recut_masks(pictures(ring, far_apart), RegionConfig(), SeedConfig(), lambda _share: None)
    assert all(a is b for a, b in zip(kept, far_apart, strict=True))
