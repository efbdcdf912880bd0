"""How sharp a picture is: smears are seen, noise and brightness hardly matter."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from server.geometry.poses import look_at
from server.vision.sharpness import sharpness
from tests.nerf.tiny_scene import BALL_CENTRE, CAMERA, trace


@pytest.fixture(scope="module")
def image_bgr() -> np.ndarray:
    pose = look_at(np.array([1.4, 0.0, 0.8]), BALL_CENTRE)
    return trace(CAMERA.scaled(10), pose)[..., ::-1].copy()


def test_the_longer_the_smear_the_less_sharp(image_bgr: np.ndarray) -> None:
    smeared = [cv2.blur(image_bgr, (length_px, 1)) for length_px in (1, 9, 15, 25)]
    measured = [sharpness(image.astype(np.uint8)) for image in smeared]
    assert measured == sorted(measured, reverse=True)
    assert measured[-1] < 0.6 * measured[0]


def test_noise_is_not_taken_for_sharpness(image_bgr: np.ndarray) -> None:
    noise = np.random.default_rng(0).normal(0.0, 8.0, image_bgr.shape)
    noisy = np.clip(image_bgr + noise, 0, 255).astype(np.uint8)
    assert sharpness(noisy) == pytest.approx(sharpness(image_bgr), rel=0.15)


def test_nothing_is_not_sharp() -> None:
    assert sharpness(np.full((72, 96, 3), 127, np.uint8)) == 0.0
    assert sharpness(np.zeros((2, 2, 3), np.uint8)) == 0.0
