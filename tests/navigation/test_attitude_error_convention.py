"""One attitude error everywhere: theta in the axes of the body b, dcm_a_from_b_true = dcm_a_from_b exp([theta x]).

Truth is written here with scipy's rotations and a pinhole of its own. Every Jacobian by an attitude error is compared
with central differences of the model that the true attitude gives; a sign or a frame taken otherwise fails. Covariances
do not know the sign of theta alone: their joint blocks with position do, and the axes that they stand in.
"""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.accuracy.sensitivity import sensitivity
from relnav.dynamics.rigid_body import RigidBody
from relnav.estimation.attitude import ATTITUDE_TRACK, CHASER, COMPARED, LASTING, compare_attitude
from relnav.estimation.factored import factorize
from relnav.geometry.rotation_vector import attitude_error
from relnav.geometry.wahba import solve_wahba
from relnav.navigation.attitude.prediction import take_if_near
from relnav.navigation.attitude.target_attitude import METHODS, TargetAttitude
from relnav.navigation.pose_state import PoseState, state_from_pose
from relnav.sensors.dual_field.camera_fit import _Camera
from relnav.sensors.dual_field.matching import turn
from relnav.sensors.dual_field.optics import project
from relnav.sensors.sun_attitude import attitude_from_sun_and_vector
from relnav.sensors.sun_direction import attitude_observation, direction_with_covariance
from relnav.sensors.three_marker import Pose, measure, spot_jacobians

ZERO = np.zeros(3)
THETA = np.array([2e-3, -1e-3, 3e-3])
EPS = 1e-4
SMALL = 1e-6
"""1-sigma, rad, of which the second order in the covariance of a port is nothing."""


def true_dcm(dcm_b_from_a, theta):
    """The true attitude of b where the estimated one is off by theta: exp(-[theta x]) dcm."""
    return Rotation.from_rotvec(-np.asarray(theta)).as_matrix() @ dcm_b_from_a


def error_of(dcm_b_from_a, dcm_b_from_a_true):
    """Theta of an estimate: dcm_a_from_b^T dcm_a_from_b_true = exp([theta x])."""
    return Rotation.from_matrix(dcm_b_from_a @ dcm_b_from_a_true.T).as_rotvec()


def directions(rng, n):
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def assert_close(got, expected, share=1e-6):
    np.testing.assert_allclose(got, expected, rtol=0.0, atol=share * np.abs(expected).max())


# --- the marker camera ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def mission():
    """The vision mission with the camera off the centre of mass and turned in the chaser."""
    model = relnav.load_model("three_marker_vision")
    mount = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_quat()
    camera = dataclasses.replace(model.camera, position_m=(0.4, -0.2, 0.6), q_cam_from_chaser=tuple(mount.tolist()))
    chaser = dataclasses.replace(model.chaser, port_position_m=(0.2, -0.1, 0.9), attitude_sigma_rad=0.0)
    return dataclasses.replace(model, camera=camera, chaser=chaser)


@pytest.fixture(scope="module")
def scene(mission):
    """dcm_chaser_from_lvlh, dcm_target_from_lvlh, and rho (3,) m."""
    chaser = true_dcm(mission.dcm_chaser_from_lvlh, [0.02, -0.03, 0.01])
    return chaser, Rotation.from_rotvec([0.05, -0.08, 0.1]).as_matrix().T, np.array([6.0, 0.3, -0.2])


@pytest.fixture(scope="module")
def spots(mission, scene):
    """spots(drho, target=, chaser=, camera=) -> true spots (2 n,) px where the three attitudes are off by theta."""
    camera, (dcm_chaser, dcm_target, rho) = mission.camera, scene

    def of(drho=ZERO, *, target=ZERO, chaser=ZERO, camera_turn=ZERO):
        in_lvlh = mission.markers.points_m @ true_dcm(dcm_target, target) - (rho + drho)
        in_chaser = in_lvlh @ true_dcm(dcm_chaser, chaser).T
        mount = true_dcm(camera.dcm_cam_from_chaser, camera_turn)
        x, y, z = ((in_chaser - np.array(camera.position_m)) @ mount.T).T
        (fx, fy), (cx, cy) = camera.focal_length_px, camera.principal_point_px
        return np.stack([fx * x / z + cx, fy * y / z + cy], axis=-1).ravel()

    return of


