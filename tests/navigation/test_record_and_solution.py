"""What records and solutions say of themselves: derived figures, parts, consistency, one line for the console."""

import numpy as np
import pytest

import relnav


@pytest.fixture(scope="module")
def flight(vbar, drift, look):
    t = 0.1 * np.arange(300)
    truth = drift(vbar, t, [7.0, 0.2, -0.3, -0.01, 0.0, 0.0])
    spots = look(vbar, truth, seed=2)
    spots[50, 0] += 5e-4
    spots[60] += 5e-4
    spots[70] = np.nan
    return t, spots


def test_docking_covariance_is_the_covariance_of_the_docking_view(vbar, flight):
    """J P J^T against samples of the state's own Gaussian."""
    t, spots = flight
    solution = relnav.filter_epochs(vbar, t, spots, method="spots")
    rng = np.random.default_rng(1)
    x = rng.multivariate_normal(solution.state[-1], solution.covariance[-1], size=20_000)
    horizontal = np.hypot(x[:, 0], x[:, 1])
    sample = np.stack(
        [np.hypot(horizontal, x[:, 2]), np.arctan2(x[:, 1], x[:, 0]), np.arctan2(-x[:, 2], horizontal)], axis=1
    )
    np.testing.assert_allclose(sample.mean(axis=0), solution.docking[-1], atol=4e-5)
    sigma = solution.docking_sigma[-1]
    np.testing.assert_allclose(
        np.cov(sample.T) / np.outer(sigma, sigma), solution.docking_covariance[-1] / np.outer(sigma, sigma), atol=0.04
    )


def test_covariances_are_symmetric_and_positive(vbar, flight):
    t, spots = flight
    for method in ("spots", "fix"):
        p = relnav.filter_epochs(vbar, t, spots, method=method).covariance[2:]
        np.testing.assert_array_equal(p, np.swapaxes(p, 1, 2))
        assert np.linalg.eigvalsh(p).min() > 0.0


def test_accepted_is_used_whole(vbar, flight):
    t, spots = flight
    solution = relnav.filter_epochs(vbar, t, spots, method="spots")
    names = {k: relnav.EpochStatus(solution.status[k]).name for k in (0, 1, 2, 50, 60, 70)}
    assert names == {0: "WAITING", 1: "STARTED", 2: "UPDATED", 50: "PARTIAL", 60: "REJECTED", 70: "PREDICTED"}
    assert [bool(solution.accepted[k]) for k in names] == [False, True, True, False, False, False]


def test_nis_consistency_is_of_the_epochs_used_whole(vbar, flight):
    t, spots = flight
    solution = relnav.filter_epochs(vbar, t, spots, method="spots")
    consistency = solution.nis_consistency()
    used = np.isin(solution.status, (1, 5))
    assert consistency.dof == solution.dof[used].sum()
    assert consistency.ratio == pytest.approx(solution.nis[used].sum() / solution.dof[used].sum(), rel=1e-12)
    assert "NIS per degree of freedom" in str(consistency)


def test_a_part_is_a_solution(vbar, flight):
    t, spots = flight
    solution = relnav.filter_epochs(vbar, t, spots, method="spots")
    part = solution.part(40, 80)
    assert len(part) == 40
    np.testing.assert_array_equal(part.covariance, solution.covariance[40:80])
    np.testing.assert_array_equal(part.docking_sigma, solution.docking_sigma[40:80])
    assert part.model == solution.model
    assert part.status.tolist() == solution.status[40:80].tolist()


def test_a_record_prints_as_one_line(vbar, flight):
    t, spots = flight
    navigator = relnav.Navigator(vbar, method="spots")
    assert repr(navigator.step(t[0], spots[0])) == "FilterRecord(t_s=0, WAITING: OK)"
    text = repr(navigator.step(t[1], spots[1]))
    assert text.startswith("FilterRecord(t_s=0.1, STARTED, range 7.")
    assert text.count("+-") == 3
    assert "\n" not in text


def test_without_a_state_everything_is_nan(vbar):
    record = relnav.Navigator(vbar, method="spots").step(0.0, np.full((3, 2), np.nan))
    assert not record.has_state
    assert not record.accepted
    assert record.measurement_status == relnav.Status.NOT_SEEN
    for value in (record.state, record.covariance, record.innovation, record.docking_covariance):
        assert np.isnan(value).all()
    assert np.isnan([record.range_m, record.azimuth_rad, record.elevation_rad, record.nis, record.sigma_range_m]).all()


def test_angles_are_the_papers(vbar, drift, look):
    """Azimuth toward +y, elevation toward -z.

    Eq. (13) of Cai, Zhao, Sun, Qiao, Dai (1996),
    "Determination of target relative position and range by PSD optical sensor system".
    """
    t = 0.1 * np.arange(60)
    spots = look(vbar, drift(vbar, t, [8.0, 0.3, -0.2, 0.0, 0.0, 0.0]), seed=1)
    solution = relnav.filter_epochs(vbar, t, spots, method="spots")
    assert np.degrees(solution.azimuth_rad[-1]) == pytest.approx(np.degrees(np.arctan2(0.3, 8.0)), abs=0.05)
    assert np.degrees(solution.elevation_rad[-1]) == pytest.approx(np.degrees(np.arctan2(0.2, 8.005)), abs=0.05)


def test_progress_counts_every_epoch(vbar):
    n = 150_000
    calls = []
    relnav.filter_epochs(
        vbar, np.arange(n, dtype=float), np.full((n, 3, 2), np.nan), progress=calls.append, method="spots"
    )
    assert sum(calls) == n
    assert len(calls) > 1


def test_chunks_leave_no_seam(vbar, drift, look, monkeypatch):
    """A log that is worked through in pieces of 7 epochs is the same as in one piece."""
    from relnav.navigation import log as whole_log

    t = 0.1 * np.arange(100)
    spots = look(vbar, drift(vbar, t, [8.0, 0.1, -0.1, 0.0, 0.0, 0.0]), seed=1)
    whole = relnav.filter_epochs(vbar, t, spots, acceleration_m_s2=np.zeros((100, 3)), method="spots")
    monkeypatch.setattr(whole_log, "CHUNK", 7)
    pieces = relnav.filter_epochs(vbar, t, spots, acceleration_m_s2=np.zeros((100, 3)), method="spots")
    for name in ("state", "factor", "nis", "dof", "status", "innovation", "docking"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(pieces, name))


def test_a_part_is_the_whole_cut(vbar, flight):
    t, spots = flight
    whole = relnav.filter_epochs(vbar, t[:60], spots[:60], method="spots")
    part = whole.part(40, 60)
    assert len(part) == 20
    for name in ("t_s", "state", "covariance", "docking", "docking_covariance", "innovation", "nis", "accepted"):
        assert np.array_equal(getattr(part, name), getattr(whole, name)[40:], equal_nan=True), name
