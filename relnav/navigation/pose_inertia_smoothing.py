"""Smoothing of a marker log whose target's inertia is not quite known: a gain that knows of it, and exact bookkeeping.

The smoothed state is that of `pose_smoothing.py`, x_s = x + G (x_s' - f(x)), a prime for the event after. With errors
e = S l + n of a filtered state, l lasting ones of one sigma each, and P of n, a step is e' = Phi e + B l + w. The gain
is that of all errors together,

    G = (P Phi^T + S (Phi S + B)^T) (Phi P Phi^T + Q + (Phi S + B)(Phi S + B)^T)^-1

for without B it would follow the events after as if the motion were known, and what the inertia does would add up on
the way back. The filter does not learn l, so that what it says of an event is correlated with what it says of others,
and P - G (...) G^T would be too small. What a smoothed error is made of is therefore counted. By the update of the
event, e = U e_predicted + D l + K v with U = P_all P_all,predicted^-1,

    e_s = X e_predicted + Y l + Z^(1/2) z      and, from the event after with W = G (1 - X'), A = 1 - W Phi,

    e_s = A e + (G Y' - W B) l - W w + G Z'^(1/2) z',     X = A U,  Y = A D + G Y' - W B

so that P_s = A P A^T + W Q W^T + G Z' G^T and S_s = A S + G Y' - W B, whatever the gain.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from relnav.arrays import Matrix, Stack, Vector
from relnav.codegen.kernel import entry
from relnav.dynamics.error_state import MOTION, POSE, RATE, THETA
from relnav.estimation.factored import compose, factorize
from relnav.geometry.rotation_vector import rotation_vector_between, turned
from relnav.mission import VisionMission
from relnav.navigation.blocks import inertia_errors
from relnav.navigation.packed_factors import unpack_factors
from relnav.navigation.pose_epoch import LOWER
from relnav.navigation.pose_memory import pose_views
from relnav.navigation.pose_propagation import advance_pose
from relnav.navigation.propagation import prepare_step
from relnav.navigation.status import STARTED

STRAIGHT = 0.01
"""Of the smoothed sigma: what second-order terms of one step may be. Some ten steps add up to a tenth of it."""
MOST_REPEATED = 4
"""Times that a step is made; each time the error of the slopes is about the square of the one before."""


@dataclass(frozen=True)
class Place:
    """Motion (6,), dcm_lvlh_from_target (3, 3) and rate (3,)."""

    motion: Vector
    dcm: Matrix
    rate: Vector

    def moved(self, e: Vector) -> "Place":
        """The place that errors (12,) lead to."""
        return Place(self.motion + e[:MOTION], turned(self.dcm, e[THETA:RATE]), self.rate + e[RATE:])

    def to(self, other: "Place") -> Vector:
        """The errors (12,) that lead to another place."""
        turn = rotation_vector_between(other.dcm, self.dcm)
        return np.concatenate([other.motion - self.motion, turn, other.rate - self.rate])


@dataclass(frozen=True)
class Step:
    """A step: where it ends, Phi (12, 12), Q (12, 12) and B (12, m)."""

    end: Place
    phi: Matrix
    noise: Matrix
    pushed: Matrix


@dataclass(frozen=True)
class Later:
    """An event, smoothed: the filter's P and S, the smoothed place, and how its error follows from the filtered one.

    follows, lasting, rest: A (12, 12), G Y' - W B (12, m), and W Q W^T + G Z' G^T (12, 12).
    """

    epoch: Any
    covariance: Matrix
    sensitivity: Matrix
    place: Place
    follows: Matrix
    lasting: Matrix
    rest: Matrix


@entry
def _go_on(block: Vector, t: float, dt: float) -> bool:
    """Carry the first hypothesis of `spare` over dt from t, the control being that of `motion`."""
    m = pose_views(block)
    prepare_step(m.step, m.motion, m.scratch, t, dt)
    return advance_pose(m.body, m.step, m.scratch, m.motion["orbit"], m.spare[0], t, m.step["dt"])


class InertiaSmoother:
    """Goes backward over a log's events, chunk by chunk."""

    def __init__(self, mission: VisionMission, memory: Vector) -> None:
        """Begin behind the last event; memory: of a filter that is used for nothing else."""
        self._memory, self._m, self._errors = memory, pose_views(memory), inertia_errors(mission)
        self._later: Later | None = None

    def backward(self, events: Any, apart: Stack) -> None:
        """As `PoseSmoother.backward`."""
        for k in range(len(events) - 1, -1, -1):
            one = events[k]
            if one["hypotheses"] == 0:
                self._later = None
                continue
            now, alone = self._filtered(one, apart[k].T.copy()), one["hypotheses"] == 1
            if self._later is not None and alone:
                now = self._back(now, self._later)
            own = now.follows @ now.covariance @ now.follows.T + now.rest
            lasting = now.follows @ now.sensitivity + now.lasting
            one["motion"], one["dcm"], one["rate"] = now.place.motion, now.place.dcm, now.place.rate
            one["factor"] = factorize(_symmetric(own + lasting @ lasting.T))[LOWER]
            one["by_chaser"] = lasting[:, :3].T
            self._later = now if alone and one["status"] != STARTED else None

    def _filtered(self, one: Any, sensitivity: Matrix) -> Later:
        ld, nothing = np.zeros((POSE, POSE)), np.zeros((POSE, POSE))
        unpack_factors(np.ascontiguousarray(one["factor"]), ld)
        place = Place(one["motion"].copy(), one["dcm"].copy(), one["rate"].copy())
        return Later(one.copy(), compose(ld), sensitivity, place, np.eye(POSE), np.zeros_like(sensitivity), nothing)

    def _back(self, now: Later, later: Later) -> Later:
        """Smooth an event by the one after; slopes are taken about the filtered state, and then about what follows."""
        about, dt = now.place, float(later.epoch["t"] - now.epoch["t"])
        own = step = self._step(now, about, later)
        x, y, z = self._of_update(now, later, own)
        for _ in range(MOST_REPEATED):
            gain = _gain(now, step)
            correction = gain @ (step.end.to(later.place) - step.phi @ about.to(now.place))
            place = now.place.moved(correction)
            held = gain @ (np.eye(POSE) - x)
            follows = np.eye(POSE) - held @ step.phi
            rest = held @ step.noise @ held.T + gain @ z @ gain.T
            total = np.diag(follows @ now.covariance @ follows.T + rest)
            if _is_straight(about.to(place), total, dt):
                break
            about = place
            step = self._step(now, about, later)
        return Later(now.epoch, now.covariance, now.sensitivity, place, follows, gain @ y - held @ step.pushed, rest)

    def _step(self, now: Later, about: Place, later: Later) -> Step:
        """The step from an event to the one after, about a place."""
        m, track, t = self._m, self._m.spare[0], float(now.epoch["t"])
        m.motion["acceleration"], m.motion["delta_v"] = later.epoch["acceleration"], later.epoch["delta_v"]
        track["motion"], track["dcm"], track["rate"], track["ld"] = about.motion, about.dcm, about.rate, np.eye(POSE)
        _go_on(self._memory, t, float(later.epoch["t"]) - t)
        pushed = np.zeros_like(now.sensitivity)
        pushed[THETA:, -self._errors :] = m.body["pushed"].T
        end = Place(track["motion"].copy(), track["dcm"].copy(), track["rate"].copy())
        return Step(end, m.scratch["phi"].copy(), compose(np.array(m.scratch["noise"])), pushed)

    def _of_update(self, now: Later, later: Later, step: Step) -> tuple[Matrix, Matrix, Matrix]:
        """X, Y and Z of the event after, by what the filter's update there has made of its prediction."""
        predicted = step.phi @ now.covariance @ step.phi.T + step.noise
        lasting = step.phi @ now.sensitivity + step.pushed
        after = later.covariance + later.sensitivity @ later.sensitivity.T
        update = _divided(after, predicted + lasting @ lasting.T)
        added = later.covariance - update @ predicted @ update.T
        taken, follows = later.sensitivity - update @ lasting, later.follows
        return follows @ update, follows @ taken + later.lasting, follows @ added @ follows.T + later.rest