@pytest.fixture(scope="module")
def seen(mission, scene):
    """The pose (4, 3) that the camera sees."""
    dcm_chaser, dcm_target, rho = scene
    camera = mission.camera
    position = camera.dcm_cam_from_chaser @ (-dcm_chaser @ rho - np.array(camera.position_m))
    return np.vstack([camera.dcm_cam_from_chaser @ dcm_chaser @ dcm_target.T, position])


@pytest.mark.parametrize(
    ("name", "argument"), [("attitude", "target"), ("mounting", "camera_turn"), ("chaser_attitude", "chaser")]
)
def test_marker_jacobians(mission, seen, spots, truth, name, argument):
    assert not any(mission.camera.distortion)
    jacobian = getattr(spot_jacobians(mission.markers.points_m, seen, mission.camera), name)
    expected = truth.derivative(lambda theta: spots(**{argument: theta}), ZERO, EPS)
    assert_close(jacobian.reshape(-1, 3), expected)


@pytest.fixture(scope="module")
def image_jacobian(mission, scene, spots, truth):
    """By (position in camera axes, theta of the target), (2 n, 6), by differences."""
    back = -(mission.camera.dcm_cam_from_chaser @ scene[0]).T  # drho of a position error in camera axes
    by_position = truth.derivative(lambda dr: spots(back @ dr), ZERO, EPS)
    return np.hstack([by_position, truth.derivative(lambda theta: spots(target=theta), ZERO, EPS)])


def test_covariance_of_a_measured_pose(mission, seen, spots, image_jacobian):
    """Its joint block of position and attitude has the sign of theta."""
    result = measure(spots().reshape(-1, 2), mission, prior=Pose(seen[3], seen[:3], 1e-2 * np.eye(6)))
    assert result.ok
    assert_close(result.dcm_cam_from_target, seen[:3], 1e-9)
    expected = mission.camera.spot_noise_px**2 * np.linalg.inv(image_jacobian.T @ image_jacobian)
    assert_close(result.covariance, expected, 1e-5)
    assert np.abs(expected[:3, 3:]).max() > 0.1 * np.sqrt(expected[:3, :3].max() * expected[3:, 3:].max())


def test_a_measured_pose_follows_the_spots(mission, seen, spots):
    """Spots of a target that is off by theta: the new estimate is off the old one by theta."""
    result = measure(spots(target=THETA).reshape(-1, 2), mission, prior=Pose(seen[3], seen[:3], 1e-2 * np.eye(6)))
    np.testing.assert_allclose(error_of(seen[:3].T, result.dcm_cam_from_target.T), THETA, atol=1e-9)


# --- the pose filter --------------------------------------------------------------------------------------------------


def pose_state(scene, covariance, drho=ZERO, theta=ZERO):
    _, dcm_target, rho = scene
    motion = np.concatenate([rho + drho, [-0.05, 0.01, 0.02]])
    return PoseState(motion, true_dcm(dcm_target, theta).T, np.array([0.01, -0.02, 0.015]), covariance)


def test_rows_of_the_pose_filter(mission, scene, spots, truth, marker_image):
    state = pose_state(scene, 1e-12 * np.eye(12))
    rows = marker_image(state, spots().reshape(-1, 2), mission, scene[0]).rows
    assert_close(rows[:, :3], truth.derivative(spots, ZERO, EPS))
    assert_close(rows[:, 6:9], truth.derivative(lambda theta: spots(target=theta), ZERO, EPS))


def test_errors_and_corrections_of_a_pose_state(scene):
    state, true = pose_state(scene, np.eye(12)), pose_state(scene, np.eye(12), theta=THETA)
    np.testing.assert_allclose(state.error_of(true)[6:9], THETA, atol=1e-12)
    corrected = state.moved(np.concatenate([np.zeros(6), THETA, ZERO]), state.covariance)
    np.testing.assert_allclose(corrected.dcm_lvlh_from_target, true.dcm_lvlh_from_target, atol=1e-12)


def docking_error(estimate, true):
    turned = error_of(estimate.dcm_target_from_chaser, true.dcm_target_from_chaser)
    moved = [getattr(true, name) - getattr(estimate, name) for name in ("position_m", "velocity_m_s", "rate_rad_s")]
    return np.concatenate([*moved[:2], turned, moved[2]])


def believed(mission, sigma_rad):
    """The mission with this 1-sigma of the chaser's attitude, none of it new at every image."""
    chaser = dataclasses.replace(mission.chaser, attitude_sigma_rad=sigma_rad, attitude_noise_rad=0.0)
    return dataclasses.replace(mission, chaser=chaser)


