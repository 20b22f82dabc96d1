"""What a caller asks for, checked: a filter of a model as fresh memory, and arrays."""

import math
from importlib.metadata import version

import numpy as np
from numpy.typing import ArrayLike

from relnav.arrays import LARGEST, Matrix, Vector, number, vector
from relnav.dynamics.error_state import MOTION
from relnav.estimation.factored import stated_covariance
from relnav.geometry.linear_algebra import lengths
from relnav.mission import Model, VisionMission
from relnav.navigation.memory import METHODS, new_memory, views
from relnav.navigation.observation.beacon_geometry import attitude_changed
from relnav.sensors.three_beacon.measure import PROJECTIONS

ENGINES = ("compiled", "filterpy")


def choose(model: Model, method: str, projection: str | None, engine: str) -> Vector:
    """Memory of a fresh filter; ValueError for an unknown method, projection or engine."""
    refuse_no_beacons(model, "it is flown by relnav.PoseNavigator, not by relnav.Navigator")
    refuse_unknown_engine(engine)
    if method not in METHODS:
        raise ValueError(f'method must be "spots" or "fix"; got {method!r}')
    name = model.sensor.projection if projection is None else projection
    if name not in PROJECTIONS:
        raise ValueError(f'projection must be "perspective" or "parallel"; got {name!r}')
    block = new_memory(model, method, name)
    m = views(block)
    attitude_changed(m.kept, m.sensor)
    return block


def refuse_no_beacons(model: object, instead: str) -> None:
    """ValueError unless it is a mission of beacons; instead: who takes one of markers."""
    if isinstance(model, VisionMission):
        raise ValueError(f"{model.name} is a marker mission: {instead}")
    if not isinstance(model, Model):
        raise ValueError(f"model is a loaded mission, relnav.load_model(...); got {model!r}")


def refuse_unknown_engine(engine: str) -> None:
    """ValueError unless it is one of `ENGINES`."""
    if engine not in ENGINES:
        raise ValueError(f'engine must be "compiled" or "filterpy"; got {engine!r}')


def start_values(t_s: float, state: ArrayLike, covariance: ArrayLike, size: int) -> tuple[float, Vector, Matrix]:
    """Time, state (6,) and factors (size, size) of a start; ValueError for what is none."""
    t, x = number("t_s", t_s), vector("state", state, (MOTION,))
    if not math.isfinite(t):
        raise ValueError(f"t_s must be finite; got {t_s!r}")
    return t, x, stated_covariance(vector("covariance", covariance, (size, size)))[1]


CONTROL = 6
"""Acceleration and impulse of a row."""


def controls(n: int, acceleration: Matrix | None, delta_v: Matrix | None) -> Matrix:
    """Acceleration and impulse of each row, (n, 6), or (0, 6) if there are none."""
    if acceleration is None and delta_v is None:
        return np.empty((0, CONTROL))
    control = np.zeros((n, CONTROL))
    if acceleration is not None:
        control[:, :3] = vector("acceleration_m_s2", acceleration, (n, 3))
    if delta_v is not None:
        control[:, 3:] = vector("delta_v_m_s", delta_v, (n, 3))
    return control


def quaternions(name: str, n: int, given: Matrix | None) -> Matrix:
    """Attitude of each row, (n, 4), or (0, 4) if the model's is to be used."""
    if given is None:
        return np.empty((0, 4))
    quaternion = np.ascontiguousarray(vector(name, given, (n, 4)))
    if (np.abs(lengths(quaternion) - 1.0) > 9e-4).any():
        raise ValueError(f"{name} must hold unit quaternions (x, y, z, w)")
    return quaternion


def not_negative(name: str, value: float) -> float:
    """A number from zero to LARGEST; ValueError names it otherwise."""
    out = number(name, value)
    if not 0.0 <= out <= LARGEST:
        raise ValueError(f"{name} is zero or more, up to {LARGEST:g}; got {value!r}")
    return out


def refuse_another_version(saved: str) -> None:
    """Refuse the state of a navigator that another version of relnav has saved.

    Raises
    ------
    ValueError
        Naming both.
    """
    here = version("relnav")
    if saved != here:
        raise ValueError(
            f"a navigator saved by relnav {saved} cannot go on in relnav {here}: its memory may be laid out "
            "otherwise; filter from the log again, or begin from its last state (`start`)"
        )


def told_time(t_s: float) -> str:
    """Time of the last step, for the console."""
    return f"t_s={t_s:.12g}" if math.isfinite(t_s) else "no step yet"
