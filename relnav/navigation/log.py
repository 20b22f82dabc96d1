"""The filter over a log: forward chunk by chunk, and backward from what stands after a chunk.

Chunks follow one another on one block, so a log in pieces gives the same bits as the log in one piece.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from relnav.arrays import LARGEST, Codes, Matrix, Stack, Vector, one_piece
from relnav.codegen.kernel import entry, kernel, long_entry
from relnav.codegen.together import select
from relnav.dynamics.error_state import MOTION, factor_size
from relnav.estimation.considered import join_considered
from relnav.estimation.rows import copy_track
from relnav.geometry.rotation import dcm_from_quaternion_into
from relnav.mission import Model
from relnav.navigation.arguments import choose, controls, quaternions, refuse_no_beacons
from relnav.navigation.lasting_words import lasting_words
from relnav.navigation.memory import Memory, views
from relnav.navigation.observation.beacon_geometry import attitude_changed
from relnav.navigation.packed_factors import pack_factors, unpack_factors
from relnav.navigation.record import Solution
from relnav.navigation.reference import for_beacons
from relnav.navigation.smoothing import nothing_later, smooth_run
from relnav.navigation.step import step

CHUNK = 65_536


@dataclass(frozen=True)
class Epochs:
    """What the filter says of n epochs.

    state (n, 6), factor (n, 21), innovation (n, 2 beacons), nis (n,); codes (n, 4): dof, EpochStatus, Status, Alarm;
    considered (n, m, 6): sensitivities to what is considered, factor then being the filter's own, until both are
    joined. m = 0: nothing is considered, or it is in the factors.
    """

    state: Matrix
    factor: Matrix
    innovation: Matrix
    nis: Vector
    codes: Codes
    considered: Stack

    @classmethod
    def empty(cls, n: int, beacons: int, considered: int = 0) -> "Epochs":
        """Room for n epochs."""
        codes, numbers = np.empty((n, 4), dtype=np.int64), 2 * beacons
        rows = np.empty((n, considered, MOTION))
        return cls(
            np.empty((n, MOTION)), np.empty((n, factor_size(MOTION))), np.empty((n, numbers)), np.empty(n), codes, rows
        )

    def part(self, cut: slice) -> "Epochs":
        """Some of the epochs (views, not copies)."""
        return Epochs(*(getattr(self, entry.name)[cut] for entry in fields(self)))


class Rows(NamedTuple):
    """What epochs are told and say, a row each; of inputs that there are none of, no rows.

    t (n,), spots (n, beacons, 2), control (n, 6), quaternion (n, 4), sigma (n, beacons, 2), lasting (n, beacons); and
    as `Epochs`.
    """

    t: Vector
    spots: Stack
    control: Matrix
    quaternion: Matrix
    sigma: Stack
    lasting: Matrix
    state: Matrix
    factor: Matrix
    innovation: Matrix
    nis: Vector
    codes: Codes
    considered: Stack


@kernel
def _take_inputs(m: Memory, e: int, rows: Rows) -> None:
    """Write what an epoch's row says besides its spots: control, attitude, sigmas."""
    acceleration, delta_v = m.motion["acceleration"], m.motion["delta_v"]
    if rows.control.shape[0] > 0:
        for j in range(3):
            acceleration[j], delta_v[j] = rows.control[e, j], rows.control[e, 3 + j]
    if rows.quaternion.shape[0] > 0:
        dcm_from_quaternion_into(rows.quaternion[e], m.kept["mount"])
        attitude_changed(m.kept, m.sensor)
    if rows.sigma.shape[0] > 0:
        for i in range(m.beacons.shape[0]):
            own = m.beacons[i]["spot_sigma"]
            for k in range(2):
                own[k] = select(rows.sigma[e, i, k] > 0.0, rows.sigma[e, i, k], own[k])
    if rows.lasting.shape[0] > 0:
        for i in range(m.beacons.shape[0]):
            m.beacons[i]["lasting_sigma"] = rows.lasting[e, i]


