"""The patent as written: its equations hold, its roll does not.

The patent is "Birefringent sun sensor and its measurement of three-axis attitude" (Chinese patent).
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.accuracy.birefringent_sun import rank_with_beacon
from relnav.sensors.birefringent_sun.crystal import extraordinary_ray, extraordinary_wave, ordinary_wave
from relnav.sensors.birefringent_sun.observability import observability
from relnav.sensors.birefringent_sun.patent import patent_angles, patent_body_angles, refracted_rays
from relnav.sensors.birefringent_sun.spots import project


def test_equations_1_to_10_are_the_closed_form(crystals):
    """Restored as said, in the plane of incidence, for 300 crystals and angles: 1e-12."""
    rng = np.random.default_rng(5)
    for sensor in crystals(300):
        theta, n_o, n_e, c = 1.4 * rng.random(), sensor.ordinary_index, sensor.extraordinary_index, sensor.axis
        u = np.array([np.sin(theta), 0.0])
        ordinary, extra = refracted_rays(theta, sensor.axis_polar_rad, sensor.axis_azimuth_rad, n_o, n_e)
        o, e = ordinary_wave(u, n_o), extraordinary_ray(extraordinary_wave(u, c, n_o, n_e), c, n_o, n_e)
        np.testing.assert_allclose(ordinary, o / np.linalg.norm(o), atol=1e-14)
        np.testing.assert_allclose(extra, e / np.linalg.norm(e), atol=1e-12)


def test_phi_p_counts_from_the_plane_of_incidence(sensor):
    """Taken as a constant of the crystal for a sun at another azimuth, the extraordinary ray is degrees off."""
    theta, turn = 0.7, 1.2
    n_o, n_e = sensor.ordinary_index, sensor.extraordinary_index
    u = np.sin(theta) * np.array([np.cos(turn), np.sin(turn)])
    true = extraordinary_ray(extraordinary_wave(u, sensor.axis, n_o, n_e), sensor.axis, n_o, n_e)
    true /= np.linalg.norm(true)
    to_sensor = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    right = to_sensor @ refracted_rays(theta, sensor.axis_polar_rad, sensor.axis_azimuth_rad - turn, n_o, n_e)[1]
    wrong = to_sensor @ refracted_rays(theta, sensor.axis_polar_rad, sensor.axis_azimuth_rad, n_o, n_e)[1]
    np.testing.assert_allclose(right, true, atol=1e-12)
    assert np.degrees(np.arccos(wrong @ true)) > 1.0


def test_along_the_axis_there_is_no_walk_off():
    n_o, n_e = 1.6584, 1.4864
    theta = np.arcsin(n_o * np.sin(0.3))
    ordinary, extra = refracted_rays(theta, 0.3, 0.0, n_o, n_e)
    np.testing.assert_allclose(extra, ordinary, atol=1e-6)


def test_its_angles(sensor, cone):
    """(11), (12) by hand; pitch and yaw of the light are those of the sun."""
    for s in cone(55.0, 50):
        spots = project(sensor, s)
        angles = patent_angles(sensor, spots)
        (x_o, y_o), (x_e, y_e) = (spots - sensor.zero_spot_px) * sensor.pixel_pitch_m
        f = sensor.crystal_thickness_m
        assert (angles.theta_o_rad, angles.psi_o_rad) == pytest.approx((np.arctan(y_o / f), np.arctan(x_o / f)))
        assert (angles.theta_e_rad, angles.psi_e_rad) == pytest.approx((np.arctan(y_e / f), np.arctan(x_e / f)))
        assert angles.phi_m_rad == pytest.approx(np.angle(complex(x_e - x_o, y_e - y_o)))
        assert (angles.theta_m_rad, angles.psi_m_rad) == pytest.approx((np.arctan(s[1] / s[2]), np.arctan(s[0] / s[2])))


def test_a_turn_about_the_sun_line_changes_nothing(sensor, cone):
    """30 deg about the sun: the same image, the same three angles, whatever the patent says of its roll."""
    for s in cone(55.0, 20):
        turned = Rotation.from_rotvec(np.radians(30.0) * s).apply(s)
        np.testing.assert_allclose(
            patent_angles(sensor, project(sensor, turned / np.linalg.norm(turned))).triple_rad,
            patent_angles(sensor, project(sensor, s)).triple_rad,
            atol=1e-10,
        )


def test_the_triple_has_rank_two(sensor, cone, truth):
    """Phi_m is a function of the other two: two singular values, the third is rounding."""
    for s in cone(50.0, 20, seed=2):

        def triple(e, s=s):
            return patent_angles(sensor, project(sensor, Rotation.from_rotvec(e).apply(s))).triple_rad

        sizes = np.linalg.svd(truth.derivative(triple, np.zeros(3), 1e-3), compute_uv=False)
        assert sizes[1] > 0.1
        assert sizes[2] < 1e-7


def test_a_turn_about_the_boresight_is_not_phi_m(sensor):
    """A whole turn with the sun 30 deg off: phi_m swings to and fro and comes back without having turned once."""
    turns = np.linspace(0.0, 2.0 * np.pi, 721)
    s = np.stack(
        [np.sin(0.52) * np.cos(turns), np.sin(0.52) * np.sin(turns), np.full_like(turns, np.cos(0.52))], axis=1
    )
    phi = np.unwrap([patent_angles(sensor, project(sensor, v)).phi_m_rad for v in s])
    assert phi[-1] == pytest.approx(phi[0], abs=1e-9)
    assert np.degrees(np.ptp(phi)) == pytest.approx(58.0, abs=2.0)


def test_13_is_no_rotation(sensor, cone):
    """The literal product with a mounting of 90 deg gives other angles than the turned direction has."""
    s = cone(50.0, 1)[0]
    mounting = Rotation.from_euler("x", 40.0, degrees=True).as_matrix()
    angles = patent_angles(sensor, project(sensor, s))
    body = mounting @ s
    literal = patent_body_angles(angles, mounting)
    assert np.abs(np.degrees(literal[:2] - np.arctan2(body[[1, 0]], body[2]))).max() > 5.0
    np.testing.assert_array_equal(patent_body_angles(angles, np.eye(3)), angles.triple_rad)


def test_rank_two_always(crystals, cone):
    """1000 random crystals and directions (10000 in the command): rank 2, and the sun line is what is not seen."""
    for sensor, s in zip(crystals(1000, 3), cone(80.0, 1000, 3), strict=True):
        seen = observability(sensor, s)
        assert seen.rank == 2
        assert seen.singular_values[2] < 1e-8 * seen.singular_values[0]
        assert abs(seen.unseen_axis @ s) > 1.0 - 1e-8


def test_a_polarised_beacon_has_rank_three(sensor, cone):
    for s, psi in zip(cone(55.0, 20), np.linspace(0.1, 3.0, 20), strict=True):
        assert rank_with_beacon(sensor, s, psi) == 3


def test_wrong_use(sensor):
    with pytest.raises(ValueError, match=r"shape \(2, 2\), rows o, e; got \(2,\)"):
        patent_angles(sensor, [1.0, 2.0])
