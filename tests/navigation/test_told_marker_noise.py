"""Noise that is told of each spot of a marker log: one by one, as arrays, in files; honest where it changes."""

from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.estimation.consistency import chi_square_interval
from relnav.files.marker_logs import write_marker_log
from relnav.navigation.pose_innovations import MarkerInnovations
from relnav.simulation.marker_flight import simulate_flight, true_spots
from relnav.simulation.trajectory import Approach

CHANGE = np.array([0.3, 3.0])
"""Times the noise that the model states: in the first and in the second half of a flight."""
AXES = np.array([1.0, 1.5])
"""And times that along x and along y."""


@pytest.fixture(scope="module")
def mission():
    return relnav.load_model(
        "three_marker_vision", {"chaser.attitude_sigma_deg": 0.0, "chaser.attitude_noise_deg": 0.0}
    )


def flown(mission, seed, duration_s=20.0):
    """A flight with noise of its own, from another generator than the flight's, and its sigmas (n, markers, 2), px."""
    flight = simulate_flight(mission, Approach(duration_s=duration_s, rate_hz=4.0, assumed_noise=True), seed=seed)
    half = np.arange(len(flight.t_s)) * 2 // len(flight.t_s)
    sigma = np.broadcast_to((mission.camera.spot_noise_px * CHANGE[half])[:, None, None] * AXES, flight.spots_px.shape)
    clean = true_spots(mission, flight.motion, flight.dcm_lvlh_from_target, flight.dcm_chaser_from_lvlh)
    return replace(flight, spots_px=clean + sigma * np.random.default_rng(seed + 1000).normal(size=sigma.shape)), sigma


def filtered(mission, flight, sigma=None, **options):
    told = {} if sigma is None else {"spot_covariance_px2": sigma[..., None] ** 2 * np.eye(2)}
    return relnav.filter_marker_epochs(
        mission, flight.t_s, flight.spots_px, acceleration_m_s2=flight.acceleration_m_s2, **told, **options
    )


def test_told_noise_is_honest(mission):
    """NIS of both halves of 16 flights, and NEES of motion at their ends, in intervals that chance leaves 1 of 1000."""
    runs, nis, dof, nees, untold = 16, np.zeros(2), np.zeros(2), 0.0, np.zeros(2)
    for seed in range(runs):
        flight, sigma = flown(mission, seed)
        told, plain = filtered(mission, flight, sigma), filtered(mission, flight)
        half = np.arange(len(flight.t_s)) * 2 // len(flight.t_s)
        for k in range(2):
            used = (half == k) & (told.dof > 0)
            nis[k], dof[k] = nis[k] + told.nis[used].sum(), dof[k] + told.dof[used].sum()
            used = (half == k) & (plain.dof > 0)
            untold[k] += plain.nis[used].sum() / plain.dof[used].sum() / runs
        error = told.state[-1] - flight.motion[-1]
        nees += error @ np.linalg.solve(told.covariance[-1][:6, :6], error)
    for k in range(2):
        lower, upper = chi_square_interval(int(dof[k]), 0.999)
        assert lower < nis[k] / dof[k] < upper
    lower, upper = chi_square_interval(6 * runs, 0.999)
    assert lower < nees / (6 * runs) < upper
    assert untold[0] < 0.5
    assert untold[1] > 2.0


def log_of(flight, sigma, path):
    """As it is written, with columns of the sigmas; None: empty cells."""
    write_marker_log(flight, path)
    head, *rows = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    head += "".join(f",sigma_spot_{marker}_{axis}_px" for marker in "abc" for axis in "xy")
    cells = [[""] * 6] * len(rows) if sigma is None else sigma.reshape(len(rows), -1).tolist()
    lines = [f"{row},{','.join(map(str, own))}" for row, own in zip(rows, cells, strict=True)]
    path.write_text("\n".join([head, *lines]) + "\n")
    return path


def attitude_of(flight):
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(flight.dcm_chaser_from_lvlh).as_quat(canonical=True)