def test_docking_covariance_by_the_attitude_of_the_target(mission, scene, truth, docking_of):
    mission, covariance = believed(mission, 0.0), np.zeros((12, 12))
    covariance[6:9, 6:9] = SMALL**2 * np.diag([1.0, 2.0, 3.0])
    own = np.array([0.003, -0.004, 0.002])
    estimate = docking_of(pose_state(scene, covariance), mission, scene[0], own)
    by_theta = truth.derivative(
        lambda theta: docking_error(
            estimate, docking_of(pose_state(scene, covariance, theta=theta), mission, scene[0], own)
        ),
        ZERO,
        EPS,
    )
    assert_close(estimate.covariance / SMALL**2, by_theta @ np.diag([1.0, 2.0, 3.0]) @ by_theta.T)


def test_docking_covariance_by_the_attitude_of_the_chaser(mission, scene, truth, docking_of):
    mission = believed(mission, SMALL)
    state, own = pose_state(scene, np.zeros((12, 12))), np.array([0.003, -0.004, 0.002])
    estimate = docking_of(state, mission, scene[0], own)
    by_alpha = truth.derivative(
        lambda alpha: docking_error(estimate, docking_of(state, mission, true_dcm(scene[0], alpha), own)), ZERO, EPS
    )
    assert_close(estimate.covariance / SMALL**2, by_alpha @ by_alpha.T)


def test_a_start_by_the_attitudes_of_target_and_chaser(mission, scene, seen, truth):
    """Position and attitude of the state by the pose's theta; its joint block has the sign of the chaser's."""
    pick = [0, 1, 2, 6, 7, 8]

    def started(theta=ZERO, alpha=ZERO, covariance=0.0, sigma=0.0):
        one = dataclasses.replace(mission, chaser=dataclasses.replace(mission.chaser, attitude_noise_rad=sigma))
        pose = Pose(seen[3], true_dcm(seen[:3].T, theta).T, covariance * np.diag([0.0, 0.0, 0.0, 1.0, 2.0, 3.0]))
        return state_from_pose(pose, one, true_dcm(scene[0], alpha), t_s=0.0)

    plain = started()

    def off(**errors):
        other = started(**errors)
        theta = error_of(plain.dcm_lvlh_from_target.T, other.dcm_lvlh_from_target.T)
        return np.concatenate([other.motion[:3] - plain.motion[:3], theta])

    by_theta = truth.derivative(lambda theta: off(theta=theta), ZERO, EPS)
    by_alpha = truth.derivative(lambda alpha: off(alpha=alpha), ZERO, EPS)
    of_pose, of_chaser = (one.covariance[np.ix_(pick, pick)] for one in (started(covariance=1.0), started(sigma=1.0)))
    assert_close(of_pose, by_theta @ np.diag([1.0, 2.0, 3.0]) @ by_theta.T)
    assert_close(of_chaser, by_alpha @ by_alpha.T)


# --- the target's attitude alone --------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_innovation_and_correction_of_the_target_attitude(method):
    """A measurement that is off by theta is the innovation theta; it counts as much as each of the start's two."""
    dcm = Rotation.from_rotvec([0.2, -0.1, 0.3]).as_matrix()
    measured = true_dcm(dcm.T, THETA).T
    settings = {"rate_noise_density_rad2_s3": 0.0, "initial_rate_sigma_rad_s": 1e-3, "method": method}
    target, noise = TargetAttitude(np.diag([3.0, 4.0, 5.0]), 1e-3, **settings), 1e-4 * np.eye(3)
    for _ in range(2):
        target.step(0.0, dcm, noise)
    record = target.step(0.0, measured, noise)
    np.testing.assert_allclose(record.innovation_rad, THETA, atol=1e-12)
    np.testing.assert_allclose(error_of(dcm.T, record.dcm_lvlh_from_target.T), THETA / 3.0, atol=1e-6)


