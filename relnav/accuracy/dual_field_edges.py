"""Frames at the edges through the star sensor: what the model says of fold, image, noise or axis does not hold.

Such a frame may be refused; none may be solved wrongly.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from relnav.accuracy.dual_field_blind import EPOCH_JYEAR, WIDTH_PX
from relnav.arrays import Matrix, Vector
from relnav.geometry.linear_algebra import cross_matrix
from relnav.geometry.rotation import dcm_from_quaternion
from relnav.geometry.rotation_vector import attitude_error
from relnav.sensors.dual_field.blind import Blind, solve_blind
from relnav.sensors.dual_field.measure import measure
from relnav.sensors.dual_field.optics import plane_points, project, rays
from relnav.sensors.dual_field.sensor import StarSensor
from relnav.sensors.dual_field.solution import StarSolution
from relnav.simulation.star_field import SkyConditions, StarFieldSimulator, random_attitude, random_velocity

FAR_NEES = 31.81
"""A chi^2 of three exceeds it as rarely as a normal variable 5 sigma: 5.7e-7."""

KINDS = ("turned", "turned", "turned", "turned", "mirrored", "mirrored", "noisy", "noisy", "as stated", "off axis")
"""One after the other, so that a tenth of a campaign is a tenth of every kind."""

LEAST_TURN_RAD, MOST_TURN_RAD = np.radians(1.0 / 3600.0), 0.5 * np.pi
NOISE_PX = (1.0, 3.0)
AXIS_OFF_PX = 10.0
FOCAL_PX = (1500.0, 2897.0, 5000.0)
FOCAL_ERROR = 0.03


def fly_edges(
    sensor: StarSensor, count: int, seed: int, *, progress: Callable[[int], None] | None = None
) -> dict[str, dict[str, float]]:
    """Solve `count` frames; for every kind: frames, solved, far (more than 5 sigma off), and NEES of those solved.

    turned: the detector with its lens is turned about the boresight by 1 arcsec to 90 deg (evenly in the logarithm,
    either sense), the mirror is not. mirrored: left and right exchanged. noisy: spots of 1 to 3 px, the model says
    0.07. as stated: nothing but the model's own errors. off axis: one field of a camera whose axis is 10 px beside the
    image's centre, solved with nothing known but a focal length that is up to 3 % wrong.
    """
    rng = np.random.default_rng(seed)
    result = {kind: {"frames": 0, "solved": 0, "far": 0, "nees": 0.0} for kind in dict.fromkeys(KINDS)}
    for k in range(count):
        kind = KINDS[k % len(KINDS)]
        solution, true = _off_axis(rng, sensor) if kind == "off axis" else _two_fields(rng, sensor, kind)
        row = result[kind]
        row["frames"] += 1
        if progress is not None:
            progress(1)
        if not solution.ok:
            continue
        error = attitude_error(solution.dcm_cam_from_icrs, true)
        nees = float(error @ np.linalg.solve(solution.covariance, error))
        row["solved"] += 1
        row["far"] += nees > FAR_NEES
        row["nees"] += nees
    for row in result.values():
        row["nees"] /= max(row["solved"], 1.0)
    return result


def _two_fields(rng: np.random.Generator, sensor: StarSensor, kind: str) -> tuple[StarSolution, Matrix]:
    real = sensor
    if kind == "noisy":
        real = dataclasses.replace(
            sensor, camera=dataclasses.replace(sensor.camera, spot_noise_px=rng.uniform(*NOISE_PX))
        )
    simulator = StarFieldSimulator(real, SkyConditions())
    simulator.mount(rng)
    if kind == "turned" and simulator.fold is not None:
        angle = np.exp(rng.uniform(np.log(LEAST_TURN_RAD), np.log(MOST_TURN_RAD))) * rng.choice([-1.0, 1.0])
        R = dcm_from_quaternion(np.array([0.0, 0.0, np.sin(0.5 * angle), np.cos(0.5 * angle)]))
        simulator.fold = R @ simulator.fold @ R.T
    frame = simulator.frame(rng, velocity_km_s=random_velocity(rng))
    spots = frame.spots_px * (-1.0, 1.0) if kind == "mirrored" else frame.spots_px
    solution = measure(spots, sensor, magnitude=frame.magnitude, velocity_km_s=frame.velocity_km_s)
    return solution, frame.dcm_cam_from_icrs


def _off_axis(rng: np.random.Generator, sensor: StarSensor) -> tuple[StarSolution, Matrix]:
    """A frame of a camera that nobody calibrated; its true attitude is of the axes through the image's centre."""
    focal, angle, size = rng.choice(FOCAL_PX), rng.uniform(0.0, 2.0 * np.pi), np.array([WIDTH_PX, 0.75 * WIDTH_PX])
    principal, distortion = AXIS_OFF_PX * np.array([np.cos(angle), np.sin(angle)]), (rng.uniform(-0.1, 0.1), 0.0)
    A, magnitude = random_attitude(rng), np.asarray(sensor.catalogue.hp_mag, dtype=np.float64)
    seen = sensor.catalogue.directions(EPOCH_JYEAR) @ A.T
    front = np.flatnonzero(seen[:, 2] > 0.8)
    spots, magnitude = project(seen[front], focal, principal, distortion), magnitude[front]
    inside = np.flatnonzero(np.all(np.abs(spots) < 0.5 * size, axis=1) & (rng.random(len(spots)) > 0.05))[:40]
    noise = rng.choice([0.1, 0.3, 1.0])
    spots = np.concatenate(
        [spots[inside] + noise * rng.normal(size=(len(inside), 2)), (rng.random((3, 2)) - 0.5) * size]
    )
    magnitude = magnitude[inside] + 0.2 * rng.normal(size=len(inside))
    magnitude = np.concatenate([magnitude, rng.uniform(3.0, 6.0, 3)])
    order = np.argsort(magnitude)
    given = focal * (1.0 + rng.uniform(-FOCAL_ERROR, FOCAL_ERROR))
    solution = solve_blind(Blind(spots[order], magnitude[order], given), sensor.catalogue, EPOCH_JYEAR)
    return solution, _about_centre(A, rays(plane_points(np.zeros((1, 2)), focal, principal, distortion))[0])


def _about_centre(dcm: Matrix, centre: Vector) -> Matrix:
    """The attitude turned the shortest way so that z looks where the ray (3,) through the image's centre does."""
    v = cross_matrix(np.cross(centre, (0.0, 0.0, 1.0)))
    onto_z: Matrix = np.eye(3) + v + v @ v / (1.0 + float(centre[2]))
    return onto_z @ dcm