def _gain(now: Later, step: Step) -> Matrix:
    """G of all errors together."""
    lasting = step.phi @ now.sensitivity + step.pushed
    predicted = step.phi @ now.covariance @ step.phi.T + step.noise + lasting @ lasting.T
    return _divided(now.covariance @ step.phi.T + now.sensitivity @ lasting.T, predicted)


def _divided(a: Matrix, covariance: Matrix) -> Matrix:
    """A P^-1, units made alike: a sigma of a position is many times one of a rate."""
    scale = np.sqrt(np.diag(covariance))
    out: Matrix = np.linalg.solve(covariance / scale / scale[:, None], (a / scale).T).T / scale
    return out


def _is_straight(moved: Vector, variance: Vector, dt: float) -> bool:
    """As `pose_smoothing`: whether slopes over dt s differ by nothing that matters between two places."""
    turn, rate = float(np.linalg.norm(moved[THETA:RATE])), float(np.linalg.norm(moved[RATE:]))
    bend = dt * (turn * rate + rate * dt)
    least_turn, least_rate = math.sqrt(variance[THETA:RATE].min()), math.sqrt(variance[RATE:].min())
    return rate * dt <= STRAIGHT * least_rate and bend <= STRAIGHT * least_turn


def _symmetric(matrix: Matrix) -> Matrix:
    out: Matrix = 0.5 * (matrix + matrix.T)
    return out
