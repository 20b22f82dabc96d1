"""A call with its answer: an acceleration in; range, state and covariance out; relnav, peers and compiled limits.

Part of `speed.py`. Every contender is held against relnav's filtered log first, states, covariances and ranges to 1e-6
sigma; the peers of `fix` on a second log as well, with an image that is wrong and that all must refuse. Only the
filterpy user of the timed tables has no gate.
"""

import numpy as np
from peers.by_hand import OnFilterpy
from peers.c_and_eigen import Build, ByCtypes, ByExtension, from_a_loop_in_c
from peers.on_fast_kalman import OnFastKalman
from peers.on_gtsam import LAG_S, VARIANCE_BOUND, OnFixedLag, OnKalmanFilter
from peers.on_jax import OnJax
from peers.six_coordinates import SixCoordinates
from peers.start import Start
from rounds import installed

import relnav
from relnav.estimation.gating import chi_square_limit
from relnav.navigation.status import EpochStatus
from relnav.simulation.detector import Faults, image

BOUND = 1e-6
"""Largest difference of answers, in sigma of relnav's."""
LAG = f"GTSAM user, all states of the last {LAG_S:g} s"
START, PEER_EPOCHS = 5, 300
WRONG_IMAGE = START + 150
GLINT_M = 1e-4


class Flight:
    """Images of a chaser that accelerates, and relnav's answers."""

    def __init__(self, model, hand, times, method, wrong=()):
        """Simulate as many epochs as times; a spot of the images named as wrong is a glint's."""
        self.model, self.hand, self.times, self.method = model, hand, times, method
        n, (phi, self.q), self.effect = len(times), hand.transition(0.1), hand.effect(0.1)
        self.phi = phi
        self.push = 1e-4 * np.sin(0.01 * np.arange(n))[:, None] * [1.0, -0.5, 0.25]
        x, truth = np.array([9.0, 0.2, -0.1, -0.01, 0.0, 0.0]), np.empty((n, 6))
        for e in range(n):
            x = phi @ x + self.effect @ self.push[e]
            truth[e] = x
        self.spots = image(model, truth, Faults(), np.random.default_rng(5))
        for e in wrong:
            self.spots[e, 0] += GLINT_M
        self.solution = relnav.filter_epochs(model, times, self.spots, acceleration_m_s2=self.push, method=method)
        refused = np.flatnonzero(self.solution.status[START + 1 :] == EpochStatus.REJECTED) + START + 1
        assert list(refused) == list(wrong), f"refused were the images {refused}"

    def start(self):
        """Where peers begin, as they take it."""
        x, covariance = self.solution.state[START], self.solution.covariance[START]
        gate = chi_square_limit(self.model.filter.gate_probability, 3)
        return Start(self.hand, x, covariance, self.phi, self.q, self.effect, gate)

    def after(self, epochs=None):
        """Images and accelerations after the start, that many or all."""
        part = slice(START + 1, None if epochs is None else START + 1 + epochs)
        return self.spots[part], self.push[part]

    def check(self, name, ranges, states, covariances):
        """Assert that these are relnav's answers after the start."""
        part = slice(START + 1, START + 1 + len(ranges))
        sigma = self.solution.sigma[part]
        by_range = np.abs(np.array(ranges) - self.solution.range_m[part]) / sigma[:, 0]
        by_state = np.abs(np.array(states) - self.solution.state[part]) / sigma
        between = np.abs(np.array(covariances) - self.solution.covariance[part])
        by_covariance = between / (sigma[:, :, None] * sigma[:, None, :])
        worst = max(by_range.max(), by_state.max())
        assert worst < BOUND, f"{name} differs by {worst:.1e} sigma ({self.method})"
        worst = by_covariance.max()
        assert worst < (VARIANCE_BOUND if name == LAG else BOUND), f"covariances of {name} differ by {worst:.1e}"


def stepping(flight, make, epochs=PEER_EPOCHS):
    """Function that makes a peer, hands it image after image, and returns its answers."""
    spots, pushes = map(list, flight.after(epochs))

    def run():
        step = make(flight.start()).step
        return [step(z, a) for z, a in zip(spots, pushes, strict=True)]

    return run


