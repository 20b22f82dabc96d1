"""Wrong use raises ValueError with the fix in its text, and the filter is afterwards as it was before."""

import dataclasses
import math

import numpy as np
import pytest

import relnav

SPOTS = np.array([[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]])
FIVE = ((0.0, 0.06, 0.0), (0.0, -0.06, 0.0))
TURN = np.eye(3)[[1, 0, 2]]  # a reflection

CALLS = {
    "shape of spots": ({"t_s": 9.0, "spots_m": SPOTS.T}, r"spots_m has shape \(3, 2\), rows A, B, C.*got \(2, 3\)"),
    "no spots": ({"t_s": 9.0, "spots_m": []}, r"spots_m has shape \(3, 2\).*got \(0,\)"),
    "same time": ({"t_s": 0.2, "spots_m": SPOTS}, r"t_s must be finite and after the last step's 0.2 s; got 0.2"),
    "time back": ({"t_s": 0.1, "spots_m": SPOTS}, r"after the last step's 0.2 s; got 0.1"),
    "no time": ({"t_s": math.nan, "spots_m": SPOTS}, "t_s must be finite.*got nan"),
    "endless time": ({"t_s": math.inf, "spots_m": SPOTS}, "t_s must be finite.*got inf"),
    "acceleration shape": (
        {"t_s": 9.0, "spots_m": SPOTS, "acceleration_m_s2": [1.0]},
        r"acceleration_m_s2 has shape \(3,\); got \(1,\)",
    ),
    "acceleration NaN": (
        {"t_s": 9.0, "spots_m": SPOTS, "acceleration_m_s2": [0.0, math.nan, 0.0]},
        r"acceleration_m_s2 must be finite; got \[0.0, nan, 0.0\]",
    ),
    "impulse shape": ({"t_s": 9.0, "spots_m": SPOTS, "delta_v_m_s": np.zeros((3, 1))}, r"delta_v_m_s has shape \(3,\)"),
    "impulse infinite": ({"t_s": 9.0, "spots_m": SPOTS, "delta_v_m_s": [math.inf, 0, 0]}, "delta_v_m_s must be finite"),
    "good acceleration, bad impulse": (
        {"t_s": 9.0, "spots_m": SPOTS, "acceleration_m_s2": [5.0, 5.0, 5.0], "delta_v_m_s": [math.nan, 0, 0]},
        "delta_v_m_s must be finite",
    ),
    "dcm shape": (
        {"t_s": 9.0, "spots_m": SPOTS, "dcm_cam_from_lvlh": np.eye(4)},
        r"dcm_cam_from_lvlh has shape \(3, 3\)",
    ),
    "dcm NaN": ({"t_s": 9.0, "spots_m": SPOTS, "dcm_cam_from_lvlh": np.full((3, 3), math.nan)}, "must be finite"),
    "dcm scaled": ({"t_s": 9.0, "spots_m": SPOTS, "dcm_cam_from_lvlh": 2 * np.eye(3)}, "must be a rotation matrix"),
    "dcm huge": ({"t_s": 9.0, "spots_m": SPOTS, "dcm_cam_from_lvlh": 1e200 * np.eye(3)}, "must be a rotation matrix"),
    "dcm reflected": ({"t_s": 9.0, "spots_m": SPOTS, "dcm_cam_from_lvlh": TURN}, r"orthonormal, determinant \+1"),
    "good control, bad dcm": (
        {"t_s": 9.0, "spots_m": SPOTS, "acceleration_m_s2": [5.0, 5.0, 5.0], "dcm_cam_from_lvlh": TURN},
        "must be a rotation matrix",
    ),
}


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("method", ["spots", "fix"])
def test_a_wrong_call_raises_and_changes_nothing(vbar, drift, look, name, method):
    arguments, text = CALLS[name]
    t = 0.1 * np.arange(10)
    spots = look(vbar, drift(vbar, t, [8.0, 0.1, -0.1, 0.0, 0.0, 0.0]))
    used, twin = relnav.Navigator(vbar, method), relnav.Navigator(vbar, method)
    for k in range(3):
        used.step(t[k], spots[k])
        twin.step(t[k], spots[k])
    with pytest.raises(ValueError, match=text):
        used.step(**arguments)
    for k in range(3, 10):
        record, expected = used.step(t[k], spots[k]), twin.step(t[k], spots[k])
        np.testing.assert_array_equal(record.state, expected.state)
        np.testing.assert_array_equal(record.covariance, expected.covariance)
        assert record.status == expected.status


