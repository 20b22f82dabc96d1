"""`engine="filterpy"`: the filter's decisions in plain Python over filterpy's algebra, for comparison.

Measurement rows and noise come from the same `observation`; prediction, update, NIS, gate, iteration and restart are
done here a second time on purpose, in covariance form. On well-conditioned logs both engines agree to 1e-9 sigma.
"""

import math

import numpy as np

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.estimation.factored import compose, factorize
from relnav.estimation.reference import ReferenceTrack
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.navigation.block import (
    ATTITUDE,
    CLOCK,
    EFFECT,
    GATE,
    INNOVATION,
    INPUT,
    PHI,
    Q_FACTORS,
    R_FACTOR,
    RESIDUAL,
    RESULT,
    SENSOR,
    SETTINGS,
    TRACK,
    TRIAL,
    VARIANCE,
    H,
)
from relnav.navigation.observation import linearise, prepare
from relnav.navigation.propagation import prepare_step
from relnav.navigation.record import UPPER
from relnav.navigation.sight import camera_position_dock, uses_coordinates
from relnav.navigation.status import PARTIAL, PREDICTED, REJECTED, STARTED, UPDATED, WAITING
from relnav.navigation.step import start
from relnav.navigation.update import LONE_GATE_SHARE, MAX_ITERATIONS
from relnav.sensors.measurement import OK