def filterpy_user(flight):
    """Function: filterpy, without a gate."""
    spots, pushes = map(list, flight.after(PEER_EPOCHS))
    x, covariance, phi, q = (getattr(flight.start(), name) for name in ("x", "covariance", "phi", "q"))

    def run():
        fix = flight.method == "fix"
        user = (OnFilterpy if fix else SixCoordinates)(flight.hand if fix else flight.model, x, covariance, phi, q)
        answers = []
        for z, a in zip(spots, pushes, strict=True):
            user.step(z, flight.effect @ a)
            x_now = user.filter.x
            answers.append((np.linalg.norm(x_now[:3]), x_now, user.filter.P))
        return answers

    return run


def relnav_user(flight):
    """Function: relnav, as its README has it; only the last answer is kept."""
    times, spots, pushes = flight.times.tolist(), list(flight.spots), list(flight.push)

    def run():
        step, read = relnav.Navigator(flight.model, flight.method).step, ()
        for t, z, a in zip(times, spots, pushes, strict=True):
            record = step(t, z, acceleration_m_s2=a)
            read = record.range_m, record.state, record.covariance
        return read

    return run


def compiled(flight, build):
    """Name -> (epochs, function): plain C and C++, called from Python and in a loop of their own."""
    spots, pushes = map(np.ascontiguousarray, flight.after())
    entries = {}

    def from_python(cls, code):
        return len(spots), stepping(flight, lambda start: cls(code, start), None)

    if build.extension is not None:
        entries["plain C, called from Python (extension)"] = from_python(ByExtension, build.extension)
    for language, library in build.libraries.items():

        def loop(library=library):
            return from_a_loop_in_c(library, flight.start(), spots, pushes)

        entries[f"{language}, called from Python (ctypes)"] = from_python(ByCtypes, library)
        entries[f"{language}, called from a loop in C: the limit"] = (len(spots), loop)
    return entries


def packages(flight):
    """Name -> (epochs, function): what other packages make of it."""
    entries = {}
    if installed("kalman"):
        entries["fast-kalman user"] = (PEER_EPOCHS, stepping(flight, OnFastKalman))
    if installed("gtsam"):
        entries["GTSAM user, its Kalman filter"] = (PEER_EPOCHS, stepping(flight, OnKalmanFilter))
        entries[LAG] = (PEER_EPOCHS, stepping(flight, OnFixedLag))
    if installed("jax"):
        on_jax, images = OnJax(flight.start()), flight.after()  # made once: compiling is not timed
        entries["JAX user, a compiled call per epoch"] = (PEER_EPOCHS, stepping(flight, lambda _: on_jax.restart()))
        entries["JAX user, a log in memory (lax.scan)"] = (len(images[0]), lambda: on_jax.scan(*images))
    return entries


def answers_of(found):
    """Ranges, states, covariances of what a contender returned: those already, or a list of answers."""
    return found if isinstance(found, tuple) else tuple(zip(*found, strict=True))


def contenders(model, hand, times, method):
    """Name -> (epochs, function) for `rounds.measure`, every answer checked; the filterpy user is the first."""
    flight = Flight(model, hand, times, method)
    solution, user, ours = flight.solution, filterpy_user(flight), relnav_user(flight)
    flight.check("filterpy", *answers_of(user()))
    distance, x, covariance = ours()
    assert (distance, *x) == (solution.range_m[-1], *solution.state[-1])
    assert np.array_equal(covariance, solution.covariance[-1])
    entries = {f"filterpy user, {method}, in and out": (PEER_EPOCHS, user)}
    entries[f"relnav per epoch, {method}, in and out"] = (len(times), ours)
    if method != "fix":
        return entries
    build = Build()
    for case in (Flight(model, hand, times, method, (WRONG_IMAGE,)), flight):
        others = compiled(case, build) | packages(case)
        for name, (_, run) in others.items():
            case.check(name, *answers_of(run()))

    def log():
        found = relnav.filter_epochs(model, times, flight.spots, acceleration_m_s2=flight.push, method=method)
        return found.range_m, found.state, found.covariance

    return entries | {"relnav, a log in memory, all read": (len(times), log)} | others