@kernel
def run_rows(block: Vector, begin: int, end: int, rows: Rows) -> None:
    """`step` with the inputs of each row from `begin` to before `end`, and what the filter says into that row.

    With room in considered (n, m, 6), sensitivities and the filter's own factors are kept apart.
    """
    m = views(block)
    codes, state, factor, considered = rows.codes, rows.state, rows.factor, rows.considered
    apart, result, sensitivities = considered.shape[1], m.result, m.sensitivities
    reported = m.work["ld"] if sensitivities.shape[0] > apart else m.track["ld"]
    for e in range(begin, end):
        _take_inputs(m, e, rows)
        codes[e, 1] = step(block, rows.t[e], rows.spots[e])
        codes[e, 0], codes[e, 2] = result["dof"], result["reason"]
        codes[e, 3] = m.watch["alarm"] if m.clock["running"] > 0 else 0
        rows.nis[e] = result["nis"]
        for k in range(rows.innovation.shape[1]):
            rows.innovation[e, k] = m.innovations[k]
        if m.clock["running"] > 0:
            for i in range(MOTION):
                state[e, i] = m.track["state"][i]
            if sensitivities.shape[0] > apart:
                copy_track(m.track, m.work)
                join_considered(reported, sensitivities)
            pack_factors(reported, factor[e])
            for k in range(apart):
                for i in range(MOTION):
                    considered[e, k, i] = sensitivities[k, i]
        else:
            for i in range(MOTION):
                state[e, i] = np.nan
            for i in range(factor.shape[1]):
                factor[e, i] = np.nan
            for k in range(apart):
                for i in range(MOTION):
                    considered[e, k, i] = np.nan


@long_entry
def _run(
    block: Vector,
    t: Vector,
    spots: Stack,
    control: Matrix,
    quaternion: Matrix,
    sigma: Stack,
    lasting: Matrix,
    state: Matrix,
    factor: Matrix,
    innovation: Matrix,
    nis: Vector,
    codes: Codes,
    considered: Stack,
) -> None:
    """`run_rows` over all."""
    rows = Rows(
        t, spots, control, quaternion, sigma, lasting, state, factor, innovation, nis, codes, considered
    )  # fmt: skip
    run_rows(block, 0, t.shape[0], rows)


@entry
def _join(state: Matrix, factor: Matrix, considered: Stack, ld: Matrix) -> None:
    """Add what is considered (n, m, 6) to the packed factors (n, 21) of states (n, 6); ld (6, 6) is scratch."""
    for e in range(factor.shape[0]):
        if state[e, 0] == state[e, 0]:
            unpack_factors(factor[e], ld)
            join_considered(ld, considered[e])
            pack_factors(ld, factor[e])


class LogFilter:
    """A filter that is fed a log in chunks, forward; and each chunk backward, once what comes after it is known."""

    def __init__(
        self, model: Model, method: str = "fix", *, projection: str | None = None, engine: str = "compiled"
    ) -> None:
        """As for `Navigator`."""
        self.model, self.method = model, method
        self.block = choose(model, method, projection, engine)
        self._reference = for_beacons(engine, model, method, projection, self.block)
        self._named = views(self.block)
        self._considered = len(self._named.sensitivities)
        self._dock, self._port = model.dcm_dock_from_lvlh, model.port_position_m
        self._held_lever, self._words = _levers(model, 1, np.empty((0, 4))), lasting_words(model, method)

    def room(self, n: int, *, smooth: bool) -> Epochs:
        """Room for n epochs, which are to be smoothed or not."""
        return Epochs.empty(n, len(self._named.beacons), self._considered if smooth else 0)

    def nothing_later(self) -> Vector:
        """What stands after a log's last epoch."""
        return nothing_later(self._considered)

    def forward(
        self, t: Vector, spots: Stack, control: Matrix, quaternion: Matrix, epochs: Epochs, sigma: Stack | None = None
    ) -> None:
        """Filter the next epochs.

        t (n,), spots (n, beacons, 2), control (n, 6) or (0, 6), quaternion (n, 4) or (0, 4); sigma (n, beacons, 2) of
        the spots' noise, if it is not the model's.
        """
        if len(quaternion):
            self._named.sensor["attitude_known"] = 1
        lasting = np.empty((0, 0))
        if self.model.calibration is not None:
            spots, lasting = self.model.calibration.corrected(spots)
        noise = np.empty((0, 0, 2)) if sigma is None else sigma
        rows = Rows(t, spots, control, quaternion, noise, lasting, *vars(epochs).values())
        if self._reference is None:
            _run(self.block, *rows)
        else:
            self._reference.run(rows)

    def backward(self, t: Vector, control: Matrix, epochs: Epochs, later: Vector) -> None:
        """Smooth filtered epochs in place; `later` is what stands after them, and then what stands at their first."""
        self._named.motion["acceleration"], self._named.motion["delta_v"] = 0.0, 0.0
        state, factor, considered = epochs.state, epochs.factor, epochs.considered
        smooth_run(self.block, t, control, epochs.codes, state, factor, considered, later)
        if self._considered:
            _join(state, factor, considered, np.empty((MOTION, MOTION)))

    @property
    def restarts(self) -> int:
        """How often a confirmed start has replaced a track."""
        return max(0, int(self._named.clock["starts"]) - 1)

    def solution(self, t: Vector, quaternion: Matrix, epochs: Epochs, *, smoothed: bool) -> Solution:
        """The epochs for a reader."""
        return Solution(
            t_s=t,
            state=epochs.state,
            factor=epochs.factor,
            innovation=epochs.innovation,
            nis=epochs.nis,
            dof=epochs.codes[:, 0],
            status=epochs.codes[:, 1],
            measurement_status=epochs.codes[:, 2],
            alarm=epochs.codes[:, 3],
            model=self.model.name,
            method=self.method,
            restarts=self.restarts,
            dcm_dock_from_lvlh=self._dock,
            port_m=self._port,
            lever_lvlh_m=_levers(self.model, len(t), quaternion) if len(quaternion) else self._held_lever,
            smoothed=smoothed,
            metadata=dict(self._words),
        )