def test_what_lasts_turns_a_measured_attitude(truth):
    """A true chaser attitude off by alpha turns the measured attitude by what the filter's B says: -C_TB alpha."""
    chaser = Rotation.from_rotvec([0.4, -0.7, 0.2]).as_matrix()
    dcm = Rotation.from_rotvec([0.2, -0.1, 0.3]).as_matrix()

    def measured_error(alpha):
        seen = true_dcm(chaser, alpha) @ dcm  # what the vision sees of the true target, dcm
        return error_of(dcm.T, (chaser.T @ seen).T)

    settings = {"rate_noise_density_rad2_s3": 0.0, "initial_rate_sigma_rad_s": 1e-3, "chaser_attitude_sigma_rad": 1.0}
    target = TargetAttitude(np.diag([3.0, 4.0, 5.0]), 1e-3, **settings)
    target.memory["track"]["dcm"] = dcm
    take_if_near(target.memory, False, dcm, np.eye(3), chaser, 0.0)
    assert_close(target.memory[0]["by_lasting"][:, CHASER], truth.derivative(measured_error, ZERO, EPS))


def test_rate_learnt_from_a_turned_measurement():
    """With theta' = dw a target found turned forward by theta after dt turns faster, not slower."""
    dcm, covariance = np.eye(3), np.eye(6)
    covariance[:3, 3:] = covariance[3:, :3] = 0.5 * np.eye(3)
    track, out = np.zeros(1, ATTITUDE_TRACK)[0], np.zeros(1, COMPARED)[0]
    track["dcm"], track["ld"] = dcm, factorize(covariance)
    compare_attitude(track, true_dcm(dcm, THETA).T, np.eye(3), np.zeros((3, LASTING)), out, np.zeros((14, 6))[:, :3])
    np.testing.assert_allclose(out["track"]["rate"], 0.25 * THETA, atol=1e-12)


def test_transition_of_the_rigid_body(truth):
    body, dcm, rate = RigidBody(np.diag([3.0, 4.0, 5.0]), 1e-3), np.eye(3), np.array([0.02, -0.01, 0.03])
    end, _, phi, _ = body.propagate_with_errors(dcm, rate, 5.0, 0.0)
    expected = truth.derivative(
        lambda theta: error_of(end.T, body.propagate(true_dcm(dcm.T, theta).T, rate, 5.0)[0].T), ZERO, EPS
    )
    np.testing.assert_allclose(phi[:3, :3], expected, atol=1e-4)
    assert np.abs(expected - expected.T).max() > 0.1


# --- sun, stars, directions -------------------------------------------------------------------------------------------


def test_sun_observation(truth):
    rng = np.random.default_rng(1)
    for _ in range(5):
        estimated, sun = Rotation.random(rng=rng).as_matrix(), directions(rng, 1)[0]

        def innovation(theta, estimated=estimated, sun=sun):
            seen = direction_with_covariance(true_dcm(estimated, theta) @ sun, np.zeros((3, 3)))
            return attitude_observation(seen, sun, estimated).innovation

        jacobian = attitude_observation(
            direction_with_covariance(estimated @ sun, np.zeros((3, 3))), sun, estimated
        ).jacobian
        assert_close(jacobian, truth.derivative(innovation, ZERO, EPS))


def curvature(cost):
    """Half the second derivative (3, 3) of a cost of theta, by differences."""
    step, eye = 1e-3, np.eye(3)
    ends = [[[cost(step * (p * a + q * b)) for p, q in ((1, 1), (1, -1), (-1, 1), (-1, -1))] for b in eye] for a in eye]
    return np.array([[(e[0] - e[1] - e[2] + e[3]) / (8.0 * step**2) for e in row] for row in ends])


def test_attitude_from_the_sun_and_a_star():
    """The estimate is where the misfit is least, and the covariance is that of theta in body axes."""
    rng, sigmas = np.random.default_rng(2), (3e-4, 1e-4)
    true, known = Rotation.random(rng=rng).as_matrix(), directions(rng, 2)
    seen = known @ true.T + 1e-4 * rng.normal(size=(2, 3))
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    both = [direction_with_covariance(s.copy(), sigma**2 * np.eye(3)) for s, sigma in zip(seen, sigmas, strict=True)]
    dcm, covariance = attitude_from_sun_and_vector(*both, *known)

    def cost(theta):
        apart = seen - known @ true_dcm(dcm, theta).T
        return float(np.sum(np.sum(apart**2, axis=1) / np.square(sigmas)))

    slopes = [(cost(1e-5 * axis) - cost(-1e-5 * axis)) / 2e-5 for axis in np.eye(3)]
    assert np.abs(np.sqrt(np.diag(covariance)) * slopes).max() < 1e-3
    assert_close(covariance, np.linalg.inv(curvature(cost)), 1e-3)


