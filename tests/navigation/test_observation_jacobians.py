"""Measurement rows and noise of every method against finite differences, lever arms and turned frames included."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.codegen.kernel import STRAIGHT_LINES, shapes_of
from relnav.codegen.trace import Trace
from relnav.geometry.spherical import range_azimuth_elevation_jacobian
from relnav.navigation.arguments import choose
from relnav.navigation.blocks import FIELD_ERRORS
from relnav.navigation.memory import views
from relnav.navigation.observation.beacon_geometry import locate, see_beacon
from relnav.navigation.observation.beacon_lasting_errors import errors_of_coordinates, errors_of_position
from relnav.navigation.observation.beacon_rows import observe, observe_again
from relnav.navigation.observation.measurement_matrices import rows_in_use
from relnav.sensors.three_beacon.fix import image_rays
from relnav.sensors.three_beacon.invariants import position_gradient, rays_from_position, spot_gradient

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
        tolerances=replace(model.tolerances, considered=True, distortion_limit_m=0.0),
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


# --- against derivatives derived of the measurement itself ------------------------------------------------------------


def derived_by_errors(derivatives, m, x, spots, method):
    """d(numbers)/d(position) of the rows in use, and what one sigma of each lasting error does to them, (k, m)."""
    dcm, lever = m.kept["mount"][:, :3].copy(), m.kept["mount"][:, 3].copy()
    dock, port = m.kept["dock"][:, :3].copy(), m.kept["dock"][:, 3].copy()
    f, sigma = float(m.sensor["focal_length"]), m.tolerances
    attitude, count = float(m.sensor["attitude_sigma"]), len(m.beacons)
    if method.startswith("spots"):
        seen = derivatives.derivative(derivatives.spot_of_light, "spot", "errors", at_zero=True, **derivatives.LIGHT)
        rows, effects, same = [], [], np.eye(3)
        for i in np.flatnonzero(np.isfinite(spots[:, 0])):
            place = m.beacons[i]["position"].copy()
            by = seen(same, dcm, same, place, x[:3].copy(), lever, np.full(2, f), np.zeros(5))
            by_place, own = by[:, 15:][:, :3] @ dock.T, np.zeros((2, count, 3))
            own[:, i] = sigma["beacon_placement"] * by_place
            by_turn = [by_place @ np.cross(axis, dock @ (place - port)) for axis in np.eye(3)]
            rows.append(by[:, :3])
            effects.append(
                np.hstack(
                    [
                        attitude * by[:, 6:9],
                        sigma["focal_length"] * by[:, 18:],
                        sigma["camera_mounting"] * by[:, 9:12],
                        sigma["beacon_mounting"] * np.transpose(by_turn),
                        own.reshape(2, -1),
                    ]
                )
            )
        return np.vstack(rows), np.vstack(effects)
    order = [i for i in range(3) if np.isfinite(spots[i, 0])] + [i for i in range(3) if not np.isfinite(spots[i, 0])]
    p, arm = dock @ (x[:3] + dcm.T @ lever - port), dock @ dcm.T @ lever
    places = np.array([dock @ (m.beacons[i]["position"] - port) for i in order])
    shapes = {"p": (3,), "arm": (3,), "places": (3, 3), "errors": (15,), "g": (3,)}
    none = np.zeros(15)
    by_p = derivatives.derivative(derivatives.rays_of_beacons, "g", "p", **shapes)(p, arm, places, none)
    by = derivatives.derivative(derivatives.rays_of_beacons, "g", "errors", at_zero=True, **shapes)(p, arm, places)
    if method == "fix":
        angles = derivatives.derivative(derivatives.angles_of_place, "rae", "p", p=(3,), rae=(3,))(p)
        by, by_p = angles @ np.linalg.solve(by_p, by), angles
    size = 1 if method.startswith("pair") else 3
    moved = np.zeros((3, count, 3))
    moved[:, order] = by[:, 6:].reshape(3, 3, 3)
    effects = [
        attitude * by[:, :3] @ dock @ dcm.T,
        sigma["focal_length"] * (m.fix["jacobian"] @ np.nan_to_num(spots).ravel())[:, None],
        np.zeros((3, 3)),
        sigma["beacon_mounting"] * by[:, 3:6],
        sigma["beacon_placement"] * moved.reshape(3, -1),
    ]
    return (by_p @ dock)[:size], np.hstack(effects)[:size]


def test_rows_and_lasting_errors_are_the_derived_ones(prepared, derivatives):
    """Of every method; what lasts in the detector's field is linear as it stands."""
    memory, state, spots, method = prepared
    rows, effects = derived_by_errors(derivatives, memory, state, spots, method)
    here = rows_in_use(memory)[0]
    np.testing.assert_allclose(here[:, :3], rows, rtol=1e-9, atol=1e-11 * np.abs(rows).max())
    if method.startswith("spots"):
        errors_of_coordinates(memory, state, spots)
        seen = np.flatnonzero(np.isfinite(spots[:, 0]))
        got = memory.by_error[np.stack([2 * seen, 2 * seen + 1], axis=1).ravel()]
    else:
        errors_of_position(memory, state, spots)
        size = len(rows)
        lower = np.tril(memory.fix["factor"][:size, :size], -1) + np.eye(size)
        got = lower @ memory.by_error[:size]
    got = got[:, FIELD_ERRORS:]
    assert got.shape == effects.shape
    for column, expected in zip(got.T, effects.T, strict=True):
        np.testing.assert_allclose(column, expected, rtol=1e-8, atol=1e-10 * np.abs(effects).max())


def test_by_hand_takes_fewer_operations(derivatives):
    """Why the rows of an image are written by hand; ARCHITECTURE.md has these figures."""
    derived, place = derivatives.derivative, {"p": (3,), "rae": (3,)}
    shapes = {"p": (3,), "arm": "000", "places": ("0*0", "0*0", "*00"), "errors": "0" * 15, "g": (3,)}
    for expected, by_hand, of_measurement in (
        ((35, 49), [see_beacon], derived(see_beacon, "residual", "x", **STRAIGHT_LINES[see_beacon])),
        ((29, 33), [range_azimuth_elevation_jacobian], derived(derivatives.angles_of_place, "rae", "p", **place)),
        (
            (145, 204),
            [rays_from_position, position_gradient],
            derived(derivatives.rays_of_beacons, "g", "p", **shapes),
        ),
        (
            (111, 162),
            [image_rays, spot_gradient],
            derived(derivatives.invariants_of_spots, "g", "spots", spots=(3, 2), g=(3,)),
        ),
    ):
        counts = [derivatives.operations(Trace(one, shapes_of(one, 0))) for one in by_hand]
        assert (sum(counts), of_measurement.operations) == expected
