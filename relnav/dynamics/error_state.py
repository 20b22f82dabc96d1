"""The errors of what moves, in the one order in which every filter keeps them.

    position, velocity   chaser from target, m and m/s, `lvlh_ccsds`                   `relative_motion.py`
    attitude, rate       of the target: theta with C = C_hat exp([theta x]), rad, and
                         its inertial rate, rad/s, both target axes                    `rigid_body.py`

The beacon filter has the first two, the marker filter and a vehicle all four; the vehicle's others stand behind them.
"""

MOTION = 6
"""Size of position and velocity."""
ROTATION = 6
"""Size of attitude and rate."""
POSE = MOTION + ROTATION
VELOCITY, THETA, RATE = 3, MOTION, MOTION + 3
"""Where these begin; the position at 0."""


def factor_size(n: int) -> int:
    """Numbers of the lower triangle of (n, n): of packed factors L D L^T."""
    return n * (n + 1) // 2
