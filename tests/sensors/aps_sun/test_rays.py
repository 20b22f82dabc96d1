"""The ray trace against closed forms of its parts, its symmetries and its inverse."""

from dataclasses import replace

import numpy as np
import pytest

from relnav.sensors.aps_sun.rays import on_detector, pinhole_angles, project, project_jacobian, tangents_from_spots


def test_a_parallel_plate_has_its_closed_form(aligned):
    """Spot at rho = (h - t) tan th + t sin th / sqrt(n^2 - sin^2 th), wherever the plate lies."""
    sensor = aligned.sensor
    h, t, n = sensor.hole_height_m, sensor.glass_thickness_m, sensor.glass_index
    for theta in np.radians([0.0, 1.0, 30.0, 60.0, 75.0]):
        s = np.array([np.sin(theta) * 0.6, np.sin(theta) * 0.8, np.cos(theta)])
        rho = (h - t) * np.tan(theta) + t * np.sin(theta) / np.sqrt(n**2 - np.sin(theta) ** 2)
        for depth in (0.0, 0.8e-3):
            moved = replace(aligned, sensor=replace(sensor, glass_depth_m=depth))
            spot = (project(moved, s) - sensor.zero_spot_px) * sensor.pixel_pitch_m
            np.testing.assert_allclose(spot, [0.6 * rho, 0.8 * rho], atol=1e-15)


def test_the_paraxial_height_is_the_slope_on_axis(aligned):
    slope = project_jacobian(aligned, np.zeros(2)) * aligned.sensor.pixel_pitch_m
    np.testing.assert_allclose(slope, aligned.sensor.paraxial_height_m * np.eye(2), rtol=1e-8, atol=1e-12)


def test_a_concentric_dome_does_nothing(model, unit, grid):
    dome = replace(model.dome, centre_m=(0.0, 0.0, 0.0), wedge_m=(0.0, 0.0))
    s = unit(grid(9))
    without = replace(dome, thickness_m=0.0)
    np.testing.assert_allclose(
        project(replace(model, dome=dome), s), project(replace(model, dome=without), s), atol=1e-10
    )


@pytest.mark.parametrize("theta_deg", [0.0, 25.0, 60.0])
def test_a_shifted_dome_turns_a_ray_by_its_closed_form(aligned, theta_deg):
    """Concentric spheres, impact parameter b: asin(b/R1) - asin(b/(n R1)) + asin(b/(n R2)) - asin(b/R2)."""
    R1, thickness, n, b = 16e-3, 2e-3, 1.4585, 0.6e-3
    R2 = R1 - thickness
    theta = np.radians(theta_deg)
    inside = np.array([np.sin(theta), 0.0, np.cos(theta)])
    across = np.array([np.cos(theta), 0.0, -np.sin(theta)])
    turned = np.arcsin(b / R1) - np.arcsin(b / (n * R1)) + np.arcsin(b / (n * R2)) - np.arcsin(b / R2)
    assert abs(np.degrees(turned)) > 0.09
    # a ray that leaves the hole along `inside` passes the centre, at +b across, at distance b; it bends away from it
    outside = np.cos(turned) * inside + np.sin(turned) * across
    dome = replace(
        aligned.dome, radius_m=R1, thickness_m=thickness, index=n, centre_m=tuple(b * across), wedge_m=(0.0, 0.0)
    )
    np.testing.assert_allclose(project(replace(aligned, dome=dome), outside), project(aligned, inside), atol=1e-7)


def test_a_tilted_detector_by_hand(aligned):
    """No glass: intersection of the ray with the tilted plane, in the plane's own axes."""
    tilt = 0.1
    sensor = replace(aligned.sensor, glass_thickness_m=0.0, detector_tilt_rad=(tilt, 0.0), pixel_pitch_m=1e-6)
    theta = 0.5
    # plane through (0, h): its x axis is (cos tilt, -sin tilt); solve s lambda = (0, h) + u (cos tilt, -sin tilt)
    h = sensor.hole_height_m
    _, u = np.linalg.solve([[np.sin(theta), -np.cos(tilt)], [np.cos(theta), np.sin(tilt)]], [0.0, h])
    spot = project(replace(aligned, sensor=sensor), [np.sin(theta), 0.0, np.cos(theta)]) - sensor.zero_spot_px
    np.testing.assert_allclose(spot, [u / 1e-6, 0.0], atol=1e-9)


def test_rotations_turn_the_spot_and_the_sun(aligned, unit):
    """Rotation kappa turns the pixel axes; a rotation about z of the whole sensor turns the spot the other way."""
    s = unit([[20.0, -35.0]])[0]
    plain = project(aligned, s) - aligned.sensor.zero_spot_px
    angle = 0.05
    c, n = np.cos(angle), np.sin(angle)
    turned = replace(aligned, sensor=replace(aligned.sensor, detector_rotation_rad=angle))
    np.testing.assert_allclose(project(turned, s) - aligned.sensor.zero_spot_px, [[c, n], [-n, c]] @ plain, atol=1e-9)
    twisted = replace(aligned, sensor=replace(aligned.sensor, misalignment_rad=(0.0, 0.0, angle)))
    np.testing.assert_allclose(project(twisted, s) - aligned.sensor.zero_spot_px, [[c, -n], [n, c]] @ plain, atol=1e-9)


def test_there_and_back(model, unit, grid):
    """Over the field and 10 deg more, to 1e-11."""
    angles = 70.0 / 60.0 * grid(15)
    spots = project(model, unit(angles))
    np.testing.assert_allclose(tangents_from_spots(model, spots), np.tan(np.radians(angles)), atol=1e-11)


def test_what_is_to_be_compensated(model, unit, grid):
    """The patent's 5 deg: here 7.7, from the cover glass; dome and assembly alone 0.2."""
    angles = grid(25)
    error = np.degrees(pinhole_angles(model, project(model, unit(angles)))) - angles
    assert 7.0 < np.abs(error).max() < 8.5
    bare = replace(model, sensor=replace(model.sensor, glass_thickness_m=0.0))
    error = np.degrees(pinhole_angles(bare, project(bare, unit(angles)))) - angles
    assert 0.1 < np.abs(error).max() < 0.7


def test_no_light_from_below_and_spots_off_the_detector(model):
    spots = project(model, [[0.0, 0.0, 1.0], [0.6, 0.0, -0.8], [0.96, 0.0, -0.28]])
    assert np.isfinite(spots[0]).all()
    assert np.isnan(spots[1:]).all()
    np.testing.assert_array_equal(
        on_detector(model, np.array([[0.0, 0.0], [-0.6, 5.0], [1023.4, 0.0], [0.0, 1024.0]])), [1, 0, 1, 0]
    )
    assert np.isnan(tangents_from_spots(model, [1e6, 0.0])).all()


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda m: project(m, [1.0, 0.0]), r"3 components in its last axis; got shape \(2,\)"),
        (lambda m: project(m, [0.0, 0.0, 1.1]), "unit vectors"),
        (lambda m: tangents_from_spots(m, [1.0, 2.0, 3.0]), r"2 coordinates .* got shape \(3,\)"),
    ],
)
def test_wrong_use(model, call, text):
    with pytest.raises(ValueError, match=text):
        call(model)


def test_impossible_sensors(model):
    with pytest.raises(ValueError, match="must end above the detector"):
        replace(model.sensor, glass_depth_m=2e-3)
    with pytest.raises(ValueError, match="must lie inside the dome"):
        replace(model.dome, centre_m=(0.0, 0.0, 15e-3))
