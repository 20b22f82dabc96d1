"""The covariance is honest: mean NEES over 6 is 1, and a wrong root is hardly ever taken for the right one."""

import dataclasses

import numpy as np
import pytest

from relnav.accuracy.three_marker_trials import pose_trials

RUNS = 700


@pytest.mark.parametrize("name", ["model", "five"])
@pytest.mark.parametrize("range_m", [1.5, 5.0, 15.0])
def test_mean_nees(request, name, range_m):
    """Band: 0.1 and, beyond that, what 700 runs leave (3 sigma of the mean is 0.065)."""
    trials = pose_trials(request.getfixturevalue(name), range_m, RUNS, 3)
    assert trials.ok.mean() > 0.99
    assert np.nanmean(trials.nees) / 6.0 == pytest.approx(1.0, abs=0.1)


def test_it_can_fail(model):
    """Spots with 1.5 times the noise that the model states."""
    assert np.nanmean(pose_trials(model, 5.0, 200, 3, noise=1.5).nees) / 6.0 > 1.8


def test_with_distortion(with_lens):
    assert np.nanmean(pose_trials(with_lens, 3.0, RUNS, 4).nees) / 6.0 == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("range_m", [1.0, 1.5, 3.0])
def test_a_flat_pattern_is_refused_rather_than_wrong(flat, range_m):
    """Roots 11 to 34 deg apart, pairs of them merging in noise: what is given is right, most is refused."""
    trials = pose_trials(flat, range_m, RUNS, 5)
    assert 0.02 < trials.ok.mean() < 0.9
    assert np.nanmax(trials.nees) < 60.0  # a wrong root has thousands
    assert np.nanmean(trials.nees) / 6.0 == pytest.approx(1.0, abs=0.1 + 3.0 * np.sqrt(2.0 / (6.0 * trials.ok.sum())))


def test_far_away_a_flat_pattern_gives_nothing(flat):
    trials = pose_trials(flat, 15.0, 100, 6)
    assert not trials.ok.any()


def test_a_wide_prior_makes_a_flat_pattern_ambiguous_close_in(flat):
    wide = dataclasses.replace(flat, view=dataclasses.replace(flat.view, attitude_sigma_rad=0.5))
    assert pose_trials(wide, 1.5, 100, 7).ok.mean() < 0.2


@pytest.mark.parametrize("range_m", [0.9, 1.5])
def test_a_raised_vertex_near_its_danger_cylinder(model, range_m):
    """Excluded as singular around 0.75 m: nothing given there is wrong."""
    R, h = 0.3, 0.3
    points = ((0.0, R * 0.75**0.5, 0.5 * R), (0.0, -R * 0.75**0.5, 0.5 * R), (h, 0.0, -R))
    wide = dataclasses.replace(model.camera, focal_length_px=(700.0, 700.0))
    vertex = dataclasses.replace(model, camera=wide, markers=dataclasses.replace(model.markers, positions_m=points))
    trials = pose_trials(vertex, range_m, 300, 8)
    assert np.nanmax(trials.nees) < 60.0
    assert np.nanmean(trials.nees) / 6.0 == pytest.approx(1.0, abs=0.2)
