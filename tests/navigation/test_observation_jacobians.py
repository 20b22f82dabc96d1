"""Measurement rows and noise of every method against finite differences, lever arms and turned frames included."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.navigation.arguments import choose
from relnav.navigation.memory import views
from relnav.navigation.observation.beacon_geometry import locate
from relnav.navigation.observation.beacon_rows import observe, observe_again
from relnav.navigation.observation.measurement_matrices import rows_in_use

METHODS = ["spots", "spots, one beacon", "fix", "invariants", "pair AB", "pair BC", "pair AC"]
CORRELATED = [method for method in METHODS if not method.startswith("spots")]
LOST = {"spots, one beacon": [1], "pair AB": [2], "pair BC": [0], "pair AC": [1]}
STATE = np.array([7.0, 0.35, -0.4, -0.02, 0.01, 0.005])


def mission(model, method):
    known = method.startswith(("spots", "fix"))
    mount = tuple(Rotation.from_euler("zyx", [80.0, -20.0, 35.0], degrees=True).as_quat().tolist())
    dock = Rotation.from_euler("zyx", [4.0, -3.0, 170.0], degrees=True)
    cam = Rotation.from_quat([0.5, -0.5, -0.5, -0.5]) * Rotation.from_euler("zyx", [2.0, 1.0, 0.0], degrees=True)
    return replace(
        model,
        docking=replace(
            model.docking, q_dock_from_lvlh=tuple(dock.as_quat().tolist()), port_position_m=(0.4, -0.3, 0.25)
        ),
        camera=replace(
            model.camera, position_m=(0.6, 0.2, -0.35) if known else (0.0, 0.0, 0.0), q_cam_from_chaser=mount
        ),
        attitude=replace(
            model.attitude,
            mode="lvlh_hold" if known else "unknown",
            q_cam_from_lvlh=tuple((cam * dock.inv()).as_quat().tolist()) if known else model.attitude.q_cam_from_lvlh,
        ),
    )


@pytest.fixture(params=METHODS)
def prepared(request, vbar, look):
    """(memory, state, spots, number of rows, method): an image taken near the state, made ready at the state."""
    method = request.param
    model = mission(vbar, method)
    dock = model.dcm_dock_from_lvlh
    lever = model.dcm_cam_from_lvlh.T @ model.camera_lever_cam_m
    state = STATE.copy()
    state[:3] = model.port_position_m + dock.T @ STATE[:3] - lever
    held = None
    if model.attitude.mode == "unknown":  # any attitude that has the target in view
        held = (Rotation.from_quat([0.5, -0.5, -0.5, -0.5]).as_matrix() @ dock)[None]
    taken = np.add(state, [0.02, -0.01, 0.015, 0, 0, 0])
    wide = replace(model, sensor=replace(model.sensor, detector_size_m=(0.05, 0.05)))
    spots = look(wide, taken[None], seed=1, dcm=held)[0]
    assert np.isfinite(spots).all()
    spots[LOST.get(method, [])] = np.nan
    memory = views(choose(wide, "fix" if method == "fix" else "spots", "perspective", "compiled"))
    _, rows, status = observe_from(memory, state, spots)
    assert status == relnav.Status.OK
    assert rows == {"spots": 6, "spots, one beacon": 4, "fix": 3, "invariants": 3}.get(method, 1)
    return memory, state, spots, method


def observe_from(memory, state, spots):
    """`observe` with a prior of 1 mm: tight, so noise is that of the predicted geometry."""
    memory.track["state"] = state
    memory.track["ld"][:3, :3] = 1e-6 * np.eye(3)
    assert locate(memory, memory.track)
    return observe(memory, memory.track["state"], spots)


def residual_at(memory, x, spots):
    assert observe_again(memory, x, spots)
    return rows_in_use(memory)[1]


def test_rows_are_the_derivative_of_the_prediction(prepared):
    memory, state, spots, _ = prepared
    analytic = rows_in_use(memory)[0]
    numeric = np.empty_like(analytic)
    for j in range(6):
        h = 1e-4
        d = np.zeros(6)
        d[j] = h
        r = [residual_at(memory, state + k * d, spots) for k in (-2, -1, 1, 2)]
        numeric[:, j] = -(r[0] - 8 * r[1] + 8 * r[2] - r[3]) / (12 * h)
    scale = np.abs(analytic).max(axis=1, keepdims=True)
    np.testing.assert_allclose(numeric / scale, analytic / scale, rtol=0.0, atol=2e-9)
    np.testing.assert_array_equal(analytic[:, 3:], 0.0)


def test_residual_is_zero_where_the_image_was_taken(prepared, vbar, look):
    """With noise-free spots of the very state, measured equals predicted."""
    memory, state, spots, method = prepared
    model = mission(vbar, method)
    wide = replace(model, sensor=replace(model.sensor, detector_size_m=(0.05, 0.05)))
    held = None
    if model.attitude.mode == "unknown":
        held = (Rotation.from_quat([0.5, -0.5, -0.5, -0.5]).as_matrix() @ model.dcm_dock_from_lvlh)[None]
    exact = look(wide, state[None], dcm=held, noise_m=0.0)[0]
    exact[np.isnan(spots)] = np.nan
    observe_from(memory, state, exact)
    _, residual, r, _ = rows_in_use(memory)
    assert np.all(np.abs(residual) < 1e-6 * np.sqrt(np.diag(r)))


def test_noise_is_that_of_many_noisy_images(prepared):
    """R against the scatter of the residual over images that differ by spot noise alone, about the taken geometry."""
    memory, state, spots, _ = prepared
    stated = rows_in_use(memory)[2]
    rng = np.random.default_rng(0)
    residuals = []
    for _ in range(4000):
        observe_from(memory, state, spots + 1e-5 * rng.normal(size=(3, 2)))
        residuals.append(rows_in_use(memory)[1])
    scatter = np.atleast_2d(np.cov(np.array(residuals).T))
    scale = np.sqrt(np.outer(np.diag(stated), np.diag(stated)))
    np.testing.assert_allclose(scatter / scale, stated / scale, atol=0.1)


@pytest.mark.parametrize("prepared", CORRELATED, indirect=True)
def test_independent_rows_say_the_same(prepared):
    """L^-1 turns rows with covariance R into rows with a diagonal one, without loss: r^T S^-1 r is the same."""
    memory = prepared[0]
    h, r, noise, _ = rows_in_use(memory)
    p = np.diag([1e-2, 2e-2, 3e-2, 1e-3, 1e-3, 1e-3]) ** 2
    expected = r @ np.linalg.solve(h @ p @ h.T + noise, r)
    n = len(r)
    group = memory.groups[0]
    r, h, noise = group["residual"][:n], group["gradient"][:n], np.diag(group["variance"][:n])
    assert r @ np.linalg.solve(h @ p @ h.T + noise, r) == pytest.approx(expected, rel=1e-9)
