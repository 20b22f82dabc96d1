"""Drifts that are looked for in innovations: sums, chi-squares, what is named; and flights in which one drifts."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from relnav.arrays import Matrix
from relnav.estimation.schmidt import carry_into, gate_rows, take_gated
from relnav.simulation.rendezvous import Rendezvous
from relnav.simulation.vehicle_faults import VehicleFault, with_fault
from relnav.simulation.vehicle_sensors import simulate_rendezvous
from relnav.vehicle.drift_sums import carry_drifts, no_sums, score_of, take_drifts
from relnav.vehicle.drifts import Drifts
from relnav.vehicle.monitor import ALARM_SIGMA, FADES_S
from relnav.vehicle.navigator import VehicleNavigator
from relnav.vehicle.smoothing import VehicleSmoother

ERRORS, ROWS, STEPS, DT_S = 5, 2, 40, 0.7
DRIVES = np.array([3, 4])
"""Of five errors the last two last, and may drift."""


class LinearFilter:
    """A small filter with its sums, and the matrices by which its true errors move: by F, and by I - K H."""

    def __init__(self):
        rng = np.random.default_rng(8)
        self.drift = no_sums(ERRORS, len(DRIVES))
        self.told, self.transitions, self.corrections = [], [], []
        P = np.diag([1.0, 2.0, 1.0, 0.3, 0.3])
        for _ in range(STEPS):
            F = np.eye(3, ERRORS)
            F[:, :] += 0.1 * rng.normal(size=F.shape)
            H, R = rng.normal(size=(ROWS, ERRORS)), 0.5 * np.eye(ROWS)
            P = self._step(P, F, 0.02 * np.eye(3))
            P = self._update(P, H, R, rng.normal(size=ROWS))

    def _step(self, P: Matrix, F: Matrix, Q: Matrix) -> Matrix:
        after, work, places = np.empty_like(P), np.empty((ERRORS, 3)), np.zeros((3, ERRORS), dtype=np.int64)
        weights, counts = np.empty((3, ERRORS)), np.zeros(3, dtype=np.int64)
        carry_into(P, F, Q, after, work, places, weights, counts)
        carry_drifts(self.drift, DT_S, DRIVES, places, weights, counts, np.empty((3, len(DRIVES))))
        self.transitions.append(np.vstack([F, np.eye(ERRORS)[3:]]))
        return after

    def _update(self, P: Matrix, H: Matrix, R: Matrix, residual: Matrix) -> Matrix:
        work, places = np.empty((4 * ROWS + 3, ERRORS)), np.zeros(ERRORS, dtype=np.int64)
        chosen, correction, told = np.zeros(ROWS, dtype=np.int64), np.empty(ERRORS), np.empty((ROWS, len(DRIVES)))
        limits, considered = np.full(ROWS + 1, math.inf), np.zeros(ERRORS, dtype=bool)
        S = H @ P @ H.T + R
        self.corrections.append(np.eye(ERRORS) - P @ H.T @ np.linalg.inv(S) @ H)
        gate_rows(P, residual, H, R, ROWS, limits, ERRORS, chosen, work, places)
        take_gated(P, considered, ERRORS, chosen, work, places, correction)
        take_drifts(H, chosen, work, places, False, self.drift, told)
        self.told.append((told, np.linalg.solve(np.linalg.cholesky(S), residual)))
        return P


@pytest.fixture(scope="module")
def linear():
    return LinearFilter()


def test_sensitivity_is_what_a_drift_does_to_the_errors(linear):
    """A drift that sets in by and by, as strong as what is remembered of then: S at the end, by the true errors."""
    for column, error in enumerate(DRIVES):
        errors = np.zeros(ERRORS)
        for k, (F, correction) in enumerate(zip(linear.transitions, linear.corrections, strict=True)):
            errors = F @ errors
            errors[error] += DT_S * math.exp(-(STEPS - 1 - k) * DT_S / FADES_S)
            errors = correction @ errors
        np.testing.assert_allclose(linear.drift[:ERRORS, column], errors, rtol=1e-9, atol=1e-12)


def test_sums_fade(linear):
    score, information = np.zeros(2), np.zeros((2, 2))
    for k, (told, white) in enumerate(linear.told):
        weight = math.exp(-(STEPS - 1 - k) * DT_S / FADES_S)
        score += weight * told.T @ white
        information += weight**2 * told.T @ told
    found, of_all = score_of(linear.drift)
    np.testing.assert_allclose(found, score, rtol=1e-9)
    np.testing.assert_allclose(of_all, information, rtol=1e-9)


def test_without_a_drift_deviations_are_normal(linear):
    """Also far out: of 20,000 flights of white innovations as many beyond 2 and 3 sigma as a normal variable has."""
    rng, runs, (_, information) = np.random.default_rng(4), 20_000, score_of(linear.drift)
    scores = np.zeros((runs, 2))
    for k, (told, _) in enumerate(linear.told):
        scores += math.exp(-(STEPS - 1 - k) * DT_S / FADES_S) * rng.normal(size=(runs, ROWS)) @ told
    found = np.array([Drifts({"star": 2}, score, information).deviations["star"] for score in scores])
    assert abs(found.mean()) < 0.06  # Wilson and Hilferty's normal is off by so much at two degrees of freedom
    assert abs(found.std() - 1.0) < 0.06
    for limit in (2.0, 3.0):
        expected = runs * norm.sf(limit)
        assert 0.6 * expected < (found > limit).sum() < 1.4 * expected


def test_while_rows_bend_the_sums_begin_anew(linear):
    sums = linear.drift.copy()
    take_drifts(np.zeros((1, ERRORS)), np.zeros(1, dtype=np.int64), np.zeros((7, ERRORS)), DRIVES, True, sums, sums)
    assert not sums.any()


def found_with(**chi_squares):
    """Drifts of one error each with these chi-squares."""
    score = np.sqrt(np.array(list(chi_squares.values())))
    return Drifts(dict.fromkeys(chi_squares, 1), score, np.eye(len(score)))


def test_what_explains_it_half_as_well_is_named_too():
    assert found_with(camera=60.0, psd=29.0, star=31.0).suspects == ("camera", "star")
    assert found_with(camera=40.0, psd=41.0, star=3.0).suspects == ("psd", "camera")


def test_nothing_is_named_without_an_alarm():
    quiet = found_with(camera=9.0, psd=8.0)
    assert max(quiet.deviations.values()) < ALARM_SIGMA
    assert quiet.suspects == ()
    unseen = Drifts({"camera": 3}, np.zeros(3), np.zeros((3, 3)))
    assert math.isnan(unseen.deviations["camera"])
    assert unseen.suspects == ()


def test_what_is_not_seen_does_not_count():
    """A direction has two degrees of freedom: a turn about it is not seen."""
    flat = np.diag([4.0, 1.0, 1e-14])
    two = Drifts({"sun": 2}, np.array([6.0, 2.0]), flat[:2, :2])
    three = Drifts({"sun": 3}, np.array([6.0, 2.0, 1e-9]), flat)
    assert three.deviations["sun"] == pytest.approx(two.deviations["sun"], rel=1e-12)


FLIGHT = Rendezvous(start_m=5.5, final_m=2.0, fast_m_s=0.1, slow_m_s=0.1)
BEGINS_S, LASTS_S = 8.0, 25.0
DRIFTING = [
    (VehicleFault.RAMP, "gyro", {"gyro", "star"}),
    (VehicleFault.RAMP, "star", {"gyro", "star"}),
    (VehicleFault.RAMP, "camera", {"camera", "psd"}),
    (VehicleFault.RAMP, "psd", {"camera", "psd"}),
    (VehicleFault.WEAK, "thrust", {"thrust"}),
]
"""What drifts, and what cannot be told from it."""


@pytest.fixture(scope="module")
def run(slow):
    return simulate_rendezvous(slow, FLIGHT, seed=76)


@pytest.mark.parametrize(("fault", "name", "named"), DRIFTING)
def test_what_drifts_is_named(slow, run, fault, name, named):
    nav, second = VehicleNavigator(slow), 1.0
    for seen in with_fault(run, fault, name, np.random.default_rng(1), BEGINS_S, LASTS_S):
        nav.observe(seen.sensor, seen.t_s, seen.value)
        if seen.t_s >= second:
            now, second = nav.state(second), second + 1.0
            if now.alarms:
                break
    assert name in now.alarms
    assert set(now.alarms) <= named
    assert BEGINS_S < now.t_s < BEGINS_S + LASTS_S


def test_without_the_filter_that_watches_nothing_is_looked_for(slow, run):
    nav = VehicleNavigator(slow, monitor=False)
    for seen in run.observations[:200]:
        nav.observe(seen.sensor, seen.t_s, seen.value)
    assert nav.state().drifts.deviations == {}
    assert nav.state().alarms == ()


def test_smoothed_estimates_have_those_of_the_filter(slow, run):
    nav, smoother = VehicleNavigator(slow), VehicleSmoother(slow)
    seen = sorted((one for one in run.observations if one.t_s < 6.0), key=lambda one: one.t_s)
    for one in seen:
        smoother.observe(one.sensor, one.t_s, one.value)
        if one.t_s <= 4.0:
            nav.observe(one.sensor, one.t_s, one.value)
    (smoothed,) = smoother.estimates([4.0])
    assert smoothed.drifts.deviations == nav.state(4.0).drifts.deviations
    assert not math.isnan(smoothed.drifts.deviations["psd"])
