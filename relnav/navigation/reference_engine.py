"""`engine="filterpy"`: the filter's decisions in plain Python over filterpy's algebra, for comparison.

Measurement rows and noise come from the same `observation`; prediction, update, NIS, gate, iteration and restart are
done here a second time on purpose, in covariance form; the monitors are not (its alarm is UNWATCHED). On
well-conditioned logs both engines agree to 1e-9 sigma.
"""

import math
from typing import Any

import numpy as np

from relnav.arrays import Codes, Matrix, Stack, Vector
from relnav.estimation.factored import compose, factorize
from relnav.estimation.monitors import UNWATCHED
from relnav.estimation.reference import ReferenceTrack
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.pinhole import central_projection, central_projection_jacobian
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.navigation.beacon_geometry import (
    TIGHT_SHARE2,
    attitude_changed,
    camera_position_dock,
    uses_coordinates,
)
from relnav.navigation.beacon_observation import observe, observe_again
from relnav.navigation.beacon_start import start
from relnav.navigation.docking_view import LOWER
from relnav.navigation.measurement_matrices import errors_in_use, rows_in_use, turns_in_sight
from relnav.navigation.memory import ATTITUDE_ERRORS, FIELD_ERRORS, FIX, TOLERANCES_SHARED, fill, views
from relnav.navigation.propagation import prepare_step
from relnav.navigation.status import PARTIAL, PREDICTED, REJECTED, STARTED, UPDATED, WAITING
from relnav.navigation.step import WRONG_SHAPE, WRONG_TIME
from relnav.navigation.update import LONE_GATE_SHARE, MAX_ITERATIONS, bends
from relnav.sensors.measurement import MISALIGNED, OK


