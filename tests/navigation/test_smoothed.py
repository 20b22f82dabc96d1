"""A smoothed log: better than filtered, honest, and cut where the track is cut."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.accuracy.campaign import noise_alone
from relnav.navigation.log import Epochs, LogFilter
from relnav.navigation.smoothing import nothing_later
from relnav.navigation.status import EpochStatus
from relnav.simulation.detector import Faults
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach


@pytest.fixture(scope="module")
def model():
    return noise_alone(relnav.load_model("three_beacon_psd"), "spots")


def both(model, log, method):
    return [
        relnav.filter_epochs(
            model, log.t_s, log.spots_m, acceleration_m_s2=log.acceleration_m_s2, method=method, smooth=smooth
        )
        for smooth in (False, True)
    ]


@pytest.mark.parametrize("method", ["spots", "fix"])
def test_smoothed_is_no_worse_anywhere(model, method):
    """Over 20 faulted flights, component by component, in pieces of 25 s; and the last epoch is the filter's own."""
    square = np.zeros((2, 12, 6))
    for seed in range(20):
        log = simulate(model, Approach(assumed_noise=True), Faults(dropout=0.05, outliers=0.02), seed=seed)
        for row, solution in enumerate(both(model, log, method)):
            error = np.nan_to_num(solution.state - log.truth) ** 2
            square[row] += error.reshape(12, 250, 6).sum(axis=1)
            if row == 0:
                last = solution.state[-1]
        assert np.array_equal(solution.state[-1], last)
    assert np.all(square[1] <= square[0])
    assert square[1].sum(axis=0)[0] < 0.4 * square[0].sum(axis=0)[0]


def test_smoothed_sigma_never_exceeds_filtered(model):
    log = simulate(model, Approach(), Faults(dropout=0.1), seed=1)
    filtered, smoothed = both(model, log, "spots")
    known = filtered.status != EpochStatus.WAITING
    assert np.all(smoothed.sigma[known] <= filtered.sigma[known] * (1.0 + 1e-9))
    assert np.array_equal(np.isnan(smoothed.state), np.isnan(filtered.state))
    assert smoothed.smoothed
    assert not filtered.smoothed


def test_pieces_do_not_mix(model):
    """The scene jumps; the piece before the restart is smoothed as if the log ended there."""
    first = simulate(model, Approach(duration_s=20.0), seed=3)
    second = simulate(model, Approach(duration_s=20.0, start_m=(9.0, -0.2, 0.2)), seed=4)
    spots = np.concatenate([first.spots_m, second.spots_m])
    t = np.arange(400) * 0.1
    whole = relnav.filter_epochs(model, t, spots, smooth=True, method="spots")
    restart = int(np.flatnonzero(whole.status == EpochStatus.STARTED)[1])
    before = relnav.filter_epochs(model, t[:restart], spots[:restart], smooth=True, method="spots")
    assert np.array_equal(whole.state[:restart], before.state, equal_nan=True)
    after = relnav.filter_epochs(model, t[restart - 1 :], spots[restart - 1 :], smooth=True, method="spots")
    assert np.allclose(whole.state[restart:], after.state[1:], rtol=0.0, atol=1e-12)


def test_epochs_side_by_side_are_as_one_at_a_time(model):
    """Bit for bit, with burns, impulses, gaps, a restart and irregular times between stretches of one step."""
    rng = np.random.default_rng(12)
    log = simulate(model, Approach(duration_s=40.0), Faults(dropout=0.1), seed=5)
    n = len(log.t_s)
    steps = np.full(n, 0.1)
    steps[rng.choice(n, 40, replace=False)] = rng.uniform(0.01, 3.0, size=40)
    steps[250] = 5000.0  # the track is dropped
    t, control = np.cumsum(steps), np.zeros((n, 6))
    control[60:90, :3], control[90:97, :3] = 1e-3 * rng.normal(size=3), 1e-3 * rng.normal(size=3)
    control[[100, 101, 180], 3:] = 1e-3 * rng.normal(size=(3, 3))
    runs = []
    for length in (n, 1, 5):
        run, epochs, later = LogFilter(model, method="spots"), Epochs.empty(n, 3), nothing_later()
        run.forward(t, log.spots_m, control, np.empty((0, 4)), epochs)
        for end in range(n, 0, -length):
            piece = slice(max(0, end - length), end)
            part = Epochs(**{key: value[piece] for key, value in vars(epochs).items()})
            run.backward(t[piece], control[piece], part, later)
        runs.append(np.concatenate([epochs.state, epochs.factor], axis=1))
    assert np.sum(epochs.codes[:, 1] == EpochStatus.STARTED) >= 2
    assert np.sum(epochs.codes[:, 1] == EpochStatus.WAITING) < 0.1 * n
    for other in runs[1:]:
        np.testing.assert_array_equal(other, runs[0])


@pytest.mark.parametrize("name", ["three_beacon_psd", "three_beacon_psd_rbar"])
def test_the_share_of_the_attitude_is_its_derivative(name):
    """What a lasting turn of the chaser does to a smoothed track without noise, as shipped, to a part in a million."""
    model = relnav.load_model(name)
    silent = dataclasses.replace(model, sensor=dataclasses.replace(model.sensor, spot_noise_m=1e-12))
    log = simulate(silent, Approach(duration_s=20.0), seed=3)
    beacons = model.port_position_m + model.sensor.beacons_dock_m @ model.dcm_dock_from_lvlh
    sight = (beacons - log.truth[:, None, :3]) @ model.dcm_cam_from_lvlh.T

    def smoothed(turn):
        c = sight - np.cross(turn, sight) - model.camera_lever_cam_m
        spots = model.sensor.focal_length_m * c[..., :2] / c[..., 2:]
        control = np.hstack([log.acceleration_m_s2, np.zeros((len(c), 3))])
        run = LogFilter(model, "spots")
        epochs = run.room(len(c), smooth=True)
        run.forward(log.t_s, spots, control, np.empty((0, 4)), epochs)
        run.backward(log.t_s, control, epochs, run.nothing_later())
        return epochs

    nominal = smoothed(np.zeros(3))
    known = np.isfinite(nominal.state[:, 0])
    scale = np.sqrt(np.sum(nominal.considered**2, axis=1))
    for k, step in enumerate(1e-3 * model.attitude.sigma_rad * np.eye(3)):
        derivative = (smoothed(step).state - smoothed(-step).state) / 2e-3
        off = np.abs(derivative - nominal.considered[:, k]) / scale
        assert off[known].max() < 1e-6