def test_wahba():
    """Known directions seen from a frame that is off by theta: the new estimate is off the old one by theta."""
    rng = np.random.default_rng(3)
    estimated, v = Rotation.random(rng=rng).as_matrix(), directions(rng, 4)
    sigma = np.array([1e-4, 2e-4, 3e-4, 1e-4])
    solution = solve_wahba(v @ true_dcm(estimated, THETA).T, v, sigma)
    np.testing.assert_allclose(attitude_error(estimated, solution.dcm), THETA, atol=1e-12)

    def cost(theta):
        apart = v @ solution.dcm.T - v @ true_dcm(solution.dcm, theta).T
        return float(np.sum(np.sum(apart**2, axis=1) / sigma**2))

    assert_close(solution.covariance, np.linalg.inv(curvature(cost)), 1e-5)


def test_a_star_camera_is_turned_to_the_truth():
    """The turn of the search, and one step of the fit from an attitude that is off by theta."""
    rng = np.random.default_rng(4)
    estimated = Rotation.random(rng=rng).as_matrix()
    true = true_dcm(estimated, THETA)
    moved = estimated.copy()
    turn(moved, *THETA)
    np.testing.assert_allclose(error_of(moved, true), 0.0, atol=np.linalg.norm(THETA) ** 3)
    rays = np.column_stack([rng.uniform(-0.2, 0.2, (30, 2)), np.ones(30)])
    stars = rays / np.linalg.norm(rays, axis=1, keepdims=True) @ true
    spots, variance = project(stars @ true.T, 4000.0), (0.1 / 4000.0) ** 2
    camera = _Camera(spots, True, estimated.copy(), np.array([4000.0, 0.0, 0.0, 0.0, 0.0]), variance)
    camera.improve(np.arange(30), stars, 4)
    assert np.linalg.norm(error_of(camera.dcm, true)) < 0.02 * np.linalg.norm(THETA)


def test_covariance_of_a_star_frame():
    """A covariance in camera axes: the stars of two fields tell the camera's axes apart."""
    from relnav.simulation.star_field import SkyConditions, StarFieldSimulator

    shipped = relnav.load_model("dual_field_star")
    exact = dataclasses.replace(shipped.fold, error_rad=0.0)
    sensor = dataclasses.replace(shipped, fold=exact)  # the noise of the spots alone
    frame = StarFieldSimulator(sensor, SkyConditions(false_spots=0, missing=0.0)).frame(np.random.default_rng(5))
    solution = relnav.dual_field.measure(
        frame.spots_px, sensor, magnitude=frame.magnitude, velocity_km_s=frame.velocity_km_s
    )
    assert solution.ok
    rays = np.column_stack([frame.spots_px / sensor.camera.focal_length_px, np.ones(len(frame.spots_px))])
    rays = (rays / np.linalg.norm(rays, axis=1, keepdims=True))[solution.hip > 0]
    field = solution.field[solution.hip > 0]
    stars = np.where(field[:, None] == 1, rays @ sensor.fold.matrix.T, rays) @ solution.dcm_cam_from_icrs
    sigma = sensor.camera.spot_noise_px / sensor.camera.focal_length_px

    def cost(theta):
        apart = stars @ (true_dcm(solution.dcm_cam_from_icrs, theta) - solution.dcm_cam_from_icrs).T
        return float(np.sum(apart**2)) / sigma**2

    expected = np.linalg.inv(curvature(cost))
    assert_close(solution.covariance, expected, 0.05)  # the distortion and the edge of the field are left out here
    in_icrs = solution.dcm_cam_from_icrs.T @ expected @ solution.dcm_cam_from_icrs
    assert np.abs(in_icrs - expected).max() > 0.2 * np.abs(expected).max()
    e = error_of(solution.dcm_cam_from_icrs, frame.dcm_cam_from_icrs)
    assert e @ np.linalg.solve(solution.covariance, e) < 30.0


# --- beacons ----------------------------------------------------------------------------------------------------------


def test_spots_of_beacons_by_a_turn_of_the_camera(make_model, truth):
    model, place = make_model(), np.array([5.0, 0.2, -0.1])
    at = sensitivity(model, place)
    dcm, beacons, f = model.dcm_cam_from_lvlh @ model.dcm_dock_from_lvlh.T, model.sensor.beacons_dock_m, truth.f
    by_turn = truth.derivative(lambda theta: truth.central(place, true_dcm(dcm, theta), f, beacons), ZERO, EPS)
    assert_close(at.by_camera_turn, by_turn)
