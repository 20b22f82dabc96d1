"""`engine="filterpy"` for beacons: the filter's decisions in plain Python over filterpy's algebra, for comparison.

It is written from the model (`beacon_rows`, `lasting_errors`, `motion`, beside) and reads nothing of the compiled
filter's memory; what comes out is written there, from where records are made. Prediction, rows, noise, update, NIS,
gate, iteration, start and restart are done here a second time on purpose, in covariance form; the monitors are not (its
alarm is UNWATCHED). On well-conditioned logs both engines agree to 1e-9 sigma.
"""

import copy
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from relnav.arrays import Codes, Matrix, Vector
from relnav.estimation.factored import compose, factorize
from relnav.estimation.gating import gate_limits
from relnav.estimation.monitors import UNWATCHED
from relnav.estimation.reference import ReferenceTrack, believed
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.mission import Model
from relnav.navigation.docking_view import LOWER
from relnav.navigation.epoch_report import ACCELERATION, ATTITUDE, ATTITUDE_NOISE, ATTITUDE_SIGMA, DELTA_V, SPOT_SIGMA
from relnav.navigation.memory import fill, views
from relnav.navigation.reference.attitude_check import attitude_is_credible
from relnav.navigation.reference.beacon_rows import POSITION, BeaconImage, BeaconOptics, Prior
from relnav.navigation.reference.lasting_errors import begin, errors_of, turns_follow
from relnav.navigation.reference.motion import predict_motion, step_between
from relnav.navigation.status import PARTIAL, PREDICTED, REJECTED, STARTED, UPDATED, WAITING
from relnav.navigation.update import LONE_GATE_SHARE, MAX_ITERATIONS
from relnav.sensors.measurement import MISALIGNED, OK

if TYPE_CHECKING:
    from relnav.navigation.log import Rows

NOTHING_SAID = {"nis": math.nan, "status": 0, "dof": 0, "reason": 0, "iterations": 0, "used": 0}


