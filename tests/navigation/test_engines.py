"""Two engines, one contract: ours and the one on filterpy's ExtendedKalmanFilter agree on flown logs.

Beacons: to 1e-9 sigma. Markers: to 1e-9 sigma but for the prediction of the target's turn; there the compiled filter
adds a step's noise as if the target stood still in it (its document says: to 1 % of its sigmas), the other integrates.
"""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

import relnav
from relnav.dynamics.rigid_body import GRADIENT, ORBIT, RigidBody
from relnav.errors import UsageError
from relnav.files.filter_log import filter_log
from relnav.files.marker_logs import write_marker_log
from relnav.mission import MarkerTolerances
from relnav.navigation.pose_log import filter_marker_epochs
from relnav.navigation.reference import bank as reference_bank
from relnav.navigation.status import Alarm, EpochStatus
from relnav.sensors.three_marker.outcome import AMBIGUITY_LIMIT
from relnav.simulation.as_built import markers_as_built
from relnav.simulation.detector import Faults
from relnav.simulation.marker_flight import MarkerFaults, simulate_flight
from relnav.simulation.scenario import simulate
from relnav.simulation.trajectory import Approach


@pytest.fixture(scope="module")
def models():
    vbar = relnav.load_model("three_beacon_psd")
    return {
        "vbar": vbar,
        "rbar": relnav.load_model("three_beacon_psd_rbar"),
        "attitude unknown": replace(vbar, attitude=replace(vbar.attitude, mode="unknown")),
    }


@pytest.mark.parametrize("method", ["spots", "fix"])
@pytest.mark.parametrize("name", ["vbar", "rbar", "attitude unknown"])
@pytest.mark.parametrize("faults", [Faults(), Faults(dropout=0.05, outliers=0.05)], ids=["clean", "faulted"])
def test_engines_agree(models, name, method, faults, outside):
    model = models[name]
    log = simulate(model, Approach(duration_s=60.0, rate_hz=5.0, assumed_start=True), faults, seed=11)
    ours, theirs = (
        relnav.filter_epochs(
            model, log.t_s, log.spots_m, acceleration_m_s2=log.acceleration_m_s2, method=method, engine=engine
        )
        for engine in ("compiled", "filterpy")
    )
    assert np.array_equal(ours.status, theirs.status)
    assert np.array_equal(ours.dof, theirs.dof)
    assert np.array_equal(ours.measurement_status, theirs.measurement_status)
    off = np.nanmax(np.abs(ours.state - theirs.state) / ours.sigma)
    outside("filterpy ExtendedKalmanFilter", f"`{method}` filter, states of a minute, 1-sigma", off, 1e-9)
    assert np.nanmax(np.abs(theirs.sigma / ours.sigma - 1.0)) < 1e-9
    assert np.nanmax(np.abs(theirs.nis - ours.nis) / (1.0 + ours.nis)) < 1e-9


@pytest.mark.parametrize("method", ["spots", "fix"])
@pytest.mark.parametrize("projection", ["perspective", "parallel"])
def test_engines_agree_on_all_that_a_model_says(models, method, projection):
    """A lever arm, tolerances, noise of the attitude, an eccentric orbit, an impulse."""
    plain = models["vbar"]
    model = replace(
        plain,
        attitude=replace(plain.attitude, noise_rad=2e-4),
        camera=replace(plain.camera, position_m=(0.5, 0.2, -0.3)),
        orbit=replace(plain.orbit, eccentricity=0.1, true_anomaly_rad=1.0),
        tolerances=replace(plain.tolerances, considered=True),
    )
    faults = Faults(dropout=0.05, outliers=0.05)
    log = simulate(model, Approach(duration_s=15.0, rate_hz=5.0, assumed_start=True), faults, seed=11)
    told = {"acceleration_m_s2": log.acceleration_m_s2, "delta_v_m_s": np.zeros((len(log.t_s), 3))}
    told["delta_v_m_s"][40] = 1e-3
    ours, theirs = (
        relnav.filter_epochs(model, log.t_s, log.spots_m, method=method, projection=projection, engine=engine, **told)
        for engine in ("compiled", "filterpy")
    )
    assert np.array_equal(ours.status, theirs.status)
    assert np.array_equal(ours.measurement_status, theirs.measurement_status)
    assert np.nanmax(np.abs(ours.state - theirs.state) / ours.sigma) < 1e-9
    assert np.nanmax(np.abs(theirs.covariance / ours.covariance - 1.0)) < 1e-6
    assert np.nanmax(np.abs(theirs.sigma / ours.sigma - 1.0)) < 1e-9


