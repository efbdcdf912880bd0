"""The Laplacian of Gaussian against discs of known size and against its closed form."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from server.vision.config import RegionConfig
from server.vision.scale_space import find_blobs, lab_float, log_kernels, log_stack, scales


def picture_of_disc(radius: float, colour: tuple[int, int, int]) -> np.ndarray:
    image = np.full((180, 240, 3), 90, np.uint8)
    cv2.circle(image, (120, 90), round(radius), colour, -1)
    return image


@pytest.mark.parametrize("radius", [8, 14, 25, 40])
@pytest.mark.parametrize("colour", [(200, 200, 200), (20, 20, 20), (60, 90, 140)])
def test_a_disc_answers_at_its_radius_over_root_two(radius, colour):
    config = RegionConfig()
    sigmas = scales(config)
    stack = log_stack(lab_float(picture_of_disc(radius, colour)), sigmas, config.chroma_weight)
    best = find_blobs(stack, sigmas, config.min_response)[0]
    assert best.sigma_px * np.sqrt(2.0) == pytest.approx(radius, rel=0.06)
    assert (best.x_px, best.y_px) == pytest.approx((120, 90), abs=2)


def test_the_kernel_is_equation_two():
    sigma = 5.0
    g, second = log_kernels(sigma)
    x = np.arange(len(g)) - len(g) // 2
    squared = x[:, None] ** 2 + x[None, :] ** 2
    kernel = -(np.outer(second, g) + np.outer(g, second))
    # Equation 2 carries 1 / (pi sigma^2); sigma^2 (g_xx + g_yy) equals minus that.
    equation = (1 - squared / (2 * sigma**2)) * np.exp(-squared / (2 * sigma**2))
    np.testing.assert_allclose(kernel, equation / (np.pi * sigma**2), atol=2e-5)


@given(level=st.integers(0, 255))
@settings(max_examples=10, deadline=None)
def test_an_even_picture_has_no_blob(level):
    config = RegionConfig()
    sigmas = scales(config)
    image = np.full((90, 120, 3), level, np.uint8)
    assert find_blobs(log_stack(lab_float(image), sigmas), sigmas, config.min_response) == []


def test_halved_octaves_equal_the_full_picture():
    rng = np.random.default_rng(0)
    noise = rng.normal(50, 30, (160, 200, 3))
    noise = cv2.GaussianBlur(noise, (0, 0), 3).astype(np.float32)
    from_octaves = log_stack(noise, np.array([20.0], np.float32))[0]
    g, second = log_kernels(20.0)
    full = cv2.sepFilter2D(noise, cv2.CV_32F, second, g, borderType=cv2.BORDER_REFLECT)
    full = full + cv2.sepFilter2D(noise, cv2.CV_32F, g, second, borderType=cv2.BORDER_REFLECT)
    exact = np.sqrt((full**2).sum(axis=2))
    assert np.abs(from_octaves - exact)[20:-20, 20:-20].max() < 0.08 * exact.max()