class ReferenceEngine:
    """A beacon filter of a model; `block` is where its results are written to."""

    def __init__(self, model: Model, method: str, projection: str | None, block: Vector) -> None:
        """A filter that has seen nothing yet."""
        self._model, self._out = model, views(block)
        self.optics = BeaconOptics(model, method, projection)
        self._limits = gate_limits(model.filter.gate_probability, 2 * len(self.optics.beacons))
        self._acceleration, self._delta_v = np.zeros(3), np.zeros(3)
        self.result: dict[str, Any] = dict(NOTHING_SAID)
        self.innovations = np.full(2 * len(self.optics.beacons), np.nan)
        self.track: ReferenceTrack | None = None
        self.trial: ReferenceTrack | None = None
        self.t_s, self.streak, self.starts = -math.inf, 0, 0

    def take_over(self, t_s: float, state: Vector, ld: Matrix) -> None:
        """Go on from a state that is known otherwise, and the factors of its covariance."""
        self.track = ReferenceTrack(state, compose(ld))
        self.track.considered = np.zeros((self.optics.considered, 6))
        self.trial, self.streak, self.t_s, self.starts = None, 0, t_s, self.starts + 1

    def saved(self) -> dict[str, Any]:
        """What `restore` needs, as values."""
        return copy.deepcopy({name: value for name, value in self.__dict__.items() if name != "_out"})

    def restore(self, saved: dict[str, Any]) -> None:
        """Go on from what `saved` gave."""
        self.__dict__.update(copy.deepcopy(saved))

    def tell(
        self,
        told: int,
        acceleration: Vector,
        delta_v: Vector,
        dcm: Matrix,
        sigma: Matrix,
        attitude_noise: float,
        attitude_sigma: float,
    ) -> None:
        """Take this step's control, attitude and noise, which have been checked: as `epoch_report.take_inputs`."""
        optics = self.optics
        self._acceleration = np.array(acceleration if told & ACCELERATION else np.zeros(3))
        self._delta_v = np.array(delta_v if told & DELTA_V else np.zeros(3))
        optics.dcm = np.array(dcm if told & ATTITUDE else optics.held)
        optics.known = bool(told & ATTITUDE) or optics.held_known
        if told & ATTITUDE_NOISE:
            optics.attitude_noise = attitude_noise
        if told & ATTITUDE_SIGMA:
            optics.attitude_sigma = attitude_sigma
        if told & SPOT_SIGMA:
            optics.spot_sigma = np.where(sigma > 0.0, sigma, optics.spot_sigma)

    def step(self, t_s: float, spots: Matrix) -> int:
        """Take one image (n, 2) m of a time after the last; results go to the memory."""
        dt = step_between(self.t_s, t_s) if self.track is not None or self.trial is not None else 0.0
        self.track, self.trial = (self._carried(track, dt) for track in (self.track, self.trial))
        self.t_s = t_s
        self.result["status"] = status = self._step_track(spots)
        self._write(status)
        return status

    def _write(self, status: int) -> None:
        """Where records are made from."""
        m, track = self._out, self.track
        if track is not None:
            m.track["state"], m.track["ld"] = track.state, factorize(0.5 * (track.covariance + track.covariance.T))
            m.sensitivities[:] = track.considered
        fill(m.clock, t=self.t_s, running=track is not None, rejected=self.streak, starts=self.starts)
        fill(m.result, **(self.result | {"status": status}))
        m.innovations[:] = self.innovations
        m.watch["alarm"] = UNWATCHED

    def _carried(self, track: ReferenceTrack | None, dt: float) -> ReferenceTrack | None:
        """The track after dt, unless its prediction says nothing any more: numbers, and position sigma below range."""
        if track is None:
            return None
        model, control = self._model, (self._acceleration, self._delta_v)
        phi, q, effect = predict_motion(model.orbit, model.process_noise, self.t_s, dt, *control)
        if not np.isfinite(q).all():
            return None
        track.time_update(phi, effect, q)
        track.considered = track.considered @ phi.T
        if not (np.isfinite(track.state).all() and np.isfinite(track.covariance).all()):
            return None
        prior = self._prior(track)
        return track if prior.variance < prior.place @ prior.place else None

    def _prior(self, track: ReferenceTrack) -> Prior:
        return Prior(self.optics.place(track.state), float(np.trace(track.covariance[:3, :3])))

    def _clear(self) -> None:
        self.result = dict(NOTHING_SAID)
        self.innovations = np.full(len(self.innovations), np.nan)

    def _step_track(self, spots: Matrix) -> int:
        self._clear()
        status = WAITING
        if self.track is not None:
            status = self._correct(self.track, spots)
            seen = int(np.sum(~np.isnan(spots).all(axis=1)))
            if status == REJECTED or (status == PARTIAL and 2 * self.result["used"] <= seen):
                self.streak += 1
            else:
                self.streak, self.trial = 0, None
            if self.streak < self._model.filter.restart_after_epochs:
                return status
        kept, innovations = dict(self.result), self.innovations
        if self._look_for_start(spots):
            return STARTED
        reason = self.result["reason"]
        self.result, self.innovations = kept, innovations
        if self.track is None:
            self.result["reason"] = reason
        return status

    def _look_for_start(self, spots: Matrix) -> bool:
        """Test the trial with this image, or open one; True if a trial was confirmed and now is the track."""
        if self.trial is not None:
            tight = self._prior(self.trial).tight
            outcome = self._correct(self.trial, spots)
            agrees = outcome == UPDATED and self.result["dof"] >= (6 if self.optics.coordinates else 3)
            if agrees and not tight:
                return False
            if agrees:
                self.track, self.trial, self.streak, self.starts = self.trial, None, 0, self.starts + 1
                return True
        begun = begin(self.optics, self._model, spots, self._limits)
        self._clear()
        self.result["reason"] = begun.status
        if begun.status == OK:
            self.trial = ReferenceTrack(begun.state, begun.covariance)
            self.trial.considered = begun.considered
        return False

    def _correct(self, track: ReferenceTrack, spots: Matrix) -> int:
        x, p, optics = track.state.copy(), track.covariance.copy(), self.optics
        self._clear()
        image = optics.observe(x, spots, self._prior(track))
        self.result["reason"] = image.reason
        if image.seen == 0:
            return PREDICTED
        if len(image.groups) == 0:
            return REJECTED
        if optics.coordinates:
            image = self._with_considered(image, track, x, spots)
            if len(set(image.groups)) == 1 and not self._lone_beacon_is_telling(int(image.groups[0]), x, p):
                return PREDICTED
        rows = np.arange(len(image.groups))
        self.innovations[image.places] = image.residual
        self.result["nis"], self.result["dof"] = self._update(track, image, x, x, p, rows), len(rows)
        if optics.coordinates:
            rows = self._gate(track, image, x, p)
            passed = len(set(image.groups[rows]))
        else:
            passed = int(self.result["nis"] <= self._limits[len(rows) - 1])
            if passed and not attitude_is_credible(optics, self._limits, track, spots):
                self.result["reason"], passed = MISALIGNED, 0
        if passed == 0:
            track.set(x, p)
            return REJECTED
        self._take(track, image, x, p, rows, spots)
        self.result["used"] = passed
        return UPDATED if passed == image.seen else PARTIAL

    def _take(
        self, track: ReferenceTrack, image: BeaconImage, x: Vector, p: Matrix, rows: Codes, spots: Matrix
    ) -> None:
        """Update from the prior (x, p) with some rows, linearised anew while that matters, and what is considered."""
        self._update(track, image, x, x, p, rows)
        at, iterations = x, 1
        while iterations < MAX_ITERATIONS and self._bends(at, track.state):
            again = self.optics.again(image, track.state.copy(), spots)
            if again is None:
                break
            at, image = track.state.copy(), again
            self._update(track, image, at, x, p, rows)
            iterations += 1
        self.result["iterations"] = iterations
        if len(track.considered):
            h, r = image.rows[rows], image.noise[np.ix_(rows, rows)]
            gain = np.linalg.solve(r, h @ track.covariance).T
            s = track.considered.T + turns_follow(self.optics, at - x)
            s += gain @ (errors_of(self.optics, image, at, spots)[rows] - h @ s)
            track.considered = (s + turns_follow(self.optics, track.state - at)).T

    def _update(
        self, track: ReferenceTrack, image: BeaconImage, at: Vector, x: Vector, p: Matrix, rows: Codes
    ) -> float:
        """Update from the prior (x, p) with some of the rows, linearised at `at`; returns NIS."""
        track.set(x, p)
        h = image.rows[rows]
        return track.measurement_update(h, image.noise[np.ix_(rows, rows)], image.residual[rows] - h @ (x - at))

    def _with_considered(self, image: BeaconImage, track: ReferenceTrack, x: Vector, spots: Matrix) -> BeaconImage:
        """With considered errors in each variance, its own whole, of others what is left; and the attitude's noise."""
        optics = self.optics
        turned = optics.attitude_noise * image.turns
        noise = image.noise + turned @ turned.T
        errors = errors_of(optics, image, x, spots)
        shared = optics.shared
        left = errors[:, shared] - image.rows @ track.considered[shared].T
        own = np.delete(errors, shared, axis=1)
        return replace(image, noise=noise + np.diag((own**2).sum(axis=1) + (left**2).sum(axis=1)))

    def _bends(self, at: Vector, x: Vector) -> bool:
        """Whether the step between two states is long enough for a second linearisation to matter."""
        apart = self.optics.beacons - at[:3] - self.optics.offset - self.optics.port
        moved2, nearest2 = float(np.sum((x - at)[:3] ** 2)), float(np.min(np.sum(apart**2, axis=1)))
        return bool(self.optics.focal_length * moved2 > 0.1 * self._model.spot_sigma_m * nearest2)

    def _lone_beacon_is_telling(self, beacon: int, x: Vector, p: Matrix) -> bool:
        """Whether a single beacon is predicted so well that a glint would hardly pass for it."""
        half, slopes = self.optics.half, self.optics.coordinate_slopes(x)[2][beacon, :, POSITION]
        s = slopes @ p[:3, :3] @ slopes.T + np.diag(self.optics.spot_sigma[beacon] ** 2)
        area = math.pi * self._limits[1] * math.sqrt(max(0.0, np.linalg.det(s)))
        return bool(area < LONE_GATE_SHARE * 4.0 * half[0] * half[1])

    def _gate(self, track: ReferenceTrack, image: BeaconImage, x: Vector, p: Matrix) -> Codes:
        """Rows of the beacons that are credible alone and together."""

        def rows(beacons: list[int]) -> Codes:
            return np.flatnonzero(np.isin(image.groups, beacons))

        def limit(beacons: list[int]) -> float:
            return float(self._limits[len(rows(beacons)) - 1])

        seen = sorted(set(image.groups.tolist()))
        return rows(believed(seen, lambda beacons: self._update(track, image, x, x, p, rows(beacons)), limit))

    def run(self, rows: "Rows") -> None:
        """The log loop: what rows are told is taken in, and what comes out is written into them."""
        t, spots, control, quaternion, sigma, lasting, state, factor, innovation, nis, codes, considered = rows
        nothing, none = np.zeros(3), np.zeros((0, 0))
        for e in range(len(t)):
            told = (ACCELERATION | DELTA_V if len(control) else 0) | (ATTITUDE if len(quaternion) else 0)
            push, impulse = (control[e, :3], control[e, 3:]) if len(control) else (nothing, nothing)
            dcm = dcm_from_quaternion(quaternion[e]) if len(quaternion) else none
            noise = sigma[e] if len(sigma) else none
            self.tell(told | (SPOT_SIGMA if len(sigma) else 0), push, impulse, dcm, noise, 0.0, 0.0)
            if len(lasting):
                self.optics.lasting = lasting[e]
            status = self.step(float(t[e]), spots[e])
            codes[e] = self.result["dof"], status, self.result["reason"], UNWATCHED
            nis[e], innovation[e] = self.result["nis"], self.innovations
            track = self.track
            state[e] = math.nan if track is None else track.state
            if considered.shape[1]:
                considered[e] = math.nan if track is None else track.considered
            if track is None:
                factor[e] = math.nan
                continue
            own = track.covariance if considered.shape[1] else track.covariance + track.considered.T @ track.considered
            factor[e] = factorize(0.5 * (own + own.T))[LOWER]