class ReferenceEngine:
    """A filter over a block of `new_block`, with its tracks on filterpy."""

    def __init__(self, block: Matrix) -> None:
        """Take over a fresh block."""
        self.block = block
        self.track: ReferenceTrack | None = None
        self.trial: ReferenceTrack | None = None
        self.streak = 0

    def step(self, t: float, spots: Matrix) -> int:
        """Take one image, as `relnav.navigation.step.step` does; results go to the same rows."""
        block = self.block
        tracks = [track for track in (self.track, self.trial) if track is not None]
        if tracks:
            prepare_step(block, t - block[CLOCK, 0])
            for track in tracks:
                track.time_update(
                    block[PHI : PHI + 6].copy(), block[EFFECT].copy(), compose(block[Q_FACTORS : Q_FACTORS + 6])
                )
            self.track, self.trial = self._usable(self.track), self._usable(self.trial)
        block[CLOCK, 0] = t
        status = self._step_track(spots)
        if self.track is not None:
            block[TRACK] = self.track.state
            block[TRACK + 1 : TRACK + 7] = factorize(0.5 * (self.track.covariance + self.track.covariance.T))
        block[CLOCK, 1], block[CLOCK, 3] = float(self.track is not None), self.streak
        block[RESULT, 0] = status
        return status

    def _usable(self, track: ReferenceTrack | None) -> ReferenceTrack | None:
        """The track, unless its prediction says nothing any more, as `step.is_usable` decides."""
        if track is None or not (np.isfinite(track.state).all() and np.isfinite(track.covariance).all()):
            return None
        p = np.empty(3)
        camera_position_dock(self.block, np.ascontiguousarray(track.state), p)
        return track if np.trace(track.covariance[:3, :3]) < p @ p else None

    def _step_track(self, spots: Matrix) -> int:
        block = self.block
        self._clear()
        status = WAITING
        if self.track is not None:
            status = self._correct(self.track, spots)
            seen = int(np.sum(~np.isnan(spots).all(axis=1)))
            if status == REJECTED or (status == PARTIAL and 2 * block[RESULT, 5] <= seen):
                self.streak += 1
            else:
                self.streak, self.trial = 0, None
            if self.streak < block[SETTINGS, 3]:
                return status
        kept = block[RESULT : INNOVATION + 1].copy()
        if self._look_for_start(spots):
            return STARTED
        reason = block[RESULT, 3]
        block[RESULT : INNOVATION + 1] = kept
        if self.track is None:
            block[RESULT, 3] = reason
        return status

    def _clear(self) -> None:
        self.block[RESULT] = (0.0, math.nan, 0.0, 0.0, 0.0, 0.0)
        self.block[INNOVATION] = math.nan

    def _look_for_start(self, spots: Matrix) -> bool:
        block = self.block
        if self.trial is not None:
            p = np.empty(3)
            camera_position_dock(block, np.ascontiguousarray(self.trial.state), p)
            tight = np.trace(self.trial.covariance[:3, :3]) < 4e-4 * (p @ p)
            outcome = self._correct(self.trial, spots)
            agrees = outcome == UPDATED and block[RESULT, 2] == (6 if uses_coordinates(block) else 3)
            if agrees and not tight:
                return False
            if agrees:
                block[CLOCK, 4] += 1.0
                self.track, self.trial, self.streak = self.trial, None, 0
                return True
        rows = block[TRIAL : TRIAL + 7]
        block[RESULT, 3] = start(block, rows, spots)
        if block[RESULT, 3] == OK:
            self.trial = ReferenceTrack(rows[0], compose(rows[1:7]))
        return False

    def _correct(self, track: ReferenceTrack, spots: Matrix) -> int:
        block, x, p = self.block, track.state.copy(), track.covariance.copy()
        self._clear()
        block[CLOCK, 5] = np.trace(p[:3, :3])
        seen, usable, block[RESULT, 3] = prepare(block, x, spots)
        if seen == 0:
            return PREDICTED
        if usable == 0 or not linearise(block, x, spots):
            return REJECTED
        rows = np.flatnonzero(block[VARIANCE] > 0.0)
        if uses_coordinates(block) and len(set(rows // 2)) == 1:
            both = block[H + 2 * (rows[0] // 2) : H + 2 * (rows[0] // 2) + 2]
            s = both @ p @ both.T + block[SENSOR, 3] ** 2 * np.eye(2)
            area = math.pi * block[GATE, 1] * math.sqrt(max(0.0, np.linalg.det(s)))
            if not area < LONE_GATE_SHARE * 4.0 * block[SENSOR, 1] * block[SENSOR, 2]:
                return PREDICTED
        block[INNOVATION, rows] = block[RESIDUAL, rows]
        block[RESULT, 1], block[RESULT, 2] = self._update(track, x, x, p, rows), len(rows)
        if uses_coordinates(block):
            rows = self._gate(track, x, p, rows)
            passed = len(set(rows // 2))
        else:
            passed = int(block[RESULT, 1] <= block[GATE, len(rows) - 1])
        if passed == 0:
            track.set(x, p)
            return REJECTED
        linearise(block, x, spots)
        self._update(track, x, x, p, rows)
        at, iterations = x, 1
        while iterations < MAX_ITERATIONS and self._bends(track.state, at):
            at = track.state.copy()
            if not linearise(block, at, spots):
                break
            self._update(track, at, x, p, rows)
            iterations += 1
        block[RESULT, 4], block[RESULT, 5] = iterations, passed
        return UPDATED if passed == seen else PARTIAL

    def _update(self, track: ReferenceTrack, at: Vector, x: Vector, p: Matrix, rows: Codes) -> float:
        """Update from the prior (x, p) with the given rows, linearised at `at`; returns NIS."""
        block = self.block
        h = block[H : H + 6][rows]
        variances = np.diag(block[VARIANCE, rows])
        if uses_coordinates(block):
            r = variances
        else:
            lower = np.tril(block[R_FACTOR : R_FACTOR + 3, :3], -1)[: len(rows), : len(rows)] + np.eye(len(rows))
            r = lower @ variances @ lower.T
        track.set(x, p)
        return track.measurement_update(h, r, block[RESIDUAL, rows] - h @ (x - at))

    def _gate(self, track: ReferenceTrack, x: Vector, p: Matrix, rows: Codes) -> Codes:
        """Rows of the beacons that are credible alone and together, as `update` decides."""

        def credible(beacons: list[int]) -> bool:
            chosen = rows[np.isin(rows // 2, beacons)]
            limit = self.block[GATE, len(chosen) - 1]
            return len(chosen) > 0 and self._update(track, x, x, p, chosen) <= limit

        good = [i for i in range(3) if credible([i])]
        if good and not credible(good):
            pairs = [pair for pair in ([1, 2], [0, 2], [0, 1]) if len(good) == 3 and credible(pair)]
            good = pairs[0] if len(pairs) == 1 else []
        return rows[np.isin(rows // 2, good)]

    def _bends(self, state: Vector, at: Vector) -> bool:
        sensor, p = self.block[SENSOR], np.empty(3)
        camera_position_dock(self.block, np.ascontiguousarray(at), p)
        nearest2 = float(np.sum((p - [sensor[5], 0.0, 0.0]) ** 2))
        return bool(sensor[0] * np.sum((state[:3] - at[:3]) ** 2) > 0.1 * sensor[3] * nearest2)


def run_reference(
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
    engine: ReferenceEngine,
) -> None:
    """The log loop over the reference engine, with the arguments of the compiled one."""
    for e in range(len(t)):
        if len(control):
            block[INPUT] = control[e]
        if len(quaternion):
            block[ATTITUDE : ATTITUDE + 3, :3] = dcm_from_quaternion(quaternion[e])
        status = engine.step(float(t[e]), spots[e])
        codes[e] = int(block[RESULT, 2]), status, int(block[RESULT, 3])
        nis[e], innovation[e] = block[RESULT, 1], block[INNOVATION]
        running = engine.track is not None
        state[e] = block[TRACK] if running else math.nan
        factor[e] = block[TRACK + 1 : TRACK + 7][UPPER] if running else math.nan