def test_engines_agree_on_a_restart(models):
    model = models["vbar"]
    log = simulate(model, Approach(duration_s=20.0), seed=3)
    later = simulate(model, Approach(duration_s=20.0, start_m=(9.0, -0.2, 0.2)), seed=4)
    spots = np.concatenate([log.spots_m[:100], later.spots_m[:100]])
    t = np.arange(200) * 0.1
    ours, theirs = (
        relnav.filter_epochs(model, t, spots, engine=engine, method="spots") for engine in ("compiled", "filterpy")
    )
    assert ours.restarts == theirs.restarts == 1
    assert np.array_equal(ours.status, theirs.status)
    assert np.nanmax(np.abs(ours.state - theirs.state) / ours.sigma) < 1e-9


def test_navigator_takes_the_engine(models):
    navigators = [
        relnav.Navigator(models["vbar"], engine=engine, method="spots") for engine in ("compiled", "filterpy")
    ]
    log = simulate(models["vbar"], Approach(duration_s=3.0), seed=1)
    for t, spots, acceleration in zip(log.t_s, log.spots_m, log.acceleration_m_s2, strict=True):
        ours, theirs = (n.step(t, spots, acceleration_m_s2=acceleration) for n in navigators)
        assert ours.status == theirs.status
    assert np.max(np.abs(ours.state - theirs.state) / np.sqrt(np.diag(ours.covariance))) < 1e-9


def test_an_unknown_engine():
    with pytest.raises(ValueError, match='engine must be "compiled" or "filterpy"; got \'numpy\''):
        relnav.Navigator(relnav.load_model("three_beacon_psd"), engine="numpy", method="spots")


MINUTE = Approach(duration_s=60.0, rate_hz=2.0, start_m=(10.0, 0.25, -0.15), final_range_m=4.0, speed_m_s=0.1)
SHORT = replace(MINUTE, duration_s=15.0)


@pytest.fixture(scope="module")
def missions():
    """The shipped models, and one with all that the filter knows of: lens, lever arm, tolerances, eccentric orbit."""
    shipped = relnav.load_model("three_marker_vision")
    camera = replace(shipped.camera, distortion=(-0.1, 0.02, 1e-3, -5e-4, 0.0), position_m=(0.4, -0.2, 0.6))
    everything = replace(
        shipped,
        camera=camera,
        chaser=replace(shipped.chaser, attitude_noise_rad=1e-4),
        orbit=replace(shipped.orbit, eccentricity=0.1, true_anomaly_rad=1.0),
        tolerances=MarkerTolerances(1e-3, 2e-4, 1e-4, considered=True),
    )
    flat = relnav.load_model("three_marker_vision_flat")
    corner = replace(flat.markers, positions_m=(*flat.markers.positions_m, (0.0, 0.3, -0.3)))
    built = replace(
        flat,
        markers=corner,
        chaser=replace(flat.chaser, attitude_sigma_rad=5e-3),
        tolerances=MarkerTolerances(1e-3, 2e-4, 1e-3, considered=True),
    )
    return {"shipped": shipped, "everything": everything, "flat": flat, "flat, built": built}


def both(mission, flight, **options):
    """The log by the two engines."""
    options |= {"acceleration_m_s2": flight.acceleration_m_s2}
    spots = options.pop("spots_px", flight.spots_px)
    return [
        filter_marker_epochs(mission, flight.t_s, spots, engine=engine, **options)
        for engine in ("compiled", "filterpy")
    ]


