"""The Laplacian of Gaussian against discs of known size, its closed form and the fast search."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from server.vision.blob import Blob
from server.vision.config import RegionConfig
from server.vision.pyramid import fast_blobs
from server.vision.scale_space import find_blobs, lab_float, log_kernels, log_stack, scales

# Twelve scales per octave: the reference is as fine as its time allows.
FINE = np.geomspace(4.0, 48.0, int(12 * np.log2(12.0)) + 1).astype(np.float32)


def picture_of_disc(radius: float, colour: tuple[int, int, int]) -> np.ndarray:
    image = np.full((180, 240, 3), 90, np.uint8)
    cv2.circle(image, (120, 90), round(radius), colour, -1)
    return image


def fast(image: np.ndarray, config: RegionConfig) -> list[Blob]:
    weights = np.array([1.0, config.chroma_weight, config.chroma_weight], np.float32)
    return fast_blobs(lab_float(image) * weights, config, config.min_response)


@pytest.mark.parametrize("radius", [8, 14, 25, 40])
@pytest.mark.parametrize("colour", [(200, 200, 200), (20, 20, 20), (60, 90, 140)])
def test_a_disc_answers_at_its_radius_over_root_two(radius, colour):
    config = RegionConfig()
    sigmas = scales(config)
    stack = log_stack(lab_float(picture_of_disc(radius, colour)), sigmas, config.chroma_weight)
    best = find_blobs(stack, sigmas, config.min_response)[0]
    assert best.sigma_px * np.sqrt(2.0) == pytest.approx(radius, rel=0.06)
    assert (best.x_px, best.y_px) == pytest.approx((120, 90), abs=0.1)


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
    assert fast(image, config) == []


def picture_of_ellipse(rng: np.random.Generator) -> np.ndarray:
    """Return one soft-edged ellipse on a background of light noise, any colours."""
    back = rng.integers(40, 200, 3)
    colour = back.astype(int)
    while np.abs(colour - back).max() < 60:
        colour = rng.integers(10, 245, 3)
    radius = rng.uniform(8.0, 42.0)
    axes = radius * rng.uniform(0.85, 1.18), radius
    mask = np.zeros((720, 960), np.float32)
    centre = rng.uniform(260, 700), rng.uniform(230, 490)
    cv2.ellipse(mask, (centre, (8.0 * axes[0], 8.0 * axes[1]), rng.uniform(0, 180)), 1.0, -1)
    image = back + cv2.resize(mask, (240, 180), interpolation=cv2.INTER_AREA)[..., None] * (
        colour - back
    )
    image += cv2.GaussianBlur(rng.normal(0.0, 6.0, image.shape), (0, 0), 1.0)
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.mark.slow
def test_the_fast_search_agrees_with_the_reference():
    config = RegionConfig()
    for k in range(24):
        image = picture_of_ellipse(np.random.default_rng(k))
        stack = log_stack(lab_float(image), FINE, config.chroma_weight)
        exact = find_blobs(stack, FINE, config.min_response)[0]
        near = fast(image, config)[0]
        off = np.hypot(near.x_px - exact.x_px, near.y_px - exact.y_px)
        assert config.work_scale * off <= 2.0, f"picture {k}"
        assert near.sigma_px == pytest.approx(exact.sigma_px, rel=0.05), f"picture {k}"
        assert near.response == pytest.approx(exact.response, rel=0.1), f"picture {k}"


def test_of_a_map_only_what_stands_out_positively_counts():
    config = RegionConfig()
    image = np.zeros((180, 240), np.float32)
    cv2.circle(image, (80, 90), 20, 1.0, -1)
    cv2.circle(image, (180, 90), 20, -1.0, -1)
    best = fast_blobs(image, config, 0.3)
    assert (best[0].x_px, best[0].y_px) == pytest.approx((80, 90), abs=0.5)
    assert all(blob.x_px < 130 for blob in best if blob.response > 0.5)


@given(width=st.integers(60, 97), height=st.integers(50, 83))
@settings(max_examples=20, deadline=None)
def test_maxima_lie_in_pictures_of_any_size(width, height):
    noise = np.random.default_rng(width * height).normal(0, 20, (height, width, 3))
    noise = cv2.GaussianBlur(noise, (0, 0), 3).astype(np.float32) * 4.0
    for blob in fast_blobs(noise, RegionConfig(), 1.0):
        assert -0.5 <= blob.x_px <= width - 0.5
        assert -0.5 <= blob.y_px <= height - 0.5
