"""The orbital frame's axes by what they mean, and an attitude carried into it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relnav.geometry.orbital_attitude import dcm_cam_from_lvlh, dcm_lvlh_from_inertial


def test_axes():
    """X along the velocity of a circular orbit, y against the angular momentum, z to the Earth's centre."""
    r, v = np.array([7000.0, 0.0, 0.0]), np.array([0.0, 7.5, 0.0])
    dcm = dcm_lvlh_from_inertial(r, v)
    np.testing.assert_allclose(dcm @ (v / 7.5), [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(dcm @ (-r / 7000.0), [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(dcm @ [0, 0, -1], [0, 1, 0], atol=1e-15)


def test_it_is_the_frame_of_relative_states():
    from relnav.geometry.frames import lvlh_ccsds_from_rsw, relative_state_rsw

    rng = np.random.default_rng(1)
    r, v = rng.normal(size=3) * 7e6, rng.normal(size=3) * 7e3
    offset = np.array([10.0, -20.0, 5.0])
    state = lvlh_ccsds_from_rsw(relative_state_rsw(r, v, r + offset, v))
    np.testing.assert_allclose(dcm_lvlh_from_inertial(r, v) @ offset, state[:3], atol=1e-8)


def test_an_attitude_in_it():
    rng = np.random.default_rng(2)
    star, mounting = Rotation.random(5, rng=rng).as_matrix(), Rotation.random(rng=rng).as_matrix()
    r, v = rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    dcm = dcm_cam_from_lvlh(star, r, v, mounting)
    for k in range(5):
        some = rng.normal(size=3)
        np.testing.assert_allclose(dcm[k] @ dcm_lvlh_from_inertial(r[k], v[k]) @ some, mounting @ star[k] @ some)
    np.testing.assert_allclose(dcm_cam_from_lvlh(star[0], r[0], v[0]), star[0] @ dcm_lvlh_from_inertial(r[0], v[0]).T)


@pytest.mark.parametrize(("r", "v"), [([1, 0, 0], [2, 0, 0]), ([1, 0, 0], [np.nan, 1, 0]), ([0, 0, 0], [1, 0, 0])])
def test_no_orbital_plane(r, v):
    with pytest.raises(ValueError, match="without an orbital plane"):
        dcm_lvlh_from_inertial(r, v)