def apart(ours, theirs):
    """Largest difference of states, by sigma, and of covariances, by both sigmas; decisions are the same."""
    for name in ("status", "used", "dof", "hypotheses", "observable"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)
    told = Alarm.EXCHANGED | Alarm.OUT_OF_VIEW | Alarm.CONTRADICTED  # monitors, of ours alone, say all else
    assert (theirs.alarm == ours.alarm & told | Alarm.UNWATCHED).all()
    np.testing.assert_array_equal(np.isinf(ours.ambiguity), np.isinf(theirs.ambiguity))
    known = ours.hypotheses > 0
    sigma = np.sqrt(np.diagonal(ours.covariance[known], axis1=1, axis2=2))
    turn = np.swapaxes(ours.dcm_lvlh_from_target[known], 1, 2) @ theirs.dcm_lvlh_from_target[known]
    turn = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1)
    moved, turned = theirs.state[known] - ours.state[known], theirs.rate_rad_s[known] - ours.rate_rad_s[known]
    state = np.abs(np.concatenate([moved, turn, turned], axis=1) / sigma)
    covariance = np.abs(theirs.covariance[known] - ours.covariance[known]) / (sigma[:, :, None] * sigma[:, None])
    assert np.nanmax(np.abs(theirs.nis - ours.nis) / (1.0 + ours.nis)) < 1e-5
    return state.max(), covariance.max()


@pytest.mark.parametrize("name", ["shipped", "everything", "flat", "flat, built"])
def test_marker_engines_agree(missions, name, outside):
    faults = MarkerFaults() if name.startswith("flat") else MarkerFaults(dropout=0.05, outliers=0.05)
    flown = markers_as_built(missions[name], 3) if name == "flat, built" else missions[name]
    flight = simulate_flight(flown, MINUTE, faults, seed=6)
    ours, theirs = both(missions[name], flight)
    state, covariance = apart(ours, theirs)
    odds = np.isfinite(ours.ambiguity)
    np.testing.assert_allclose(theirs.ambiguity[odds], ours.ambiguity[odds], rtol=1e-3, atol=1e-3)
    outside("filterpy ExtendedKalmanFilter", "marker filter, states of a minute, 1-sigma", state, 1e-4)
    assert covariance < 4e-4


@pytest.fixture
def _turns_alike(monkeypatch):
    """The target's turn predicted as by the compiled filter: all else stays two implementations."""

    def alike(inertia, orbit, dcm, rate, dt_s, density):
        body = RigidBody(inertia, orbit[0])
        body.matrix[ORBIT, GRADIENT] = 3.0 * orbit[1]
        return body.propagate_with_errors(dcm, rate, dt_s, density)

    monkeypatch.setattr(reference_bank, "predict_rotation", alike)


@pytest.mark.usefixtures("_turns_alike")
def test_marker_engines_agree_but_for_the_turn(missions, outside):
    mission = missions["everything"]
    flight = simulate_flight(mission, MINUTE, MarkerFaults(dropout=0.05, outliers=0.05), seed=7)
    ours, theirs = both(mission, flight)
    state, covariance = apart(ours, theirs)
    assert {int(EpochStatus.PARTIAL), int(EpochStatus.REJECTED)} <= set(ours.status.tolist())
    outside("filterpy ExtendedKalmanFilter", "the same, the target's turn predicted alike, 1-sigma", state, 1e-9)
    assert covariance < 1e-9


@pytest.mark.usefixtures("_turns_alike")
def test_marker_engines_agree_on_poses_that_look_alike(missions):
    """After a minute and a half the expected view is so wide that other roots of every image are within it."""
    long = replace(MINUTE, duration_s=130.0, speed_m_s=0.05)
    ours, theirs = both(missions["shipped"], simulate_flight(missions["shipped"], long, seed=3))
    state, _ = apart(ours, theirs)
    assert state < 1e-7
    several = ours.hypotheses > 1
    assert np.count_nonzero(several) > 20
    assert np.mean(ours.ambiguity[several] >= AMBIGUITY_LIMIT) > 0.8
    np.testing.assert_allclose(theirs.ambiguity[several], ours.ambiguity[several], atol=1e-3)


def test_marker_engines_agree_on_a_gap_and_a_restart(missions):
    """Spots from another place restart both; after ten minutes without an image both start anew beside the bank."""
    mission = missions["shipped"]
    first = simulate_flight(mission, SHORT, seed=3)
    other = simulate_flight(mission, replace(SHORT, start_m=(7.0, -0.3, 0.2)), seed=4)
    t = np.concatenate([first.t_s, first.t_s[-1] + 0.5 + other.t_s])
    t = np.concatenate([t, t[-1] + 600.0 + first.t_s])
    spots = np.concatenate([first.spots_px, other.spots_px, first.spots_px])
    push = np.concatenate([first.acceleration_m_s2, other.acceleration_m_s2, first.acceleration_m_s2])
    ours, theirs = both(mission, replace(first, t_s=t, spots_px=spots, acceleration_m_s2=push))
    apart(ours, theirs)
    assert np.count_nonzero(ours.status == EpochStatus.STARTED) == 3


