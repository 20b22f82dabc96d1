"""One seed, one log; and what is switched on in one place does not change the draws of another."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from relnav.dynamics.clohessy_wiltshire import propagate
from relnav.mission import ProcessNoise
from relnav.simulation.detector import Faults, project_beacons
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach

SHORT = Approach(duration_s=20.0, assumed_noise=True)
FIELDS = ("t_s", "spots_m", "acceleration_m_s2", "truth")


def test_shapes(make_model) -> None:
    log = simulate(make_model(), SHORT)
    assert [getattr(log, name).shape for name in FIELDS] == [(200,), (200, 3, 2), (200, 3), (200, 6)]
    assert all(getattr(log, name).dtype == np.float64 for name in FIELDS)


def test_the_same_seed_gives_the_same_log(make_model) -> None:
    faults = Faults(dropout=0.1, outliers=0.1)
    one, two = (simulate(make_model(), SHORT, faults, seed=3) for _ in range(2))
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_another_seed_gives_another_log(make_model) -> None:
    one, two = (simulate(make_model(), SHORT, seed=seed) for seed in (3, 4))
    assert (one.spots_m != two.spots_m).all()
    assert (one.truth[1:] != two.truth[1:]).any(axis=1).all()


def test_faults_do_not_touch_the_flight(make_model) -> None:
    plain = simulate(make_model(), SHORT, seed=3)
    faulty = simulate(make_model(), SHORT, Faults(dropout=0.3, outliers=0.1), seed=3)
    np.testing.assert_array_equal(plain.truth, faulty.truth)
    np.testing.assert_array_equal(plain.acceleration_m_s2, faulty.acceleration_m_s2)
    kept = np.isfinite(faulty.spots_m) & (np.abs(faulty.spots_m - plain.spots_m) < 1e-12)
    assert 0.5 < kept.mean() < 0.8  # (1 - 0.3)(1 - 0.1) = 0.63: the good spots keep their noise


def test_flight_noise_does_not_touch_the_detector(make_model) -> None:
    """The noise on the spots is the same whatever was flown."""
    model, noises = make_model(), []
    for assumed in (False, True):
        log = simulate(model, Approach(duration_s=20.0, assumed_noise=assumed), seed=3)
        noises.append(log.spots_m - project_beacons(model, log.truth))
    np.testing.assert_allclose(noises[0], noises[1], rtol=0.0, atol=1e-15)


def test_flight_and_detector_draw_from_different_streams(make_model, truth, sensor) -> None:
    """Else the noise on the spots would hold the kicks that the chaser got, number by number."""
    model = make_model(process_noise=ProcessNoise(1e-6))
    log = simulate(model, Approach(duration_s=100.0, assumed_noise=True), seed=0)
    noise = (log.spots_m - project_beacons(model, log.truth)).ravel() / sensor.spot_noise_m
    rows = range(1, len(log.truth))
    coasts = [propagate(log.truth[k - 1], truth.n, 0.1, log.acceleration_m_s2[k]) for k in rows]
    kicks = (log.truth[1:] - np.array(coasts))[:, 3:] / np.sqrt(1e-6 * 0.1)
    assert kicks.std() == pytest.approx(1.0, abs=0.1)
    nearest, _ = cKDTree(np.lib.stride_tricks.sliding_window_view(noise, 3)).query(kicks, p=np.inf)
    assert nearest.min() > 1e-3  # three numbers in a row, as close by chance once in 300 logs


def test_defaults(make_model) -> None:
    log = simulate(make_model())
    assert log.truth[-1, 0] == pytest.approx(4.0, abs=0.02)
    assert np.isfinite(log.spots_m).all()
