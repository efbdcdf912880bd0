"""A simulated camera without faults, for tests in which pictures must be what is drawn."""

from __future__ import annotations

from server.sim.config import CameraConfig

# A still pinhole: no distortion, no smear, no exposure that wanders.
IDEAL_CAMERA = CameraConfig(
    distortion=(0.0, 0.0, 0.0, 0.0, 0.0),
    focal_sigma=0.0,
    principal_sigma_px=0.0,
    readout_s=0.0,
    exposure_s=0.0,
    gain_sigma=0.0,
    balance_sigma=0.0,
)
