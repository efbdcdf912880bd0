"""The speeds that stick positions ask for: a real drone's calibration; pure.

Measured at 20 to 50 in runs of one metre, extrapolated above, with a dead zone below 10.
"""

from __future__ import annotations

import math

_STICK = (10.0, 20.0, 30.0, 40.0, 50.0, 70.0, 100.0)
_CURVES = (
    (0.0, 0.099, 0.174, 0.258, 0.362, 0.53, 0.80),  # Right, m/s.
    (0.0, 0.069, 0.128, 0.192, 0.287, 0.41, 0.61),  # Forward, m/s.
    (0.0, 0.042, 0.082, 0.124, 0.178, 0.26, 0.40),  # Up, m/s.
    tuple(math.radians(d) for d in (0.0, 9.1, 16.9, 25.7, 35.1, 53.8, 88.6)),  # Clockwise, rad/s.
)


def stick_speed(axis: int, stick: float) -> float:
    """Return the steady speed along ``axis`` (0 right, 1 forward, 2 up, 3 clockwise)."""
    size, curve = abs(stick), _CURVES[axis]
    if size <= _STICK[0]:
        return 0.0
    speed = curve[-1]
    for i in range(1, len(_STICK)):
        if size <= _STICK[i]:
            share = (size - _STICK[i - 1]) / (_STICK[i] - _STICK[i - 1])
            speed = curve[i - 1] + share * (curve[i] - curve[i - 1])
            break
    return math.copysign(speed, stick)