def test_unknown_names_are_refused_with_the_known_ones(vbar):
    with pytest.raises(ValueError, match='method must be "spots" or "fix"; got \'spot\''):
        relnav.Navigator(vbar, "spot")
    with pytest.raises(ValueError, match='projection must be "perspective" or "parallel"; got \'central\''):
        relnav.Navigator(vbar, projection="central", method="spots")
    with pytest.raises(ValueError, match='method must be "spots" or "fix"'):
        relnav.filter_epochs(vbar, np.arange(2.0), np.zeros((2, 3, 2)), method="Fix")


BATCHES = {
    "times repeat": ({"t_s": [0.0, 1.0, 1.0]}, "t_s must be finite and strictly increasing"),
    "times go back": ({"t_s": [0.0, 1.0, 0.5]}, "strictly increasing"),
    "time NaN": ({"t_s": [0.0, math.nan, 2.0]}, "finite"),
    "times in two axes": ({"t_s": np.zeros((3, 1))}, "t_s has one axis"),
    "spots of other length": ({"spots_m": np.zeros((2, 3, 2))}, r"spots_m has shape \(3, 3, 2\); got \(2, 3, 2\)"),
    "acceleration": ({"acceleration_m_s2": np.zeros((2, 3))}, r"acceleration_m_s2 has shape \(3, 3\); got \(2, 3\)"),
    "impulse NaN": ({"delta_v_m_s": np.full((3, 3), math.nan)}, "delta_v_m_s must be finite"),
    "quaternion shape": ({"q_cam_from_lvlh": np.zeros((3, 3))}, r"q_cam_from_lvlh has shape \(3, 4\)"),
    "quaternion norm": ({"q_cam_from_lvlh": np.full((3, 4), 0.6)}, "q_cam_from_lvlh must hold unit quaternions"),
}


@pytest.mark.parametrize("name", BATCHES)
def test_wrong_batches_are_refused(vbar, name):
    changed, text = BATCHES[name]
    arguments = {"t_s": np.arange(3.0), "spots_m": np.tile(SPOTS, (3, 1, 1))} | changed
    with pytest.raises(ValueError, match=text):
        relnav.filter_epochs(vbar, **arguments)


def test_no_epochs_are_no_error(vbar):
    solution = relnav.filter_epochs(vbar, np.empty(0), np.empty((0, 3, 2)), method="spots")
    assert len(solution) == 0
    assert solution.state.shape == (0, 6)


def test_a_model_with_a_lever_arm_and_no_attitude_cannot_be_made(vbar):
    from dataclasses import replace

    with pytest.raises(ValueError, match=r"camera.position_m must be zero with attitude mode 'unknown'"):
        replace(
            vbar,
            attitude=replace(vbar.attitude, mode="unknown"),
            camera=replace(vbar.camera, position_m=(0.1, 0.0, 0.0)),
        )


@pytest.mark.parametrize("name", ["q_cam_from_lvlh", "q_cam_from_chaser", "q_dock_from_lvlh"])
def test_a_model_with_a_quaternion_that_is_none_cannot_be_made(vbar, name):
    from dataclasses import replace

    section = {"q_cam_from_lvlh": vbar.attitude, "q_cam_from_chaser": vbar.camera, "q_dock_from_lvlh": vbar.docking}
    with pytest.raises(ValueError, match=f"{name} is a unit quaternion.*its norm is 2"):
        replace(section[name], **{name: (2.0, 0.0, 0.0, 0.0)})


