"""The relative navigation filter: per epoch (`Navigator`), or over arrays of epochs (`filter_epochs`)."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from relnav._kernel import kernel
from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.geometry.rotation import dcm_from_quaternion_into
from relnav.mission import Model
from relnav.navigation.block import (
    ATTITUDE,
    CLOCK,
    DOCK,
    INNOVATION,
    INPUT,
    METHODS,
    RECORD_END,
    RESULT,
    SETTINGS,
    TRACK,
    new_block,
)
from relnav.navigation.record import FilterRecord, Solution
from relnav.navigation.reference_engine import ReferenceEngine, run_reference
from relnav.navigation.smoothing import pack_factors, smooth_run
from relnav.navigation.step import step
from relnav.sensors.three_beacon.measure import PROJECTIONS

CHUNK = 20_000


ENGINES = ("compiled", "filterpy")


def _choose(model: Model, method: str, projection: str | None, engine: str) -> Matrix:
    if not isinstance(model, Model):
        raise ValueError(f"model is a loaded mission, relnav.load_model(...); got {model!r}")
    if engine not in ENGINES:
        raise ValueError(f'engine must be "compiled" or "filterpy"; got {engine!r}')
    if method not in METHODS:
        raise ValueError(f'method must be "spots" or "fix"; got {method!r}')
    name = model.sensor.projection if projection is None else projection
    if name not in PROJECTIONS:
        raise ValueError(f'projection must be "perspective" or "parallel"; got {name!r}')
    return new_block(model, method, name)


def _vector(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Matrix:
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"{name} has shape {shape}; got {array.shape}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{name} must be finite; got {array.tolist()}")
    return array


class Navigator:
    """A relative navigation filter that takes one image at a time.

    Parameters
    ----------
    model : Model
        From `relnav.load_model`.
    method : {"spots", "fix"}
        Measurement model: the detector coordinates themselves, or the closed form's range, azimuth and elevation.
    projection : {"perspective", "parallel"}, optional
        Closed form of `fix` and of every start; the model's own if left out.
    engine : {"compiled", "filterpy"}
        Ours, or the same filter on filterpy's ExtendedKalmanFilter: hundreds of times slower, for comparison.

    Raises
    ------
    ValueError
        For an unknown method, projection or engine.

    Examples
    --------
    >>> import relnav
    >>> navigator = relnav.Navigator(relnav.load_model("three_beacon_psd"))
    >>> record = navigator.step(0.0, [[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]])
    >>> record.status.name
    'WAITING'
    """

    def __init__(
        self, model: Model, method: str = "spots", *, projection: str | None = None, engine: str = "compiled"
    ) -> None:
        self._block = _choose(model, method, projection, engine)
        self._reference = ReferenceEngine(self._block) if engine == "filterpy" else None
        self._held = self._block[ATTITUDE : ATTITUDE + 3, :3].copy()
        self._held_known = bool(self._block[SETTINGS, 2])
        self._kept = self._block[DOCK:RECORD_END]
        self._last_t = -math.inf
        self._input_used = False
        self._attitude_used = False
        self.model = model
        self.method = method

    def step(
        self,
        t_s: float,
        spots_m: ArrayLike,
        *,
        acceleration_m_s2: ArrayLike | None = None,
        delta_v_m_s: ArrayLike | None = None,
        dcm_cam_from_lvlh: ArrayLike | None = None,
    ) -> FilterRecord:
        """Take one image, and return the state after it.

        Parameters
        ----------
        t_s : float
            Time of the image, after that of the last step.
        spots_m : (3, 2)
            Detector coordinates of beacons A, B, C, m; NaN = not seen.
        acceleration_m_s2 : (3,), optional
            Commanded acceleration in `lvlh_ccsds`, held since the last step.
        delta_v_m_s : (3,), optional
            Impulse in `lvlh_ccsds` just before this image.
        dcm_cam_from_lvlh : (3, 3), optional
            Camera attitude now; the model's if left out.

        Returns
        -------
        FilterRecord
            A bad measurement never raises: it is rejected and reported.

        Raises
        ------
        ValueError
            For wrong use: shapes, a time that does not advance, control or attitude that is not finite. The filter
            is then unchanged.
        """
        spots = np.ascontiguousarray(spots_m, np.float64)
        if spots.shape != (3, 2):
            raise ValueError(f"spots_m has shape (3, 2), rows A, B, C, columns x, y in metres; got {spots.shape}")
        spots = self.model.corrected(spots)
        t = float(t_s)
        if not (self._last_t < t < math.inf):
            raise ValueError(f"t_s must be finite and after the last step's {self._last_t!r} s; got {t!r}")
        if acceleration_m_s2 is not None or delta_v_m_s is not None or self._input_used:
            self._set_input(acceleration_m_s2, delta_v_m_s)
        if dcm_cam_from_lvlh is not None or self._attitude_used:
            self._set_attitude(dcm_cam_from_lvlh)
        if self._reference is None:
            step(self._block, t, spots)
        else:
            self._reference.step(t, spots)
        self._last_t = t
        return FilterRecord(self._kept.copy())

    def _set_input(self, acceleration: ArrayLike | None, delta_v: ArrayLike | None) -> None:
        a = None if acceleration is None else _vector("acceleration_m_s2", acceleration, (3,))
        v = None if delta_v is None else _vector("delta_v_m_s", delta_v, (3,))
        self._block[INPUT, :3] = 0.0 if a is None else a
        self._block[INPUT, 3:] = 0.0 if v is None else v
        self._input_used = a is not None or v is not None

    def _set_attitude(self, dcm: ArrayLike | None) -> None:
        if dcm is None:
            self._block[ATTITUDE : ATTITUDE + 3, :3] = self._held
            self._block[SETTINGS, 2] = float(self._held_known)
        else:
            c = _vector("dcm_cam_from_lvlh", dcm, (3, 3))
            if np.max(np.abs(c)) > 2.0 or np.max(np.abs(c @ c.T - np.eye(3))) > 1e-6 or np.linalg.det(c) < 0.0:
                raise ValueError("dcm_cam_from_lvlh must be a rotation matrix (orthonormal, determinant +1)")
            self._block[ATTITUDE : ATTITUDE + 3, :3] = c
            self._block[SETTINGS, 2] = 1.0
        self._attitude_used = dcm is not None


@kernel
def _run(
    block: Matrix,
    t: Vector,
    spots: Stack,
    control: Matrix,
    quaternion: Matrix,
    state: Matrix,
    factor: Matrix,
    innovation: Matrix,
    nis: Vector,
    codes: Codes,
) -> None:
    """`step` over epochs; control (n, 6) and quaternion (n, 4) may be empty; codes (n, 3): dof, status, Status."""
    for e in range(t.shape[0]):
        if control.shape[0] > 0:
            for j in range(6):
                block[INPUT, j] = control[e, j]
        if quaternion.shape[0] > 0:
            dcm_from_quaternion_into(quaternion[e], block[ATTITUDE : ATTITUDE + 3])
        codes[e, 1] = step(block, t[e], spots[e])
        codes[e, 0] = int(block[RESULT, 2])
        codes[e, 2] = int(block[RESULT, 3])
        nis[e] = block[RESULT, 1]
        running = block[CLOCK, 1] > 0.0
        for i in range(6):
            innovation[e, i] = block[INNOVATION, i]
            state[e, i] = block[TRACK, i] if running else math.nan
        if running:
            pack_factors(block[TRACK + 1 : TRACK + 7], factor[e])
        else:
            for k in range(factor.shape[1]):
                factor[e, k] = math.nan


def filter_epochs(
    model: Model,
    t_s: Vector,
    spots_m: Stack,
    *,
    acceleration_m_s2: Matrix | None = None,
    delta_v_m_s: Matrix | None = None,
    q_cam_from_lvlh: Matrix | None = None,
    method: str = "spots",
    projection: str | None = None,
    engine: str = "compiled",
    smooth: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Solution:
    """Filter a log that is already in memory: the same step as `Navigator`, epoch after epoch.

    Parameters
    ----------
    model : Model
        From `relnav.load_model`.
    t_s : (n,)
        Strictly increasing times.
    spots_m : (n, 3, 2)
        Detector coordinates of beacons A, B, C, m; NaN = not seen.
    acceleration_m_s2, delta_v_m_s : (n, 3), optional
        Control in `lvlh_ccsds`: acceleration held since the row before, impulse just before the row.
    q_cam_from_lvlh : (n, 4), optional
        Camera attitude of each row, unit quaternions, scalar last; the model's if left out.
    method, projection, engine
        As for `Navigator`.
    smooth : bool
        Run backward too: every state then rests on all measurements of its unbroken piece of track.
    progress : callable, optional
        Called with the number of epochs just done.

    Raises
    ------
    ValueError
        For shapes that do not agree, times that do not increase, control or attitude that is not usable.
    """
    block = _choose(model, method, projection, engine)
    reference = ReferenceEngine(block) if engine == "filterpy" else None
    t, spots = _epochs(t_s, spots_m)
    spots = model.corrected(spots)
    n = len(t)
    control = _controls(n, acceleration_m_s2, delta_v_m_s)
    quaternion = _quaternions(n, q_cam_from_lvlh)
    if len(quaternion):
        block[SETTINGS, 2] = 1.0
    state, factor, innovation = np.empty((n, 6)), np.empty((n, 21)), np.empty((n, 6))
    nis, codes = np.empty(n), np.empty((n, 3), dtype=np.int64)
    for begin in range(0, n, CHUNK):
        part = slice(begin, min(n, begin + CHUNK))
        arguments = (
            block,
            t[part],
            spots[part],
            control[part],
            quaternion[part],
            state[part],
            factor[part],
            innovation[part],
            nis[part],
            codes[part],
        )
        if reference is None:
            _run(*arguments)
        else:
            run_reference(*arguments, reference)
        if progress is not None:
            progress(part.stop - part.start)
    if smooth:
        block[INPUT] = 0.0
        smooth_run(block, t, control, codes[:, 1].copy(), state, factor, np.zeros((73, 6)))
    return Solution(
        t_s=t,
        state=state,
        factor=factor,
        innovation=innovation,
        nis=nis,
        dof=codes[:, 0],
        status=codes[:, 1],
        measurement_status=codes[:, 2],
        model=model.name,
        method=method,
        restarts=max(0, int(block[CLOCK, 4]) - 1),
        dcm_dock_from_lvlh=model.dcm_dock_from_lvlh,
        port_m=model.port_position_m,
        lever_lvlh_m=_levers(model, n, quaternion),
        smoothed=smooth,
    )


def _epochs(t_s: Vector, spots_m: Stack) -> tuple[Vector, Stack]:
    t = np.ascontiguousarray(t_s, dtype=np.float64)
    if t.ndim != 1:
        raise ValueError(f"t_s has one axis; got shape {t.shape}")
    spots = np.ascontiguousarray(spots_m, dtype=np.float64)
    if spots.shape != (len(t), 3, 2):
        raise ValueError(f"spots_m has shape ({len(t)}, 3, 2); got {spots.shape}")
    if not np.all(np.isfinite(t)) or np.any(np.diff(t) <= 0.0):
        raise ValueError("t_s must be finite and strictly increasing")
    return t, spots


def _controls(n: int, acceleration: Matrix | None, delta_v: Matrix | None) -> Matrix:
    """Acceleration and impulse of each row, (n, 6), or (0, 6) if there are none."""
    if acceleration is None and delta_v is None:
        return np.empty((0, 6))
    control = np.zeros((n, 6))
    if acceleration is not None:
        control[:, :3] = _vector("acceleration_m_s2", acceleration, (n, 3))
    if delta_v is not None:
        control[:, 3:] = _vector("delta_v_m_s", delta_v, (n, 3))
    return control


def _quaternions(n: int, q_cam_from_lvlh: Matrix | None) -> Matrix:
    """Camera attitude of each row, (n, 4), or (0, 4) if the model's is to be used."""
    if q_cam_from_lvlh is None:
        return np.empty((0, 4))
    quaternion = np.ascontiguousarray(_vector("q_cam_from_lvlh", q_cam_from_lvlh, (n, 4)))
    if np.any(np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) > 9e-4):
        raise ValueError("q_cam_from_lvlh must hold unit quaternions (x, y, z, w)")
    return quaternion


def _levers(model: Model, n: int, quaternion: Matrix) -> Matrix:
    """Camera from the chaser's centre of mass in `lvlh_ccsds`, (n, 3); one number repeated where it is held."""
    lever = model.camera_lever_cam_m
    if not np.any(lever) or len(quaternion) == 0:
        return np.broadcast_to(model.dcm_cam_from_lvlh.T @ lever, (n, 3))
    out = np.empty((n, 3))
    dcm = np.empty((3, 3))
    for e in range(n):
        dcm_from_quaternion_into(quaternion[e], dcm)
        out[e] = dcm.T @ lever
    return out