def test_marker_engines_agree_on_a_late_start(missions):
    """The first spots come after 40 s, when the expected view is wider than the model states."""
    mission = missions["flat"]
    flight = simulate_flight(mission, MINUTE, seed=6)
    spots = flight.spots_px.copy()
    spots[:80] = np.nan
    state, covariance = apart(*both(mission, flight, spots_px=spots))
    assert max(state, covariance) < 4e-4


def test_marker_engines_agree_on_exchanged_markers(missions):
    mission = missions["shipped"]
    flight = simulate_flight(mission, SHORT, seed=2)
    spots = flight.spots_px.copy()
    spots[20:23] = spots[20:23, [1, 0, 2]]
    ours, theirs = both(mission, flight, spots_px=spots)
    apart(ours, theirs)
    assert (theirs.alarm[20:23] == Alarm.EXCHANGED | Alarm.UNWATCHED).all()


def test_the_pose_navigator_takes_the_engine(missions):
    """Handed a state, sigmas, attitudes and impulses, and copied on the way."""
    mission, rng = missions["everything"], np.random.default_rng(5)
    flight = simulate_flight(mission, SHORT, seed=1)
    navigators = [relnav.PoseNavigator(mission, engine=engine) for engine in ("compiled", "filterpy")]
    root = np.diag(np.repeat([0.05, 0.02, 0.01, 1e-3], 3))
    for navigator in navigators:
        navigator.start(-1.0, flight.motion[0], flight.dcm_lvlh_from_target[0], flight.rate_rad_s[0], root @ root)
    for k in range(20):
        said = {
            "delta_v_m_s": 1e-3 * rng.normal(size=3) if k % 5 == 0 else None,
            "dcm_chaser_from_lvlh": flight.dcm_chaser_from_lvlh[k],
            "spot_covariance_px2": np.array([[[0.02, 0.004], [0.004, 0.03]]] * 3),
            "attitude_noise_rad": 2e-4,
            "attitude_sigma_rad": 1e-3 if k < 5 else 5e-4,
        }
        ours, theirs = (n.step(flight.t_s[k], flight.spots_px[k], **said) for n in navigators)
        assert ours.status == theirs.status
        np.testing.assert_array_equal(ours.accepted, theirs.accepted)
        if k == 10:
            navigators[1] = pickle.loads(pickle.dumps(copy.deepcopy(navigators[1])))
    sigma = np.sqrt(np.diag(ours.covariance))
    assert np.max(np.abs(theirs.state - ours.state) / sigma[:6]) < 1e-5
    assert np.max(np.abs(theirs.covariance - ours.covariance) / np.outer(sigma, sigma)) < 1e-4
    np.testing.assert_allclose(theirs.docking.position_m, ours.docking.position_m, atol=1e-8)
    one, other = (navigator.hypotheses[0] for navigator in navigators)
    assert abs(one.score - other.score) < 1e-4
    assert np.max(np.abs(one.state.error_of(other.state)) / sigma) < 1e-4


def test_what_filterpy_does_not_do_for_markers(missions, tmp_path):
    mission = missions["shipped"]
    flight = simulate_flight(mission, replace(SHORT, duration_s=2.0), seed=1)
    navigator = relnav.PoseNavigator(mission, engine="filterpy")
    with pytest.raises(UsageError, match="takes no late images"):
        navigator.step(1.0, flight.spots_px[0], image_t_s=0.5)
    with pytest.raises(UsageError, match="forward alone"):
        both(mission, flight, smooth=True)
    with pytest.raises(ValueError, match="engine must be"):
        relnav.PoseNavigator(mission, engine="numpy")
    log = tmp_path / "log.csv"
    write_marker_log(flight, log)
    track = filter_log(log, mission, engine="filterpy")
    assert track.metadata["engine"] == "filterpy"
    assert track.status[1] == EpochStatus.STARTED
    with pytest.raises(UsageError, match="forward alone"):
        filter_log(log, mission, engine="filterpy", smooth=True)
