"""Spots in any order: the labelling found is the true one, or none is claimed."""

import numpy as np
import pytest

import relnav
from relnav.sensors.three_marker import measure, project


@pytest.mark.parametrize("largest_deg", [2.0, 5.0, 10.0])
def test_raised_layout(model, own, largest_deg):
    rng = np.random.default_rng(1)
    ok = 0
    for _ in range(40):
        dcm = model.view.dcm_cam_from_target @ own.tilt(rng, largest_deg)
        r = rng.uniform(1.5, 30.0)
        spots = project(model.markers.points_m @ dcm.T + [0.02 * r, -0.02 * r, r], model.camera).spots_px
        order = rng.permutation(3)
        noisy = spots[order] + 0.1 * rng.normal(size=(3, 2))
        result = measure(noisy, model, labelled=False)
        if result.ok:
            ok += 1
            assert result.labels == tuple(order.tolist())
            known = np.full((3, 2), np.nan)
            known[order] = noisy
            np.testing.assert_allclose(result.position_m, measure(known, model).position_m, rtol=1e-9, atol=1e-9)
    assert ok == 40


def test_five_markers_some_hidden_and_a_false_spot(five, own):
    rng = np.random.default_rng(2)
    for _ in range(6):
        dcm = five.view.dcm_cam_from_target @ own.tilt(rng, 5.0)
        spots = project(five.markers.points_m @ dcm.T + [0.1, -0.1, 5.0], five.camera).spots_px
        order = rng.permutation(5)[:4]
        shown = np.vstack([spots[order] + 0.1 * rng.normal(size=(4, 2)), [[100.0, 900.0]]])
        result = measure(shown, five, labelled=False)
        assert result.ok
        assert result.labels == (*order.tolist(), -1)


def test_a_turned_image_of_a_symmetric_pattern_is_not_claimed(flat):
    """Without knowing the roll, an equilateral triangle has three labellings that fit alike."""
    import dataclasses

    unknown = dataclasses.replace(flat, view=dataclasses.replace(flat.view, attitude_sigma_rad=np.pi))
    dcm = flat.view.dcm_cam_from_target
    spots = project(flat.markers.points_m @ dcm.T + [0.0, 0.0, 3.0], flat.camera).spots_px
    result = measure(spots, unknown, labelled=False)
    assert result.status is relnav.Status.OUTSIDE_DOMAIN
    assert len(result.roots) >= 3


def test_nothing_fits(model):
    result = measure(np.full((3, 2), 500.0), model, labelled=False)
    assert result.status is relnav.Status.NO_CONVERGENCE
    assert result.labels == (-1, -1, -1)
    assert measure(np.empty((0, 2)), model, labelled=False).status is relnav.Status.NOT_SEEN
