"""What a caller of a vehicle's filter gives, checked."""

from numpy.typing import ArrayLike

from relnav.arrays import LARGEST, numbers
from relnav.spacecraft import FASTEST_TARGET_RAD_S, GYRO, THRUST
from relnav.vehicle.gyro import FASTEST_RAD_S

MOST = {GYRO: FASTEST_RAD_S, THRUST: 1e4, "target_rate_rad_s": FASTEST_TARGET_RAD_S}
"""Of a rate, rad/s, and an acceleration, m/s^2: more is a mistake."""


def refuse_covariance(name: str, covariance: ArrayLike | None) -> None:
    """Refuse that of a gyro sample or a command.

    Raises
    ------
    ValueError
        If there is one.
    """
    if covariance is not None:
        raise ValueError(f"covariance: {name} takes none, its errors are those of [{name}] in the vehicle file")


def three(name: str, value: ArrayLike) -> tuple[float, float, float]:
    """Three numbers of a caller.

    Raises
    ------
    ValueError
        For what is none, or too large to be meant.
    """
    array, most = numbers(name, value), MOST.get(name, LARGEST)
    if array.shape == (3,):
        x, y, z = array.tolist()
        if -most <= x <= most and -most <= y <= most and -most <= z <= most:
            return x, y, z
    raise ValueError(f"{name}: three finite numbers up to {most:g} in size are expected; got {array.tolist()}")
