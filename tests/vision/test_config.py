"""Settings that make no sense are refused where they are made, by name."""

from dataclasses import replace

import pytest

from server.vision.config import LocalizationConfig, RegionConfig, SeedConfig, VisionConfig


@pytest.mark.parametrize(
    ("config", "field", "value"),
    [
        (RegionConfig(), "work_scale", 0),
        (RegionConfig(), "sigma_max_px", 1.0),
        (RegionConfig(), "max_area_share", 1.5),
        (RegionConfig(), "histogram_bins", 2),
        (SeedConfig(), "slices", 0),
        (SeedConfig(), "min_views", 1),
        (SeedConfig(), "agreement", 1.5),
        (LocalizationConfig(), "start_yaw_sigma_rad", -0.1),
        (LocalizationConfig(), "tof_offset_m", 2.0),
    ],
)
def test_a_bad_value_is_refused_by_name(config, field, value):
    with pytest.raises(ValueError, match=field):
        replace(config, **{field: value})


def test_the_defaults_are_valid():
    VisionConfig()