class ReferenceEngine:
    """A filter over a fresh filter's memory, with its tracks on filterpy."""

    def __init__(self, block: Vector) -> None:
        """Take over the memory."""
        self.named = views(block)
        self.track: ReferenceTrack | None = None
        self.trial: ReferenceTrack | None = None
        self.streak = 0

    def take_over(self) -> None:
        """Go on from the track in the memory."""
        m = self.named
        self.track = ReferenceTrack(m.track["state"], compose(m.track["ld"]))
        self.track.considered = m.sensitivities.copy()
        self.trial, self.streak = None, 0

    def tracks(self) -> tuple[Any, ...]:
        """What `restore` needs: values of track and trial, and the streak."""
        return _values(self.track), _values(self.trial), self.streak

    def restore(self, track: Any, trial: Any, streak: int) -> None:
        """Go on from what `tracks` gave."""
        self.track, self.trial, self.streak = _track(track), _track(trial), streak

    def step(self, t: float, spots: Matrix) -> int:
        """Take one image, as `relnav.navigation.step.step` does; results go to the same rows."""
        m = self.named
        if spots.shape != (len(m.beacons), 2):
            return WRONG_SHAPE
        if not m.clock["t"] < t < math.inf:
            return WRONG_TIME
        tracks = [track for track in (self.track, self.trial) if track is not None]
        if tracks:
            prepare_step(m.step, m.motion, m.scratch, float(m.clock["t"]), t - float(m.clock["t"]))
            for track in tracks:
                phi = m.step["phi"].copy()
                track.time_update(phi, m.step["effect"].copy(), compose(m.step["noise"]))
                track.considered = track.considered @ phi.T
            self.track, self.trial = self._usable(self.track), self._usable(self.trial)
        m.clock["t"] = t
        status = self._step_track(spots)
        if self.track is not None:
            m.track["state"] = self.track.state
            m.track["ld"] = factorize(0.5 * (self.track.covariance + self.track.covariance.T))
            m.sensitivities[:] = self.track.considered
        m.clock["running"], m.clock["rejected"] = self.track is not None, self.streak
        m.result["status"], m.watch["alarm"] = status, UNWATCHED
        return status

    def _place(self, track: ReferenceTrack) -> tuple[float, float]:
        """The prior of a track; returns its squared range and position variance."""
        m, place = self.named, self.named.prior["place"]
        camera_position_dock(track.state.copy(), m.sensor["offset"], m.kept["dock"], place)
        m.prior["range2"], m.prior["variance"] = place @ place, np.trace(track.covariance[:3, :3])
        return float(m.prior["range2"]), float(m.prior["variance"])

    def _usable(self, track: ReferenceTrack | None) -> ReferenceTrack | None:
        """The track, unless its prediction says nothing any more, as `locate` decides."""
        if track is None or not (np.isfinite(track.state).all() and np.isfinite(track.covariance).all()):
            return None
        range2, variance = self._place(track)
        return track if variance < range2 else None

    def _step_track(self, spots: Matrix) -> int:
        m = self.named
        self._clear()
        status = WAITING
        if self.track is not None:
            status = self._correct(self.track, spots)
            seen = int(np.sum(~np.isnan(spots).all(axis=1)))
            if status == REJECTED or (status == PARTIAL and 2 * m.result["used"] <= seen):
                self.streak += 1
            else:
                self.streak, self.trial = 0, None
            if self.streak < m.fixed["restart_after"]:
                return status
        kept, innovations = m.result.copy(), m.innovations.copy()
        if self._look_for_start(spots):
            return STARTED
        reason = m.result["reason"]
        fill(m.result, **{name: kept[name] for name in kept.dtype.names})
        m.innovations[:] = innovations
        if self.track is None:
            m.result["reason"] = reason
        return status

    def _clear(self) -> None:
        fill(self.named.result, nis=math.nan, status=0, dof=0, reason=0, iterations=0, used=0)
        self.named.innovations[:] = math.nan

    def _look_for_start(self, spots: Matrix) -> bool:
        m = self.named
        if self.trial is not None:
            range2, variance = self._place(self.trial)
            tight = variance < TIGHT_SHARE2 * range2
            outcome = self._correct(self.trial, spots)
            agrees = outcome == UPDATED and m.result["dof"] >= (6 if uses_coordinates(m.sensor) else 3)
            if agrees and not tight:
                return False
            if agrees:
                m.clock["starts"] += 1
                self.track, self.trial, self.streak = self.trial, None, 0
                return True
        m.result["reason"] = start(m, m.trial, m.trial_sensitivities, spots)
        if m.result["reason"] == OK:
            self.trial = ReferenceTrack(m.trial["state"], compose(m.trial["ld"]))
            self.trial.considered = m.trial_sensitivities.copy()
        return False

    def _correct(self, track: ReferenceTrack, spots: Matrix) -> int:
        m, x, p = self.named, track.state.copy(), track.covariance.copy()
        self._clear()
        self._place(track)
        seen, usable, m.result["reason"] = observe(m, x, spots)
        if seen == 0:
            return PREDICTED
        if usable == 0:
            return REJECTED
        coordinates = uses_coordinates(m.sensor)
        if coordinates and (len(track.considered) or m.sensor["attitude_noise"] > 0.0):
            self._add_considered_noise(track, x, spots)
        h, residual, _, groups = rows_in_use(m)
        if coordinates and len(set(groups)) == 1 and not self._lone_beacon_is_telling(int(groups[0]), p):
            return PREDICTED
        seen_coordinates = np.flatnonzero(m.groups["variance"][:, :2].ravel() > 0.0)
        m.innovations[seen_coordinates if coordinates else slice(0, len(h))] = residual
        m.result["nis"], m.result["dof"] = self._update(track, x, x, p, np.arange(len(h))), len(h)
        rows = np.arange(len(h))
        if coordinates:
            rows = self._gate(track, x, p, groups)
            passed = len(set(groups[rows]))
        else:
            passed = int(m.result["nis"] <= self._limit(len(h)))
            if passed and not self._attitude_is_credible(track.state, track.covariance, spots):
                m.result["reason"], passed = MISALIGNED, 0
        if passed == 0:
            track.set(x, p)
            return REJECTED
        self._update(track, x, x, p, rows)
        at, iterations = x, 1
        while iterations < MAX_ITERATIONS and bends(m, at, track.state.copy()):
            at = track.state.copy()
            if not observe_again(m, at, spots):
                break
            self._update(track, at, x, p, rows)
            iterations += 1
        if len(track.considered):
            self._consider(track, at, rows, spots)
        m.result["iterations"], m.result["used"] = iterations, passed
        return UPDATED if passed == seen else PARTIAL

    def _limit(self, dof: int) -> float:
        return float(self.named.gate[dof - 1])

    def _attitude_is_credible(self, x: Vector, p: Matrix, spots: Matrix) -> bool:
        m = self.named
        if m.sensor["method"] != FIX or not m.sensor["attitude_known"]:
            return True
        mount, f, turn = m.kept["mount"], float(m.sensor["focal_length"]), float(m.sensor["attitude_sigma"]) ** 2
        points = (m.beacons["position"][:3] - x[:3]) @ mount[:, :3].T - mount[:, 3]
        predicted, slopes = f * central_projection(points), f * central_projection_jacobian(points)
        h = -np.mean(slopes @ mount[:, :3], axis=0)
        turns = np.mean([slope @ cross_matrix(point) for slope, point in zip(slopes, points, strict=True)], axis=0)
        own = m.beacons["spot_sigma"][:3] ** 2 + m.beacons["lasting_sigma"][:3, None] ** 2
        s = h @ p[:3, :3] @ h.T + np.diag(np.sum(own, axis=0)) / 9.0 + turn * turns @ turns.T
        residual = np.mean(spots[:3] - predicted, axis=0)
        if residual @ np.linalg.solve(s, residual) > self._limit(2):
            return False
        (x_said, y_said), (x_seen, y_seen) = predicted[0] - predicted[1], spots[0] - spots[1]
        length2 = x_said**2 + y_said**2
        roll = (x_said * y_seen - y_said * x_seen) / length2
        return bool(roll**2 <= self._limit(1) * (2.0 * np.mean(own) / length2 + turn))

    def _lone_beacon_is_telling(self, beacon: int, p: Matrix) -> bool:
        m = self.named
        both, sigma, half = m.groups["gradient"][beacon, :2], m.beacons["spot_sigma"][beacon], m.sensor["half_width"]
        s = both @ p @ both.T + np.diag(sigma**2)
        area = math.pi * self._limit(2) * math.sqrt(max(0.0, np.linalg.det(s)))
        return bool(area < LONE_GATE_SHARE * 4.0 * half[0] * half[1])

    def _update(self, track: ReferenceTrack, at: Vector, x: Vector, p: Matrix, rows: Codes) -> float:
        """Update from the prior (x, p) with some of the rows in use, linearised at `at`; returns NIS."""
        h, residual, r, _ = rows_in_use(self.named)
        track.set(x, p)
        return track.measurement_update(h[rows], r[np.ix_(rows, rows)], residual[rows] - h[rows] @ (x - at))

    def _add_considered_noise(self, track: ReferenceTrack, x: Vector, spots: Matrix) -> None:
        """Add considered errors to the variances of the coordinates in use: own ones, and what is left of others."""
        m = self.named
        h, _, _, _ = rows_in_use(m)
        first = FIELD_ERRORS - int(m.fixed["first_error"])
        errors, shared = errors_in_use(m, x, spots), slice(first, first + ATTITUDE_ERRORS + TOLERANCES_SHARED)
        own = np.delete(errors, shared, axis=1)
        rest = errors[:, shared] - h @ track.considered[shared].T
        m.turns[:] = turns_in_sight(m, x)
        variance = m.groups["variance"]
        used = np.nonzero(variance[:, :2] > 0.0)
        turned = np.sum((m.sensor["attitude_noise"] * m.turns.reshape(-1, 2, 3)[used]) ** 2, axis=1)
        variance[used] += np.sum(own**2, axis=1) + np.sum(rest**2, axis=1) + turned

    def _consider(self, track: ReferenceTrack, at: Vector, rows: Codes, spots: Matrix) -> None:
        """Update what is considered by the rows used, K = P+ H^T R^-1."""
        h, _, r, _ = rows_in_use(self.named)
        gain = np.linalg.solve(r[np.ix_(rows, rows)], h[rows] @ track.covariance).T
        s = track.considered.T
        track.considered = (s + gain @ (errors_in_use(self.named, at, spots)[rows] - h[rows] @ s)).T

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


