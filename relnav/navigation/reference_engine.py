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
    DOCK,
    EFFECT,
    FIELD_ERRORS,
    GRADIENT,
    INNOVATION,
    INPUT,
    LAYOUT,
    OBSERVED,
    OFFSET,
    PHI,
    PLACE,
    POSITION,
    Q_FACTORS,
    RESULT,
    SENSOR,
    SETTINGS,
    TOLERANCES_SHARED,
    TRACK,
    TRIAL,
    beacon_row,
    set_lasting_sigma,
    set_spot_sigma,
)
from relnav.navigation.docking_view import LOWER
from relnav.navigation.in_use import errors_in_use, rows_in_use
from relnav.navigation.propagation import prepare_step
from relnav.navigation.sight import TIGHT_SHARE2, attitude_changed, camera_position_dock, uses_coordinates
from relnav.navigation.start import start
from relnav.navigation.status import PARTIAL, PREDICTED, REJECTED, STARTED, UPDATED, WAITING
from relnav.navigation.step import WRONG_SHAPE, WRONG_TIME
from relnav.navigation.update import LONE_GATE_SHARE, MAX_ITERATIONS, bends, linearise_again, observe
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
        if spots.shape != (block[LAYOUT, 0], 2):
            return WRONG_SHAPE
        if not block[CLOCK, 0] < t < math.inf:
            return WRONG_TIME
        tracks = [track for track in (self.track, self.trial) if track is not None]
        if tracks:
            prepare_step(block, t - block[CLOCK, 0])
            for track in tracks:
                track.time_update(
                    block[PHI : PHI + 6].copy(), block[EFFECT].copy(), compose(block[Q_FACTORS : Q_FACTORS + 6])
                )
                track.considered = track.considered @ block[PHI : PHI + 6].T
            self.track, self.trial = self._usable(self.track), self._usable(self.trial)
        block[CLOCK, 0] = t
        status = self._step_track(spots)
        if self.track is not None:
            block[TRACK] = self.track.state
            block[TRACK + 1 : TRACK + 7] = factorize(0.5 * (self.track.covariance + self.track.covariance.T))
            block[int(block[LAYOUT, 4]) : int(block[LAYOUT, 1])] = self.track.considered
        block[CLOCK, 1], block[CLOCK, 3] = float(self.track is not None), self.streak
        block[RESULT, 0] = status
        return status

    def _place(self, track: ReferenceTrack) -> tuple[float, float]:
        """PLACE of a track; returns its squared range and position variance."""
        place = self.block[PLACE]
        camera_position_dock(track.state.copy(), self.block[OFFSET], self.block[DOCK : DOCK + 3], place)
        place[3], place[4] = place[:3] @ place[:3], np.trace(track.covariance[:3, :3])
        return float(place[3]), float(place[4])

    def _usable(self, track: ReferenceTrack | None) -> ReferenceTrack | None:
        """The track, unless its prediction says nothing any more, as `sight.locate` decides."""
        if track is None or not (np.isfinite(track.state).all() and np.isfinite(track.covariance).all()):
            return None
        range2, variance = self._place(track)
        return track if variance < range2 else None

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
        results = block[RESULT : int(block[LAYOUT, 4])]
        kept = results.copy()
        if self._look_for_start(spots):
            return STARTED
        reason = block[RESULT, 3]
        results[:] = kept
        if self.track is None:
            block[RESULT, 3] = reason
        return status

    def _clear(self) -> None:
        self.block[RESULT] = (0.0, math.nan, 0.0, 0.0, 0.0, 0.0)
        self.block[INNOVATION : int(self.block[LAYOUT, 4])] = math.nan

    def _look_for_start(self, spots: Matrix) -> bool:
        block = self.block
        if self.trial is not None:
            range2, variance = self._place(self.trial)
            tight = variance < TIGHT_SHARE2 * range2
            outcome = self._correct(self.trial, spots)
            agrees = outcome == UPDATED and block[RESULT, 2] >= (6 if uses_coordinates(block) else 3)
            if agrees and not tight:
                return False
            if agrees:
                block[CLOCK, 4] += 1.0
                self.track, self.trial, self.streak = self.trial, None, 0
                return True
        rows = block[TRIAL : TRIAL + 7]
        considered = block[int(block[LAYOUT, 5]) :]
        block[RESULT, 3] = start(block, rows, considered, spots)
        if block[RESULT, 3] == OK:
            self.trial = ReferenceTrack(rows[0], compose(rows[1:7]))
            self.trial.considered = considered.copy()
        return False

    def _correct(self, track: ReferenceTrack, spots: Matrix) -> int:
        block, x, p = self.block, track.state.copy(), track.covariance.copy()
        self._clear()
        self._place(track)
        seen, usable, block[RESULT, 3] = observe(block, x, spots)
        if seen == 0:
            return PREDICTED
        if usable == 0:
            return REJECTED
        coordinates = uses_coordinates(block)
        if coordinates and len(track.considered):
            self._add_considered_noise(track, x, spots)
        h, residual, _, groups = rows_in_use(block)
        if coordinates and len(set(groups)) == 1 and not self._lone_beacon_is_telling(int(groups[0]), p):
            return PREDICTED
        numbers = block[INNOVATION : int(block[LAYOUT, 4])].ravel()
        numbers[_places(block, groups) if coordinates else range(len(h))] = residual
        block[RESULT, 1], block[RESULT, 2] = self._update(track, x, x, p, np.arange(len(h))), len(h)
        rows = np.arange(len(h))
        if coordinates:
            rows = self._gate(track, x, p, groups)
            passed = len(set(groups[rows]))
        else:
            passed = int(block[RESULT, 1] <= self._limit(len(h)))
        if passed == 0:
            track.set(x, p)
            return REJECTED
        self._update(track, x, x, p, rows)
        at, iterations = x, 1
        while iterations < MAX_ITERATIONS and bends(block, at, track.state.copy()):
            at = track.state.copy()
            if not linearise_again(block, at, spots):
                break
            self._update(track, at, x, p, rows)
            iterations += 1
        if len(track.considered):
            self._consider(track, rows, spots)
        block[RESULT, 4], block[RESULT, 5] = iterations, passed
        return UPDATED if passed == seen else PARTIAL

    def _limit(self, dof: int) -> float:
        return float(self.block[int(self.block[LAYOUT, 1]) :].ravel()[dof - 1])

    def _lone_beacon_is_telling(self, beacon: int, p: Matrix) -> bool:
        block = self.block
        first = beacon_row(block, beacon)
        both, sigma = block[first + GRADIENT : first + GRADIENT + 2], block[first + POSITION, 3:5]
        s = both @ p @ both.T + np.diag(sigma**2)
        area = math.pi * self._limit(2) * math.sqrt(max(0.0, np.linalg.det(s)))
        return bool(area < LONE_GATE_SHARE * 4.0 * block[SENSOR, 1] * block[SENSOR, 2])

    def _update(self, track: ReferenceTrack, at: Vector, x: Vector, p: Matrix, rows: Codes) -> float:
        """Update from the prior (x, p) with some of the rows in use, linearised at `at`; returns NIS."""
        h, residual, r, _ = rows_in_use(self.block)
        track.set(x, p)
        return track.measurement_update(h[rows], r[np.ix_(rows, rows)], residual[rows] - h[rows] @ (x - at))

    def _add_considered_noise(self, track: ReferenceTrack, x: Vector, spots: Matrix) -> None:
        """Add considered errors to the variances of the coordinates in use: own ones, and what is left of others."""
        block = self.block
        h, _, _, _ = rows_in_use(block)
        errors, shared = errors_in_use(block, x, spots), slice(FIELD_ERRORS, FIELD_ERRORS + TOLERANCES_SHARED)
        own = np.delete(errors, shared, axis=1)
        rest = errors[:, shared] - h @ track.considered[shared].T
        left = np.sum(own**2, axis=1) + np.sum(rest**2, axis=1)
        places = [(i, k) for i in range(int(block[LAYOUT, 0])) for k in range(2)]
        used = [(beacon_row(block, i) + OBSERVED, 2 + k) for i, k in places]
        used = [place for place in used if block[place] > 0.0]
        for place, variance in zip(used, left, strict=True):
            block[place] += variance

    def _consider(self, track: ReferenceTrack, rows: Codes, spots: Matrix) -> None:
        """Update what is considered by the rows used, K = P+ H^T R^-1."""
        h, _, r, _ = rows_in_use(self.block)
        gain = np.linalg.solve(r[np.ix_(rows, rows)], h[rows] @ track.covariance).T
        s = track.considered.T
        track.considered = (s + gain @ (errors_in_use(self.block, track.state, spots)[rows] - h[rows] @ s)).T

    def _gate(self, track: ReferenceTrack, x: Vector, p: Matrix, groups: Codes) -> Codes:
        """Rows of the beacons that are credible alone and together, as `update` decides."""

        def rows(beacons: list[int]) -> Codes:
            return np.flatnonzero(np.isin(groups, beacons))

        def nis(beacons: list[int]) -> float:
            return self._update(track, x, x, p, rows(beacons))

        def credible(beacons: list[int]) -> bool:
            return len(beacons) > 0 and nis(beacons) <= self._limit(len(rows(beacons)))

        good = [i for i in sorted(set(groups)) if credible([i])]
        if good and not credible(good):
            while len(good) > 2:
                fewer = [[j for j in good if j != i] for i in good]
                agreeing = [beacons for beacons in fewer if credible(beacons)]
                good = min(fewer, key=nis)
                if len(agreeing) == 1 or (len(agreeing) > 1 and len(good) > 2):
                    return rows(good)
            good = []
        return rows(good)


