"""The speeds that stick positions ask for: a real drone's calibration; pure.

Measured at 20 to 50 in runs of one metre and extrapolated: above, and down to a standstill at 10.
Others report drones that hardly moved at 20, so the dead zone is a property of each drone: sticks
inside it do nothing, those outside give the speeds of the calibration.
"""

from __future__ import annotations

import math

FIRST_STICK = 10.0  # Where the curves begin, so no dead zone is smaller.
_STICK = (FIRST_STICK, 20.0, 30.0, 40.0, 50.0, 70.0, 100.0)
_CURVES = (
    (0.0, 0.099, 0.174, 0.258, 0.362, 0.53, 0.80),  # Right, m/s.
    (0.0, 0.069, 0.128, 0.192, 0.287, 0.41, 0.61),  # Forward, m/s.
    (0.0, 0.042, 0.082, 0.124, 0.178, 0.26, 0.40),  # Up, m/s.
    tuple(math.radians(d) for d in (0.0, 9.1, 16.9, 25.7, 35.1, 53.8, 88.6)),  # Clockwise, rad/s.
)


def stick_speed(axis: int, stick: float, dead_zone: float = FIRST_STICK) -> float:
    """Return the steady speed that one stick asks for.

    Args:
        axis: 0 right, 1 forward, 2 up (metres per second), 3 clockwise (radians per second).
        stick: Its position, -100 to 100.
        dead_zone: Positions nearer to the centre than this do nothing; at least ``FIRST_STICK``.
    """
    size, curve = abs(stick), _CURVES[axis]
    if size < dead_zone:
        return 0.0
    speed = curve[-1]
    for i in range(1, len(_STICK)):
        if size <= _STICK[i]:
            share = (size - _STICK[i - 1]) / (_STICK[i] - _STICK[i - 1])
            speed = curve[i - 1] + share * (curve[i] - curve[i - 1])
            break
    return math.copysign(speed, stick)