def _values(track: ReferenceTrack | None) -> tuple[Vector, Matrix, Matrix] | None:
    return None if track is None else (track.state.copy(), track.covariance.copy(), track.considered.copy())


def _track(values: tuple[Vector, Matrix, Matrix] | None) -> ReferenceTrack | None:
    if values is None:
        return None
    track = ReferenceTrack(*values[:2])
    track.considered = values[2]
    return track


def run_reference(
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
    engine: ReferenceEngine,
) -> None:
    """The log loop over the reference engine, with the arguments of the compiled one."""
    m = views(block)
    for e in range(len(t)):
        if len(control):
            m.motion["acceleration"], m.motion["delta_v"] = control[e, :3], control[e, 3:]
        if len(quaternion):
            m.kept["mount"][:, :3] = dcm_from_quaternion(quaternion[e])
            attitude_changed(m.kept, m.sensor)
        if len(sigma):
            np.copyto(m.beacons["spot_sigma"], sigma[e], where=sigma[e] > 0.0)
        if len(lasting):
            m.beacons["lasting_sigma"] = lasting[e]
        status = engine.step(float(t[e]), spots[e])
        codes[e] = m.result["dof"], status, m.result["reason"], UNWATCHED
        nis[e], innovation[e] = m.result["nis"], m.innovations
        running = engine.track is not None
        state[e] = m.track["state"] if running else math.nan
        own = m.track["ld"].copy()
        if considered.shape[1]:
            considered[e] = m.sensitivities if running else math.nan
        elif len(m.sensitivities):
            own = factorize(compose(own) + m.sensitivities.T @ m.sensitivities)
        factor[e] = own[LOWER] if running else math.nan
