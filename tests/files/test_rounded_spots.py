"""Spots in steps of the detector that are above their stated noise."""

import numpy as np
import pytest

from relnav.files.rounded_spots import rounded, step_of


def spots(noise, moving=40.0, seed=1):
    """Of 300 images, um: they move, with noise."""
    rng = np.random.default_rng(seed)
    path = np.array([[-1500.0, 0.0], [1500.0, 3.0], [0.0, 7.0]]) + moving * np.linspace(0.0, 1.0, 300)[:, None, None]
    return path + noise * rng.normal(size=(300, 3, 2))


@pytest.mark.parametrize("step", [0.1, 2.5, 10.0])
@pytest.mark.parametrize("offset", [0.0, 0.37])
def test_a_step_is_found(step, offset):
    seen = np.round(spots(3.0 * step) / step) * step + offset
    seen[::7, 1] = np.nan
    assert step_of(seen) == pytest.approx(step, rel=1e-6)
    assert step_of(seen * 1e-6) == pytest.approx(step * 1e-6, rel=1e-6)


def test_no_step():
    assert step_of(spots(3.0)) == 0.0
    assert step_of(np.full((300, 3, 2), np.nan)) == 0.0
    assert step_of(np.tile(spots(0.0)[:1], (300, 1, 1))) == 0.0  # six numbers that never change
    assert step_of(np.round(spots(30.0)[:1] / 10.0) * 10.0) == 0.0  # too few


def test_what_is_said():
    seen = np.round(spots(1.0) / 10.0) * 10.0
    (note,) = rounded(1e-6 * seen, 3e-6, "um", 1e6)
    assert note.startswith("spots come in steps of 10 um, more than their stated noise of 3 um: while a spot stays")
    assert rounded(1e-6 * seen, 11e-6, "um", 1e6) == ()