@pytest.mark.parametrize("smooth", [False, True])
def test_the_same_one_by_one_as_arrays_and_in_a_file(mission, tmp_path, smooth):
    flight, sigma = flown(mission, 5, 10.0)
    solution = filtered(mission, flight, sigma, smooth=smooth, q_chaser_from_lvlh=attitude_of(flight))
    read = relnav.filter_marker_log(log_of(flight, sigma, tmp_path / "log.csv"), mission, smooth=smooth)
    np.testing.assert_allclose(read.state, solution.state, rtol=1e-9, atol=1e-12)
    if smooth:
        return
    np.testing.assert_array_equal(read.spot_covariance_px2, solution.spot_covariance_px2)
    navigator = relnav.PoseNavigator(mission)
    for k, t in enumerate(flight.t_s):
        record = navigator.step(
            t,
            flight.spots_px[k],
            acceleration_m_s2=flight.acceleration_m_s2[k],
            dcm_chaser_from_lvlh=flight.dcm_chaser_from_lvlh[k],
            spot_covariance_px2=solution.spot_covariance_px2[k],
        )
    np.testing.assert_allclose(record.state, solution.state[-1], rtol=1e-9)
    assert record.nis == pytest.approx(solution.nis[-1], rel=1e-6)


def test_empty_cells_are_the_noise_of_the_model(mission, tmp_path):
    flight, _ = flown(mission, 6, 10.0)
    plain = filtered(mission, flight, q_chaser_from_lvlh=attitude_of(flight))
    read = relnav.filter_marker_log(log_of(flight, None, tmp_path / "log.csv"), mission)
    np.testing.assert_allclose(read.state, plain.state, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(read.nis, plain.nis, rtol=1e-6)


def test_the_other_engine_and_late_images(mission):
    flight, sigma = flown(mission, 7, 10.0)
    solution, other = filtered(mission, flight, sigma), filtered(mission, flight, sigma, engine="filterpy")
    np.testing.assert_allclose(other.state, solution.state, rtol=1e-6, atol=1e-9)
    late = filtered(mission, flight, sigma, image_t_s=flight.t_s)
    np.testing.assert_array_equal(late.state, solution.state)


def test_innovations_have_the_sigma_that_was_told(mission):
    flight, sigma = flown(mission, 8, 10.0)
    solution = filtered(mission, flight, sigma)
    whole = MarkerInnovations(mission).of(solution)
    watched = MarkerInnovations(mission)
    parts = [watched.of(solution.part(begin, begin + 7)) for begin in range(0, len(solution), 7)]
    for k in range(2):
        np.testing.assert_array_equal(np.concatenate([part[k] for part in parts]), whole[k])
    known = np.isfinite(whole[1])
    assert known.sum() > 0.8 * known.size
    assert (whole[1][known] > sigma[known]).all()
    assert (whole[1][known] < mission.camera.spot_noise_px).any()


def test_a_covariance_that_is_none_hides_its_spot(mission):
    flight, sigma = flown(mission, 9, 5.0)
    spots, broken = flight.spots_px.copy(), sigma.copy()
    spots[10:, 1], broken[10:, 1] = np.nan, np.nan
    hidden = filtered(mission, replace(flight, spots_px=spots), sigma)
    np.testing.assert_array_equal(filtered(mission, flight, broken).state, hidden.state)


def test_refusals(mission, tmp_path):
    flight, sigma = flown(mission, 9, 5.0)
    with pytest.raises(
        ValueError, match=r"spot_covariance_px2 has shape \(20, 3, 2, 2\), one a spot; got \(20, 3, 2\)"
    ):
        relnav.filter_marker_epochs(mission, flight.t_s, flight.spots_px, spot_covariance_px2=sigma)
    path = log_of(flight, sigma, tmp_path / "log.csv")
    text = path.read_text()
    path.write_text(text.replace("sigma_spot_c_y_px", "noise"))
    with pytest.raises(relnav.LogError, match="'sigma_spot_c_y_px' is missing; the others of its group are there"):
        relnav.filter_marker_log(path, mission)
    head, first, *rest = text.splitlines()
    path.write_text("\n".join([head, first.rpartition(",")[0] + ",0", *rest]))
    with pytest.raises(relnav.LogError, match=r"log.csv:2: column 'sigma_spot_c_y_px': a sigma above 0"):
        relnav.filter_marker_log(path, mission)
