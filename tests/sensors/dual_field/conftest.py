"""The shipped star sensors, frames of theirs, and how far an attitude is off."""

import dataclasses

import numpy as np
import pytest

import relnav
from relnav.accuracy.dual_field_runs import calibrated
from relnav.geometry.rotation_vector import attitude_error
from relnav.sensors.dual_field.optics import plane_points, ray_sigma, rays
from relnav.sensors.dual_field.sensor import Fold


@pytest.fixture(scope="session")
def mounted_sensor():
    """As shipped: its mirror is known to 10 arcsec."""
    return relnav.load_model("dual_field_star")


@pytest.fixture(scope="session")
def sensor(mounted_sensor):
    """With its mirror known exactly: what noise alone does."""
    return calibrated(mounted_sensor)


@pytest.fixture(scope="session")
def turned_sensor(sensor):
    """The second field turned by two reflections instead of mirrored by one."""
    return dataclasses.replace(sensor, fold=Fold("rotation", error_rad=0.0))


@pytest.fixture(scope="session")
def single_sensor(sensor):
    return dataclasses.replace(sensor, fold=Fold("none"))


@pytest.fixture(scope="session")
def as_rays():
    """as_rays(frame, sensor) -> unit rays and their sigmas."""

    def convert(frame, sensor):
        camera = sensor.camera
        points = plane_points(frame.spots_px, camera.focal_length_px, camera.principal_point_px, camera.distortion)
        return rays(points), ray_sigma(points, camera.spot_noise_px, camera.focal_length_px)

    return convert


@pytest.fixture(scope="session")
def error_rad():
    """error_rad(solution, frame) -> small rotation from truth (3,); fails the test if it is not small."""

    def of(solution, frame):
        assert np.trace(solution.dcm_cam_from_icrs @ frame.dcm_cam_from_icrs.T) > 2.999, "a wrong attitude"
        return attitude_error(solution.dcm_cam_from_icrs, frame.dcm_cam_from_icrs)

    return of
