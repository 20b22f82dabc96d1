"""A navigator's state in other hands: copied, pickled, and begun from a state that is known otherwise."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.simulation.marker_flight import simulate_flight
from relnav.simulation.trajectory import Approach

WAYS = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda navigator: pickle.loads(pickle.dumps(navigator)),
}


@pytest.fixture(scope="module")
def log(vbar, drift, look):
    t = 0.1 * np.arange(60)
    truth = drift(vbar, t, [8.0, 0.1, -0.1, -0.01, 0.0, 0.0])
    spots = look(vbar, truth, seed=3)
    spots[30:33] += 1e-3  # locks the filter out: trials run
    return t, truth, spots


def numbers(record):
    return np.concatenate([[record.t_s, record.status, record.nis], record.state, record.covariance.ravel()])


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
def test_a_copy_goes_on_bit_for_bit_and_apart(vbar, log, way, engine):
    told = replace(vbar, tolerances=replace(vbar.tolerances, considered=True))
    t, _, spots = log
    navigator = relnav.Navigator(told, "spots", engine=engine)
    for k in range(33):
        navigator.step(t[k], spots[k], acceleration_m_s2=[1e-5, 0.0, 0.0])
    other = WAYS[way](navigator)
    first = [numbers(navigator.step(t[k], spots[k])) for k in range(33, 60)]
    second = [numbers(other.step(t[k], spots[k])) for k in range(33, 60)]
    np.testing.assert_array_equal(second, first)
    assert np.isfinite(first).all()
    assert len({tuple(row) for row in first}) == 27  # a copy that reports a frozen state would repeat itself


@pytest.mark.parametrize("way", WAYS)
def test_a_pose_navigator_is_copied_likewise(way):
    mission = relnav.load_model("three_marker_vision")
    flight = simulate_flight(mission, Approach(20.0, 2.0, start_m=(10.0, 0.25, -0.15), speed_m_s=0.1), seed=1)
    navigator = relnav.PoseNavigator(mission)
    for k in range(20):
        navigator.step(flight.t_s[k], flight.spots_px[k])
    other = WAYS[way](navigator)
    for k in range(20, 40):  # with a late image: what came before is in the copy too
        late = {"image_t_s": flight.t_s[k - 1] + 0.1} if k == 21 else {}
        one, two = (each.step(flight.t_s[k], flight.spots_px[k], **late) for each in (navigator, other))
        np.testing.assert_array_equal(one.covariance, two.covariance)
        np.testing.assert_array_equal(one.state, two.state)
    assert np.isfinite(one.state).all()


@pytest.mark.parametrize(
    ("kind", "model"), [("Navigator", "three_beacon_psd"), ("PoseNavigator", "three_marker_vision")]
)
def test_another_version_is_refused(kind, model):
    kind = getattr(relnav, kind)
    state = kind(relnav.load_model(model)).__getstate__()
    with pytest.raises(ValueError, match=r"saved by relnav 0.0.1 cannot go on in relnav .*filter from the log again"):
        kind.__new__(kind).__setstate__(state | {"version": "0.0.1"})


@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
@pytest.mark.parametrize("method", ["spots", "fix"])
def test_begun_from_a_known_state(vbar, log, method, engine, nees):
    """The first image already corrects, and the covariance is that of prior and image together."""
    t, truth, spots = log
    navigator, rng = relnav.Navigator(vbar, method, engine=engine), np.random.default_rng(2)
    prior = np.diag([0.05, 0.05, 0.05, 1e-3, 1e-3, 1e-3]) ** 2
    navigator.start(t[0], truth[0] + np.sqrt(np.diag(prior)) * rng.normal(size=6), prior)
    records = [navigator.step(t[k], spots[k]) for k in range(1, 30)]
    assert records[0].status is relnav.EpochStatus.UPDATED
    values = nees(np.array([r.state for r in records]) - truth[1:30], np.array([r.covariance for r in records]))
    assert values.max() < 25.0
    assert np.all(np.diag(records[0].covariance) < 1.001 * np.diag(prior))


def test_a_pose_filter_begun_from_a_known_state():
    mission = relnav.load_model("three_marker_vision")
    flight = simulate_flight(mission, Approach(20.0, 2.0, start_m=(10.0, 0.25, -0.15), speed_m_s=0.1), seed=1)
    navigator = relnav.PoseNavigator(mission)
    covariance = np.diag([0.05] * 3 + [0.01] * 3 + [0.02] * 3 + [1e-3] * 3) ** 2
    navigator.start(0.0, flight.motion[0], flight.dcm_lvlh_from_target[0], flight.rate_rad_s[0], covariance)
    record = navigator.step(flight.t_s[1], flight.spots_px[1])
    assert record.status is relnav.EpochStatus.UPDATED
    assert np.all(np.diag(record.covariance)[:3] < np.diag(covariance)[:3])
    with pytest.raises(ValueError, match=r"must not be before the last epoch, 0.5; got -1.0"):
        navigator.start(-1.0, flight.motion[0], flight.dcm_lvlh_from_target[0], flight.rate_rad_s[0], covariance)


@pytest.mark.parametrize(
    ("state", "covariance", "said"),
    [
        (np.zeros(5), np.eye(6), r"state has shape \(6,\); got \(5,\)"),
        (np.full(6, np.nan), np.eye(6), r"state must be finite"),
        (np.ones(6), np.zeros((6, 6)), r"variances above zero"),
        (np.ones(6), np.triu(np.ones((6, 6))), r"symmetric"),
        (np.ones(6), 2.0 * np.eye(6)[::-1] + np.eye(6), r"not positive semidefinite"),
    ],
)
def test_a_start_that_is_none_changes_nothing(vbar, state, covariance, said):
    navigator = relnav.Navigator(vbar, method="spots")
    with pytest.raises(ValueError, match=said):
        navigator.start(0.0, state, covariance)
    assert navigator.step(0.0, np.full((3, 2), np.nan)).status is relnav.EpochStatus.WAITING


def test_each_navigator_names_the_other(vbar):
    marker = relnav.load_model("three_marker_vision")
    with pytest.raises(ValueError, match=r"three_marker_vision is a marker mission: .* relnav.PoseNavigator"):
        relnav.Navigator(marker)
    with pytest.raises(ValueError, match=r"a beacon mission is flown by relnav.Navigator"):
        relnav.PoseNavigator(vbar)


def test_a_log_of_the_other_kind_is_told_who_filters_it():
    beacons, markers = relnav.load_model("three_beacon_psd"), relnav.load_model("three_marker_vision")
    t, spots = np.arange(3.0), np.full((3, 3, 2), np.nan)
    with pytest.raises(
        ValueError, match=r"three_marker_vision is a marker mission: .* relnav.filter_marker_epochs, not"
    ):
        relnav.filter_epochs(markers, t, spots)
    with pytest.raises(ValueError, match=r"three_beacon_psd is a beacon mission: .* relnav.filter_epochs, not"):
        relnav.filter_marker_epochs(beacons, t, spots)
    with pytest.raises(ValueError, match=r"model is a loaded mission, relnav.load_model\(...\); got None"):
        relnav.filter_marker_epochs(None, t, spots)


def test_the_chasers_attitude_of_a_log_as_matrices_or_quaternions():
    mission = relnav.load_model("three_marker_vision")
    flight = relnav.simulate(mission, seed=3)
    t, spots = flight.t_s[:40], flight.spots_px[:40]
    turned = Rotation.from_rotvec(np.linspace(0.0, 0.01, 40)[:, None] * [1.0, 0.0, 0.0]) * Rotation.from_matrix(
        flight.dcm_chaser_from_lvlh[:40]
    )
    ours = relnav.filter_marker_epochs(mission, t, spots, dcm_chaser_from_lvlh=turned.as_matrix())
    theirs = relnav.filter_marker_epochs(mission, t, spots, q_chaser_from_lvlh=turned.as_quat())
    np.testing.assert_allclose(ours.state, theirs.state, rtol=0.0, atol=1e-11)
    assert (ours.status == theirs.status).all()
    twice = {"dcm_chaser_from_lvlh": turned.as_matrix(), "q_chaser_from_lvlh": turned.as_quat()}
    with pytest.raises(ValueError, match="are the same attitude: give one of them"):
        relnav.filter_marker_epochs(mission, t, spots, **twice)
    with pytest.raises(ValueError, match=r"dcm_chaser_from_lvlh has shape \(40, 3, 3\); got \(39, 3, 3\)"):
        relnav.filter_marker_epochs(mission, t, spots, dcm_chaser_from_lvlh=turned.as_matrix()[:39])


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"t_s": 0.0}, r"t_s has one axis, with at least one epoch; got shape \(\)"),
        ({"t_s": [], "spots_px": np.empty((0, 3, 2))}, r"at least one epoch; got shape \(0,\)"),
        ({"image_t_s": [0.0]}, r"image_t_s has shape \(2,\), as t_s; got \(1,\)"),
        ({"spots_px": np.zeros((2, 2, 2))}, r"spots_px has shape \(2, 3, 2\), one row a marker; got \(2, 2, 2\)"),
    ],
)
def test_a_log_of_markers_of_another_shape(told, said):
    mission = relnav.load_model("three_marker_vision")
    with pytest.raises(ValueError, match=said):
        relnav.filter_marker_epochs(mission, **{"t_s": [0.0, 0.1], "spots_px": np.full((2, 3, 2), np.nan), **told})