def _places(block: Matrix, groups: Codes) -> list[int]:
    """Places of the coordinates in use among the innovations."""
    out: list[int] = []
    for beacon in sorted(set(groups)):
        used = block[beacon_row(block, int(beacon)) + OBSERVED, 2:4] > 0.0
        out.extend(2 * int(beacon) + k for k in range(2) if used[k])
    return out


def run_reference(
    block: Matrix,
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
    engine: ReferenceEngine,
) -> None:
    """The log loop over the reference engine, with the arguments of the compiled one."""
    for e in range(len(t)):
        if len(control):
            block[INPUT] = control[e]
        if len(quaternion):
            block[ATTITUDE : ATTITUDE + 3, :3] = dcm_from_quaternion(quaternion[e])
            attitude_changed(block)
        if len(sigma):
            set_spot_sigma(block, sigma[e])
        if len(lasting):
            set_lasting_sigma(block, lasting[e])
        status = engine.step(float(t[e]), spots[e])
        codes[e] = int(block[RESULT, 2]), status, int(block[RESULT, 3])
        nis[e] = block[RESULT, 1]
        innovation[e] = block[INNOVATION:].ravel()[: innovation.shape[1]]
        running = engine.track is not None
        state[e] = block[TRACK] if running else math.nan
        own, sensitivities = block[TRACK + 1 : TRACK + 7].copy(), block[int(block[LAYOUT, 4]) : int(block[LAYOUT, 1])]
        if considered.shape[1]:
            considered[e] = sensitivities if running else math.nan
        elif len(sensitivities):
            own = factorize(compose(own) + sensitivities.T @ sensitivities)
        factor[e] = own[LOWER] if running else math.nan