IMAGE = np.array([[-0.0015, 0.0], [0.0015, 0.0], [0.0, 0.0]])
REFUSED = {
    "a time that goes back": lambda n: n.step(0.1, IMAGE, spot_sigma_m=np.full((3, 2), 1e-8)),
    "a shape": lambda n: n.step(0.5, IMAGE[:2], acceleration_m_s2=[1e-3, 0.0, 0.0]),
    "complex spots": lambda n: n.step(0.5, IMAGE + 0.0j, dcm_cam_from_lvlh=np.eye(3)),
    "a date": lambda n: n.step(np.datetime64("2026-01-01"), IMAGE, delta_v_m_s=[1e-3, 0.0, 0.0]),
    "an infinite sigma": lambda n: n.step(0.5, IMAGE, spot_sigma_m=np.full((3, 2), np.inf)),
    "a sigma whose square is infinite": lambda n: n.step(0.5, IMAGE, spot_sigma_m=np.full((3, 2), 1e155)),
    "such a sigma of the attitude": lambda n: n.step(0.5, IMAGE, attitude_noise_rad=1e155),
    "no rotation": lambda n: n.step(0.5, IMAGE, spot_sigma_m=np.full((3, 2), 1e-8), dcm_cam_from_lvlh=np.ones((3, 3))),
    "a number beyond all floats": lambda n: n.step(10**400, IMAGE),
}


@pytest.mark.parametrize("engine", ["compiled", "filterpy"])
@pytest.mark.parametrize("call", REFUSED)
def test_a_refused_call_leaves_the_filter_as_it_was(vbar, call, engine):
    asked, other = (relnav.Navigator(vbar, engine=engine) for _ in range(2))
    for k in range(5):
        asked.step(0.1 * k, IMAGE)
        other.step(0.1 * k, IMAGE)
    with pytest.raises(ValueError, match=r"t_s|spot|dcm|attitude"):
        REFUSED[call](asked)
    after, never = asked.step(0.5, IMAGE), other.step(0.5, IMAGE)
    assert np.array_equal(after.state, never.state)
    assert np.array_equal(after.covariance, never.covariance)


@pytest.mark.parametrize("method", ["fix", "spots"])
def test_a_masked_spot_was_not_seen(vbar, method):
    """The value under the mask is not used."""
    masked, missing = (relnav.Navigator(vbar, method) for _ in range(2))
    hidden = np.ma.array(IMAGE + 1e-4, mask=[[False] * 2, [True] * 2, [False] * 2])
    for k in range(5):
        masked.step(0.1 * k, IMAGE)
        missing.step(0.1 * k, IMAGE)
    one = masked.step(0.5, hidden)
    other = missing.step(0.5, np.where(np.ma.getmaskarray(hidden), np.nan, IMAGE + 1e-4))
    assert one.status is other.status
    assert np.array_equal(one.state, other.state)
    track = relnav.filter_epochs(vbar, [0.0, 0.1], np.ma.array([IMAGE, IMAGE], mask=True), method=method)
    assert (track.measurement_status == int(relnav.Status.NOT_SEEN)).all()


def test_times_of_a_log_in_nanoseconds_are_refused(vbar):
    t = np.array(["2026-01-01T00:00:00", "2026-01-01T00:00:01"], dtype="datetime64[ns]")
    with pytest.raises(ValueError, match=r"t_s .*dates"):
        relnav.filter_epochs(vbar, t, np.stack([IMAGE, IMAGE]))
    with pytest.raises(ValueError, match=r"t_s .*spans of time"):
        relnav.filter_epochs(vbar, t - t[0], np.stack([IMAGE, IMAGE]))


def test_all_rows_of_five_beacons_are_named():
    model = relnav.load_model("three_beacon_psd")
    model = dataclasses.replace(model, sensor=dataclasses.replace(model.sensor, extra_beacons_m=FIVE))
    with pytest.raises(
        ValueError, match=r"spots_m has shape \(5, 2\), rows A, B, C, D, E, columns x, y in metres; got"
    ):
        relnav.Navigator(model, method="spots").step(0.0, SPOTS)
