"""Images of which some are refused and some are used, again and again: said (NOISY), where it is more than outliers.

The attitude is stated with an error that grows for a second and begins anew, as one that is stated once a second while
the craft turns. Beacons are flown by a matrix exponential and seen by the camera of `conftest.py`, which share nothing
with the filter.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import relnav
from relnav.navigation.status import PARTIAL, REJECTED

NOISY = int(relnav.Alarm.NOISY)
BEGINS_S, TOLD_S = 30.0, 20.0


@pytest.fixture(scope="module")
def seen(vbar, drift, look):
    """seen(seed, duration_s): times and spots of a craft that hardly moves, at 10 Hz."""

    def fly(seed, duration_s):
        t = 0.1 * np.arange(round(10.0 * duration_s))
        v = np.random.default_rng(seed).normal(0.0, 0.0003, 3)
        return t, look(vbar, drift(vbar, t, [8.0, 0.05, -0.04, *v]), seed=seed)

    return fly


def stepwise(t, dcm, rate_deg_s):
    """Attitudes that are off by what a turn adds until they are stated anew, every second, from a time on."""
    since = np.where(t >= BEGINS_S, np.mod(t, 1.0), 0.0)
    turn = Rotation.from_rotvec(np.radians(rate_deg_s) * since[:, None] * np.array([0.6, 0.8, 0.0]))
    return turn * Rotation.from_matrix(dcm)


def is_told(t, solution):
    """Whether NOISY is said soon after what was wrong began, not before, and nearly all the time from then on."""
    noisy = solution.alarm & NOISY > 0
    late = t > BEGINS_S + TOLD_S
    shown = np.isin(solution.status[t > BEGINS_S], (PARTIAL, REJECTED)).mean()
    assert 0.2 < shown < 0.95  # neither all nor nothing
    assert not solution.alarm[t < BEGINS_S].any()
    assert noisy[late].mean() > 0.9


@pytest.mark.parametrize("seed", range(2))
def test_spots_with_an_attitude_in_steps_are_told(vbar, seen, seed):
    t, spots = seen(seed, 90.0)
    stated = stepwise(t, vbar.dcm_cam_from_lvlh, 0.15).as_quat()
    is_told(t, relnav.filter_epochs(vbar, t, spots, q_cam_from_lvlh=stated, method="spots"))


@pytest.mark.parametrize("method", ["fix", "spots"])
def test_images_of_which_most_are_off_are_told(vbar, seen, method):
    """Three in four have two spots 0.3 mm off, each its own way."""
    t, spots = seen(3, 90.0)
    rng = np.random.default_rng(3)
    off = np.flatnonzero((t >= BEGINS_S) & (rng.uniform(size=len(t)) < 0.75))
    way = rng.uniform(0.0, 2.0 * np.pi, (len(off), 2))
    spots[off, 1:] += 3e-4 * np.stack([np.cos(way), np.sin(way)], axis=-1)
    is_told(t, relnav.filter_epochs(vbar, t, spots, method=method))


@pytest.mark.parametrize("outliers", [0.0, 0.02, 0.1])
@pytest.mark.parametrize("dark", [None, 2])
@pytest.mark.parametrize("method", ["fix", "spots"])
def test_outliers_of_one_in_ten_raise_nothing(vbar, seen, method, dark, outliers):
    """In 200 s each; a quarter of the images has one at 0.1.

    One beacon may be dark from 30 s on: all that is seen of it are glints, which `fix` refuses one and all.
    """
    t, spots = seen(5, 200.0)
    rng = np.random.default_rng(6)
    if dark is not None:
        spots[t >= BEGINS_S, dark] = np.nan
    glint = rng.uniform(size=spots.shape[:2]) < outliers
    spots[glint] = rng.uniform(-3e-3, 3e-3, (int(glint.sum()), 2))
    solution = relnav.filter_epochs(vbar, t, spots, method=method)
    whole = np.isfinite(spots).all(axis=(1, 2)) if method == "fix" else np.full(len(t), True)
    refused = np.isin(solution.status, (PARTIAL, REJECTED))
    assert refused.sum() == pytest.approx((glint.any(axis=1) & whole).sum(), abs=10)
    assert not (solution.alarm & NOISY).any()


def test_a_reflection_beside_one_beacon_is_refused_without_it(vbar, seen):
    """For 30 s in each image: the two others tell, and `returning.py` watches what becomes of it."""
    t, spots = seen(7, 90.0)
    spots[(t >= 40.0) & (t < 70.0), 2] += [5e-4, 2e-4]
    solution = relnav.filter_epochs(vbar, t, spots, method="spots")
    assert np.all(solution.status[(t >= 40.0) & (t < 70.0)] == PARTIAL)
    assert not (solution.alarm & NOISY).any()
