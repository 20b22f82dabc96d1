"""The public call: value, covariance, status, roots; bad data never raise, wrong use does."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.sensors.three_marker import Pose, measure, project


def view(model, own, rng, range_m, largest_deg=8.0):
    dcm = model.view.dcm_cam_from_target @ own.tilt(rng, rng.uniform(0.0, largest_deg))
    return dcm, np.array([*(0.05 * range_m * rng.uniform(-1.0, 1.0, 2)), range_m])


def spots_of(model, dcm, position):
    return project(model.markers.points_m @ dcm.T + position, model.camera).spots_px


@pytest.mark.parametrize("name", ["model", "five", "with_lens"])
@pytest.mark.parametrize("range_m", [1.5, 5.0, 30.0, 100.0])
def test_noise_free_spots_give_the_pose(request, own, name, range_m):
    model = request.getfixturevalue(name)
    rng = np.random.default_rng(1)
    for _ in range(10):
        dcm, position = view(model, own, rng, range_m)
        spots = spots_of(model, dcm, position)
        if name != "with_lens":
            np.testing.assert_allclose(spots, own.pinhole(model.markers.points_m, dcm, position, model.camera))
        result = measure(spots, model)
        assert result.ok
        assert own.attitude_error(result.dcm_cam_from_target, dcm) < 1e-8
        np.testing.assert_allclose(result.position_m, position, atol=1e-8 * range_m)
        assert result.misfit < 1e-9
        assert result.dof == 2 * len(spots) - 6
        assert result.labels == tuple(range(len(spots)))


def test_public_face(model):
    spots = spots_of(model, model.view.dcm_cam_from_target, np.array([0.0, 0.0, 5.0]))
    result = relnav.three_marker.measure(spots, relnav.load_model("three_marker_vision"))
    assert result.status is relnav.Status.OK
    assert result.pose.range_sigma_m > 0.0


def test_the_other_root_is_told(model):
    """The mirror image of the raised marker lies 90 deg away and does not disturb."""
    result = measure(spots_of(model, model.view.dcm_cam_from_target, np.array([0.0, 0.0, 5.0])), model)
    assert len(result.roots) == 2
    assert result.root_gap_rad == pytest.approx(np.radians(90.0), abs=np.radians(1.0))
    assert result.ambiguity > 100.0


def test_an_ambiguous_image_gives_no_value_but_its_roots(flat, own):
    """A flat pattern at 10 m: roots 3.4 deg apart, a prior of 5 deg cannot tell."""
    dcm, position = flat.view.dcm_cam_from_target, np.array([0.0, 0.0, 10.0])
    result = measure(spots_of(flat, dcm, position), flat)
    assert result.status is relnav.Status.OUTSIDE_DOMAIN
    assert np.isnan(result.position_m).all()
    assert np.isnan(result.covariance).all()
    assert len(result.roots) == 4
    assert min(own.attitude_error(root.pose.dcm_cam_from_target, dcm) for root in result.roots) < 1e-6
    assert result.root_gap_rad < np.radians(7.0)
    assert 0.0 <= result.ambiguity < 18.4


def test_a_tight_prior_tells_the_roots_apart(flat, own):
    """Well inside the danger cylinder, 0.3 m wide: the other roots lie some 10 deg away."""
    rng = np.random.default_rng(2)
    for _ in range(50):
        dcm, position = flat.view.dcm_cam_from_target @ own.tilt(rng, rng.uniform(0.0, 1.5)), np.array([0.0, 0.02, 3.0])
        prior = Pose(position, dcm @ own.tilt(rng, 0.5), np.diag([0.05**2] * 3 + [np.radians(0.5) ** 2] * 3))
        result = measure(spots_of(flat, dcm, position), flat, prior=prior)
        assert result.ok
        assert own.attitude_error(result.dcm_cam_from_target, dcm) < 1e-6


def test_three_of_five_are_enough(five, own):
    rng = np.random.default_rng(3)
    dcm, position = view(five, own, rng, 4.0)
    spots = spots_of(five, dcm, position)
    spots[[1, 3]] = np.nan
    result = measure(spots, five)
    assert result.ok
    assert result.labels == (0, -1, 2, -1, 4)
    assert own.attitude_error(result.dcm_cam_from_target, dcm) < 1e-8


@pytest.mark.parametrize("start_deg", [5.0, 20.0, 60.0])
def test_five_markers_need_no_prior(five, own, start_deg):
    wide = dataclasses.replace(five, view=dataclasses.replace(five.view, attitude_sigma_rad=np.pi))
    rng = np.random.default_rng(4)
    for _ in range(20):
        dcm = five.view.dcm_cam_from_target @ own.tilt(rng, start_deg)
        spots = spots_of(five, dcm, np.array([0.1, -0.1, 4.0]))
        result = measure(spots + 0.1 * rng.normal(size=spots.shape), wide)
        assert result.ok
        assert own.attitude_error(result.dcm_cam_from_target, dcm) < np.radians(1.0)


def test_a_marker_somewhere_else_is_noticed(five, own):
    rng = np.random.default_rng(5)
    spots = spots_of(five, *view(five, own, rng, 4.0))
    spots[2] += [3.0, -2.0]
    result = measure(spots, five)
    assert result.status is relnav.Status.NO_CONVERGENCE
    assert result.misfit > 100.0


@pytest.mark.parametrize(
    ("spots", "status"),
    [
        ([[np.nan, 0.0], [400.0, 400.0], [600.0, 400.0]], "NOT_SEEN"),
        ([[np.nan, np.nan]] * 3, "NOT_SEEN"),
        ([[-20.0, 400.0], [400.0, 400.0], [600.0, 400.0]], "OFF_DETECTOR"),
        ([[np.inf, 400.0], [400.0, 400.0], [600.0, 400.0]], "OFF_DETECTOR"),
        ([[500.0, 500.0]] * 3, "NO_CONVERGENCE"),
    ],
)
def test_bad_data_have_a_status(model, spots, status):
    result = measure(spots, model)
    assert result.status.name == status
    assert np.isnan(result.position_m).all()
    assert np.isnan(result.dcm_cam_from_target).all()
    assert np.isnan(result.covariance).all()
    assert not result.ok


def test_a_singular_view_has_no_covariance(model):
    """A vertex raised by 0.3 m is seen from its danger cylinder at 0.75 m; a wide field keeps it on the image."""
    R, h = 0.3, 0.3
    points = ((0.0, R * 0.75**0.5, 0.5 * R), (0.0, -R * 0.75**0.5, 0.5 * R), (h, 0.0, -R))
    wide = dataclasses.replace(model.camera, focal_length_px=(700.0, 700.0))
    near = dataclasses.replace(model, camera=wide, markers=dataclasses.replace(model.markers, positions_m=points))
    result = measure(spots_of(near, near.view.dcm_cam_from_target, np.array([0.0, 0.0, 0.75])), near)
    assert result.status in (relnav.Status.DEGENERATE, relnav.Status.OUTSIDE_DOMAIN)
    assert np.isnan(result.covariance).all()


def test_the_small_angle_method(model, own):
    """The value as published, biased by about 0.007 deg per square degree; the covariance is that of the noise."""
    dcm, position = model.view.dcm_cam_from_target @ own.tilt(np.random.default_rng(6), 5.0), np.array([0.1, 0.0, 4.0])
    spots = spots_of(model, dcm, position)
    published, exact = measure(spots, model, method="small_angle"), measure(spots, model)
    error = np.degrees(own.attitude_error(published.dcm_cam_from_target, dcm))
    assert 0.02 < error < 0.3
    np.testing.assert_allclose(np.diag(published.covariance), np.diag(exact.covariance), rtol=0.1)


def test_spot_covariances_are_used(model, own):
    rng = np.random.default_rng(7)
    spots = spots_of(model, *view(model, own, rng, 5.0))
    plain = measure(spots, model)
    doubled = measure(spots, model, spot_covariance_px2=np.tile(0.2**2 * np.eye(2), (3, 1, 1)))
    np.testing.assert_allclose(doubled.covariance, 4.0 * plain.covariance, rtol=1e-9)
    broken = np.tile(0.01 * np.eye(2), (3, 1, 1))
    broken[1] = [[1.0, 2.0], [2.0, 1.0]]
    assert measure(spots, model, spot_covariance_px2=broken).status is relnav.Status.NOT_SEEN


def test_seen_from_the_chaser(model, own):
    """Eq. (1b), by points: a marker is where the chaser sees it."""
    mount = Rotation.from_rotvec([0.3, 0.2, -0.5])
    camera = dataclasses.replace(
        model.camera, position_m=(0.5, -0.3, 0.2), q_cam_from_chaser=tuple(mount.as_quat().tolist())
    )
    rng = np.random.default_rng(8)
    result = measure(spots_of(model, *view(model, own, rng, 5.0)), model)
    chaser = result.pose.seen_from_chaser(camera)
    marker_cam = result.dcm_cam_from_target @ model.markers.points_m[0] + result.position_m
    marker_chaser = mount.as_matrix().T @ marker_cam + [0.5, -0.3, 0.2]
    np.testing.assert_allclose(
        chaser.dcm_cam_from_target @ model.markers.points_m[0] + chaser.position_m, marker_chaser, atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.eigvalsh(chaser.covariance), np.linalg.eigvalsh(result.covariance), rtol=1e-6)
    np.testing.assert_allclose(chaser.covariance[3:, 3:], result.covariance[3:, 3:], rtol=1e-12)
    np.testing.assert_allclose(
        result.pose.camera_in_target_m, -result.dcm_cam_from_target.T @ result.position_m, atol=1e-15
    )


def test_a_result_never_changes(model):
    result = measure(spots_of(model, model.view.dcm_cam_from_target, np.array([0.0, 0.0, 5.0])), model)
    with pytest.raises(ValueError, match="read-only"):
        result.position_m[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        measure(np.full((3, 2), np.nan), model).covariance[0, 0] = 1.0


def test_wrong_use(model):
    spots = spots_of(model, model.view.dcm_cam_from_target, np.array([0.0, 0.0, 5.0]))
    with pytest.raises(ValueError, match=r"spots_px has shape \(3, 2\), one row a marker.*; got \(4, 2\)"):
        measure(np.zeros((4, 2)), model)
    with pytest.raises(ValueError, match=r"spots_px has shape \(n, 2\)"):
        measure(np.zeros(6), model, labelled=False)
    with pytest.raises(ValueError, match=r"spot_covariance_px2 has shape \(3, 2, 2\), one a spot; got \(2, 2\)"):
        measure(spots, model, spot_covariance_px2=np.eye(2))
    with pytest.raises(ValueError, match='method must be "exact" or "small_angle"; got \'fast\''):
        measure(spots, model, method="fast")
    with pytest.raises(ValueError, match='method "small_angle" needs labelled spots'):
        measure(spots, model, method="small_angle", labelled=False)
    with pytest.raises(ValueError, match="prior is a finite pose"):
        measure(spots, model, prior=measure(np.full((3, 2), np.nan), model).pose)


def test_fuzz(model, five):
    """Random, clustered, repeated, missing and absurd spots: a status always, and a covariance that is positive."""
    rng = np.random.default_rng(9)
    for k in range(400):
        chosen = (model, five)[k % 2]
        n = len(chosen.markers.positions_m)
        spots = rng.uniform(-50.0, 1100.0, (n, 2))
        if k % 3 == 0:
            spots = 500.0 + 10.0 ** rng.uniform(-9, 2) * rng.normal(size=(n, 2))
        spots[rng.uniform(size=n) < 0.1] = rng.choice([np.nan, np.inf, -np.inf, 1e300])
        if k % 7 == 0:
            spots[0] = spots[-1]
        result = measure(spots, chosen, labelled=bool(k % 5) or n > 3)
        assert isinstance(result.status, relnav.Status)
        assert result.ok == bool(np.isfinite(result.position_m).all())
        if result.ok:
            assert np.linalg.eigvalsh(result.covariance)[0] > 0.0
            np.testing.assert_allclose(result.dcm_cam_from_target @ result.dcm_cam_from_target.T, np.eye(3), atol=1e-9)