def filter_epochs(
    model: Model,
    t_s: Vector,
    spots_m: Stack,
    *,
    acceleration_m_s2: Matrix | None = None,
    delta_v_m_s: Matrix | None = None,
    q_cam_from_lvlh: Matrix | None = None,
    method: str = "fix",
    spot_sigma_m: Stack | None = None,
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
    spots_m : (n, beacons, 2)
        Detector coordinates, m, one row for each of the model's beacons: A, B, C, then `extra_beacons_m` in order; NaN
        = not seen.
    acceleration_m_s2, delta_v_m_s : (n, 3), optional
        Control in `lvlh_ccsds`: acceleration held since the row before, impulse just before the row.
    q_cam_from_lvlh : (n, 4), optional
        Camera attitude of each row, unit quaternions, scalar last; the model's if left out.
    method, projection, engine
        As for `Navigator`.
    spot_sigma_m : (n, beacons, 2), optional
        1-sigma of each spot coordinate's noise; the model's if left out. Where it is NaN the last one stays. The
        residual of a calibration is added.
    smooth : bool
        Add a backward pass: every state is then estimated from all measurements of its segment of the track.
    progress : callable, optional
        Called with the number of epochs just done.

    Raises
    ------
    ValueError
        For another kind of model, shapes that do not agree, times that do not increase, control or attitude that is not
        usable.
    """
    refuse_no_beacons(model, "its log is filtered by relnav.filter_marker_epochs, not by relnav.filter_epochs")
    t, spots = _epochs(model, t_s, spots_m)
    n = len(t)
    if spot_sigma_m is not None:
        spot_sigma_m = one_piece("spot_sigma_m", spot_sigma_m)
        if spot_sigma_m.shape != spots.shape:
            raise ValueError(f"spot_sigma_m has shape {spots.shape}; got {spot_sigma_m.shape}")
        wrong = (spot_sigma_m <= 0.0) | (spot_sigma_m > LARGEST)
        if wrong.any():
            row = int(np.argwhere(wrong)[0, 0])
            told = spot_sigma_m[row].tolist()
            raise ValueError(f"spot_sigma_m is above zero, up to {LARGEST:g}; got {told} at epoch {row}")
    control = controls(n, acceleration_m_s2, delta_v_m_s)
    quaternion = quaternions("q_cam_from_lvlh", n, q_cam_from_lvlh)
    log = LogFilter(model, method, projection=projection, engine=engine)
    epochs = log.room(n, smooth=smooth)
    for begin in range(0, n, CHUNK):
        part = slice(begin, min(n, begin + CHUNK))
        noise = None if spot_sigma_m is None else spot_sigma_m[part]
        log.forward(t[part], spots[part], control[part], quaternion[part], epochs.part(part), noise)
        if progress is not None:
            progress(part.stop - part.start)
    if smooth:
        log.backward(t, control, epochs, log.nothing_later())
    return log.solution(t, quaternion, epochs, smoothed=smooth)


def _epochs(model: Model, t_s: Vector, spots_m: Stack) -> tuple[Vector, Stack]:
    t = one_piece("t_s", t_s)
    if t.ndim != 1:
        raise ValueError(f"t_s has one axis; got shape {t.shape}")
    spots = one_piece("spots_m", spots_m)
    expected = (len(t), len(model.beacons_lvlh_m), 2)
    if spots.shape != expected:
        raise ValueError(f"spots_m has shape {expected}; got {spots.shape}")
    if not np.all(np.isfinite(t)) or np.any(np.diff(t) <= 0.0):
        raise ValueError("t_s must be finite and strictly increasing")
    return t, spots


def _levers(model: Model, n: int, quaternion: Matrix) -> Matrix:
    """Camera from the chaser's centre of mass in `lvlh_ccsds`, (n, 3), or (1, 3) where the camera is held."""
    lever = model.camera_lever_cam_m
    if len(quaternion) == 0:
        return (model.dcm_cam_from_lvlh.T @ lever)[None]
    out = np.zeros((n, 3))
    if not np.any(lever):
        return out
    dcm = np.empty((3, 3))
    for e in range(n):
        dcm_from_quaternion_into(quaternion[e], dcm)
        out[e] = dcm.T @ lever
    return out
