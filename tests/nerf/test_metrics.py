"""Figures against closed forms and second implementations."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from server.nerf.metrics import flip, mean_metrics, psnr_db, score_picture, ssim


@pytest.fixture
def pair():
    rng = np.random.default_rng(0)
    reference = gaussian_filter(rng.random((48, 64, 3)), (2, 2, 0)).astype(np.float32)
    reference = (reference - reference.min()) / np.ptp(reference)
    return np.clip(reference + rng.normal(0, 0.05, reference.shape), 0, 1).astype(
        np.float32
    ), reference


def test_psnr_of_a_constant_error():
    reference = np.full((4, 4, 3), 0.5, np.float32)
    assert psnr_db(reference + np.float32(0.1), reference) == pytest.approx(20.0, abs=1e-4)
    assert psnr_db(reference, reference) == 100.0


def test_psnr_inside_a_mask():
    reference = np.zeros((4, 4, 3), np.float32)
    image = reference.copy()
    image[0] = 1.0
    mask = np.zeros((4, 4), bool)
    mask[0] = True
    assert psnr_db(image, reference, mask) == pytest.approx(0.0)
    assert psnr_db(image, reference, ~mask) == 100.0
    with pytest.raises(ValueError, match="empty"):
        psnr_db(image, reference, np.zeros((4, 4), bool))


def test_psnr_needs_equal_shapes():
    with pytest.raises(ValueError, match="differ in shape"):
        psnr_db(np.zeros((2, 2, 3), np.float32), np.zeros((3, 2, 3), np.float32))


def test_ssim_equals_wangs_formula(pair):
    image, reference = (p.astype(np.float64) for p in pair)

    def blur(x):
        return gaussian_filter(x, (1.5, 1.5, 0), truncate=3.5)

    mx, my = blur(image), blur(reference)
    vx, vy = blur(image**2) - mx**2, blur(reference**2) - my**2
    cxy = blur(image * reference) - mx * my
    c1, c2 = 0.01**2, 0.03**2
    table = (2 * mx * my + c1) * (2 * cxy + c2) / ((mx**2 + my**2 + c1) * (vx + vy + c2))
    assert ssim(*pair) == pytest.approx(table[5:-5, 5:-5].mean(), abs=1e-4)


def test_flip_is_zero_for_equal_pictures_and_grows(pair):
    image, reference = pair
    assert flip(reference, reference) == pytest.approx(0.0, abs=1e-6)
    assert 0.0 < flip(image, reference) < flip(1 - reference, reference)


def test_means_are_of_pictures_not_pixels():
    reference = np.full((16, 16, 3), 0.5, np.float32)
    near = score_picture(0, reference + np.float32(0.01), reference, None)
    far = score_picture(8, reference + np.float32(0.1), reference, np.ones((16, 16), bool))
    metrics = mean_metrics([near, far], 24)
    assert metrics.psnr_db == pytest.approx(30.0, abs=1e-3)
    assert metrics.psnr_db_object == pytest.approx(20.0, abs=1e-3)
    assert (metrics.images, metrics.images_held_out) == (24, 2)
    with pytest.raises(ValueError, match="no picture"):
        mean_metrics([], 3)
