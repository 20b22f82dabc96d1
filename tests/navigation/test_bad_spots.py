"""Images in which something is wrong or missing: what is used, what is refused, what is reported."""

import numpy as np
import pytest

import relnav
from relnav.navigation.status import PARTIAL, PREDICTED, REJECTED, UPDATED
from relnav.sensors.measurement import Status

AT = 300


@pytest.fixture(scope="module")
def hold(vbar, drift, look):
    t = 0.1 * np.arange(AT + 1)
    truth = drift(vbar, t, [8.5, 0.2, -0.1, 0.0, 0.0, 0.0])
    return t, truth, look(vbar, truth, seed=2)


@pytest.fixture
def last(vbar, hold):
    """Filter the hold with its last image replaced: last(edit, method) -> (solution of all, its last epoch's index)."""
    t, _, spots = hold

    def run(edit, method="spots"):
        changed = spots.copy()
        edit(changed[AT])
        return relnav.filter_epochs(vbar, t, changed, method=method)

    return run


def lose(what, value=np.nan):
    def edit(image):
        image[what] = value

    return edit


def same_track(a, b):
    np.testing.assert_array_equal(a.state[AT], b.state[AT])
    np.testing.assert_array_equal(a.factor[AT], b.factor[AT])


@pytest.mark.parametrize("beacon", [0, 1, 2])
@pytest.mark.parametrize("shift", [[3e-4, 0.0], [0.0, -2e-4], [1e-3, 1e-3]])
def test_an_outlier_is_refused_alone(last, beacon, shift):
    def glint(image):
        image[beacon] += shift

    solution = last(glint)
    assert solution.status[AT] == PARTIAL
    assert not solution.accepted[AT]
    same_track(solution, last(lose(beacon)))


def test_nis_and_innovation_are_of_everything_seen(last):
    def glint(image):
        image[1] += [3e-4, 0.0]

    solution, clean = last(glint), last(lose([], 0.0))
    assert solution.dof[AT] == 6
    assert solution.nis[AT] > 100.0 + clean.nis[AT]
    difference = solution.innovation[AT] - clean.innovation[AT]
    np.testing.assert_allclose(difference, [0, 0, 3e-4, 0, 0, 0], atol=1e-15)


@pytest.mark.parametrize("method", ["spots", "fix"])
def test_a_rejected_epoch_keeps_its_nis_and_leaves_the_prediction(last, method):
    def shift(image):
        image[:, 0] += 5e-4 if method == "spots" else [5e-4, -5e-4, 0.0]

    solution = last(shift, method)
    assert solution.status[AT] == REJECTED
    assert solution.nis[AT] > 50.0
    assert solution.dof[AT] == (6 if method == "spots" else 3)
    assert np.isfinite(solution.innovation[AT, : solution.dof[AT]]).all()
    same_track(solution, last(lose(slice(None)), method))


@pytest.mark.parametrize("method", ["spots", "fix"])
def test_an_empty_image_leaves_the_prediction(last, method):
    solution = last(lose(slice(None)), method)
    assert solution.status[AT] == PREDICTED
    assert solution.dof[AT] == 0
    assert np.isnan(solution.nis[AT])
    assert np.isnan(solution.innovation[AT]).all()
    assert solution.measurement_status[AT] == Status.NOT_SEEN


@pytest.mark.parametrize("missing", [(0, 0), (1, 1), (2, 0)])
def test_one_missing_coordinate_drops_that_coordinate(last, missing):
    solution, without_beacon = last(lose(missing)), last(lose(missing[0]))
    assert solution.status[AT] == UPDATED
    assert solution.dof[AT] == 5
    assert np.isnan(solution.innovation[AT]).sum() == 1
    assert np.isnan(solution.innovation[AT].reshape(3, 2)[missing])
    assert np.isfinite(solution.state[AT]).all()
    assert np.trace(solution.covariance[AT]) < np.trace(without_beacon.covariance[AT])


@pytest.mark.parametrize(("seen", "dof"), [([0], 2), ([2], 2), ([0, 1], 4), ([1, 2], 4), ([0, 2], 4)])
def test_spots_work_with_one_or_two_beacons(last, seen, dof):
    solution = last(lose([i for i in range(3) if i not in seen]))
    assert solution.status[AT] == UPDATED
    assert solution.dof[AT] == dof
    predicted = last(lose(slice(None)))
    assert np.all(solution.sigma[AT, :3] <= predicted.sigma[AT, :3])


def test_fix_needs_all_three(last):
    solution = last(lose(2), "fix")
    assert solution.status[AT] == PREDICTED
    assert solution.measurement_status[AT] == Status.NOT_SEEN


@pytest.mark.parametrize("value", [np.inf, -np.inf, 1e308, -1e308, 1.0, 4.01e-3])
@pytest.mark.parametrize("method", ["spots", "fix"])
def test_a_spot_off_the_detector_is_refused(last, method, value):
    solution = last(lose((0, 1), value), method)
    assert solution.measurement_status[AT] == Status.OFF_DETECTOR
    if method == "spots":  # the whole beacon goes, its other coordinate cannot be right
        assert solution.status[AT] == PARTIAL
        same_track(solution, last(lose(0)))
    else:
        assert solution.status[AT] == REJECTED
        same_track(solution, last(lose(slice(None)), method))


@pytest.mark.parametrize("value", [0.0, 1e-3, np.inf, -1e308, 1e-320])
@pytest.mark.parametrize("method", ["spots", "fix"])
def test_all_spots_equal_are_refused(last, method, value):
    solution = last(lose(slice(None), value), method)
    assert solution.status[AT] == REJECTED
    same_track(solution, last(lose(slice(None)), method))


@pytest.mark.parametrize("method", ["spots", "fix"])
@pytest.mark.parametrize("value", [0.0, 1e-3, np.inf, 1e308])
def test_equal_spots_never_start_the_filter(vbar, method, value):
    solution = relnav.filter_epochs(vbar, np.arange(50.0), np.full((50, 3, 2), value), method=method)
    assert np.all(solution.status == relnav.EpochStatus.WAITING)
    assert np.isnan(solution.state).all()
    expected = Status.DEGENERATE if abs(value) < 4e-3 else Status.OFF_DETECTOR
    assert np.all(solution.measurement_status == expected)
